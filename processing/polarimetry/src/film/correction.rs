//! Corrects the points (S1/S0, S2/S0) for oblique incidence, so that one curve holds for all pixels.

use crate::film::camera_position::{CameraPosition, Oblique};
use crate::film::choose::{Choice, choose, difference_of};
use crate::film::cloud::CloudPoint;
use crate::film::curve::{Curve, Film, Source};
use crate::film::invert_curve::{Table, distance2};
use crate::film::models::Model;
pub use crate::film::oblique::{Incidence, Material, curve_at};
use crate::film::search::{Begin, refitted};
use crate::film::solve_options::SolveOptions;
use num_complex::Complex;
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::PI;

/// Report of the oblique-incidence correction.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct ObliqueReport {
    /// Largest angle of incidence in the photographs, in degrees.
    pub largest_deg: f64,
    /// Whether the correction was requested.
    pub asked: bool,
    /// Whether the correction was applied.
    pub corrected: bool,
    /// Remaining error of a typical orientation in degrees; part of the model's error.
    pub left_deg: f64,
    /// Assumed material.
    pub material: Material,
    /// Scatter of the points about the curve relative to their noise, without and with the correction; `None` if it was
    /// not tried.
    pub scatter: Option<[f64; 2]>,
    /// Decrease of −2 ln likelihood by the correction, on the points used for model comparison.
    pub gain: Option<f64>,
}

impl ObliqueReport {
    fn new(camera: &CameraPosition, material: Material, asked: Oblique) -> Self {
        Self {
            largest_deg: camera.largest_sin2.sqrt().asin().to_degrees(),
            asked: asked == Oblique::Auto,
            corrected: false,
            left_deg: 0.0,
            material,
            scatter: None,
            gain: None,
        }
    }

    /// Warning for the user.
    pub fn warning(&self) -> Option<String> {
        let most = FIRST_ORDER.sqrt().asin().to_degrees();
        let remedy = if self.largest_deg > most {
            format!("more than {most:.0}° off the normal it cannot be taken out")
        } else if self.asked {
            return None;
        } else {
            "--oblique auto takes it out where the points tell".into()
        };
        (self.left_deg > WARNING_DEG).then(|| {
            format!(
                "light falls in at up to {:.0}°, which makes orientations wrong by some {:.2}°, as σ says: {remedy}",
                self.largest_deg, self.left_deg
            )
        })
    }
}

/// Orientation error in degrees below which no warning is issued.
const WARNING_DEG: f64 = 0.1;

/// Correction, in standard deviations of a pixel, below which it is skipped.
const MIN_DISPLACEMENT: f64 = 0.1;

/// Largest sin² of the angle of incidence (25°) for the correction. At larger angles, higher-order terms are as large
/// as the signal, and a fit would attribute them to a non-existent film (`nacre chart stress-oblique`).
const FIRST_ORDER: f64 = 0.18;

/// Number of points that decide on the correction.
const SAMPLE_POINTS: usize = 6000;

/// Displacement of a point per unit of [`CameraPosition::at`]: constant, cos 2φ and sin 2φ terms.
type Displacements = [[f32; 2]; 3];

/// Correction of oblique incidence for a film, to first order in sin² of the angle.
pub(crate) struct Correction {
    camera: CameraPosition,
    /// Maps a point to its position on the curve at normal incidence.
    table: Table,
    /// Displacements at positions along the curve.
    displacements: Vec<Displacements>,
    /// Position of bare metal at normal incidence, and its displacement.
    mirror: ([f32; 2], Displacements),
}

/// Number of positions along the curve.
const STEPS: usize = 256;

/// Squared distance to the position of bare metal, in squared standard deviations, within which points get its
/// displacement.
const MIRROR: f32 = 16.0;

impl Correction {
    fn new(camera: CameraPosition, material: &Material, film: &Film) -> Self {
        // Finite differences at a typical angle, so that higher-order terms are correct on average.
        let sin2 = (0.5 * camera.largest_sin2).max(1e-6);
        let at = |sin2: f64, phi: f64| curve_at(film, &Incidence::new(material, sin2, phi));
        let (straight, curves) = (at(0.0, 0.0), AZIMUTHS.map(|phi| at(sin2, phi)));
        let of_step = |k: usize| {
            let theta = PI * k as f64 / STEPS as f64;
            displacements(straight.at(theta), curves.each_ref().map(|c| c.at(theta)), sin2)
        };
        let mirror_position = |curve: &Curve| curve.mirror.unwrap_or_default();
        let mirror = displacements(mirror_position(&straight), curves.each_ref().map(mirror_position), sin2);
        Self {
            displacements: (0..STEPS).map(of_step).collect(),
            mirror: (mirror_position(&straight).map(|v| v as f32), mirror),
            table: Table::new(straight),
            camera,
        }
    }

    /// The point as it would be at normal incidence.
    #[inline]
    pub fn straightened(&self, pixel: usize, at: [f32; 2], variance: [f32; 3]) -> [f32; 2] {
        let incidence = self.camera.at(pixel);
        let back = |displacements: &Displacements| -> [f32; 2] {
            std::array::from_fn(|i| at[i] - (0..3).map(|k| incidence[k] * displacements[k][i]).sum::<f32>())
        };
        let (mirror, displacements) = &self.mirror;
        let straight = back(displacements);
        if distance2(straight, *mirror, variance) < MIRROR {
            return straight;
        }
        let mut straight = at;
        // The displacement depends on the corrected position, so it is iterated.
        for _ in 0..2 {
            let theta = self.table.theta(straight, variance);
            let k = (theta * (STEPS as f32 / std::f32::consts::PI) + 0.5).rem_euclid(STEPS as f32) as usize;
            straight = back(&self.displacements[k.min(STEPS - 1)]);
        }
        straight
    }

    /// Root mean square displacement of points, in standard deviations.
    fn displacement(&self, points: &[CloudPoint]) -> f64 {
        let square = |p: &CloudPoint| {
            let straight = self.straightened(p.pixel, p.at.map(|v| v as f32), p.covariance.map(|v| v as f32));
            let ([a, b, c], x, y) = (p.weights(), f64::from(straight[0]) - p.at[0], f64::from(straight[1]) - p.at[1]);
            a * x * x + 2.0 * b * x * y + c * y * y
        };
        (points.iter().map(square).sum::<f64>() / points.len().max(1) as f64).sqrt()
    }

    /// Effect of the correction on the selected model. The first value is the scatter variance of corrected points
    /// about the refitted model, relative to their noise. The second is the orientation difference in rad between the
    /// selected model and the refitted one: the error caused by oblique incidence.
    fn rotation(&self, choice: &Choice, points: &[CloudPoint]) -> Option<(f64, f64)> {
        let (chosen, straight) = (&choice.candidates[choice.chosen], self.straighten(points));
        let straightened = refitted(chosen, &straight)?;
        Some((straightened.widened, difference_of((chosen, points), (&straightened, &straight))))
    }

    fn straighten(&self, points: &[CloudPoint]) -> Vec<CloudPoint> {
        let straight = |p: &CloudPoint| {
            let at = self.straightened(p.pixel, p.at.map(|v| v as f32), p.covariance.map(|v| v as f32));
            CloudPoint { at: at.map(f64::from), ..*p }
        };
        points.iter().map(straight).collect()
    }
}

/// Azimuths of the finite differences.
const AZIMUTHS: [f64; 3] = [0.0, PI / 3.0, 2.0 * PI / 3.0];

/// Displacements per sin² of the angle of incidence, from the point at normal incidence and at the azimuths.
fn displacements(from: [f64; 2], at: [[f64; 2]; 3], sin2: f64) -> Displacements {
    let weights = [
        AZIMUTHS.map(|_| 1.0 / 3.0),
        AZIMUTHS.map(|a| 2.0 / 3.0 * (2.0 * a).cos()),
        AZIMUTHS.map(|a| 2.0 / 3.0 * (2.0 * a).sin()),
    ];
    weights.map(|w| [0, 1].map(|i| (0..3).map(|k| w[k] * (at[k][i] - from[i])).sum::<f64>() / sin2).map(|v| v as f32))
}

/// The selected model, and the correction applied before its selection.
pub(crate) struct Corrected {
    pub choice: Choice,
    pub correction: Option<Correction>,
    pub report: Option<ObliqueReport>,
}

/// Selects a model. The correction of oblique incidence is applied if requested and if it increases the likelihood. Its
/// remaining effect is added to the model's error.
pub(crate) fn choose_corrected(points: &[CloudPoint], options: &SolveOptions, distorted: f64) -> Option<Corrected> {
    let plain = choose(points, options.model, Begin::Anywhere, distorted, options.source)?;
    let Some((camera, material)) = options.camera else {
        return Some(Corrected { choice: plain, correction: None, report: None });
    };
    // At least as many as needed to detect a film.
    let few: Vec<CloudPoint> = points.iter().step_by((points.len() / SAMPLE_POINTS).max(1)).copied().collect();
    // A circle has two explanations: either of the two terms of the field (grating or mirror) may be the larger one.
    let guesses = plain.candidates[plain.assumed].film.into_iter().chain(circles(&plain, options.source));
    let corrections: Vec<Correction> = guesses
        .map(|film| Correction::new(camera, &material, &film))
        .filter(|c| c.displacement(&few) > MIN_DISPLACEMENT)
        .collect();
    // Of these explanations, the one with the smallest scatter of corrected points.
    let turned = corrections.iter().filter_map(|c| c.rotation(&plain, &few));
    let left = turned.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |(_, turn)| turn);
    let mut report = ObliqueReport::new(&camera, material, options.oblique);
    let can_be_corrected = options.oblique == Oblique::Auto && camera.largest_sin2 <= FIRST_ORDER;
    let mut found = None;
    if can_be_corrected
        && let Some((choice, correction)) = with_correction(points, &few, &plain, corrections, (options, distorted))
    {
        let gain = plain.likelihood - choice.likelihood;
        report.corrected = gain > 0.0;
        (report.scatter, report.gain) = (Some([plain.scatter(), choice.scatter()]), Some(gain));
        found = report.corrected.then_some((choice, correction));
    }
    // After a first-order correction, the second-order effect remains.
    let left = left * if report.corrected { camera.largest_sin2 } else { 1.0 };
    report.left_deg = left.to_degrees();
    let (mut choice, correction) = found.map_or((plain, None), |(choice, correction)| (choice, Some(correction)));
    choice.systematic = choice.systematic.hypot(left);
    choice.error = choice.error.map(|error| error.hypot(left));
    Some(Corrected { choice, correction, report: Some(report) })
}

/// The selected model for corrected points, and the correction.
fn with_correction(
    points: &[CloudPoint],
    few: &[CloudPoint],
    plain: &Choice,
    corrections: Vec<Correction>,
    (options, distorted): (&SolveOptions, f64),
) -> Option<(Choice, Correction)> {
    let (camera, material) = options.camera?;
    let at = |points: &[CloudPoint], films: &[Film]| {
        choose(points, options.model, Begin::At(films), distorted, options.source)
    };
    let films = plain.films();
    let tried = corrections.into_iter().filter_map(|c| Some((at(&c.straighten(few), &films)?.likelihood, c)));
    let (_, first) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // The corrected points determine the film, which in turn determines the final correction.
    let found = choose(&first.straighten(few), options.model, Begin::Anywhere, distorted, options.source)?;
    let film = found.candidates[found.chosen].film;
    let correction = film.map_or(first, |film| Correction::new(camera, &material, &film));
    Some((at(&correction.straighten(points), &found.films())?, correction))
}

/// Gratings without a film whose circle has the fitted size: |a| > |b|, as for embossed metal, and the opposite.
fn circles(choice: &Choice, source: Source) -> Vec<Film> {
    let circle = choice.candidates.iter().find(|c| c.model == Model::Circle);
    let Some(radius) = circle.map(|c| c.size().clamp(1e-3, 0.999)) else { return vec![] };
    let small = (1.0 - (1.0 - radius * radius).sqrt()) / radius;
    [small, 1.0 / small]
        .map(|size| {
            let k = Complex::new(0.0, size);
            let ratio = (k - 1.0) / (k + 1.0);
            Film { ln_r: ratio.norm().ln(), zeta: ratio.arg(), source, ..Film::NONE }
        })
        .to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle_difference;
    use crate::film::models::orientation;
    use crate::film::projection::CurveSamples;
    use crate::synthetic::{normal, uniform};
    use nacre_frames::Distances;

    /// Points of the exact curves, at every angle of incidence in view, return to the curve at normal incidence.
    /// Higher-order terms in sin² cost less than 0.15° of orientation at 15°, where oblique incidence itself costs
    /// several degrees.
    #[test]
    fn points_are_corrected_to_normal_incidence() {
        let film = Film { ln_r: 0.05, zeta: 2.9, retardance: 0.17, axis: 0.4, ..Film::NONE };
        let (size, pixel_um) = (200, 500.0);
        let geometry = Distances { distance_mm: 500.0, baseline_mm: 170.0, pixel_um: Some(pixel_um), camera_px: None };
        let camera = CameraPosition::new(&geometry, [size, size], 1).unwrap();
        let material = Material::default();
        assert!((14.0..17.0).contains(&camera.largest_sin2.sqrt().asin().to_degrees()));
        let correction = Correction::new(camera, &material, &film);
        let straight = film.curve();
        let (mut without, mut with) = (0.0_f64, 0.0_f64);
        for pixel in (0..size * size).step_by(37) {
            let [sin2, cos, sin] = camera.at(pixel).map(f64::from);
            let theta = 0.01 * pixel as f64;
            let at = curve_at(&film, &Incidence::new(&material, sin2, 0.5 * sin.atan2(cos))).at(theta);
            let (wanted, speed) = straight.with_tangent(theta);
            let off = |p: [f64; 2]| (p[0] - wanted[0]).hypot(p[1] - wanted[1]) / speed[0].hypot(speed[1]);
            let variance = [1e-4, 0.0, 1e-4];
            let back = correction.straightened(pixel, at.map(|v| v as f32), variance).map(f64::from);
            (without, with) = (without.max(off(at)), with.max(off(back)));
        }
        let [without, with] = [without, with].map(f64::to_degrees);
        println!("at most {without}° without, {with}° with the correction");
        assert!(with < 0.15 && without > 10.0 * with, "{without} {with}");
    }

    /// The reported remaining effect of oblique incidence matches the actual orientation errors beyond noise, within a
    /// factor of 1.5. Measured ratios: 0.72 to 0.79; a factor of 0.8 is that of the reported mean to a root mean
    /// square.
    #[test]
    fn the_remaining_error_is_reported() {
        let film = Film { ln_r: 0.05, zeta: 2.9, retardance: 0.17, axis: 0.4, ..Film::NONE };
        let (size, sigma, material) = (200, 0.002, Material::default());
        for baseline_mm in [100.0, 170.0, 300.0] {
            let geometry = Distances { distance_mm: 500.0, baseline_mm, pixel_um: Some(500.0), camera_px: None };
            let camera = CameraPosition::new(&geometry, [size, size], 1).unwrap();
            let theta = |pixel: usize| PI * uniform(3, pixel as u64);
            let point = |pixel: usize| {
                let [sin2, cos, sin] = camera.at(pixel).map(f64::from);
                let at = curve_at(&film, &Incidence::new(&material, sin2, 0.5 * sin.atan2(cos))).at(theta(pixel));
                let at = [0, 1].map(|k| at[k] + sigma * normal(k as u64, pixel as u64));
                CloudPoint { pixel, at, covariance: [sigma * sigma, 0.0, sigma * sigma], snr: 100.0 }
            };
            let points: Vec<CloudPoint> = (0..size * size).step_by(5).map(point).collect();
            let options = SolveOptions { camera: Some((camera, material)), ..SolveOptions::of(Model::Auto) };
            let Corrected { choice, report, .. } = choose_corrected(&points, &options, 0.0).unwrap();
            let chosen = &choice.candidates[choice.chosen];
            let curve_samples = CurveSamples::new(chosen.curve);
            let off: Vec<(f64, f64)> = points
                .iter()
                .map(|p| {
                    let (found, sigma) = orientation(chosen, &curve_samples, p);
                    (found - theta(p.pixel), sigma)
                })
                .collect();
            let (sin, cos) = off.iter().fold((0.0, 0.0), |(s, c), (d, _)| (s + (2.0 * d).sin(), c + (2.0 * d).cos()));
            let offset = 0.5 * f64::atan2(sin, cos);
            let mean = |of: &dyn Fn(&(f64, f64)) -> f64| off.iter().map(of).sum::<f64>() / off.len() as f64;
            let error = mean(&|(d, _)| angle_difference(*d, offset).powi(2)).sqrt();
            let beside_noise = (error * error - mean(&|(_, sigma)| sigma * sigma)).max(0.0).sqrt().to_degrees();
            let left = report.unwrap().left_deg;
            println!("{baseline_mm} mm: {beside_noise:.3}° off, {left:.3}° told, by {}", chosen.name());
            assert!(
                (left / beside_noise).ln().abs() < 1.5f64.ln(),
                "{baseline_mm} mm: {beside_noise}° off, {left}° told"
            );
        }
    }
}
