//! Maps and pictures of a result folder.

use super::{Options, OrientationMaps, PeriodMaps, PeriodMethod, Smoothing, StokesMaps, smoothed_orientation};
use crate::Result;
use crate::frames::LoadedFrames;
use crate::image::{Attribute, Canvas, OutputFolder, orientation_picture, scalar_picture, write_exr};
use crate::progress::Progress;

/// Writes into a result folder.
pub(super) struct Writer<'a> {
    pub folder: &'a OutputFolder,
    pub frames: &'a LoadedFrames,
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
}

impl Writer<'_> {
    /// Writes `stokes.exr`, `aolp.exr`, `orientation.exr`, `smoothed.exr` and the pictures.
    ///
    /// Pictures are compressed on one thread while maps, which are not, are written and synced by another. No two pictures are in
    /// memory at a time.
    pub fn maps(&self, maps: StokesMaps, map: &OrientationMaps) -> Result<()> {
        self.progress.stage("writing maps", 5);
        let smooths = !self.options.smooth_maps && self.options.smooth != Smoothing::NONE;
        let numbers = || self.light(&maps).and_then(|()| self.orientation(&maps, map));
        let pictures = || {
            self.scalars(&maps, map)?;
            if smooths { Ok(()) } else { self.picture(map) }
        };
        let (numbers, pictures) = rayon::join(numbers, pictures);
        numbers.and(pictures)?;
        // Smoothing takes memory.
        drop(maps);
        if smooths { self.picture(map) } else { Ok(()) }
    }

    /// Writes `period.exr` and `period.png`.
    pub fn periods(&self, found: &PeriodMaps, method: &PeriodMethod) -> Result<()> {
        let (width, height) = (found.width, found.height);
        let mut attributes = self.attributes(width, "period, sigma: um; mask: 1 found, 0 masked");
        let said = serde_json::to_string(method).unwrap_or_default();
        let note = match method {
            PeriodMethod::Brightness { .. } => format!("heuristic, only the order has a meaning: {said}"),
            PeriodMethod::Contrast { .. } => format!("under assumptions: {said}"),
        };
        attributes.push(("method", Attribute::Text(note)));
        self.exr("period.exr", [width, height], &["period", "sigma", "mask"], &attributes, &|c, y, row| match c {
            0 => copy(&found.period_um, y, row),
            1 => copy(&found.sigma_um, y, row),
            _ => mask(&found.period_um, y, row),
        })?;
        let period = |x: usize, y: usize| Some(found.period_um[y * width + x]).filter(|p| p.is_finite());
        let [low, high] = scale_of(&found.period_um);
        scalar_picture(width, height, &period, low, high, &method.label(), "Period")
            .save_png(&self.folder.path("period.png"))?;
        self.progress.check()
    }

    /// Units, pixel pitch and wavelength for the header of an EXR.
    fn attributes(&self, width: usize, units: &str) -> Vec<(&'static str, Attribute)> {
        let mut attributes = vec![("units", Attribute::Text(units.into()))];
        if let Some(pixel) = self.frames.set.geometry.and_then(|g| g.pixel_um) {
            let block = self.frames.info.width / width;
            attributes.push(("pixel_um", Attribute::Number(pixel * block as f64)));
        }
        if let Some(wavelength) = self.frames.set.wavelength_nm {
            attributes.push(("wavelength_nm", Attribute::Number(wavelength)));
        }
        attributes
    }

    fn exr(
        &self,
        name: &str,
        [width, height]: [usize; 2],
        channels: &[&str],
        attributes: &[(&str, Attribute)],
        fill: &(dyn Fn(usize, usize, &mut [f32]) + Sync),
    ) -> Result<()> {
        write_exr(&self.folder.path(name), width, height, channels, attributes, fill)?;
        // The disk has the time now that others are computing, rather than in the end.
        self.folder.sync(name)?;
        self.progress.check()
    }

    fn light(&self, maps: &StokesMaps) -> Result<()> {
        let (width, size) = (maps.width, [maps.width, maps.height]);
        let units = self.attributes(width, "linear value / (exposure s * gain)");
        self.exr("stokes.exr", size, &["S0", "S1", "S2"], &units, &|c, y, row| {
            copy([&maps.s0, &maps.s1, &maps.s2][c], y, row);
        })?;
        self.progress.step();
        let units = self.attributes(width, "aolp: rad; dolp: 0 to 1");
        self.exr("aolp.exr", size, &["aolp", "dolp"], &units, &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let i = y * width + x;
                *out = if c == 0 { aolp(maps, i) } else { dolp(maps, i) };
            }
        })?;
        self.progress.step();
        Ok(())
    }

    fn orientation(&self, maps: &StokesMaps, map: &OrientationMaps) -> Result<()> {
        let units = "orientation, sigma: rad; mask: 1 measured, 0 masked; correlation: 0 to 1";
        let mut attributes = self.attributes(maps.width, units);
        let smoothing = if self.options.smooth_maps { self.options.smooth } else { Smoothing::NONE };
        attributes.push(("smoothing", Attribute::Text(smoothing.to_string())));
        let channels = ["orientation", "sigma", "mask", "correlation"];
        self.exr("orientation.exr", [maps.width, maps.height], &channels, &attributes, &|c, y, row| match c {
            0 => copy(&map.orientation, y, row),
            1 => copy(&map.sigma, y, row),
            2 => mask(&map.orientation, y, row),
            _ => copy(&maps.correlation, y, row),
        })?;
        self.progress.step();
        Ok(())
    }

    fn scalars(&self, maps: &StokesMaps, map: &OrientationMaps) -> Result<()> {
        let (width, height) = (maps.width, maps.height);
        // Up to the mask's limit of 1/8 rad, on a scale that the bulk of the pixels fills.
        let sigma = |x: usize, y: usize| {
            let i = y * width + x;
            map.orientation[i].is_finite().then(|| map.sigma[i].to_degrees())
        };
        let top = top_of_scale(width, height, &sigma);
        let save = |picture: Canvas, name: &str| picture.save_png(&self.folder.path(name));
        save(scalar_picture(width, height, &sigma, 0.0, top, "σ (°)", "Uncertainty"), "sigma.png")?;
        self.progress.step();
        self.progress.check()?;
        let dolp = |x: usize, y: usize| Some(dolp(maps, y * width + x)).filter(|d| d.is_finite());
        let top = top_of_scale(width, height, &dolp).min(1.0);
        save(scalar_picture(width, height, &dolp, 0.0, top, "DoLP", "Degree of linear polarization"), "dolp.png")?;
        self.progress.step();
        self.progress.check()
    }

    /// The picture of the orientations, smoothed unless the map is already or nobody wants it.
    fn picture(&self, map: &OrientationMaps) -> Result<()> {
        let (width, height, smooth) = (map.width, map.height, self.options.smooth);
        let smoothed = if self.options.smooth_maps || smooth == Smoothing::NONE {
            None
        } else {
            Some(smoothed_orientation(map, smooth, self.progress)?)
        };
        if let Some(smoothed) = &smoothed {
            let mut attributes = self.attributes(width, "orientation: rad");
            attributes.push(("smoothing", Attribute::Text(smooth.to_string())));
            self.exr("smoothed.exr", [width, height], &["orientation"], &attributes, &|_, y, row| {
                copy(smoothed, y, row)
            })?;
        }
        let title = match smooth {
            Smoothing::NONE => "Orientation".to_owned(),
            smooth => format!("Orientation\nsmoothed: {smooth}"),
        };
        let shown = smoothed.as_ref().unwrap_or(&map.orientation);
        let orientation = |x: usize, y: usize| Some(shown[y * width + x]).filter(|t| t.is_finite());
        let picture = orientation_picture(width, height, &orientation, &title);
        picture.save_png(&self.folder.path("orientation.png"))?;
        self.progress.check()
    }
}

/// A row of a plane.
fn copy(plane: &[f32], y: usize, row: &mut [f32]) {
    let width = row.len();
    row.copy_from_slice(&plane[y * width..][..width]);
}

/// 1 where a row of a plane has values.
fn mask(plane: &[f32], y: usize, row: &mut [f32]) {
    let width = row.len();
    row.iter_mut().zip(&plane[y * width..]).for_each(|(m, v)| *m = f32::from(u8::from(v.is_finite())));
}

/// The range that all but the outermost hundredths of the values fill, widened where it is none.
fn scale_of(plane: &[f32]) -> [f32; 2] {
    let mut known: Vec<f32> = plane.iter().copied().filter(|v| v.is_finite()).step_by(7).collect();
    known.sort_by(f32::total_cmp);
    let at = |share: usize| known.get(known.len().saturating_sub(1) * share / 100).copied().unwrap_or(0.0);
    let (low, high) = (at(1), at(99));
    let least = 0.02 * high.abs().max(1e-3);
    if high - low > least { [low, high] } else { [low - least, high + least] }
}

/// The 98th percentile of about 10,000 pixels, rounded up to 1, 2 or 5 in its last digit.
fn top_of_scale(width: usize, height: usize, value: &dyn Fn(usize, usize) -> Option<f32>) -> f32 {
    let stride = (width * height / 10_000).max(1);
    let mut values: Vec<f32> =
        (0..width * height).step_by(stride).filter_map(|i| value(i % width, i / width)).collect();
    values.sort_by(f32::total_cmp);
    let top = values.get(values.len() * 98 / 100).copied().unwrap_or(1.0).max(1e-6);
    let digit = 10_f32.powf(top.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|k| k * digit).into_iter().find(|&t| t >= top).unwrap_or(top)
}

fn aolp(maps: &StokesMaps, i: usize) -> f32 {
    let angle = (0.5 * maps.s2[i].atan2(maps.s1[i])).rem_euclid(std::f32::consts::PI);
    if angle >= std::f32::consts::PI { 0.0 } else { angle }
}

fn dolp(maps: &StokesMaps, i: usize) -> f32 {
    if maps.s0[i] > 0.0 {
        maps.s1[i].hypot(maps.s2[i]) / maps.s0[i]
    } else if maps.s0[i].is_nan() {
        f32::NAN
    } else {
        0.0
    }
}
