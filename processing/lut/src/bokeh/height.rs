//! Conversion of light to height: dark is deep (2017 paper, section 5), along a straight line calibrated with a known
//! grating (Eq. 27).

use super::period::Lines;
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Quantiles of the light that map to relative heights 0 and 1 without a calibration.
const ENDS: [f64; 2] = [0.001, 0.999];

/// Number of phases, and of duty cycles, tried for a known grating.
const PHASES: usize = 360;
const DUTIES: usize = 25;

/// Linear relation of light and height: `height = gain_um · (light / mean light - offset)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Height in µm per mean light of the photograph, above 0: dark is deep.
    pub gain_um: f64,
    /// Light at height 0, relative to the photograph's mean.
    pub offset: f64,
    /// Root mean square deviation from the known grating's profile, in µm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rmse_um: Option<f64>,
    /// The known grating of the calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grating: Option<KnownGrating>,
}

/// Shape of a known grating.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A sinusoid.
    Sinusoid,
    /// Sawtooth: a vertical step and a linear slope, in either direction.
    Blazed,
    /// Rectangular profile; the duty cycle is fitted.
    Rectangular,
}

/// A grating with a known profile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KnownGrating {
    /// Its shape.
    pub shape: Shape,
    /// Peak-to-peak depth in µm.
    pub depth_um: f64,
}

impl Calibration {
    /// Rejects an invalid gain.
    ///
    /// # Errors
    /// `Input`.
    pub fn check(&self) -> Result<()> {
        if self.gain_um > 0.0 && self.gain_um < 1e6 && self.offset.is_finite() {
            return Ok(());
        }
        let problem = format!(
            "has gain_um {} and offset {}; expected a gain above 0, since dark is deep",
            self.gain_um, self.offset
        );
        Err(Error::input("calibration", problem, "give the calibration.json of an earlier result with a known grating"))
    }

    /// Fits the line that maps a slice, relative to the photograph's mean light, to a known profile (2017 paper, Eq.
    /// 27). The fit covers all phases and, depending on the shape, directions and duty cycles.
    ///
    /// # Errors
    /// `Input` for an invalid depth, and if light does not follow the profile.
    pub(super) fn of_known(values: &[f64], lines: &Lines, grating: KnownGrating) -> Result<Self> {
        let bad = |problem: &str, remedy: &str| Error::input("known grating", problem, remedy);
        if !(grating.depth_um > 0.0 && grating.depth_um <= 1000.0) {
            return Err(bad(
                &format!("has a depth of {} µm; expected above 0, at most 1000", grating.depth_um),
                "correct it",
            ));
        }
        let best = grating.profiles().into_iter().filter_map(|profile| closest(values, lines.period_px[0], &profile));
        let best = best.min_by(|a, b| a[2].total_cmp(&b[2]));
        let [gain_um, offset, rmse] =
            best.ok_or_else(|| bad("does not show in the slice", "check the slice and the shape"))?;
        Ok(Self { gain_um, offset, rmse_um: Some(rmse), grating: Some(grating) })
    }

    /// Height in µm of light relative to the mean.
    pub(super) fn height(&self, relative: f64) -> f64 {
        self.gain_um * (relative - self.offset)
    }
}

impl KnownGrating {
    /// Heights in µm over one period, for every direction and duty cycle.
    fn profiles(&self) -> Vec<Vec<f64>> {
        let depth = self.depth_um;
        let over = |of: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (0..PHASES).map(|k| depth * of((k as f64 + 0.5) / PHASES as f64)).collect()
        };
        match self.shape {
            Shape::Sinusoid => vec![over(&|t| 0.5 + 0.5 * (std::f64::consts::TAU * t).cos())],
            Shape::Blazed => vec![over(&|t| t), over(&|t| 1.0 - t)],
            Shape::Rectangular => {
                let share = |k: usize| 0.2 + 0.6 * k as f64 / (DUTIES - 1) as f64;
                (0..DUTIES).map(|k| over(&|t| f64::from(u8::from(t < share(k))))).collect()
            }
        }
    }
}

/// Gain, offset and root mean square residual at the best phase with a positive gain.
fn closest(values: &[f64], period: f64, profile: &[f64]) -> Option<[f64; 3]> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let at = |phase: usize| {
        let height = |i: usize| {
            let place = (i as f64 / period).fract() * PHASES as f64;
            profile[(place as usize + phase) % PHASES]
        };
        let heights: Vec<f64> = (0..values.len()).map(height).collect();
        let high = heights.iter().sum::<f64>() / n;
        let across: f64 = heights.iter().zip(values).map(|(h, v)| (h - high) * (v - mean)).sum();
        let all: f64 = heights.iter().map(|h| (h - high).powi(2)).sum();
        let gain = across / square;
        (gain > 0.0).then(|| [gain, mean - high / gain, ((all - gain * across).max(0.0) / n).sqrt()])
    };
    (0..PHASES).filter_map(at).min_by(|a, b| a[2].total_cmp(&b[2]))
}

/// Light at relative heights 0 and 1.
pub(super) fn ends(light: &[f32]) -> [f64; 2] {
    let step = (light.len() >> 20).max(1);
    let mut known: Vec<f32> = light.iter().step_by(step).copied().filter(|v| v.is_finite()).collect();
    if known.is_empty() {
        return [f64::NAN; 2];
    }
    ENDS.map(|share| {
        let rank = (share * (known.len() - 1) as f64).round() as usize;
        f64::from(*known.select_nth_unstable_by(rank, f32::total_cmp).1)
    })
}

#[cfg(test)]
mod tests {
    use super::super::period::lines;
    use super::*;

    #[test]
    fn a_known_grating_determines_gain_and_offset() {
        for shape in [Shape::Sinusoid, Shape::Blazed, Shape::Rectangular] {
            let grating = KnownGrating { shape, depth_um: 0.4 };
            let profile = grating.profiles().pop().unwrap();
            // height = 0.5 · (light - 0.7)
            let light = |i: usize| {
                let place = (i as f64 / 23.7 + 0.31).fract() * PHASES as f64;
                profile[place as usize % PHASES] / 0.5 + 0.7
            };
            let values: Vec<f64> = (0..500).map(light).collect();
            let found = Calibration::of_known(&values, &lines(&values).unwrap(), grating).unwrap();
            assert!((found.gain_um / 0.5 - 1.0).abs() < 0.02 && (found.offset - 0.7).abs() < 0.02, "{found:?}");
            // One of 500 samples may lie on the wrong side of a steep edge.
            let most = if shape == Shape::Sinusoid { 0.01 } else { (1.01_f64 / 500.0).sqrt() };
            assert!(found.rmse_um.unwrap() < most * 0.4, "{found:?}");
        }
    }

    #[test]
    fn calibrations_of_no_height_are_refused() {
        let of = |gain_um, offset| Calibration { gain_um, offset, rmse_um: None, grating: None };
        assert!(of(0.5, 0.2).check().is_ok());
        assert_eq!(of(0.5, 0.2).height(1.2), 0.5);
        for wrong in [of(-1.0, 0.0), of(0.0, 0.0), of(f64::INFINITY, 0.0), of(1.0, f64::NAN)] {
            assert!(wrong.check().is_err(), "{wrong:?}");
        }
    }
}
