//! Photographs for calibrations, as files.

use crate::shots::{levels, light, metered, several};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_drivers::Pattern;
use nacre_frames::{Calibration, Distances, Frame, FrameSet, Illumination, Kind, Transfer, save};
use nacre_image::write_png16_gray;
use nacre_sim::{Bench, BenchConfig, Shining};
use std::path::Path;
use std::time::Duration;

/// Angles of a turn: every 15°.
pub(super) const TURN: usize = 24;

/// Angles about the crossed direction in degrees.
const CROSSED_DEG: [f64; 4] = [-2.0, -1.0, 1.0, 2.0];

/// Exposures of a photon transfer relative to the metered one, which is just below white: evenly spaced, as in a
/// session, and a saturated one.
const LEVELS: [f64; 2] = [0.02, 1.0];
const SATURATED: f64 = 1.4;

/// Exposure of photographs of crossed polarizers relative to the others.
const LONGER: f64 = 8.0;

/// Photographs to take.
pub(super) enum Shot {
    /// Pairs of exposures, of light and of darkness.
    Transfer {
        /// Number of exposures.
        levels: usize,
    },
    /// Evenly spaced angles over a turn of the analyser, and angles near the darkest.
    Turn {
        /// Number of evenly spaced angles.
        count: usize,
        /// Whether the angles near the darkest are wanted.
        crossed: bool,
    },
}

struct Camera<'a> {
    bench: Bench,
    folder: &'a Path,
    count: usize,
}

impl Camera<'_> {
    /// Takes and writes a photograph; returns its file and the mean code.
    fn take(&mut self, angle_deg: f64, exposure_s: f64) -> Result<(String, f64)> {
        let [taken] = self.take_several(angle_deg, exposure_s)?;
        Ok(taken)
    }

    /// Takes and writes successive photographs.
    fn take_several<const N: usize>(&mut self, angle_deg: f64, exposure_s: f64) -> Result<[(String, f64); N]> {
        let late = || Error::input("camera", "sends no frame in time", "report this");
        let all = several(&mut self.bench, angle_deg, exposure_s, N).ok_or_else(late)?;
        let (width, height) = (self.bench.config().camera.width as usize, self.bench.config().camera.height as usize);
        let mut taken = std::array::from_fn(|_| (String::new(), 0.0));
        for (codes, taken) in all.iter().zip(&mut taken) {
            let file = format!("{:03}.png", self.count);
            self.count += 1;
            write_png16_gray(&self.folder.join(&file), width, height, codes)?;
            *taken = (file, codes.iter().map(|c| f64::from(*c)).sum::<f64>() / codes.len() as f64);
        }
        Ok(taken)
    }

    fn dark(&mut self, covered: bool) {
        self.bench.shine(Shining { pattern: Pattern::Black, flash: false, covered }, Duration::ZERO);
    }
}

/// Takes photographs and writes them with a `frames.json`, which names the calibration.
pub(super) fn shoot(config: &BenchConfig, shot: &Shot, calibration: &Calibration, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::output(folder, e))?;
    let exposure_s = metered(Bench::new(config, &Silent)?);
    let mut camera = Camera { bench: Bench::new(config, &Silent)?, folder, count: 0 };
    let (kind, frames) = match shot {
        Shot::Transfer { levels } => (Kind::Exposures, transfer(&mut camera, exposure_s, *levels)?),
        Shot::Turn { count, crossed } => (Kind::Polarization, turn(&mut camera, exposure_s, *count, *crossed)?),
    };
    let [black, white] = levels(config);
    let geometry = &config.geometry;
    let known = calibration.camera.as_ref();
    let set = FrameSet {
        black: Some(known.map_or(black, |c| c.black)),
        white: Some(known.map_or(white, |c| c.white)),
        noise: known.map(|c| c.noise),
        transfer: known.and_then(|c| c.response).map_or(Transfer::Linear, Transfer::Polynomial),
        wavelength_nm: Some(config.filter.wavelength_nm),
        band_nm: Some(config.filter.band_nm),
        geometry: Some(Distances {
            distance_mm: geometry.distance_mm,
            baseline_mm: geometry.baseline_mm,
            pixel_um: Some(camera.bench.pixel_um()),
            camera_px: None,
        }),
        calibration: Some(calibration.clone()),
        illumination: Illumination::CircularPanel,
        ..FrameSet::new(kind, frames)
    };
    let path = folder.join("frames.json");
    std::fs::write(&path, save(&set)).map_err(|e| Error::output(&path, e))
}

fn transfer(camera: &mut Camera, exposure_s: f64, levels: usize) -> Result<Vec<Frame>> {
    let mut frames = vec![];
    let even = |k: usize| LEVELS[0] + (LEVELS[1] - LEVELS[0]) * k as f64 / (levels - 2) as f64;
    for share in (0..levels - 1).map(even).chain([SATURATED]) {
        let exposure_s = exposure_s * share;
        camera.dark(true);
        let darks: [_; 2] = camera.take_several(0.0, exposure_s)?;
        light(&mut camera.bench);
        let pair: [_; 2] = camera.take_several(0.0, exposure_s)?;
        for ((dark, _), (file, _)) in darks.into_iter().zip(pair) {
            frames.push(Frame { exposure_s: Some(exposure_s), dark: Some(dark.into()), ..Frame::new(file) });
        }
    }
    Ok(frames)
}

fn turn(camera: &mut Camera, exposure_s: f64, count: usize, crossed: bool) -> Result<Vec<Frame>> {
    let mut frames = vec![];
    let mut means: Vec<[f64; 2]> = vec![];
    camera.dark(false);
    let dark = camera.take(0.0, exposure_s)?.0;
    light(&mut camera.bench);
    for angle in (0..count).map(|k| 360.0 * k as f64 / count as f64) {
        let (file, mean) = camera.take(angle, exposure_s)?;
        means.push([angle, mean]);
        frames.push(frame(angle, exposure_s, &dark, file));
    }
    if crossed {
        let darkest = darkest(&means);
        let exposure_s = LONGER * exposure_s;
        camera.dark(false);
        let dark = camera.take(0.0, exposure_s)?.0;
        light(&mut camera.bench);
        for angle in CROSSED_DEG.map(|d| darkest + d) {
            let (file, _) = camera.take(angle, exposure_s)?;
            frames.push(frame(angle, exposure_s, &dark, file));
        }
    }
    Ok(frames)
}

fn frame(angle_deg: f64, exposure_s: f64, dark: &str, file: String) -> Frame {
    Frame { analyser_deg: Some(angle_deg), exposure_s: Some(exposure_s), dark: Some(dark.into()), ..Frame::new(file) }
}

/// Angle of the darkest light, from 0° to 180°, by the sinusoid through equally spaced means.
fn darkest(means: &[[f64; 2]]) -> f64 {
    let sum = |of: fn(f64) -> f64| means.iter().map(|[a, v]| v * of(2.0 * a.to_radians())).sum::<f64>();
    (0.5 * sum(f64::sin).atan2(sum(f64::cos)).to_degrees() + 90.0).rem_euclid(180.0)
}
