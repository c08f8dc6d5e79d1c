//! Computation of a lookup table in memory.

use super::choose::{Choice, check, choose, given};
use super::kernel::{Kernel, Weight, Window};
use super::light::{Light, LightReport};
use super::photograph::Photograph;
use super::plane::Plane;
use super::rays::Fineness;
use super::settings::{MethodChoice, Settings, Wavelength};
use super::sharpness::between_pixels;
use super::table::{Grid, Method, Source};
use nacre_base::{Error, Result};
use nacre_image::lobe::{Lobe, find, not_found, require};
use nacre_optics::color::Illuminant;

/// Maximum distance in pixels between a given zero order and the lobe it is compared with.
const NEAR_PX: f64 = 20.0;

/// Coverage below which an entry counts as unknown.
pub(super) const UNKNOWN: f32 = 0.01;

/// Maximum number of attempts at the requested error.
const TRIES: usize = 3;

/// A lookup table.
pub struct Table {
    /// X, Y, Z and coverage of each entry, row by row from the top; normalised so that a photograph of 1 everywhere
    /// gives Y = 1 for exponent 0.
    pub entries: Vec<[f32; 4]>,
    /// Position of the zero order in pixels from the left and the top.
    pub center: [f64; 2],
    /// Standard deviation of `center` in pixels; `None` for a given position without a lobe nearby.
    pub center_sigma_px: Option<f64>,
    /// Position of the lobe near a given zero order, if it differs.
    pub lobe: Option<[f64; 2]>,
    /// A second lobe nearly as bright as the detected zero order: position and relative brightness.
    pub rival: Option<([f64; 2], f64)>,
    /// True if the zero order is saturated.
    pub saturated: bool,
    /// Summation method.
    pub choice: Choice,
    /// Root mean square error of entries against a finer sum, relative to their root mean square; `None` without light
    /// at the rim.
    pub error: Option<f64>,
    /// Interpolation error of the photograph between its pixels, including noise; a table's is about half of it.
    pub sampling_error: Option<f64>,
    /// Error due to the uncertainty of the zero order's position, defined as [`Self::error`].
    pub center_error: Option<f64>,
    /// Properties of an extended source.
    pub light: Option<LightReport>,
    /// Half vector per pixel.
    pub scale: f64,
    /// Largest component of the half vector.
    pub extent: f64,
}

impl Table {
    /// Root sum of squares of all known errors at the rim; `None` without light there.
    pub fn whole_error(&self) -> Option<f64> {
        let light = self.light.and_then(|l| l.error);
        let others = [self.center_error, self.sampling_error, light].map(|e| e.unwrap_or(0.0));
        self.error.map(|e| others.iter().fold(e, |sum, other| sum.hypot(*other)))
    }

    /// Convolves the table with an extended source. The table must not be warped.
    ///
    /// # Errors
    /// `Input` for a source wider than the table.
    pub fn spread(&mut self, light: &Light) -> Result<()> {
        let size = self.entries.len().isqrt();
        let y: Vec<f32> = self.entries.iter().map(|e| if e[3] < UNKNOWN { f32::NAN } else { e[1] }).collect();
        let middle = [0.5 * (size as f64 - 1.0); 2];
        let error = between_pixels(&Photograph { light: y, width: size, height: size }, middle);
        light.spread(&mut self.entries, size, 2.0 * self.extent / size as f64)?;
        self.light = Some(light.report(error));
        Ok(())
    }
}

/// Computes a table from one photograph in narrow-band light, or from three channels (red, green, blue) in white light.
///
/// # Errors
/// `Input` for invalid options, and for photographs without a zero order.
pub fn lookup(photographs: &[Photograph], settings: &Settings) -> Result<Table> {
    settings.check()?;
    let bands = settings.bands()?;
    let illuminant = Illuminant::of(&settings.illuminant)?;
    let first = fitting(photographs, bands)?;
    let (lobe, lobe_elsewhere) = zero_order(first, settings)?;
    let (mut planes, mut places) = (vec![], vec![]);
    for p in photographs {
        match (&settings.geometry, settings.scale) {
            (Some(geometry), _) => {
                let size = [p.width, p.height];
                let r = geometry.view(size, lobe.center)?.resample(&p.light, size);
                planes.push(Plane::new(&r.light, r.width, r.height));
                places.push((r.center, r.scale));
            }
            (None, scale) => {
                planes.push(Plane::new(&p.light, p.width, p.height));
                let remedy = "give --scale H_PER_PIXEL (at one distance, 2 pixel sizes over it) or --geometry FILE";
                let scale = scale.ok_or_else(|| Error::input("scale", "is not known", remedy))?;
                places.push((lobe.center, scale));
            }
        }
    }
    let mut sources = vec![];
    for (plane, (center, scale)) in planes.iter().zip(&places) {
        sources.push(Source { plane, center: *center, scale: *scale });
    }
    let kernels = kernels(settings, bands, &illuminant);
    let extent = settings.extent.unwrap_or_else(|| measured(&sources, &kernels));
    let grid = Grid { size: settings.size, extent, warp: settings.warp };
    let pairs: Vec<(Kernel, &Source)> = kernels.into_iter().zip(&sources).collect();
    // Uncertainty of the zero order in pixels: measured, or the distance between a given position and the lobe.
    let known = Some(lobe.sigma_px).filter(|s| s.is_finite());
    let (entries, choice, [error, center_error]) = add_up(&pairs, &grid, settings, known.unwrap_or(0.0));
    Ok(Table {
        entries,
        center: lobe.center,
        center_sigma_px: known,
        lobe: lobe_elsewhere,
        rival: settings.center.is_none().then(|| lobe.rival(&first.light, first.width, first.height)).flatten(),
        saturated: lobe.saturated,
        choice,
        error,
        sampling_error: between_pixels(first, lobe.center),
        center_error: known.and(center_error),
        light: None,
        scale: places.first().map_or(1.0, |p| p.1),
        extent,
    })
}

/// Largest half vector along an axis for which nearly all wavelengths were measured, to two digits; a mean over four
/// directions.
fn measured(sources: &[Source], kernels: &[Kernel]) -> f64 {
    let of = |(source, kernel): (&Source, &Kernel)| {
        let [x, y] = source.center;
        let sides = [x, (source.plane.width - 1) as f64 - x, y, (source.plane.height - 1) as f64 - y];
        sides.iter().sum::<f64>() / 4.0 * source.scale * kernel.shortest_nm() / kernel.wavelength_nm
    };
    let extent = sources.iter().zip(kernels).map(of).fold(f64::INFINITY, f64::min);
    let digit = 10_f64.powf(extent.log10().floor() - 1.0);
    ((extent / digit).floor() * digit).clamp(1e-3, 2.0)
}

/// Photograph in which the zero order is detected.
fn fitting(photographs: &[Photograph], bands: Wavelength) -> Result<&Photograph> {
    let wanted = if matches!(bands, Wavelength::Band(_)) { 1 } else { 3 };
    let bad =
        |problem: String| Error::input("photographs", problem, "give one channel per wavelength, all of one size");
    let first = photographs.first().ok_or_else(|| bad("there are none".into()))?;
    if photographs.len() != wanted {
        return Err(bad(format!("there are {} for {wanted} wavelengths", photographs.len())));
    }
    let fits = |p: &Photograph| {
        p.light.len() == p.width * p.height && (p.width, p.height) == (first.width, first.height) && !p.light.is_empty()
    };
    if !photographs.iter().all(fits) {
        return Err(bad("do not belong together".into()));
    }
    // The green channel is the brightest to the eye and in the middle of the spectrum.
    Ok(photographs.get(1).unwrap_or(first))
}

/// The zero order, and the lobe's position if another one was given.
fn zero_order(p: &Photograph, settings: &Settings) -> Result<(Lobe, Option<[f64; 2]>)> {
    let Some(center) = settings.center else { return Ok((require(&p.light, p.width, p.height)?, None)) };
    let inside = |c: f64, n: usize| (0.0..=(n - 1) as f64).contains(&c);
    if !inside(center[0], p.width) || !inside(center[1], p.height) {
        return Err(not_found(&format!("{}, {} is outside of the photograph", center[0], center[1])));
    }
    let Ok(lobe) = find(&p.light, p.width, p.height, Some(center)) else {
        return Ok((Lobe::given(center, f64::NAN, false), None));
    };
    let off = (lobe.center[0] - center[0]).hypot(lobe.center[1] - center[1]);
    if off >= NEAR_PX {
        return Ok((Lobe::given(center, f64::NAN, lobe.saturated), None));
    }
    let elsewhere = off > (3.0 * lobe.sigma_px).max(0.1);
    Ok((Lobe::given(center, lobe.sigma_px.hypot(off), lobe.saturated), elsewhere.then_some(lobe.center)))
}

fn kernels(settings: &Settings, bands: Wavelength, illuminant: &Illuminant) -> Vec<Kernel> {
    let kernel = |nm: f64| Kernel::new(nm, settings.exponent, settings.observer, illuminant.clone());
    match bands {
        Wavelength::Band(nm) => vec![kernel(nm)],
        Wavelength::Channels([r, g, b]) => [(Some(g), r, None), (Some(b), g, Some(r)), (None, b, Some(g))]
            .map(|(below_nm, middle_nm, above_nm)| {
                kernel(middle_nm).of_window(Window { below_nm, middle_nm, above_nm })
            })
            .to_vec(),
    }
}

/// Computes the table with the requested method, or with the cheapest sufficient one, and verifies it.
fn add_up(
    pairs: &[(Kernel, &Source)],
    grid: &Grid,
    settings: &Settings,
    moved: f64,
) -> (Vec<Weight>, Choice, [Option<f64>; 2]) {
    // With several bands, the middle one decides for all.
    let (kernel, source) = (&pairs[pairs.len() / 2].0, pairs[pairs.len() / 2].1);
    let mut wanted = settings.max_error;
    let mut tries = 0;
    loop {
        let requested = match settings.method {
            MethodChoice::Auto => None,
            MethodChoice::Rays(spacing_px) => Some(Method::Rays(Fineness { spacing_px, every: 1 })),
            MethodChoice::Fixed(step_nm) => Some(Method::Fixed { step_nm }),
            MethodChoice::Single(spacing_px) => Some(Method::Single { spacing_px }),
        };
        let (method, choice) = match requested {
            None => choose(source, kernel, grid, wanted),
            Some(method) => (method, given(source, kernel, grid, method)),
        };
        let mut entries = pairs[0].1.table(&pairs[0].0, grid, method);
        for (kernel, source) in &pairs[1..] {
            let more = source.table(kernel, grid, method);
            entries.iter_mut().zip(more).for_each(|(sum, m)| (0..4).for_each(|c| sum[c] += m[c]));
        }
        let errors = check(pairs, grid, &entries, moved);
        tries += 1;
        let off = errors[0].unwrap_or(0.0);
        if requested.is_some() || off <= settings.max_error || tries == TRIES {
            return (entries, choice, errors);
        }
        // Compensates for the ratio of verified to predicted error in the next selection.
        wanted = choice.predicted_error.unwrap_or(wanted) * settings.max_error / off;
    }
}
