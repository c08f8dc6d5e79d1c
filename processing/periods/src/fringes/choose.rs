//! Prediction of the accuracy of a fringe setting before capture, and selection of the cheapest sufficient setting.

use super::answer::Demands;
use super::carriers::frequencies;
use super::optics::{Optics, carrier};
use super::solve::MAX_CARRIERS;
use nacre_frames::NoiseModel;
use serde::Serialize;

/// Frames in addition to the fringes: uniform light and a black panel.
const BESIDES: usize = 4;

/// Minimum number of fringes for reliable identification of gratings. Of 4096 pixels, none was misidentified with 10
/// fringes, three with 8, and 1 % with 6 (docs/validation/spots.md).
pub const LEAST_FRINGES: usize = 10;

/// Light of a pixel, and of one of its first orders, relative to white: a dim case of a metal grating 100 nm deep, so
/// that most pixels are better.
const MEAN: f64 = 0.25;
const FIRST: f64 = 0.06;

/// Parameters of the fringes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// Number of different fringes.
    pub count: usize,
    /// Number of phases per fringe.
    pub phases: usize,
    /// Period of the finest fringe in mm.
    pub finest_mm: f64,
}

/// Predicted accuracy of a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// The setting.
    pub setting: Setting,
    /// Number of patterns, including uniform light and black.
    pub patterns: usize,
    /// Relative σ of the period in a dim pixel with the longest period.
    pub period: f64,
    /// Standard deviation of its orientation in degrees.
    pub orientation_deg: f64,
}

/// Required accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Relative σ of the period.
    pub period: f64,
    /// Standard deviation of the orientation in degrees.
    pub orientation_deg: f64,
    /// Longest period in µm. Its orders are nearest to the mirror direction, so that panel positions determine it least
    /// accurately.
    pub longest_um: f64,
    /// Maximum number of patterns.
    pub at_most: usize,
}

impl Default for Request {
    fn default() -> Self {
        Self { period: 0.01, orientation_deg: 0.5, longest_um: 3.0, at_most: 64 }
    }
}

/// Predicts σ from camera noise by the Fisher information of one first order in addition to the mirrored light. `None`
/// if no order of this period reaches the panel from the sample's centre.
pub fn predict(optics: &Optics, noise: &NoiseModel, setting: Setting, period_um: f64) -> Option<Prediction> {
    let place = optics.place([0.0; 3]);
    let size = optics.wavelength_um / period_um;
    let phases = setting.phases.max(1) as f64;
    let floor = (noise.read_noise_e / noise.full_scale_e).powi(2);
    let demands = Demands::default();
    let variance = 8.0 / phases * (MEAN / noise.full_scale_e + floor) + (2.0 * demands.model_error * MEAN).powi(2);
    let mut worst: Option<[f64; 2]> = None;
    for step in 0..12 {
        let angle = f64::from(15 * step).to_radians();
        let along = [angle.cos(), angle.sin()];
        let q = along.map(|a| size * a);
        // The more accurate of both first orders.
        let best = [1.0, -1.0].into_iter().filter_map(|sign| {
            let sines = [0, 1].map(|a| place.mirror[a] + sign * q[a]);
            let landing = optics.land(place.point, sines).filter(|l| optics.is_on(l.at, 0.5 * optics.aperture_mm))?;
            let (mut radial, mut across) = (0.0, 0.0);
            for f in frequencies(setting.count, setting.finest_mm) {
                let k = carrier(f);
                let left = FIRST * optics.modulation(k, &landing, &place, sign, q);
                let [[a, b], [c, d]] = landing.slope;
                let phase = [k[0] * a + k[1] * c, k[0] * b + k[1] * d];
                radial += (left * (phase[0] * along[0] + phase[1] * along[1])).powi(2);
                across += (left * (phase[1] * along[0] - phase[0] * along[1])).powi(2);
            }
            Some([radial, across].map(|information| (variance / information.max(1e-30)).sqrt() / size))
        });
        let Some(found) = best.min_by(|a, b| a[0].total_cmp(&b[0])) else { continue };
        worst = Some(worst.map_or(found, |w| [w[0].max(found[0]), w[1].max(found[1])]));
    }
    let [period, turn] = worst?;
    let patterns = BESIDES + setting.count * setting.phases;
    Some(Prediction { setting, patterns, period, orientation_deg: turn.to_degrees() })
}

/// The cheapest setting that meets the requirements, with phases and finest fringe of `like`. `None` if the maximum
/// number of patterns does not suffice, or no order is within reach.
pub fn cheapest(optics: &Optics, noise: &NoiseModel, like: &Setting, request: &Request) -> Option<Prediction> {
    let counts = LEAST_FRINGES..=MAX_CARRIERS;
    let all = counts.filter_map(|count| predict(optics, noise, Setting { count, ..*like }, request.longest_um));
    let meets = |p: &Prediction| {
        p.period <= request.period && p.orientation_deg <= request.orientation_deg && p.patterns <= request.at_most
    };
    all.filter(meets).min_by_key(|p| p.patterns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fringes::optics::tests::facing;

    fn optics() -> Optics {
        Optics { band: 0.0076, ..facing() }
    }

    #[test]
    fn a_better_camera_needs_no_more_patterns() {
        let request = Request { period: 0.008, ..Request::default() };
        let patterns = |full_scale_e: f64| {
            let noise = NoiseModel { full_scale_e, read_noise_e: 8.0 };
            let like = Setting { count: 0, phases: 4, finest_mm: 28.0 };
            cheapest(&optics(), &noise, &like, &request).map(|p| p.patterns)
        };
        let (few, many) = (patterns(40_000.0).unwrap(), patterns(3000.0).unwrap_or(usize::MAX));
        assert!(few <= many && (BESIDES + 4 * LEAST_FRINGES..=64).contains(&few), "{few} {many}");
        assert!(patterns(30.0).is_none(), "thirty electrons tell nothing");
    }

    #[test]
    fn unreachable_periods_are_not_predicted() {
        let noise = NoiseModel { full_scale_e: 40_000.0, read_noise_e: 8.0 };
        let setting = Setting { count: 12, phases: 4, finest_mm: 28.0 };
        assert!(predict(&optics(), &noise, setting, 0.5).is_none());
        let found = predict(&optics(), &noise, setting, 3.0).unwrap();
        assert!(found.period < 0.01 && found.orientation_deg < 0.5, "{found:?}");
    }
}
