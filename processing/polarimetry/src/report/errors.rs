//! Expected error of a typical orientation, by terms: noise and systematic errors.

use crate::angles::angle_error::{AngleErrorEstimate, angle_sigma};
use crate::angles::sample::{AREA, SIDE, Sample};
use crate::film::choose::Choice;
use crate::film::cloud::{CloudPoint, cloud};
use crate::film::models::{Candidate, orientation};
use crate::film::projection::CurveSamples;
use crate::fit::views::View;
use crate::{Alignment, Design, FrameNoise, MASK_SNR, StokesMaps, angle_difference};
use nacre_base::statistics::median;
use nacre_frames::LoadedFrames;
use schemars::JsonSchema;
use serde::Serialize;

/// Number of points on which errors are propagated to orientations.
const POINTS: usize = 2000;

/// Expected error of a typical orientation after the best common offset, and its terms.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
pub struct ErrorReport {
    /// Camera noise: the median σ.
    pub noise_deg: Option<f64>,
    /// Random analyser-angle errors: root mean square over the orientations in view.
    pub angle_deg: Option<f64>,
    /// Misregistration of the photographs: median over the pixels.
    pub registration_deg: Option<f64>,
    /// Error and uncertainty of the model.
    pub model_deg: Option<f64>,
    /// Total of these terms. Unknown terms count as zero, but without noise or model there is no total.
    pub total_deg: Option<f64>,
    /// Standard deviation of the analyser angles behind `angle_deg`.
    pub angle_sigma_deg: Option<f64>,
    /// Source of that standard deviation.
    pub angle_source: Option<AngleSource>,
}

/// Source of the analyser's accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AngleSource {
    /// Stated in `frames.json`.
    Given,
    /// From residuals that look like angle errors; if few orientations are in view, drifting light looks the same.
    Residuals,
    /// Remaining uncertainty of angles that were corrected by the residuals.
    Corrected,
}

/// Systematic errors in degrees of orientation.
#[derive(Default)]
pub(crate) struct Systematic {
    angle_deg: Option<f64>,
    registration_deg: Option<f64>,
    angle_sigma_deg: Option<f64>,
    angle_source: Option<AngleSource>,
}

impl ErrorReport {
    /// Noise and model, in degrees.
    pub(crate) fn new(noise_deg: Option<f64>, model_deg: Option<f64>) -> Self {
        Self { noise_deg, model_deg, ..Self::default() }.with(Systematic::default())
    }

    /// Adds the systematic terms.
    pub(crate) fn with(self, terms: Systematic) -> Self {
        let Systematic { angle_deg, registration_deg, angle_sigma_deg, angle_source } = terms;
        let known = self.noise_deg.zip(self.model_deg);
        let others = angle_deg.unwrap_or(0.0).hypot(registration_deg.unwrap_or(0.0));
        let total_deg = known.map(|(noise, model)| noise.hypot(model).hypot(others));
        Self { angle_deg, registration_deg, angle_sigma_deg, angle_source, total_deg, ..self }
    }
}

/// A point of the sample, and the sensitivity of its orientation to intensities.
pub(crate) struct Answer {
    pixel: usize,
    /// A, C and S.
    fitted: [f64; 3],
    /// Derivative of the orientation in rad with respect to each view's intensity.
    per_view: Vec<f64>,
}

/// Computes systematic errors of orientations under the selected model (the sinusoid without one).
pub(crate) fn systematic(
    sample: &Sample,
    views: &[View],
    noise: &[FrameNoise],
    choice: Option<&Choice>,
    alignment: Option<&Alignment>,
    angles: &Angles,
) -> Systematic {
    let Some(SampleFit { design, maps }) = SampleFit::new(sample, views) else { return Systematic::default() };
    let answers = answers(&maps, &design, &noise[..design.frames().min(noise.len())], choice);
    // If not all views were stored, the result is scaled to all of them.
    let share = (design.frames() as f64 / views.len().max(1) as f64).sqrt();
    let angle_errors = of_angles(&answers, &design).map(|w| w * share);
    Systematic {
        angle_deg: angles.sigma.zip(angle_errors).map(|(sigma, per)| (sigma * per).to_degrees()),
        registration_deg: of_shifts(views, alignment).and_then(|s| of_registration(&answers, &maps, &design, &s)),
        angle_sigma_deg: angles.sigma.map(f64::to_degrees),
        angle_source: angles.source,
    }
}

/// Accuracy of the analyser's angles.
#[derive(Clone, Copy, Default)]
pub(crate) struct Angles {
    /// Standard deviation in rad.
    pub sigma: Option<f64>,
    source: Option<AngleSource>,
}

impl Angles {
    /// For corrected angles.
    pub(crate) fn corrected(angle_errors: &AngleErrorEstimate) -> Self {
        Self { sigma: Some(angle_errors.sigma), source: Some(AngleSource::Corrected) }
    }

    /// As stated in `frames.json`, or from the sample's residuals.
    pub(crate) fn of(frames: &LoadedFrames, sample: &Sample, views: &[View]) -> Self {
        let (sigma, source) = match frames.set.angle_sigma_deg {
            Some(deg) => (Some(deg.to_radians()), AngleSource::Given),
            // The analysers of a sensor view neighbouring points, and edges would look like angle errors.
            None if views.iter().any(|v| v.block > 1) => (None, AngleSource::Residuals),
            None => {
                let fit = SampleFit::new(sample, views);
                (fit.and_then(|s| angle_sigma(&sample.all(), &s.design, &s.maps)), AngleSource::Residuals)
            }
        };
        Self { sigma, source: sigma.map(|_| source) }
    }
}

/// Fit of Malus' law to all blocks of a sample.
struct SampleFit {
    design: Design,
    maps: StokesMaps,
}

impl SampleFit {
    fn new(sample: &Sample, views: &[View]) -> Option<Self> {
        let kept: Vec<(usize, f64)> = views.iter().map(|v| v.angle).enumerate().take(sample.views()).collect();
        let design = Design::new(&kept.iter().map(|v| v.1).collect::<Vec<_>>()).ok()?;
        let blocks: Vec<usize> = (0..sample.view(0).len() / AREA).collect();
        let maps = sample.solve(&blocks, &kept, &design);
        Some(Self { design, maps })
    }
}

pub(crate) fn answers(
    maps: &StokesMaps,
    design: &Design,
    noise: &[FrameNoise],
    choice: Option<&Choice>,
) -> Vec<Answer> {
    let model = choice.map(|c| &c.candidates[c.chosen]);
    let curve_samples = model.map(|m| CurveSamples::new(m.curve));
    let columns: Vec<_> = design.rows.iter().map(|x| design.inverse * x).collect();
    let answer = |point: &CloudPoint| {
        let slope = slope(model.zip(curve_samples.as_ref()), point)?;
        let fitted = [maps.s0[point.pixel], maps.s1[point.pixel], maps.s2[point.pixel]].map(|v| 0.5 * f64::from(v));
        let [x, y] = point.at;
        let per_view = columns.iter().map(|m| {
            let moved = [m[1] - x * m[0], m[2] - y * m[0]];
            (slope[0] * moved[0] + slope[1] * moved[1]) / fitted[0]
        });
        Some(Answer { pixel: point.pixel, fitted, per_view: per_view.collect() })
    };
    let points = cloud(maps, design, noise, POINTS);
    points.iter().filter(|p| p.snr >= f64::from(MASK_SNR)).filter_map(answer).collect()
}

/// Derivative of the orientation with respect to (S1/S0, S2/S0).
fn slope(model: Option<(&Candidate, &CurveSamples)>, point: &CloudPoint) -> Option<[f64; 2]> {
    let about = |[x, y]: [f64; 2]| {
        let square = x * x + y * y;
        (square > 0.0).then(|| [-0.5 * y / square, 0.5 * x / square])
    };
    match model {
        None => about(point.at),
        Some((Candidate { center: Some(c), .. }, _)) => about([point.at[0] - c[0], point.at[1] - c[1]]),
        Some((model, curve_samples)) => {
            let step = 1e-3 * model.size();
            let along = |k: usize| {
                let theta = |step: f64| {
                    let mut moved = *point;
                    moved.at[k] += step;
                    orientation(model, curve_samples, &moved).0
                };
                angle_difference(theta(step), theta(-step)) / (2.0 * step)
            };
            let slope = [along(0), along(1)];
            // Where the projection jumps to another branch there is no derivative.
            let across = slope[0].hypot(slope[1]) * model.size();
            (across < 10.0).then_some(slope)
        }
    }
}

/// Root mean square error of orientations after the best common offset, for independent angle errors of 1 rad.
pub(crate) fn of_angles(answers: &[Answer], design: &Design) -> Option<f64> {
    let n = answers.len() as f64;
    let of_view = |(k, x): (usize, &nalgebra::Vector3<f64>)| {
        let (sum, square) = answers.iter().fold((0.0, 0.0), |(sum, square), a| {
            let [_, c, s] = a.fitted;
            let error = a.per_view[k] * 2.0 * (s * x[1] - c * x[2]);
            (sum + error, square + error * error)
        });
        (square / n - (sum / n).powi(2)).max(0.0)
    };
    (!answers.is_empty()).then(|| design.rows.iter().enumerate().map(of_view).sum::<f64>().sqrt())
}

/// Relative shifts of the photographs, and their accuracy.
pub(crate) struct Shifts {
    /// Known shifts in pixels of the maps; empty if there are none.
    pub known: Vec<[f64; 2]>,
    pub sigma: f64,
}

/// Offset of a view's pixels from the centre of their super-pixel, in pixels of the maps.
fn beside(view: &View) -> [f64; 2] {
    let mean = |axis: usize| view.pixels.iter().map(|p| p[axis] as f64 + 0.5).sum::<f64>() / view.pixels.len() as f64;
    [0, 1].map(|axis| 0.5 - mean(axis) / view.block as f64)
}

/// `None` if nothing is known. The offsets of the views of a polarization sensor's blocks are known.
fn of_shifts(views: &[View], alignment: Option<&Alignment>) -> Option<Shifts> {
    if views.iter().any(|v| v.block > 1) {
        // Interpolated images are registered.
        let known = if views.iter().any(|v| v.step > 1) { views.iter().map(beside).collect() } else { vec![] };
        return Some(Shifts { known, sigma: 0.0 });
    }
    let Alignment { shifts_px, sigma_px, corrected, .. } = alignment?;
    let known = if *corrected { vec![] } else { shifts_px.clone() };
    Some(Shifts { known, sigma: (*sigma_px)? })
}

/// Median orientation error in degrees for these relative shifts of the photographs.
pub(crate) fn of_registration(answers: &[Answer], maps: &StokesMaps, design: &Design, shifts: &Shifts) -> Option<f64> {
    let error = |answer: &Answer| {
        let slopes = gradient(maps, answer.pixel)?;
        let (mut known, mut square) = (0.0, 0.0);
        for (k, (x, per)) in design.rows.iter().zip(&answer.per_view).enumerate() {
            let [right, down] = slopes.map(|g| per * (g[0] + g[1] * x[1] + g[2] * x[2]));
            let [dx, dy] = shifts.known.get(k).copied().unwrap_or_default();
            known -= right * dx + down * dy;
            square += shifts.sigma.powi(2) * (right * right + down * down);
        }
        let error = (known * known + square).sqrt().to_degrees();
        error.is_finite().then_some(error)
    };
    median(&mut answers.iter().filter_map(error).collect::<Vec<_>>())
}

/// Gradient of A, C and S to the right and down, per pixel; `None` at the rim of a block.
fn gradient(maps: &StokesMaps, i: usize) -> Option<[[f64; 3]; 2]> {
    let (x, y) = (i % SIDE, i % AREA / SIDE);
    let inner = |v: usize| v > 0 && v + 1 < SIDE;
    let planes = [&maps.s0, &maps.s1, &maps.s2];
    let along = |step: usize| planes.map(|p| 0.25 * f64::from(p[i + step] - p[i - step]));
    (inner(x) && inner(y)).then(|| [along(1), along(SIDE)])
}
