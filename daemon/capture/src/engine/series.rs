//! Adaptive series: selection of the next angle or fringes, and the decision to end.

use crate::plan::{Added, MORE, UntilDecided, UntilSigma};
use crate::session::{Ending, FringesSoFar, SeriesEnd, SigmaSoFar, SoFar};
use nacre_base::{Error, Result};
use nacre_periods::fringes::Survey;
use nacre_polarimetry::{Precision, Running, UNREACHABLE_FACTOR};

/// Continuation of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decision {
    /// Continue.
    Next {
        /// Addition to the series.
        added: Added,
        /// State before the addition.
        so_far: SoFar,
    },
    /// Continue with this addition, and end.
    Last(Added),
    /// End of the series.
    End(SeriesEnd),
}

/// Decides from the photographs alone, so that a resumed session decides alike. `limits_deg` is the range of the stage.
///
/// # Errors
/// `Input` if the angles do not determine an orientation.
pub fn decide(running: &Running, wanted: UntilSigma, limits_deg: [f64; 2]) -> Result<(SoFar, Decision)> {
    let precision = running.precision()?;
    let so_far = SigmaSoFar {
        angles: precision.angles(),
        sigma_deg: precision.sigma().map(f64::to_degrees),
        until_sigma_deg: wanted.until_sigma_deg,
        at_most: wanted.at_most,
        least_deg: precision.least_sigma_after(wanted.at_most as usize).map(f64::to_degrees),
    };
    let decision = match ending(&so_far, precision.is_certain()) {
        Some(why) => Decision::End(SeriesEnd { why, so_far: SoFar::Sigma(so_far) }),
        None => {
            let analyser_deg = next_angle(&precision, running, limits_deg)?;
            Decision::Next { added: Added::Angle { analyser_deg }, so_far: SoFar::Sigma(so_far) }
        }
    };
    Ok((SoFar::Sigma(so_far), decision))
}

/// As [`decide`], for a fringe series with this number of complete fringes. `besides` frames precede the fringes.
///
/// # Errors
/// `Input` if the frames are no fringe series.
pub fn decide_fringes(survey: &mut Survey, wanted: UntilDecided, besides: usize) -> Result<(SoFar, Decision)> {
    let phases = wanted.phases as usize;
    let share = |survey: &mut Survey, fringes: u32| {
        survey.decided(besides + phases * fringes as usize, wanted.period_sigma).map(|d| d.share())
    };
    // The initial fringes are evaluated each time, so that a resumed session estimates the same aperture and decides
    // alike.
    let first = share(survey, wanted.start)?;
    let fringes = ((survey.added() - besides) / phases) as u32;
    let undecided = if fringes == wanted.start { first } else { share(survey, fringes)? };
    let so_far = FringesSoFar { fringes, undecided, until_undecided: wanted.undecided, at_most: wanted.at_most };
    // State four fringes earlier.
    let earlier = fringes.checked_sub(2 * MORE).filter(|f| *f >= wanted.start);
    let before = earlier.map(|f| share(survey, f)).transpose()?.flatten();
    let so = SoFar::Fringes(so_far);
    let decision = match enough(&so_far, before) {
        Some(why) => Decision::End(SeriesEnd { why, so_far: so }),
        None => {
            let fringes = (fringes + MORE).min(wanted.at_most);
            Decision::Next { added: Added::Fringes { fringes }, so_far: so }
        }
    };
    Ok((so, decision))
}

/// Fraction of undecided pixels remaining after the last fringes, relative to before, above which a series is
/// abandoned.
const HARDLY: f64 = 0.9;

fn enough(so_far: &FringesSoFar, before: Option<f64>) -> Option<Ending> {
    let Some(undecided) = so_far.undecided else { return Some(Ending::Cannot) };
    if undecided <= so_far.until_undecided {
        return Some(Ending::Met);
    }
    if so_far.fringes >= so_far.at_most {
        return Some(Ending::AtMost);
    }
    before.is_some_and(|b| undecided > HARDLY * b).then_some(Ending::Cannot)
}

fn ending(so_far: &SigmaSoFar, certain: bool) -> Option<Ending> {
    let wanted = so_far.until_sigma_deg;
    if so_far.sigma_deg.is_some_and(|sigma| sigma <= wanted) {
        return Some(Ending::Met);
    }
    if so_far.angles >= so_far.at_most as usize {
        return Some(Ending::AtMost);
    }
    let unreachable = so_far.least_deg.is_none_or(|least| least > UNREACHABLE_FACTOR * wanted);
    (certain && unreachable).then_some(Ending::Cannot)
}

/// Best whole-degree angle within range of the stage, other than its present one, so that a repetition is approached
/// anew.
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
    fn a_scan_ends_when_it_should_and_says_why() {
        let at = |fringes, undecided| FringesSoFar { fringes, undecided, until_undecided: 0.01, at_most: 14 };
        for (so_far, before, wanted) in [
            (at(8, Some(0.01)), None, Some(Ending::Met)),
            (at(8, Some(0.2)), None, None),
            (at(12, Some(0.1)), Some(0.2), None),
            (at(12, Some(0.19)), Some(0.2), Some(Ending::Cannot)),
            (at(14, Some(0.1)), Some(0.2), Some(Ending::AtMost)),
            (at(8, None), None, Some(Ending::Cannot)),
        ] {
            assert_eq!(enough(&so_far, before), wanted, "{so_far:?}");
        }
    }

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
