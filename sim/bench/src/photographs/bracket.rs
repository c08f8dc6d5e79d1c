//! Exposure brackets, shared by the scenes: noise of the camera, files, and their description.

use crate::random::{electrons, key};
use nacre_base::{Error, Result};
use nacre_frames::NoiseModel;
use nacre_frames::{FILE_NAME, Frame, FrameSet, Kind, save};
use nacre_image::{Attribute, OutputFolder, write_exr, write_png16_gray};
use rayon::prelude::*;

/// Codes of black and white in the 16-bit files.
const BLACK: f64 = 1000.0;
const WHITE: f64 = 65_000.0;

/// A camera with its exposures and filter.
pub(super) struct Bracket<'a> {
    pub seed: u64,
    pub width: usize,
    pub height: usize,
    /// Exposures relative to the first.
    pub exposures: &'a [f64],
    /// Electrons at white.
    pub full_scale_e: f64,
    pub read_noise_e: f64,
    pub wavelength_nm: f64,
    pub band_nm: f64,
}

/// The bracket of a scene, from the fields that all scenes have.
macro_rules! bracket {
    ($scene:expr) => {
        $crate::photographs::bracket::Bracket {
            seed: $scene.seed,
            width: $scene.width,
            height: $scene.height,
            exposures: &$scene.exposures,
            full_scale_e: $scene.full_scale_e,
            read_noise_e: $scene.read_noise_e,
            wavelength_nm: $scene.wavelength_nm,
            band_nm: $scene.band_nm,
        }
    };
}
pub(super) use bracket;

/// Checks the exposures.
pub(super) fn check_exposures(exposures: &[f64]) -> Result<()> {
    if (1..=16).contains(&exposures.len()) && exposures.iter().all(|e| (1e-6..=1e6).contains(e)) {
        return Ok(());
    }
    Err(Error::input("exposures", "are not 1 to 16 numbers from 1e-6 to 1e6", "correct the scene"))
}

impl Bracket<'_> {
    /// Writes levels (fraction of white) as a 16-bit file with the camera's noise; `id` makes the noise of files
    /// independent.
    pub fn save(
        &self,
        folder: &OutputFolder,
        name: &str,
        id: [u64; 2],
        level: &(dyn Fn(usize) -> f64 + Sync),
    ) -> Result<()> {
        let code = |i: usize| {
            let mean = level(i) * self.full_scale_e;
            let seen = electrons(key(&[self.seed, id[0], id[1], i as u64]), mean, self.read_noise_e);
            (BLACK + (WHITE - BLACK) * seen / self.full_scale_e).clamp(0.0, WHITE).round() as u16
        };
        let codes: Vec<u16> = (0..self.width * self.height).into_par_iter().map(code).collect();
        write_png16_gray(&folder.path(name), self.width, self.height, &codes)
    }

    /// Writes all exposures of a photograph with these levels in the first one. Returns their frames; file names begin
    /// with `name`.
    pub fn expose(
        &self,
        folder: &OutputFolder,
        (name, id): (&str, u64),
        level: &(dyn Fn(usize) -> f64 + Sync),
    ) -> Result<Vec<Frame>> {
        let exposed = |(k, exposure): (usize, &f64)| {
            let file = format!("{name}{k:02}.png");
            self.save(folder, &file, [id, k as u64], &|i| level(i) * exposure)?;
            Ok(Frame { exposure_s: Some(*exposure), flash: Some(true), ..Frame::new(file) })
        };
        self.exposures.iter().enumerate().map(exposed).collect()
    }

    /// Writes the `frames.json` of these frames.
    pub fn describe(&self, folder: &OutputFolder, frames: Vec<Frame>) -> Result<()> {
        let set = FrameSet {
            black: Some(BLACK),
            white: Some(WHITE),
            wavelength_nm: Some(self.wavelength_nm),
            band_nm: (self.band_nm > 0.0).then_some(self.band_nm),
            noise: Some(NoiseModel { full_scale_e: self.full_scale_e, read_noise_e: self.read_noise_e }),
            ..FrameSet::new(Kind::Flash, frames)
        };
        folder.write(FILE_NAME, save(&set).as_bytes())
    }

    /// Writes a complete photograph: exposures, `frames.json` and `truth.exr` (radiance without noise). `level` is
    /// that of the brightest pixel in the first exposure.
    pub fn write(&self, folder: &OutputFolder, radiance: &[f64], level: f64) -> Result<()> {
        let top = radiance.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let frames = self.expose(folder, ("", 0), &|i| radiance[i] / top * level)?;
        self.describe(folder, frames)?;
        let units = [("units", Attribute::Text("radiance, brightest is 1".into()))];
        write_exr(&folder.path("truth.exr"), self.width, self.height, &["Y"], &units, &|_, y, row| {
            row.iter_mut().zip(&radiance[y * self.width..]).for_each(|(out, v)| *out = (v / top) as f32);
        })
    }
}
