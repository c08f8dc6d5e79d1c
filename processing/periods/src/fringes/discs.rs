//! Verification by photographs of discs on the panel.
//!
//! Fringes are periodic, discs are not: each grating predicts whether a disc's mirrored or diffracted light reaches a
//! pixel. Diffuse reflection grows with the disc's solid angle, and room light is constant; both are fitted. Of two
//! ambiguous gratings, the one consistent with the discs is selected; gratings inconsistent with them are masked.

use super::answer::{Grating, Verdict};
use super::optics::{Optics, Place};
use super::scan::{Found, Points};
use super::signals::frame_noise;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use nacre_frames::{Frame, Linearizer, LoadedFrames, Spot};
use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;

/// Minimum number of discs, since two parameters are fitted per pixel.
const MIN_DISCS: usize = 4;
/// Relative model error of the light, and of an order that lands on a disc's edge and is half covered.
const MODEL_ERROR: f64 = 0.01;
const EDGE_ERROR: f64 = 0.1;
/// Reduced χ² below which discs confirm a grating, and above which they contradict it.
const MAX_CONFIRMING_CHI2: f64 = 3.0;
const MIN_CONTRADICTING_CHI2: f64 = 4.0;
/// Minimum χ² difference between two gratings for a decision: five standard deviations.
const MARGIN: f64 = 25.0;
/// Scale factor at which the logistic function approximates the Gaussian integral to 1 %.
const LOGISTIC: f64 = 1.702;

/// Effect of the discs.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct DiscVerification {
    /// Number of photographs of discs.
    pub discs: usize,
    /// Number of ambiguous pixels that they decided.
    pub decided: usize,
    /// Number of pixels masked because discs contradict their grating.
    pub contradicted: usize,
    /// Median reduced χ² over the pixels with a grating.
    pub residual: Option<f64>,
}

/// Weighted sums of a grating's residuals, for the fit of (room light, diffuse reflection).
#[derive(Clone, Copy, Default)]
struct Sums {
    normal: [f64; 3],
    right: [f64; 2],
    square: f64,
    count: f64,
}

impl Sums {
    fn add(&mut self, off: f64, ground: f64, variance: f64) {
        let weight = 1.0 / variance;
        for (sum, term) in self.normal.iter_mut().zip([1.0, ground, ground * ground]) {
            *sum += weight * term;
        }
        for (sum, term) in self.right.iter_mut().zip([1.0, ground]) {
            *sum += weight * term * off;
        }
        self.square += weight * off * off;
        self.count += 1.0;
    }

    /// χ² of the residuals, and reduced χ².
    fn chi2(&self) -> [f64; 2] {
        let [a, b, c] = self.normal;
        let right = Vector2::from(self.right);
        // If all discs look alike, only one parameter is determined.
        let normal = Matrix2::new(a * (1.0 + 1e-9), b, b, c * (1.0 + 1e-9) + 1e-30);
        let explained = normal.try_inverse().map_or(0.0, |inverse| right.dot(&(inverse * right)));
        let chi2 = (self.square - explained).max(0.0);
        [chi2, chi2 / (self.count - 2.0).max(1.0)]
    }
}

/// Discs photographed behind the same analyser as the fringes.
pub fn discs(frames: &LoadedFrames) -> Vec<(usize, Spot)> {
    let all = &frames.set.frames;
    let analyser = all.iter().find(|f| f.fringes.is_some()).map(|f| f.analyser_deg);
    let disc = |(i, f): (usize, &Frame)| {
        f.spot.filter(|_| f.fringes.is_none() && Some(f.analyser_deg) == analyser).map(|s| (i, s))
    };
    all.iter().enumerate().filter_map(disc).collect()
}

/// Decides ambiguous pixels and masks contradicted ones; `None` with too few discs. Photographs are read one at a time.
///
/// # Errors
/// `Input` for unreadable frames; `Cancelled`.
pub fn verify(
    frames: &LoadedFrames,
    optics: &Optics,
    points: Points<'_>,
    found: &mut Found,
    progress: &dyn Progress,
) -> Result<Option<DiscVerification>> {
    let discs = discs(frames);
    if discs.len() < MIN_DISCS {
        return Ok(None);
    }
    let width = frames.info.width;
    let linearizer = Linearizer::new(frames)?;
    let noise = frame_noise(frames, &linearizer);
    let unit = frames.set.frames.first().map_or(1.0, Frame::scale);
    let mut sums = vec![[Sums::default(); 2]; found.verdicts.len()];
    progress.stage("reading photographs of discs", discs.len() as u64);
    for (i, disc) in &discs {
        progress.check()?;
        let decoded = linearizer.frame(frames, &frames.set.frames[*i])?;
        let known = &*found;
        sums.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let (mut light, mut bad) = (vec![0.0_f32; width], vec![0_u8; width]);
            decoded.row(y, &mut light, &mut bad);
            for (x, sums) in row.iter_mut().enumerate().filter(|(x, _)| bad[*x] == 0) {
                let gratings = hypotheses(known, y * width + x);
                if gratings.iter().all(Option::is_none) {
                    continue;
                }
                let Some(point) = points(x, y) else { continue };
                let (place, light) = (optics.place(point), f64::from(light[x]) / unit);
                for (sums, grating) in sums.iter_mut().zip(gratings) {
                    let Some(grating) = grating else { continue };
                    let [expected, unsure] = expected(optics, &place, &grating, disc);
                    let variance = noise[0] * light.max(0.0) + noise[1] + unsure;
                    sums.add(light - expected, solid_angle(optics, &place, disc), variance);
                }
            }
        });
        progress.step();
    }
    Ok(Some(decide(found, &sums, discs.len())))
}

/// The grating of a pixel, or its two ambiguous gratings.
fn hypotheses(found: &Found, i: usize) -> [Option<Grating>; 2] {
    match (found.verdicts[i], found.rivals[i]) {
        (Verdict::Resolved, _) => [found.gratings[i], None],
        (Verdict::Ambiguous, Some(pair)) => pair.map(Some),
        _ => [None; 2],
    }
}

fn decide(found: &mut Found, sums: &[[Sums; 2]], discs: usize) -> DiscVerification {
    let mut verification = DiscVerification { discs, decided: 0, contradicted: 0, residual: None };
    let mut residuals = vec![];
    for (i, sums) in sums.iter().enumerate() {
        let chi2 = sums.map(|s| s.chi2());
        let enough = sums.map(|s| s.count >= MIN_DISCS as f64);
        match (found.verdicts[i], found.rivals[i]) {
            (Verdict::Resolved, _) if enough[0] => {
                residuals.push(chi2[0][1]);
                if chi2[0][1] > MIN_CONTRADICTING_CHI2 {
                    found.verdicts[i] = Verdict::Unexplained;
                    verification.contradicted += 1;
                }
            }
            (Verdict::Ambiguous, Some(pair)) if enough == [true; 2] => {
                let best = usize::from(chi2[1][0] < chi2[0][0]);
                if chi2[best][1] <= MAX_CONFIRMING_CHI2 && chi2[1 - best][0] - chi2[best][0] > MARGIN {
                    found.gratings[i] = Some(pair[best]);
                    found.verdicts[i] = Verdict::Resolved;
                    verification.decided += 1;
                }
            }
            _ => {}
        }
    }
    verification.residual = median(residuals);
    verification
}

/// Predicted light of a disc by a grating at a pixel, relative to white, and its variance. The model error is largest
/// where an order lands on a disc's edge.
fn expected(optics: &Optics, place: &Place, grating: &Grating, disc: &Spot) -> [f64; 2] {
    let q = optics.wavelength_um / grating.period_um;
    let q = [q * grating.orientation.cos(), q * grating.orientation.sin()];
    let highest = (grating.weights.len() / 2) as f64;
    let (mut sum, mut variance) = (0.0, 0.0);
    for (weight, k) in grating.weights.iter().zip(0..) {
        let (weight, m) = (f64::from(*weight), f64::from(k) - highest);
        let sines = [0, 1].map(|a| place.mirror[a] + grating.mirror_offset[a] + m * q[a]);
        let Some(landing) = optics.land(place.point, sines).filter(|_| weight > 0.0) else { continue };
        let [[a, b], [c, d]] = landing.slope;
        let mm_per_sine = (a * d - b * c).abs().sqrt();
        let spread = mm_per_sine * place.spread.hypot(optics.band * m * q[0].hypot(q[1]));
        let away = (landing.at[0] - disc.center_mm[0]).hypot(landing.at[1] - disc.center_mm[1]);
        let inside = LOGISTIC * (0.5 * disc.diameter_mm - away) / spread.max(1e-3);
        let part = 1.0 / (1.0 + (-inside).exp());
        sum += weight * part;
        variance += (4.0 * EDGE_ERROR * weight * part * (1.0 - part)).powi(2);
    }
    let whole: f64 = grating.weights.iter().map(|w| f64::from(*w)).sum();
    [sum, variance + (MODEL_ERROR * whole).powi(2)]
}

/// Projected solid angle of a disc at the sample.
fn solid_angle(optics: &Optics, place: &Place, disc: &Spot) -> f64 {
    let [u, v] = optics.towards(place.point, disc.center_mm);
    let cosine = (1.0 - u * u - v * v).max(0.0).sqrt();
    let Some(landing) = optics.land(place.point, [u, v]) else { return 0.0 };
    // The determinant of the slope is the area per projected solid angle.
    let [[a, b], [c, d]] = landing.slope;
    let area = std::f64::consts::PI * (0.5 * disc.diameter_mm).powi(2);
    if cosine > 0.0 { area / (a * d - b * c).abs().max(1e-9) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::optics::tests::facing;
    use super::*;

    fn grating(degrees: f64, period_um: f64) -> Grating {
        Grating {
            orientation: degrees.to_radians(),
            orientation_sigma: 0.002,
            period_um,
            period_sigma_um: 0.01,
            mirror_offset: [0.0; 2],
            residual: 1.0,
            first: 0.6,
            weights: [0.0, 0.0, 0.3, 0.2, 0.3, 0.0, 0.0],
        }
    }

    /// A grid of discs with room light and diffuse reflection: the correct one of two gratings is selected, and a wrong
    /// one is masked.
    #[test]
    fn discs_decide_and_contradict() {
        let optics = facing();
        let place = optics.place([4.0, -3.0, 0.0]);
        let truth = grating(20.0, 1.9);
        let (mut right, mut wrong) = (Sums::default(), Sums::default());
        for k in 0..24 {
            let center_mm = [f64::from(k % 6) * 80.0 - 200.0, f64::from(k / 6) * 80.0 - 120.0];
            let disc = Spot { center_mm, diameter_mm: 80.0 };
            let ground = solid_angle(&optics, &place, &disc);
            let light = expected(&optics, &place, &truth, &disc)[0] + 0.05 + 0.4 * ground;
            for (sums, grating) in [(&mut right, truth), (&mut wrong, grating(110.0, 2.4))] {
                let [expected, unsure] = expected(&optics, &place, &grating, &disc);
                sums.add(light - expected, ground, unsure + 1e-5);
            }
        }
        assert!(
            right.chi2()[1] < 1e-6 && wrong.chi2()[1] > MIN_CONTRADICTING_CHI2,
            "{:?} {:?}",
            right.chi2(),
            wrong.chi2()
        );
        let mut found = Found {
            verdicts: vec![Verdict::Ambiguous, Verdict::Resolved, Verdict::Resolved],
            gratings: vec![None, Some(truth), Some(grating(110.0, 2.4))],
            rivals: vec![Some([grating(110.0, 2.4), truth]), None, None],
        };
        let verification =
            decide(&mut found, &[[wrong, right], [right, Sums::default()], [wrong, Sums::default()]], 24);
        assert_eq!((verification.decided, verification.contradicted), (1, 1));
        assert_eq!(found.verdicts, [Verdict::Resolved, Verdict::Resolved, Verdict::Unexplained]);
        assert!((found.gratings[0].unwrap().period_um - 1.9).abs() < 1e-12);
    }

    /// Projected solid angle of a small disc, compared with area · cos θ · cos θ / r².
    #[test]
    fn a_ground_sees_the_projected_solid_angle() {
        let optics = facing();
        let place = optics.place([0.0; 3]);
        let disc = Spot { center_mm: [60.0, -40.0], diameter_mm: 10.0 };
        let to = [50.0 + 60.0, -40.0, 250.0];
        let square: f64 = to.iter().map(|v: &f64| v * v).sum();
        let cosine = 250.0 / square.sqrt();
        let exact = std::f64::consts::PI * 25.0 * cosine * cosine / square;
        assert!((solid_angle(&optics, &place, &disc) / exact - 1.0).abs() < 1e-9);
    }
}
