//! Response of a nonlinear camera: a polynomial from file values to light, fitted to means at several exposures.

use crate::transfer::Level;
use nacre_frames::Transfer;
use nalgebra::{DMatrix, DVector};
use schemars::JsonSchema;
use serde::Serialize;

/// Mean relative deviation below which no further coefficient is fitted. A deviation of 0.1 % leaves 1 % of error in
/// the slope at low light, which is the gain.
const LINEAR: f64 = 5e-5;

/// Largest deviation with a further coefficient, relative to that without it, for which the coefficient is kept.
const WORTHWHILE: f64 = 0.5;

/// Highest number of coefficients.
const MOST: usize = 3;

/// Exposures that a fit requires. Noise alone halves the deviation of a linear camera in 1 to 2 % of series of seven
/// exposures, and in 13 % of series of four.
const LEAST: usize = 7;

/// Range of the values between black and white that the fit uses (EMVA 1288).
pub const RANGE: [f64; 2] = [0.05, 0.95];

/// Response of a camera: a value v between black (0) and white (1) is the light v (1 + a v + b v² + c v³), which is v
/// at low light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "CameraResponse")]
pub struct Response {
    /// The coefficients a, b and c, as in `"transfer": {"polynomial": …}` of a `frames.json`.
    pub coefficients: [f64; 3],
    /// File value without light.
    pub black_dn: f64,
    /// File value of a saturated pixel.
    pub white_dn: f64,
    /// Mean deviation of file values from proportionality to the exposure, as a share.
    pub deviation: f64,
}

impl Response {
    /// The response of a linear camera.
    pub fn linear(black_dn: f64, white_dn: f64) -> Self {
        Self { coefficients: [0.0; 3], black_dn, white_dn, deviation: 0.0 }
    }

    /// True if values are proportional to light.
    pub fn is_linear(&self) -> bool {
        self.coefficients == [0.0; 3]
    }

    /// The corrected value in DN: proportional to light above black, and equal to the file value at low light.
    pub fn linearised(&self, dn: f64) -> f64 {
        let [a, b, c] = self.coefficients;
        let v = (dn - self.black_dn) / (self.white_dn - self.black_dn);
        dn + (dn - self.black_dn) * v * (a + v * (b + v * c))
    }

    /// Measures the response from levels with light; `black(level)` is the value of darkness at its exposure. The
    /// number of coefficients is the smallest that leaves a mean deviation of 0.005 %, or that a further one does not
    /// halve.
    pub fn measure(levels: &[Level], black: &dyn Fn(&Level) -> f64, [black_dn, white_dn]: [f64; 2]) -> Self {
        let span = white_dn - black_dn;
        let points: Vec<[f64; 2]> = levels
            .iter()
            .filter(|l| l.is_whole())
            .map(|l| [l.exposure_s, (l.mean_dn - black(l)) / span])
            .filter(|[_, v]| (RANGE[0]..=RANGE[1]).contains(v))
            .collect();
        let mut best = Self::linear(black_dn, white_dn);
        let Some((_, mut deviation)) = fit(&points, 0) else { return best };
        best.deviation = deviation;
        for count in 1..=MOST {
            if deviation <= LINEAR {
                break;
            }
            let Some((coefficients, remaining)) = fit(&points, count) else { break };
            let rises = Transfer::Polynomial(coefficients).check_known().is_ok();
            if !rises || remaining > WORTHWHILE * deviation {
                break;
            }
            (best.coefficients, deviation) = (coefficients, remaining);
        }
        best
    }
}

/// Coefficients and mean relative deviation of light that is proportional to the exposure, with `count` coefficients.
/// `None` for too few points.
fn fit(points: &[[f64; 2]], count: usize) -> Option<([f64; 3], f64)> {
    if points.len() < LEAST {
        return None;
    }
    // v + a v² + b v³ + c v⁴ = slope · t; relative deviations are least.
    let longest = points.iter().map(|[t, _]| *t).fold(0.0, f64::max);
    let row = |[t, v]: &[f64; 2]| {
        let mut row = vec![t / longest / v];
        row.extend((1..=count as i32).map(|k| -v.powi(k)));
        row
    };
    let rows: Vec<f64> = points.iter().flat_map(row).collect();
    let design = DMatrix::from_row_slice(points.len(), 1 + count, &rows);
    let wanted = DVector::from_element(points.len(), 1.0);
    let found = design.clone().svd(true, true).solve(&wanted, 1e-12).ok()?;
    let deviation = (design * &found - wanted).abs().sum() / points.len() as f64;
    let mut coefficients = [0.0; 3];
    coefficients.iter_mut().zip(found.iter().skip(1)).for_each(|(to, from)| *to = *from);
    Some((coefficients, deviation))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels of a camera that reads `electrons (1 - loss · electrons)`, of full well 1, with light of some flicker.
    fn levels(loss: f64, flicker: f64) -> Vec<Level> {
        let level = |k: u32| {
            let light = f64::from(k) / 12.0 * (1.0 + flicker * f64::from(k * 7919 % 13).sin());
            Level {
                exposure_s: 0.1 * f64::from(k),
                photographs: 2,
                mean_dn: 100.0 + 4000.0 * light * (1.0 - loss * light),
                variance_dn2: 1.0,
                variance_sigma_dn2: 0.1,
                unsaturated: 1.0,
                high_dn: 4000.0,
            }
        };
        (1..=12).map(level).collect()
    }

    #[test]
    fn a_curved_response_is_straightened_and_a_straight_one_is_kept() {
        let measured = |loss, flicker| Response::measure(&levels(loss, flicker), &|_| 100.0, [100.0, 4100.0]);
        assert!(measured(0.0, 0.0).is_linear());
        assert!(measured(0.0, 0.003).is_linear(), "flicker");
        for loss in [0.02, 0.08, 0.15] {
            let found = measured(loss, 0.0);
            let off = |light: f64| {
                let dn = 100.0 + 4000.0 * light * (1.0 - loss * light);
                ((found.linearised(dn) - 100.0) / (4000.0 * light) - 1.0).abs()
            };
            let worst = [0.1, 0.3, 0.6, 0.9].into_iter().map(off).fold(0.0, f64::max);
            assert!(worst < 0.01 && !found.is_linear(), "{loss}: {worst} {found:?}");
        }
        assert!(Response::measure(&levels(0.1, 0.0)[..6], &|_| 100.0, [100.0, 4100.0]).is_linear(), "too few");
    }
}
