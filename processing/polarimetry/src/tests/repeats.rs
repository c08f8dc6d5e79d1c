//! Tests of repeats against series of known noise, through files as written by a session.

use crate::reconstruct;
use crate::synthetic::normal;
use crate::tests::bracket::write_set;
use crate::{Align, NoiseModel, NoiseSource, Options, Report, Smoothing};
use nacre_base::progress::Silent;
use nacre_frames::{Frame, FrameSet, Kind, SESSION_FILE};
use nacre_image::encode_png16_gray;
use std::path::Path;

const SIZE: usize = 160;
const CAMERA: NoiseModel = NoiseModel { full_scale_e: 10_000.0, read_noise_e: 12.0 };

/// A series of a surface with slowly varying brightness and polarization, and with edges.
pub(crate) struct Series {
    /// Analyser angles in degrees, as given to the reconstruction.
    pub angles: Vec<f64>,
    /// Analyser-angle errors in degrees; missing ones are 0.
    pub missed: Vec<f64>,
    /// Accuracy of the angles as given to the reconstruction.
    pub angle_sigma_deg: Option<f64>,
    /// Step between codes, relative to white.
    pub step: f64,
    /// Brightness of each photograph.
    pub lamp: fn(usize) -> f64,
    /// Shift of each photograph to the right, in pixels.
    pub shift: fn(usize) -> f64,
    /// Ratio of the true noise variance to that stated in `frames.json`.
    pub louder: f64,
    /// Whether the photographs come from another program.
    pub foreign: bool,
}

impl Default for Series {
    fn default() -> Self {
        let angles = (0..8).map(|k| 45.0 * f64::from(k)).collect();
        Self {
            angles,
            missed: vec![],
            angle_sigma_deg: None,
            step: 1.0 / 4095.0,
            lamp: |_| 1.0,
            shift: |_| 0.0,
            louder: 1.0,
            foreign: false,
        }
    }
}

impl Series {
    /// Intensity at a position, and its polarization angle.
    fn scene(x: f64, y: f64) -> (f64, f64) {
        let tile = (x / 20.0).floor() + 3.0 * (y / 40.0).floor();
        (0.05 + 0.5 * y / SIZE as f64 + 0.1 * (0.7 * tile).sin().abs(), 0.3 + 0.41 * tile)
    }

    fn report(&self, stated: Option<NoiseModel>) -> Report {
        self.reconstructed(tempfile::tempdir().unwrap().path(), stated)
    }

    /// Writes photographs, and results in `out`, into a folder.
    pub(crate) fn reconstructed(&self, folder: &Path, stated: Option<NoiseModel>) -> Report {
        self.photograph(folder, stated);
        // Registration smooths the noise, so it is off.
        let (model, align, smooth) = (Some(crate::Model::Sinusoid), Some(Align::Off), Smoothing::NONE);
        let options = Options { model, align, smooth, ..Options::default() };
        reconstruct(folder, &folder.join("out"), &options, &Silent).unwrap()
    }

    /// Writes the photographs and `frames.json` into `folder`.
    pub(crate) fn photograph(&self, folder: &Path, stated: Option<NoiseModel>) {
        let frame = |(k, deg): (usize, &f64)| {
            let code = |i: usize| {
                let (light, aolp) = Self::scene((i % SIZE) as f64 - (self.shift)(k), (i / SIZE) as f64);
                let psi = (deg + self.missed.get(k).unwrap_or(&0.0)).to_radians();
                let seen = (self.lamp)(k) * light * (1.0 + 0.4 * (2.0 * (psi - aolp)).cos());
                let noise = CAMERA.frame(1.0, 1.0, 0.0);
                let sigma = (self.louder * (noise.shot * seen + noise.floor)).sqrt();
                // Black is at 6 % of white, so that noise in the dark is not clipped.
                let value = seen + sigma * normal(31 * k as u64 + 5, i as u64);
                ((value / self.step).round() * self.step * 60_000.0 + 4000.0) as u16
            };
            let codes: Vec<u16> = (0..SIZE * SIZE).map(code).collect();
            let file = format!("{k:02}.png");
            std::fs::write(folder.join(&file), encode_png16_gray(SIZE, SIZE, &codes).unwrap()).unwrap();
            Frame { analyser_deg: Some(*deg), ..Frame::new(file) }
        };
        let frames = self.angles.iter().enumerate().map(frame).collect();
        let set = FrameSet {
            black: Some(4000.0),
            white: Some(64_000.0),
            noise: stated,
            angle_sigma_deg: self.angle_sigma_deg,
            ..FrameSet::new(Kind::Polarization, frames)
        };
        write_set(folder, &set);
        if !self.foreign {
            std::fs::write(folder.join(SESSION_FILE), "{}").unwrap();
        }
    }
}

fn is_near(report: &Report, truth: impl Fn(f64) -> f64, share: f64) {
    for level in [0.1, 0.3, 0.6] {
        let ratio = (report.noise.shot * level + report.noise.floor) / truth(level);
        assert!((ratio - 1.0).abs() < share, "at {level}: {ratio} {:?}", report.noise);
    }
}

fn camera(level: f64) -> f64 {
    let noise = CAMERA.frame(1.0, 1.0, 0.0);
    noise.shot * level + noise.floor
}

/// The estimated noise matches the truth within the required 5 %, σ matches the difference of the halves, and a
/// drifting lamp is detected without harm.
#[test]
fn noise_is_found_in_repeats() {
    let lamps: [fn(usize) -> f64; 2] = [|_| 1.0, |k| 1.0 + 0.004 * k as f64];
    for lamp in lamps {
        let report = Series { lamp, ..Series::default() }.report(None);
        assert_eq!(report.noise.source, NoiseSource::Repeats);
        is_near(&report, camera, 0.05);
        let found = report.repeats.unwrap();
        assert!((0.8..=1.3).contains(&found.chi2) && (0.8..=1.3).contains(&found.chi2_median), "{found:?}");
        assert_eq!((found.pairs, found.gain.len()), (4, 4));
        for (k, gain) in found.gain.iter().enumerate() {
            // 256 blocks of 64 pixels with 1.5 % noise each: determined to 0.02 %.
            assert!((gain / (lamp(k + 4) / lamp(k)) - 1.0).abs() < 1e-3, "{found:?}");
        }
        assert!(found.pixels > SIZE * SIZE / 3 && report.warnings.iter().all(|w| !w.contains("χ²")), "{found:?}");
    }
}

/// Rounding to coarse codes is noise like any other, including a quiet camera whose repeats are equal: the error
/// remains there.
#[test]
fn coarse_codes_are_noise_too() {
    let coarse = Series { step: 1.0 / 128.0, ..Series::default() }.report(None);
    is_near(&coarse, |level| camera(level) + (1.0f64 / 128.0).powi(2) / 12.0, 0.05);
    assert!((0.8..=1.3).contains(&coarse.repeats.unwrap().chi2));
    // The files' codes are 16 bit, the only remaining noise.
    let quiet = Series { louder: 0.0, step: 1.0 / 60_000.0, ..Series::default() }.report(None);
    assert!((quiet.noise.floor * 12.0).sqrt() * 60_000.0 > 0.999, "{:?}", quiet.noise);
}

/// An analyser that shifts the image by half a pixel per turn causes differences at edges. The estimated noise rises by
/// less than a tenth, although the photographs are not registered.
#[test]
fn moving_edges_are_not_noise() {
    let report = Series { shift: |k| 0.5 * f64::from(u8::from(k > 3)), ..Series::default() }.report(None);
    is_near(&report, camera, 0.1);
    assert!((0.8..=1.3).contains(&report.repeats.unwrap().chi2_median));
}

/// A camera with more noise than stated is detected.
#[test]
fn wrong_stated_noise_is_detected() {
    let report = Series { louder: 2.0, ..Series::default() }.report(Some(CAMERA));
    let found = report.repeats.clone().unwrap();
    assert_eq!(report.noise.source, NoiseSource::Given);
    // Variances are twice those of σ.
    assert!((found.chi2_median / 2.0 - 1.0).abs() < 0.1, "{found:?}");
    assert!(report.warnings.iter().any(|w| w.contains("σ is too small")), "{:?}", report.warnings);
    let honest = Series::default().report(Some(CAMERA)).repeats.unwrap();
    assert!((honest.chi2 - 1.0).abs() < 0.1, "{honest:?}");
}

/// Angles in any order and from more than one turn, and exactly equal ones; two repeated angles are not enough.
#[test]
fn repeats_are_found() {
    let of =
        |angles: &[f64]| Series { angles: angles.to_vec(), ..Series::default() }.report(None).repeats.map(|r| r.pairs);
    assert_eq!(of(&[0.0, 60.0, 120.0, 180.04, -60.0, 240.0, 30.0]), Some(3));
    assert_eq!(of(&[0.0, 0.0, 60.0, 60.0, 120.0, 120.0, 0.0, 180.0]), Some(4));
    assert_eq!(of(&[0.0, 60.0, 120.0, 180.0, 240.0, 300.2]), None);
}
