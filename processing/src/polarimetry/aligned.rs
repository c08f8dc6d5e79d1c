//! Photographs that a wedged analyser or a loose stage has shifted against each other, laid over each other again.

use super::FrameNoise;
use super::merge::Merge;
use super::running::{Running, Sums, noise_of_bracket, read, sampled};
use super::sample::Sample;
use crate::Result;
use crate::image::registration::{Registrar, Registration, Resampler, Shift};
use crate::progress::Progress;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Root mean square shift in pixels from which moving photographs back gains more at edges than resampling them costs, and
/// how many standard deviations it must have.
const WORTH_PX: f64 = 0.05;
const WORTH_SIGMA: f64 = 3.0;

/// Whether photographs that are shifted against each other are moved back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Align {
    /// Where the shifts are worth it.
    #[default]
    Auto,
    /// Never; the shifts are told all the same.
    Off,
}

impl std::str::FromStr for Align {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            _ => Err(format!("{text:?} is neither auto nor off")),
        }
    }
}

/// How far the photographs are shifted against each other.
#[derive(Clone, Debug, Serialize)]
pub struct Alignment {
    /// Where each photograph's content lies against the mean of all, in pixels right and down; empty when it cannot be told.
    pub shifts_px: Vec<[f64; 2]>,
    /// Largest standard deviation of a shift.
    pub sigma_px: Option<f64>,
    /// The photographs were moved back: the shifts are worth it.
    pub corrected: bool,
    /// Why shifts cannot be told.
    pub doubt: Option<String>,
}

/// Which shifts the photographs have; `None` for sensors that take all angles at once.
pub(super) fn alignment(registrar: Option<&Registrar>, angles: &[f64]) -> Option<Alignment> {
    Some(match registrar?.polarized(angles) {
        Registration::Told(shifts) => {
            let sigma = shifts.iter().map(|s| s.sigma).fold(0.0, f64::max);
            let square = |s: &Shift| s.dx * s.dx + s.dy * s.dy;
            let rms = (shifts.iter().map(square).sum::<f64>() / shifts.len().max(1) as f64).sqrt();
            Alignment {
                shifts_px: shifts.iter().map(|s| [s.dx, s.dy]).collect(),
                sigma_px: Some(sigma),
                corrected: rms > WORTH_PX && rms > WORTH_SIGMA * sigma,
                doubt: None,
            }
        }
        Registration::CannotTell(doubt) => {
            Alignment { shifts_px: vec![], sigma_px: None, corrected: false, doubt: Some(doubt.to_string()) }
        }
    })
}

/// Reads all photographs again and folds them into new sums, each moved back by its view's shift.
pub(super) fn fit_moved_back(
    running: &Running,
    shifts: &[[f64; 2]],
    progress: &dyn Progress,
) -> Result<(Sums, Sample)> {
    let Running { frames, linearizer, brackets, views, .. } = running;
    let (width, height) = (frames.info.width, frames.info.height);
    progress.stage("moving photographs back", views.len() as u64);
    let mut sums = Sums::new(matches!(running.sums, Sums::Weighted(_)), width, height);
    let mut sample = running.sample.emptied();
    for (view, shift) in views.iter().zip(shifts) {
        progress.check()?;
        let bracket = &brackets[view.bracket];
        let photographs = read(frames, linearizer, bracket)?;
        let back = Resampler::new(*shift, width, height);
        let merge = Merge::new(noise_of_bracket(frames, linearizer, bracket)).scaled(back.noise_factor());
        let row = |k: usize, y: usize, values: &mut [f32], bad: &mut [u8]| {
            back.row(y, |y, v, b| photographs[k].row(y, v, b), values, bad);
        };
        sums.add(view.angle, &merge, row);
        sampled(&mut sample, photographs.len(), &merge, row);
        progress.step();
    }
    Ok((sums, sample))
}

/// What resampling leaves of the noise that a camera is said to have.
pub(super) fn smoothed_noise(noise: &mut [FrameNoise], shifts: &[[f64; 2]], [width, height]: [usize; 2]) {
    for (noise, shift) in noise.iter_mut().zip(shifts) {
        let factor = Resampler::new(*shift, width, height).noise_factor();
        (noise.shot, noise.floor) = (noise.shot * factor, noise.floor * factor);
    }
}

/// How much larger the variance of a mean over many pixels is than the resampled pixels' own noise says, since they share it.
pub(super) fn correlated(shifts: &[[f64; 2]], [width, height]: [usize; 2]) -> f64 {
    let left = |shift: &[f64; 2]| Resampler::new(*shift, width, height).noise_factor();
    shifts.len().max(1) as f64 / shifts.iter().map(left).sum::<f64>().max(f64::MIN_POSITIVE)
}
