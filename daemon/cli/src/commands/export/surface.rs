//! Gratings as anisotropic metal, the nearest material of formats without diffraction.
//!
//! The roughness is increased along the grating vector, across the grooves, as of brushed metal. Its GGX slope α is
//! the slope of a facet that reflects normal incidence into the first order of [`WAVELENGTH_NM`]. The highlight is then
//! as wide as the first order is far from the mirror direction. It has no colours.

use super::maps;
use nacre_base::{Error, Result};
use nacre_brdf::Reflectance;
use nacre_image::{encode_png8, read_exr, read_exr_header};
use std::path::{Path, PathBuf};

/// Wavelength of the first order in nm: the middle of visible light.
const WAVELENGTH_NM: f64 = 550.0;
/// Period in µm where none is measured: that of a compact disc.
const ASSUMED_PERIOD_UM: f64 = 1.6;
/// GGX slope α along the grooves, and where no grating was measured. No measurement states it; 0.01 is polished metal.
pub const ALPHA_ALONG: f64 = 0.01;
/// Wavelengths in nm at which the reflectance gives red, green and blue: the dominant ones of the sRGB primaries.
const RGB_NM: [f64; 3] = [611.0, 549.0, 464.0];
/// Longest side of a texture that all graphics cards of the last ten years read.
const MAX_TEXTURE: usize = 8192;
/// File name of the texture.
pub const TEXTURE: &str = "anisotropy.png";

/// An anisotropic metal, with its texture and its losses.
pub struct Surface {
    /// Width and height of the sample in mm.
    pub size_mm: [f64; 2],
    /// PNG of direction (red and green: cos θ and sin θ from -1 to 1) and strength (blue: 0 to 1), all linear.
    pub texture: Vec<u8>,
    /// Median of α across the grooves, over the measured pixels.
    pub alpha_across: f64,
    /// Linear RGB reflectance at normal incidence.
    pub reflectance: [f64; 3],
    /// Properties of the sample that the material lacks, and assumptions.
    pub lost: Vec<String>,
    /// Problems for viewers.
    pub warnings: Vec<String>,
}

/// Maps of one sample.
struct Maps {
    width: usize,
    height: usize,
    orientation: Vec<f32>,
    period: Option<Vec<f32>>,
    sigma: Option<Vec<f32>>,
    mask: Option<Vec<f32>>,
    pitch_um: Option<f64>,
}

impl Surface {
    /// Reads a result, or a single map, with an orientation; `material` is that of the metal (default: aluminium).
    pub fn read(input: &Path, material: Option<&Reflectance>) -> Result<Self> {
        let maps = Maps::read(input)?;
        let mut pixels = Vec::with_capacity(3 * maps.orientation.len());
        let (mut across, mut sigmas, mut periods) = (vec![], vec![], vec![]);
        for k in 0..maps.orientation.len() {
            let (theta, alpha, weight) = maps.lobe(k);
            let strength = weight * ((alpha - ALPHA_ALONG) / (1.0 - ALPHA_ALONG)).max(0.0).sqrt();
            pixels.extend(
                [theta.cos() / 2.0 + 0.5, theta.sin() / 2.0 + 0.5, strength].map(|v| (v * 255.0).round() as u8),
            );
            if weight > 0.0 {
                across.push(alpha);
                sigmas.extend(maps.sigma.as_ref().map(|s| f64::from(s[k]).to_degrees()).filter(|s| s.is_finite()));
                periods.extend(maps.period.as_ref().map(|p| f64::from(p[k])).filter(|p| p.is_finite()));
            }
        }
        if across.is_empty() {
            return Err(Error::file(input, "has no pixel with an orientation", "give a result with some"));
        }
        let texture =
            encode_png8(maps.width, maps.height, 3, &pixels).map_err(|e| Error::output(Path::new(TEXTURE), e))?;
        let masked = 1.0 - across.len() as f64 / maps.orientation.len() as f64;
        let pitch_um = maps.pitch_um.unwrap_or(1e6 / maps.width.max(maps.height) as f64);
        let metal = material.cloned().map_or_else(|| "aluminium".parse(), Ok);
        let metal = metal.map_err(|e: String| Error::input("--material", e, "choose another"))?;
        let mut surface = Self {
            size_mm: [maps.width, maps.height].map(|pixels| pixels as f64 * pitch_um / 1e3),
            texture,
            alpha_across: median(&mut across),
            reflectance: RGB_NM.map(|nm| metal.at(1.0, nm)),
            lost: losses(masked, &mut periods, &mut sigmas),
            warnings: vec![],
        };
        if maps.pitch_um.is_none() {
            surface.lost.push("Size: the maps state no pixel_um, so the longer side is 1 m.".into());
        }
        if material.is_none() {
            surface
                .lost
                .push("Metal: the maps state none, so the reflectance is that of aluminium (--material).".into());
        }
        if maps.width.max(maps.height) > MAX_TEXTURE {
            let size = format!(
                "the texture has {} x {} pixels, and some viewers read only {MAX_TEXTURE}",
                maps.width, maps.height
            );
            surface.warnings.push(format!("{size}: `nacre map edit --resample` makes smaller maps"));
        }
        Ok(surface)
    }
}

/// Statement of losses and assumptions.
fn losses(masked: f64, periods: &mut [f64], sigmas: &mut [f64]) -> Vec<String> {
    let mut lost = vec![
        "Colours: these formats have no diffraction. Orders become one white highlight across the grooves. Thin-film \
         iridescence is left out, since its colour does not depend on the direction of the grooves."
            .into(),
        "Efficiencies: the highlight decreases steadily from the mirror direction; real orders are separate.".into(),
        "Roughness along the grooves: not measured; α = 0.01 is assumed.".into(),
        "Directions: 8 bits, within 0.32°; θ and θ + 180° are the same, so the texture must not be interpolated."
            .into(),
        "Offset: as in the map. Without a calibrated offset, one unknown angle is added to all directions.".into(),
    ];
    lost.push(if periods.is_empty() {
        format!("Period: not measured (µm); the width of the highlight is that of {ASSUMED_PERIOD_UM} µm everywhere.")
    } else {
        let median = median(periods);
        let of = format!("median {median:.3} µm, {ASSUMED_PERIOD_UM} µm where not measured");
        format!("Period: only as width of the highlight, at {WAVELENGTH_NM} nm ({of}).")
    });
    if !sigmas.is_empty() {
        let median = median(sigmas);
        lost.push(format!("Uncertainty: σ (median {median:.2}°) only weakens the strength, by exp(-2σ²)."));
    }
    if masked > 0.0 {
        lost.push(format!(
            "Mask: {:.1} % of the pixels carry no orientation; they are a plain mirror.",
            100.0 * masked
        ));
    }
    lost
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

impl Maps {
    fn read(input: &Path) -> Result<Self> {
        let remedy = "give a result with an orientation, or its orientation.exr";
        let path =
            with_channel(input, "orientation")?.ok_or_else(|| Error::file(input, "has no orientation", remedy))?;
        let header = read_exr_header(&path)?;
        let mut map = read_exr(&path)?;
        let orientation = map.take("orientation", &path)?;
        let period = match map.channels.remove("period") {
            Some(period) => Some((period, header)),
            None => match with_channel(input, "period")? {
                Some(path) => Some((read_exr(&path)?.take("period", &path)?, read_exr_header(&path)?)),
                None => None,
            },
        };
        if period.as_ref().is_some_and(|(_, h)| (h.width, h.height) != (map.width, map.height)) {
            let remedy = "resample or crop one with `nacre map edit`";
            return Err(Error::file(input, "has maps of orientation and period of different sizes", remedy));
        }
        // Relative periods have no unit of length.
        let period = period.filter(|(_, h)| !maps::unit(h, "period").contains("relative")).map(|(period, _)| period);
        Ok(Self {
            width: map.width,
            height: map.height,
            orientation,
            period,
            sigma: map.channels.remove("sigma"),
            mask: map.channels.remove("mask"),
            pitch_um: map.attributes.get("pixel_um").and_then(|text| text.parse().ok()).filter(|p| *p > 0.0),
        })
    }

    /// Angle of the grating vector, slope α across the grooves, and certainty of the angle, which is 0 where masked.
    fn lobe(&self, k: usize) -> (f64, f64, f64) {
        let theta = f64::from(self.orientation[k]);
        if !theta.is_finite() || self.mask.as_ref().is_some_and(|mask| mask[k] < 0.5) {
            return (0.0, ALPHA_ALONG, 0.0);
        }
        let sigma = self.sigma.as_ref().map_or(0.0, |sigma| f64::from(sigma[k]));
        let certainty = if sigma.is_finite() { (-2.0 * sigma * sigma).exp() } else { 1.0 };
        let period = self.period.as_ref().map(|period| f64::from(period[k])).filter(|p| *p > 0.0);
        (theta, alpha(period.unwrap_or(ASSUMED_PERIOD_UM)), certainty)
    }
}

/// Slope of a facet that reflects normal incidence into the first order: tan(β/2) with sin β = λ/a.
fn alpha(period_um: f64) -> f64 {
    ((WAVELENGTH_NM / 1e3 / period_um).min(1.0).asin() / 2.0).tan().max(ALPHA_ALONG)
}

/// Path of the first map with this channel.
fn with_channel(input: &Path, channel: &str) -> Result<Option<PathBuf>> {
    let mut paths = maps::listed(input)?;
    // `period.exr` is named after its channel, and other maps may repeat it.
    paths.sort_by_key(|path| path.file_stem().is_none_or(|stem| stem != channel));
    for path in paths {
        if read_exr_header(&path)?.channels.iter().any(|c| c == channel) {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_facet_of_slope_alpha_reflects_into_the_first_order() {
        for period in [0.6, 1.0, 1.6, 4.0] {
            let order = (2.0 * alpha(period).atan()).sin();
            assert!((order - 0.55 / period).abs() < 1e-12, "{period}: {order}");
        }
        assert_eq!((alpha(0.3), alpha(1e6)), (alpha(0.55), ALPHA_ALONG));
    }
}
