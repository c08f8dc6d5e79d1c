//! A series that ends when the orientation is known well enough: which angle comes next, or why there is none.

use crate::plan::UntilSigma;
use crate::session::{Ending, SeriesEnd};
use nacre_processing::polarimetry::{Precision, Running};
use nacre_processing::{Error, Result};
use serde::{Deserialize, Serialize};

/// A request is given up when what can be reached at best misses it by this factor.
const HOPELESS: f64 = 1.2;

/// How well a series knows its orientations so far.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SigmaSoFar {
    /// Analyser angles in it.
    pub angles: usize,
    /// 90th percentile of σ in degrees over the pixels that carry an orientation; none when no pixel does.
    pub sigma_deg: Option<f64>,
    /// Wanted σ in degrees.
    pub until_sigma_deg: f64,
    /// Most angles.
    pub at_most: u32,
    /// What σ will be at least after the most angles, in degrees; none when no pixel will carry an orientation.
    pub least_deg: Option<f64>,
}

/// What comes next in a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decision {
    /// Another angle, in degrees.
    Next {
        /// Where.
        analyser_deg: f64,
        /// σ before it, in degrees.
        sigma_deg: Option<f64>,
    },
    /// Nothing.
    End(SeriesEnd),
}

/// Decides from the photographs so far and nothing else, so that a resumed session decides alike. `limits_deg` is how far
/// the stage turns.
///
/// # Errors
/// `Input` when the angles cannot tell an orientation.
pub fn decide(running: &Running, wanted: UntilSigma, limits_deg: [f64; 2]) -> Result<(SigmaSoFar, Decision)> {
    let precision = running.precision()?;
    let so_far = SigmaSoFar {
        angles: precision.angles(),
        sigma_deg: precision.sigma().map(f64::to_degrees),
        until_sigma_deg: wanted.until_sigma_deg,
        at_most: wanted.at_most,
        least_deg: precision.least_sigma_after(wanted.at_most as usize).map(f64::to_degrees),
    };
    let decision = match ending(&so_far, precision.is_certain()) {
        Some(why) => Decision::End(SeriesEnd { why, so_far }),
        None => {
            let analyser_deg = next_angle(&precision, running, limits_deg)?;
            Decision::Next { analyser_deg, sigma_deg: so_far.sigma_deg }
        }
    };
    Ok((so_far, decision))
}

fn ending(so_far: &SigmaSoFar, certain: bool) -> Option<Ending> {
    let wanted = so_far.until_sigma_deg;
    if so_far.sigma_deg.is_some_and(|sigma| sigma <= wanted) {
        return Some(Ending::Met);
    }
    if so_far.angles >= so_far.at_most as usize {
        return Some(Ending::AtMost);
    }
    let hopeless = so_far.least_deg.is_none_or(|least| least > HOPELESS * wanted);
    (certain && hopeless).then_some(Ending::Cannot)
}

/// The best of the whole degrees that the stage reaches, not the one it stands at: a repeat is approached anew.
fn next_angle(precision: &Precision, running: &Running, [low, high]: [f64; 2]) -> Result<f64> {
    let last = running.frames().last().and_then(|f| f.analyser_deg);
    let reached = |a: &f64| (low..=high).contains(a) && last != Some(*a);
    let candidates: Vec<f64> = (0..180).map(f64::from).filter(reached).collect();
    let radians: Vec<f64> = candidates.iter().map(|a| a.to_radians()).collect();
    let best = precision.best_angle(&radians).and_then(|best| radians.iter().position(|a| *a == best));
    best.map(|k| candidates[k]).ok_or_else(|| {
        let problem = format!("turns from {low}° to {high}° only, where no whole degree from 0 to 179 is left");
        Error::input("the analyser's stage", problem, "list the angles in the plan (analyser.angles_deg)")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_series_ends_when_it_should_and_says_why() {
        let at = |angles, sigma_deg, least_deg| SigmaSoFar {
            angles,
            sigma_deg,
            until_sigma_deg: 0.5,
            at_most: 9,
            least_deg,
        };
        for (so_far, certain, wanted) in [
            (at(4, Some(0.5), Some(0.3)), true, Some(Ending::Met)),
            (at(4, Some(0.7), Some(0.47)), true, None),
            (at(4, Some(0.8), Some(0.59)), true, None),
            (at(4, Some(0.9), Some(0.61)), true, Some(Ending::Cannot)),
            (at(3, Some(0.9), Some(0.61)), false, None),
            (at(4, None, None), true, Some(Ending::Cannot)),
            (at(9, Some(0.51), Some(0.51)), true, Some(Ending::AtMost)),
            (at(9, None, None), true, Some(Ending::AtMost)),
        ] {
            assert_eq!(ending(&so_far, certain), wanted, "{so_far:?}");
        }
    }
}
