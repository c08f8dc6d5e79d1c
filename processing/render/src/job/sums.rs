//! Sums over orders and wavelengths that are exact enough for what is in view, which a look at some pixels tells.
//!
//! What a sum leaves out is known of whole lobes. A picture may hold nothing but the far flanks of lobes, where the same rest is all
//! that there is, or lobes under an environment, where it is next to nothing; so sums are compared with finer ones where they are looked at.

use super::flats;
use super::two_pass::{self, EnvironmentReport};
use crate::material::SAMPLES;
use crate::material::shading::Accuracy;
use crate::picture::{Pilot, compared};
use crate::prepared_scene::PreparedScene;
use crate::scene::Scene;
use crate::settings::{MOST_SAMPLES, Method, Settings};
use nacre_base::Result;
use nacre_base::progress::Progress;
use std::path::Path;

/// Part of the wanted error that sums may take.
const MODEL: f64 = 0.25;

/// Part of the noise that samples would leave that what is summed up instead may be off by: the same as of a wanted error.
const BETTER: f64 = 0.25;

/// Finer sums are asked for this part of the error, and for finer ones still so many times. A sixteenth left flanks out that both sums did not
/// follow: errors were 2.4 times as large as was said, once.
const FINER: f64 = 1.0 / 64.0;
const TRIES: usize = 4;

/// Pixels that are looked at.
const LOOKED_AT: usize = 1024;

/// What a check looks at, and how much finer its sums are.
const CHECKED: usize = 4096;
const CHECK: f64 = 1e-2;

/// A scene whose sums are exact enough.
pub(crate) struct Sums {
    pub ready: PreparedScene,
    /// What they are off by: root mean square over some pixels, over their mean luminance; 0 in the dark.
    pub error: f64,
    /// What they were allowed.
    pub allowed: f64,
    /// Measured error of two passes, as that of the sums; 0 without them.
    pub two_pass: f64,
    /// How tables are rendered under environments.
    pub environments: Vec<EnvironmentReport>,
}

impl Sums {
    /// The coarsest sums whose error is allowed, or the finest that are tried. Sums over given wavelengths are taken as they are.
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
            // What is dark may be a flank that neither has followed so far.
            if error.is_some_and(|e| e <= allowed) || left == 0 || settings.wavelengths.is_some() {
                return Ok(Self::of(coarse, error.unwrap_or(0.0), allowed));
            }
            (coarse, asked) = (fine, asked * FINER);
        }
        Ok(Self::of(coarse, f64::NAN, allowed))
    }

    fn of(ready: PreparedScene, error: f64, allowed: f64) -> Self {
        Self { ready, error, allowed, two_pass: 0.0, environments: vec![] }
    }

    /// Noise that passes may leave: what two passes leave of the error asked for, or that error where they leave nothing of it.
    pub(crate) fn noise(&self, wanted: f64) -> f64 {
        let left = wanted * wanted - self.two_pass * self.two_pass;
        if left > 0.0 { left.sqrt() } else { wanted }
    }

    /// The pilot of the picture. Flat samples are summed up first if that takes less time than the samples that reach the error asked for, whether or not
    /// that many samples are allowed.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn pilot(&mut self, settings: &Settings, most: usize, progress: &dyn Progress) -> Result<Pilot> {
        let pilot = Pilot::new(&self.ready, progress)?;
        if settings.method == Method::Samples {
            return Ok(pilot);
        }
        let passes = pilot.passes(settings.max_error, MOST_SAMPLES / SAMPLES);
        // Where samples do not suffice, what is summed up may be off by more, as long as it is off by less than they.
        let left = pilot.noise(pilot.passes(settings.max_error, most));
        let better = if left > settings.max_error { BETTER * left } else { 0.0 };
        let mut changed = false;
        if settings.method == Method::Auto
            && let Some(error) = flats::sum_up(&mut self.ready, &pilot, passes, (self.allowed, better), progress)?
        {
            self.error = self.error.hypot(error);
            changed = true;
        }
        let found = two_pass::two_passes(&mut self.ready, &pilot, passes, settings, progress)?;
        changed |= self.ready.two_passes.iter().any(Option::is_some);
        (self.two_pass, self.environments) = (found.error, found.reports);
        if changed { Pilot::new(&self.ready, progress) } else { Ok(pilot) }
    }

    /// The same error, against much finer sums of more pixels.
    ///
    /// # Errors
    /// As [`PreparedScene::new`].
    pub(crate) fn checked(&self, scene: &Scene, folder: &Path, progress: &dyn Progress) -> Result<f64> {
        let accuracy = Accuracy::new(CHECK * self.ready.accuracy.error, None);
        let mut fine = PreparedScene::like(Some(&self.ready), scene, folder, accuracy, progress)?;
        flats::sum_up_finer(&mut fine, &self.ready, progress)?;
        // Two passes were measured already; samples in their place would count as an error.
        fine.two_passes.clone_from(&self.ready.two_passes);
        Ok(compared(&self.ready, &fine, CHECKED, progress)?.unwrap_or(0.0).hypot(self.two_pass))
    }

    /// What to know of two passes that miss the error asked for.
    pub(crate) fn two_pass_warning(&self, wanted: f64) -> Option<String> {
        (self.two_pass > wanted).then(|| {
            format!(
                "two passes are off by {:.2} % (measured), {:.2} % are asked for: choose the method auto or samples, or allow a larger error",
                100.0 * self.two_pass,
                100.0 * wanted
            )
        })
    }

    /// What to know of them.
    pub(crate) fn warning(&self) -> Option<String> {
        // Next to what is allowed is near enough: it is a part of the whole error only.
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
