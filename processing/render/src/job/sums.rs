//! Selects the accuracy of sums over orders and wavelengths, by comparison with finer sums at some pixels.
//!
//! The truncation error of a sum is known for whole lobes. A picture may show only the far flanks of lobes, where the
//! truncated part is all the light there is, or lobes under an environment, where it is negligible. Sums are therefore
//! compared with finer ones in the visible directions.

use super::flats;
use super::two_pass::{self, EnvironmentReport};
use crate::material::SAMPLES;
use crate::material::shading::Accuracy;
use crate::picture::{Pilot, compared};
use crate::prepared_scene::PreparedScene;
use crate::scene::Scene;
use crate::settings::{MAX_SAMPLES, Method, Settings};
use nacre_base::Result;
use nacre_base::progress::Progress;
use std::path::Path;

/// Share of the target error that truncation may take.
const MODEL: f64 = 0.25;

/// Largest error of precomputed sums relative to the Monte Carlo noise that they replace; the same ratio as for the
/// target error.
const BETTER: f64 = 0.25;

/// Ratio of the error of finer sums to that of the tested ones, applied again for each finer step. With 1/16, both sums
/// once missed the same flanks, and the true error was 2.4 times the estimate.
const FINER: f64 = 1.0 / 64.0;
const TRIES: usize = 4;

/// Number of compared pixels.
const LOOKED_AT: usize = 1024;

/// Number of pixels in a check, and the refinement of its sums.
const CHECKED: usize = 4096;
const CHECK: f64 = 1e-2;

/// A scene with sums of sufficient accuracy.
pub(crate) struct Sums {
    pub prepared: PreparedScene,
    /// Root mean square error of the sums over some pixels, relative to their mean luminance; 0 in the dark.
    pub error: f64,
    /// Permitted error.
    pub allowed: f64,
    /// Measured error of two passes, in the same measure; 0 without them.
    pub two_pass: f64,
    /// Methods for tables under environments.
    pub environments: Vec<EnvironmentReport>,
}

impl Sums {
    /// Finds the coarsest sums with a permitted error, or the finest tested ones. Sums over given wavelengths are used
    /// unchanged.
    ///
    /// # Errors
    /// As [`PreparedScene::new`].
    pub(crate) fn new(scene: &Scene, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Self> {
        let allowed = MODEL * settings.max_error;
        let mut asked = allowed;
        let accuracy = Accuracy::new(asked, settings.wavelengths);
        let mut coarse = PreparedScene::new(scene, folder, accuracy, progress)?;
        for left in (0..TRIES).rev() {
            if !coarse.sums() {
                return Ok(Self::of(coarse, 0.0, allowed));
            }
            let accuracy = Accuracy::new(asked * FINER, None);
            let fine = PreparedScene::like(Some(&coarse), scene, folder, accuracy, progress)?;
            let error = compared(&coarse, &fine, LOOKED_AT, progress)?;
            // Darkness may be a flank that neither sum has followed so far.
            if error.is_some_and(|e| e <= allowed) || left == 0 || settings.wavelengths.is_some() {
                return Ok(Self::of(coarse, error.unwrap_or(0.0), allowed));
            }
            (coarse, asked) = (fine, asked * FINER);
        }
        Ok(Self::of(coarse, f64::NAN, allowed))
    }

    fn of(prepared: PreparedScene, error: f64, allowed: f64) -> Self {
        Self { prepared, error, allowed, two_pass: 0.0, environments: vec![] }
    }

    /// Noise that passes may leave: the remainder of the target error after that of two passes, or the whole target
    /// error if nothing remains.
    pub(crate) fn noise(&self, wanted: f64) -> f64 {
        let left = wanted * wanted - self.two_pass * self.two_pass;
        if left > 0.0 { left.sqrt() } else { wanted }
    }

    /// The pilot of the picture. Flat samples are precomputed first if that is faster than sampling to the target
    /// error, regardless of the sample limit.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn pilot(&mut self, settings: &Settings, most: usize, progress: &dyn Progress) -> Result<Pilot> {
        let pilot = Pilot::new(&self.prepared, progress)?;
        if settings.method == Method::Samples {
            return Ok(pilot);
        }
        let passes = pilot.passes(settings.max_error, MAX_SAMPLES / SAMPLES);
        // Where samples do not reach the target error, the precomputed sums may have a larger error, as long as it is
        // below that of the samples.
        let left = pilot.noise(pilot.passes(settings.max_error, most));
        let better = if left > settings.max_error { BETTER * left } else { 0.0 };
        let mut changed = false;
        if settings.method == Method::Auto
            && let Some(error) = flats::sum_up(&mut self.prepared, &pilot, passes, (self.allowed, better), progress)?
        {
            self.error = self.error.hypot(error);
            changed = true;
        }
        let found = two_pass::two_passes(&mut self.prepared, &pilot, passes, settings, progress)?;
        changed |= self.prepared.two_passes.iter().any(Option::is_some);
        (self.two_pass, self.environments) = (found.error, found.reports);
        if changed { Pilot::new(&self.prepared, progress) } else { Ok(pilot) }
    }

    /// Measures the error against much finer sums at more pixels.
    ///
    /// # Errors
    /// As [`PreparedScene::new`].
    pub(crate) fn checked(&self, scene: &Scene, folder: &Path, progress: &dyn Progress) -> Result<f64> {
        let accuracy = Accuracy::new(CHECK * self.prepared.accuracy.error, None);
        let mut fine = PreparedScene::like(Some(&self.prepared), scene, folder, accuracy, progress)?;
        flats::sum_up_finer(&mut fine, &self.prepared, progress)?;
        // The error of two passes is already known; samples in their place would count as an error.
        fine.two_passes.clone_from(&self.prepared.two_passes);
        Ok(compared(&self.prepared, &fine, CHECKED, progress)?.unwrap_or(0.0).hypot(self.two_pass))
    }

    /// Warning for two passes that miss the target error.
    pub(crate) fn two_pass_warning(&self, wanted: f64) -> Option<String> {
        (self.two_pass > wanted).then(|| {
            format!(
                "two passes are off by {:.2} % (measured), {:.2} % are asked for: choose the method auto or samples, or allow a larger error",
                100.0 * self.two_pass,
                100.0 * wanted
            )
        })
    }

    /// Warning about the truncation error.
    pub(crate) fn warning(&self) -> Option<String> {
        // Twice the permitted error is tolerated, since it is only a part of the total.
        (self.error > 2.0 * self.allowed).then(|| {
            format!(
                "sums over orders, wavelengths and skies are off by {:.2} %, {:.2} % are allowed: what is in view is far from any order, or light and \
                 pattern are too sharp",
                100.0 * self.error,
                100.0 * self.allowed
            )
        })
    }
}
