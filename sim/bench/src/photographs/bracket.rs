//! What photographs in several exposures share: the camera's noise, its files, and the set that describes them.

use crate::random::{electrons, key};
use nacre_base::{Error, Result};
use nacre_frames::NoiseModel;
use nacre_frames::{FILE_NAME, Frame, FrameSet, Kind, save};
use nacre_image::{Attribute, OutputFolder, write_exr, write_png16_gray};
use rayon::prelude::*;

/// Black and white of the 16-bit files.
const BLACK: f64 = 1000.0;
const WHITE: f64 = 65_000.0;

/// A camera, and the light that it photographs.
pub(super) struct Bracket<'a> {
    pub seed: u64,
    pub width: usize,
    pub height: usize,
    /// Exposures, each so many times the first.
    pub exposures: &'a [f64],
    /// Electrons at white.
    pub full_scale_e: f64,
    pub read_noise_e: f64,
    pub wavelength_nm: f64,
    pub band_nm: f64,
}

/// The bracket of a scene: all that photograph have these fields.
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

/// Refuses exposures that make no sense.
pub(super) fn check_exposures(exposures: &[f64]) -> Result<()> {
    if (1..=16).contains(&exposures.len()) && exposures.iter().all(|e| (1e-6..=1e6).contains(e)) {
        return Ok(());
    }
    Err(Error::input("exposures", "are not 1 to 16 numbers from 1e-6 to 1e6", "correct the scene"))
}

impl Bracket<'_> {
    /// A 16-bit file of levels (of white) with the camera's noise; `id` keeps the noise of files apart.
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

    /// All exposures of a photograph whose levels are those of the first, and the frames that say so; the files' names begin with `name`.
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

    /// Writes one photograph whole: exposures in which the brightest pixel of the first has this level, `frames.json` and `truth.exr`,
    /// the radiance without noise.
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
