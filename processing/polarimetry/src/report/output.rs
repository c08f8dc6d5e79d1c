//! Maps and pictures of a result folder.

use crate::fit::flat::Flat;
use crate::fit::noise::Covariance;
use crate::report::disk::Disk;
use crate::report::reduced::reduced;
use crate::{
    Design, FrameNoise, Model, Options, OrientationMaps, PeriodMaps, PeriodMethod, Smoothing, StokesMaps,
    smoothed_orientation,
};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::vector_atan::{atan2, folded};
use nacre_base::vectors::vectorised;
use nacre_frames::LoadedFrames;
use nacre_image::{Attribute, OutputFolder, orientation_rows, scalar_picture, scalar_rows, write_exr};

/// Maximum number of pixels along a side of a picture.
const WIDEST: usize = 2048;

/// Writes files of a result folder.
pub(crate) struct Writer<'a> {
    pub folder: &'a OutputFolder,
    pub frames: &'a LoadedFrames,
    pub options: &'a Options,
    pub model: Model,
    pub progress: &'a dyn Progress,
}

/// Noise of intensities.
pub(crate) struct LightNoise<'a> {
    pub design: &'a Design,
    pub frames: &'a [FrameNoise],
    pub flat: &'a Flat,
}

impl Writer<'_> {
    /// Writes the files that depend on the maps alone: `stokes.exr` and, beside orientations, `aolp.exr`.
    pub fn light(&self, maps: &StokesMaps, noise: &LightNoise) -> Result<()> {
        let (width, size) = (maps.width, [maps.width, maps.height]);
        let covariance = Covariance::new(noise.design, noise.frames, &maps.covariance);
        let units = self.attributes(width, "linear value / (exposure s * gain)");
        self.exr("stokes.exr", size, &["S0", "S1", "S2", "sigma_S0"], &units, &|c, y, row| match c {
            0..3 => copy([&maps.s0, &maps.s1, &maps.s2][c], y, row),
            _ => {
                for (i, out) in (y * width..).zip(row) {
                    *out = noise.flat.sigma_s0(maps, &covariance, i);
                }
            }
        })?;
        self.progress.step();
        if self.model == Model::Plain {
            return Ok(());
        }
        let units = self.attributes(width, "aolp: rad; dolp: 0 to 1");
        self.exr("aolp.exr", size, &["aolp", "dolp"], &units, &|c, y, row| polarization(maps, c, y, row))?;
        self.progress.step();
        Ok(())
    }

    /// Writes `orientation.exr` (`aolp.exr` for plain polarimetry), `smoothed.exr` if requested, and the pictures.
    ///
    /// Pictures are compressed while `disk` writes and syncs the maps, which are not compressed.
    pub fn maps(&self, maps: StokesMaps, map: &OrientationMaps, noise: &LightNoise, disk: &Disk) -> Result<()> {
        let covariance = Covariance::new(noise.design, noise.frames, &maps.covariance);
        let plain = || self.aolp(&maps, map, &covariance, noise.flat);
        let numbers = || if self.model == Model::Plain { plain() } else { self.orientation(&maps, map) };
        let (numbers, pictures) = disk.beside(numbers, || {
            self.scalars(&maps, map)?;
            self.picture(map)
        });
        numbers.and(pictures)?;
        // Smoothing a whole map takes memory, so the maps are freed.
        drop(maps);
        if self.options.smoothed_exr { self.smoothed(map) } else { Ok(()) }
    }

    /// Writes `period.exr` and `period.png`.
    pub fn periods(&self, found: &PeriodMaps, method: &PeriodMethod) -> Result<()> {
        let (width, height) = (found.width, found.height);
        let mut attributes = self.attributes(width, "period, sigma: um; mask: 1 found, 0 masked");
        let description = serde_json::to_string(method).unwrap_or_default();
        let note = match method {
            PeriodMethod::Brightness { .. } => format!("heuristic, only the order has a meaning: {description}"),
            PeriodMethod::Contrast { .. } => format!("under assumptions: {description}"),
        };
        attributes.push(("method", Attribute::Text(note)));
        self.exr("period.exr", [width, height], &["period", "sigma", "mask"], &attributes, &|c, y, row| match c {
            0 => copy(&found.period_um, y, row),
            1 => copy(&found.sigma_um, y, row),
            _ => mask(&found.period_um, y, row),
        })?;
        let period = |x: usize, y: usize| Some(found.period_um[y * width + x]).filter(|p| p.is_finite());
        let [low, high] = scale_of(&found.period_um);
        scalar_picture([width, height], &period, [low, high], &method.label(), "Period", self.bar_um(width, 1))
            .save_png(&self.folder.path("period.png"))?;
        self.progress.check()
    }

    /// Size on the sample in µm of a pixel of maps of `width` columns.
    fn pixel_um(&self, width: usize) -> Option<f64> {
        let block = self.frames.info.width / width;
        self.frames.set.geometry?.pixel_um.map(|um| um * block as f64)
    }

    /// Size on the sample of a pixel of pictures that show every `step`-th pixel; `None` for no scale bar.
    fn bar_um(&self, width: usize, step: usize) -> Option<f64> {
        self.pixel_um(width).filter(|_| !self.options.no_scale_bar).map(|um| um * step as f64)
    }

    /// Units, pixel pitch and wavelength for the header of an EXR.
    fn attributes(&self, width: usize, units: &str) -> Vec<(&'static str, Attribute)> {
        let mut attributes = vec![("units", Attribute::Text(units.into()))];
        attributes.extend(self.pixel_um(width).map(|um| ("pixel_um", Attribute::Number(um))));
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
        // The disk is idle while other threads compute, so the file is synced now.
        self.folder.sync(name)?;
        self.progress.check()
    }

    /// `aolp.exr` of plain polarimetry.
    fn aolp(&self, maps: &StokesMaps, map: &OrientationMaps, covariance: &Covariance, flat: &Flat) -> Result<()> {
        let units = "aolp, sigma: rad; dolp, sigma_dolp, correlation: 0 to 1; mask: 1 measured, 0 masked";
        let attributes = self.attributes(maps.width, units);
        let channels = ["aolp", "dolp", "sigma", "sigma_dolp", "mask", "correlation"];
        self.exr("aolp.exr", [maps.width, maps.height], &channels, &attributes, &|c, y, row| match c {
            0 | 1 => polarization(maps, c, y, row),
            2 => copy(&map.sigma, y, row),
            3 => {
                for (i, out) in (y * maps.width..).zip(row) {
                    let fitted = flat.before(maps, i).map(|v| 0.5 * v);
                    *out = covariance.degree_sigma(i, fitted, map.sigma[i]);
                }
            }
            4 => mask(&map.orientation, y, row),
            _ => copy(&maps.correlation, y, row),
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
        // Scaled to the range of most pixels.
        self.scalar("sigma.png", "σ (°)", "Uncertainty", f32::INFINITY, maps, &|first, step, row| {
            let pixels = map.orientation[first..].iter().zip(&map.sigma[first..]).step_by(step);
            for (out, (theta, sigma)) in row.iter_mut().zip(pixels) {
                *out = if theta.is_finite() { sigma.to_degrees() } else { f32::NAN };
            }
        })?;
        let title = "Degree of linear polarization";
        self.scalar("dolp.png", "DoLP", title, 1.0, maps, &|first, step, row| dolp(maps, first, step, row))
    }

    /// Writes a picture of limited size: of large maps only every second pixel, or third, ... is shown.
    /// `fill(first, step, values)` writes those of every `step`-th pixel from `first` on.
    fn scalar(
        &self,
        name: &str,
        label: &str,
        title: &str,
        highest: f32,
        maps: &StokesMaps,
        fill: &(dyn Fn(usize, usize, &mut [f32]) + Sync),
    ) -> Result<()> {
        let (width, height) = (maps.width, maps.height);
        let step = width.max(height).div_ceil(WIDEST);
        let mut some = vec![0.0; (width * height).min(10_000)];
        fill(0, (width * height / 10_000).max(1), &mut some);
        let top = top_of_scale(some).min(highest);
        let size = [width.div_ceil(step), height.div_ceil(step)];
        let row = |y: usize, row: &mut [f32]| fill(y * step * width, step, row);
        let picture = scalar_rows(size, &row, [0.0, top], label, title, self.bar_um(width, step));
        picture.save_png(&self.folder.path(name))?;
        self.progress.step();
        self.progress.check()
    }

    /// Writes `orientation.png`, smoothed unless the map already is or smoothing is off; for plain polarimetry
    /// `aolp.png`, unsmoothed.
    ///
    /// The smoothing has the same reach on the sample as that of the map. A pixel of the picture represents `step`
    /// pixels of the map, and the reach of the filter grows with the square root of its iterations.
    fn picture(&self, map: &OrientationMaps) -> Result<()> {
        let step = map.width.max(map.height).div_ceil(WIDEST);
        let small = reduced(map, step);
        let small = small.as_ref().unwrap_or(map);
        let draw = |name: &str, title: &str, values: &[f32]| {
            let (size, bar_um) = ([small.width, small.height], self.bar_um(map.width, step));
            orientation_rows(size, &|y, row| copy(values, y, row), title, self.options.palette, bar_um)
                .save_png(&self.folder.path(name))
        };
        if self.model == Model::Plain {
            draw("aolp.png", "Angle of linear polarization", &small.orientation)?;
            return self.progress.check();
        }
        match self.options.smooth {
            Smoothing::NONE => draw("orientation.png", "Orientation", &small.orientation)?,
            smooth => {
                let title = format!("Orientation\nsmoothed: {smooth}");
                let rounds = if self.options.smooth_maps { Smoothing::NONE } else { smooth.coarser(step) };
                draw("orientation.png", &title, &smoothed_orientation(small, rounds, self.progress)?)?;
            }
        }
        self.progress.check()
    }

    /// Writes `smoothed.exr`: the smoothed orientations of all pixels.
    fn smoothed(&self, map: &OrientationMaps) -> Result<()> {
        let (size, smooth) = ([map.width, map.height], self.options.smooth);
        let smoothed = smoothed_orientation(map, smooth, self.progress)?;
        let mut attributes = self.attributes(map.width, "orientation: rad");
        attributes.push(("smoothing", Attribute::Text(smooth.to_string())));
        self.exr("smoothed.exr", size, &["orientation"], &attributes, &|_, y, row| copy(&smoothed, y, row))
    }
}

/// Copies a row of a plane.
fn copy(plane: &[f32], y: usize, row: &mut [f32]) {
    let width = row.len();
    row.copy_from_slice(&plane[y * width..][..width]);
}

/// 1 where a row of a plane has values.
fn mask(plane: &[f32], y: usize, row: &mut [f32]) {
    let width = row.len();
    row.iter_mut().zip(&plane[y * width..]).for_each(|(m, v)| *m = f32::from(u8::from(v.is_finite())));
}

/// Range from the 1st to the 99th percentile of the values, widened if it is empty.
fn scale_of(plane: &[f32]) -> [f32; 2] {
    let mut known: Vec<f32> = plane.iter().copied().filter(|v| v.is_finite()).step_by(7).collect();
    known.sort_by(f32::total_cmp);
    let at = |share: usize| known.get(known.len().saturating_sub(1) * share / 100).copied().unwrap_or(0.0);
    let (low, high) = (at(1), at(99));
    let least = 0.02 * high.abs().max(1e-3);
    if high - low > least { [low, high] } else { [low - least, high + least] }
}

/// The 98th percentile, rounded up to 1, 2 or 5 in its last digit.
fn top_of_scale(mut values: Vec<f32>) -> f32 {
    values.retain(|v| v.is_finite());
    values.sort_by(f32::total_cmp);
    let top = values.get(values.len() * 98 / 100).copied().unwrap_or(1.0).max(1e-6);
    let digit = 10_f32.powf(top.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|k| k * digit).into_iter().find(|&t| t >= top).unwrap_or(top)
}

/// Row `y` of the angle (`channel` 0) or degree of linear polarization.
fn polarization(maps: &StokesMaps, channel: usize, y: usize, row: &mut [f32]) {
    let first = y * maps.width;
    if channel == 0 { aolp(&maps.s1[first..], &maps.s2[first..], row) } else { dolp(maps, first, 1, row) }
}

/// Angles of linear polarization from 0 to π.
fn aolp(s1: &[f32], s2: &[f32], row: &mut [f32]) {
    vectorised(
        #[inline(always)]
        || {
            for (out, (s1, s2)) in row.iter_mut().zip(s1.iter().zip(s2)) {
                *out = folded(0.5 * atan2(*s2, *s1));
            }
        },
    );
}

/// Degrees of linear polarization of every `step`-th pixel from `first` on.
fn dolp(maps: &StokesMaps, first: usize, step: usize, row: &mut [f32]) {
    let of = |s0: f32, s1: f32, s2: f32| {
        let (x, y) = (s1 / s0, s2 / s0);
        let degree = (x * x + y * y).sqrt();
        if s0 <= 0.0 { 0.0 } else { degree }
    };
    let [s0, s1, s2] = [&maps.s0, &maps.s1, &maps.s2].map(|plane| &plane[first..]);
    if step > 1 {
        for (i, out) in row.iter_mut().enumerate().map(|(i, out)| (i * step, out)) {
            *out = of(s0[i], s1[i], s2[i]);
        }
        return;
    }
    vectorised(
        #[inline(always)]
        || {
            for (out, ((s0, s1), s2)) in row.iter_mut().zip(s0.iter().zip(s1).zip(s2)) {
                *out = of(*s0, *s1, *s2);
            }
        },
    );
}
