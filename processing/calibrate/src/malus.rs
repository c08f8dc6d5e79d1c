//! Malus' law of a linear polarizer behind a turning analyser, with an eccentric scale and random angle errors.
//!
//! At the stage's angle ψ the light is `A (1 + x cos 2ψ' + y sin 2ψ')` with `ψ' = ψ + c cos ψ + s sin ψ`. Standard
//! deviations of the light (a share of it) and of the angles are unknown. Restricted maximum likelihood (Patterson and
//! Thompson 1971) estimates both from the residuals. Photographs on the steep flanks then count less than those near
//! the extremes.

use crate::transfer::Measured;
use crate::turn::Light;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Mean A, Stokes parameters x and y relative to it, and eccentricity c and s in rad.
pub type Parameters = [f64; 5];

/// Smallest part of the full turn that determines the eccentricity, in degrees.
const ECCENTRIC_FROM_DEG: f64 = 270.0;

/// Smallest number of angles for the eccentricity: five parameters and as many residuals.
const ECCENTRIC_ANGLES: usize = 10;

/// Searched standard deviations of the angles in rad: 0.0006° to 3°.
const ANGLES: [f64; 2] = [1e-5, 0.05];

/// Searched standard deviations of the light, as a share.
const LIGHTS: [f64; 2] = [1e-6, 0.1];

/// Number of steps of each search over a range, and of searches, each over two steps of the one before.
const STEPS: i32 = 12;
const SEARCHES: usize = 3;

/// Largest number of Gauss-Newton iterations.
const ITERATIONS: usize = 12;

/// Fit of Malus' law.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Parameters.
    pub parameters: Parameters,
    /// Covariance of the parameters, with the uncertainty of the estimated variances.
    pub covariance: DMatrix<f64>,
    /// Whether c and s were fitted; otherwise they are 0.
    pub eccentric: bool,
    /// Standard deviation of the angles in rad.
    pub angle_sigma: f64,
    /// Standard deviation of the light, as a share.
    pub light_sigma: f64,
    /// Residual of each photograph, as a share of A.
    pub residuals: Vec<f64>,
}

impl Fit {
    /// Light of the law at an angle of the stage in degrees.
    pub fn light(&self, stage_deg: f64) -> f64 {
        model(self.parameters, stage_deg.to_radians()).0
    }

    /// A parameter with its standard deviation.
    pub fn parameter(&self, k: usize) -> Measured {
        let variance = if k < self.covariance.nrows() { self.covariance[(k, k)] } else { 0.0 };
        Measured { value: self.parameters[k], sigma: variance.max(0.0).sqrt() }
    }

    /// Contrast: length of (x, y).
    pub fn contrast(&self) -> Measured {
        let [_, x, y, ..] = self.parameters;
        let length = x.hypot(y).max(f64::MIN_POSITIVE);
        Measured { value: length, sigma: self.sigma_along([x / length, y / length]) }
    }

    /// Angle of the brightest light in rad, from 0 to π.
    pub fn parallel(&self) -> Measured {
        let [_, x, y, ..] = self.parameters;
        let length = x.hypot(y).max(f64::MIN_POSITIVE);
        let sigma = 0.5 * self.sigma_along([-y / length, x / length]) / length;
        Measured { value: (0.5 * y.atan2(x)).rem_euclid(PI), sigma }
    }

    /// Standard deviation of (x, y) along a direction.
    fn sigma_along(&self, direction: [f64; 2]) -> f64 {
        let at = |i: usize, j: usize| direction[i] * direction[j] * self.covariance[(i + 1, j + 1)];
        (at(0, 0) + 2.0 * at(0, 1) + at(1, 1)).max(0.0).sqrt()
    }
}

/// Light and its derivatives by the parameters, and by the angle of the stage.
fn model([a, x, y, c, s]: Parameters, stage: f64) -> (f64, [f64; 5], f64) {
    let (sin, cos) = stage.sin_cos();
    let (sin2, cos2) = (2.0 * (stage + c * cos + s * sin)).sin_cos();
    let slope = 2.0 * a * (y * cos2 - x * sin2);
    let relative = 1.0 + x * cos2 + y * sin2;
    (a * relative, [relative, a * cos2, a * sin2, slope * cos, slope * sin], slope)
}

/// Fits the law to measurements at five angles or more; `None` if the angles do not determine it. The eccentricity is
/// fitted if requested and if the angles cover a turn.
pub fn fit(lights: &[Light], eccentric: bool) -> Option<Fit> {
    let eccentric = eccentric && covers_turn(lights) && lights.len() >= ECCENTRIC_ANGLES;
    let count = if eccentric { 5 } else { 3 };
    let freedom = lights.len().checked_sub(count)?;
    let start = harmonic(lights)?;
    let (mut ranges, mut best) = ([ANGLES, LIGHTS], None::<(f64, Solved, [f64; 2])>);
    for _ in 0..SEARCHES {
        let step = |[low, high]: [f64; 2]| (high / low).powf(1.0 / f64::from(STEPS));
        let steps = ranges.map(step);
        for (i, j) in (0..=STEPS).flat_map(|i| (0..=STEPS).map(move |j| (i, j))) {
            let sigmas = [ranges[0][0] * steps[0].powi(i), ranges[1][0] * steps[1].powi(j)];
            let from = best.as_ref().map_or(start, |b| b.1.parameters);
            let Some(solved) = solve(lights, from, count, sigmas) else { continue };
            if best.as_ref().is_none_or(|b| solved.likelihood < b.0) {
                best = Some((solved.likelihood, solved, sigmas));
            }
        }
        let (_, _, found) = best.as_ref()?;
        ranges = [0, 1].map(|k| [found[k] / steps[k].powi(2), found[k] * steps[k].powi(2)]);
    }
    let (_, solved, [angle_sigma, light_sigma]) = best?;
    // Standard deviation of Student's t relative to the normal distribution.
    let wider = if freedom > 2 { freedom as f64 / (freedom - 2) as f64 } else { 3.0 };
    let a = solved.parameters[0];
    let residual = |l: &Light| (l.light - model(solved.parameters, l.stage_deg.to_radians()).0) / a;
    Some(Fit {
        residuals: lights.iter().map(residual).collect(),
        parameters: solved.parameters,
        covariance: solved.covariance * wider,
        eccentric,
        angle_sigma,
        light_sigma,
    })
}

/// Whether the angles cover enough of a turn for the eccentricity.
fn covers_turn(lights: &[Light]) -> bool {
    let mut angles: Vec<f64> = lights.iter().map(|l| l.stage_deg.rem_euclid(360.0)).collect();
    angles.sort_by(f64::total_cmp);
    let gaps = angles.windows(2).map(|w| w[1] - w[0]);
    let around = angles.first().zip(angles.last()).map(|(a, b)| a + 360.0 - b);
    360.0 - gaps.chain(around).fold(0.0, f64::max) >= ECCENTRIC_FROM_DEG
}

/// Parameters of the sinusoid in 2ψ by linear least squares.
fn harmonic(lights: &[Light]) -> Option<Parameters> {
    let row = |l: &Light| {
        let (sin, cos) = (2.0 * l.stage_deg.to_radians()).sin_cos();
        [1.0, cos, sin]
    };
    let matrix = DMatrix::from_fn(lights.len(), 3, |i, k| row(&lights[i])[k]);
    let values = DVector::from_iterator(lights.len(), lights.iter().map(|l| l.light));
    let normal = matrix.transpose() * &matrix;
    let condition = normal.clone().symmetric_eigenvalues();
    if condition.min() < 1e-3 * condition.max() {
        return None;
    }
    let found = normal.try_inverse()? * (matrix.transpose() * values);
    let (a, c, s) = (found[0], found[1], found[2]);
    if a <= 0.0 {
        return None;
    }
    Some([a, c / a, s / a, 0.0, 0.0])
}

struct Solved {
    parameters: Parameters,
    covariance: DMatrix<f64>,
    /// −2 ln of the restricted likelihood.
    likelihood: f64,
}

/// Weighted least squares for given standard deviations of angles and light.
fn solve(lights: &[Light], start: Parameters, count: usize, [of_angle, of_light]: [f64; 2]) -> Option<Solved> {
    let mut parameters = start;
    parameters[count..].fill(0.0);
    let mut last = None;
    for _ in 0..ITERATIONS {
        let mut normal = DMatrix::<f64>::zeros(count, count);
        let mut right = DVector::<f64>::zeros(count);
        let mut likelihood = 0.0;
        for l in lights {
            let (light, derivatives, slope) = model(parameters, l.stage_deg.to_radians());
            let variance = l.variance + (of_light * light).powi(2) + (of_angle * slope).powi(2);
            let variance = variance.max(f64::MIN_POSITIVE);
            let residual = l.light - light;
            likelihood += variance.ln() + residual * residual / variance;
            for j in 0..count {
                right[j] += derivatives[j] * residual / variance;
                for k in 0..count {
                    normal[(j, k)] += derivatives[j] * derivatives[k] / variance;
                }
            }
        }
        let determinant = normal.determinant();
        let covariance = normal.try_inverse()?;
        let step = &covariance * right;
        let small = step.iter().enumerate().all(|(k, d)| d.abs() < 1e-6 * covariance[(k, k)].abs().sqrt());
        step.iter().enumerate().for_each(|(k, d)| parameters[k] += d);
        if !parameters.iter().all(|p| p.is_finite()) || parameters[0] <= 0.0 {
            return None;
        }
        last = Some(Solved { parameters, covariance, likelihood: likelihood + determinant.ln() });
        if small {
            break;
        }
    }
    last.filter(|s| s.likelihood.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_base::random::Stream;
    use nacre_optics::polarization::angle_difference;

    /// Standard normal deviate (Box and Muller 1958).
    fn normal(random: &mut Stream) -> f64 {
        (-2.0 * (1.0 - random.next()).ln()).sqrt() * (2.0 * PI * random.next()).cos()
    }

    /// A full turn, and angles near the crossed direction.
    fn turn(parameters: Parameters, angle_sigma: f64, light_sigma: f64, seed: u64) -> Vec<Light> {
        let mut random = Stream::of(seed);
        let crossed = (0.5 * parameters[2].atan2(parameters[1])).to_degrees() + 90.0;
        let angles = (0..24).map(|k| 15.0 * f64::from(k)).chain([-2.0, -1.0, 1.0, 2.0].map(|d| crossed + d));
        angles
            .map(|stage_deg: f64| {
                let at = stage_deg.to_radians() + angle_sigma * normal(&mut random);
                let light = model(parameters, at).0 * (1.0 + light_sigma * normal(&mut random));
                Light { stage_deg, axis: 0.0, light, variance: 1e-14 }
            })
            .collect()
    }

    /// Errors of 200 random series in standard deviations, for polarizers of all contrasts.
    #[test]
    fn parameters_are_within_their_standard_deviations() {
        let mut beyond = 0;
        for seed in 0..200 {
            let mut random = Stream::of(1000 + seed);
            let contrast = if seed % 4 == 0 { random.next() } else { 1.0 - 10f64.powf(-1.5 - 2.5 * random.next()) };
            let (sin, cos) = (2.0 * PI * random.next()).sin_cos();
            let eccentricity = 0.01 * random.next();
            let truth = [0.5, contrast * cos, contrast * sin, eccentricity, 0.5 * eccentricity];
            let found = fit(&turn(truth, 2e-4, 1e-3, seed), true).unwrap();
            assert!(found.eccentric);
            let errors = [
                (found.contrast(), contrast),
                (found.parameter(3), truth[3]),
                (found.parameter(4), truth[4]),
                (found.parameter(0), 0.5),
            ];
            beyond += errors.iter().filter(|(m, truth)| (m.value - truth).abs() > 3.0 * m.sigma).count();
            let angle = found.parallel();
            let off = angle_difference(angle.value, 0.5 * sin.atan2(cos));
            beyond += usize::from(off.abs() > 3.0 * angle.sigma);
        }
        // 1,000 numbers, of which 0.3 % of normal ones are beyond.
        assert!(beyond <= 10, "{beyond}");
    }

    #[test]
    fn half_a_turn_has_no_eccentricity_and_two_angles_no_fit() {
        let all = turn([0.5, 0.7, 0.7, 0.0, 0.0], 1e-4, 1e-4, 1);
        let half: Vec<Light> = all.iter().copied().filter(|l| l.stage_deg <= 180.0).collect();
        let found = fit(&half, true).unwrap();
        assert!(!found.eccentric && (found.parallel().value - PI / 8.0).abs() < 1e-3);
        let two: Vec<Light> = (0..6).map(|k| all[k % 2]).collect();
        assert!(fit(&two, true).is_none());
    }
}
