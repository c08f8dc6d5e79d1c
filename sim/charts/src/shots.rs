//! Photographs of the simulated bench at analyser angles, as files.

use nacre_base::{Error, Result};
use nacre_drivers::Pattern;
use nacre_frames::{Distances, Frame, FrameSet, Kind, save};
use nacre_image::write_png16_gray;
use nacre_polarimetry::NoiseModel;
use nacre_sim::{Bench, BenchConfig, Shining};
use std::path::Path;
use std::time::Duration;

/// Analyser angles: twelve over 180°.
const ANGLES: usize = 12;

/// Brightest code relative to white.
const EXPOSED: f64 = 0.8;

/// Writes photographs and `frames.json` into `folder`; returns the true orientations.
pub(super) fn photograph(mut bench: Bench, exposure_s: f64, folder: &Path) -> Result<Vec<f32>> {
    let config = bench.config().clone();
    let (camera, geometry) = (&config.camera, &config.geometry);
    let [black, white] = levels(&config);
    let angles: Vec<f64> = (0..ANGLES).map(|k| 180.0 * k as f64 / ANGLES as f64).collect();
    light(&mut bench);
    let mut frames = vec![];
    for (k, angle) in angles.iter().enumerate() {
        let late = || Error::input("camera", "sends no frame in time", "report this");
        let codes = codes(&mut bench, *angle, exposure_s).ok_or_else(late)?;
        let file = format!("{k:02}.png");
        write_png16_gray(&folder.join(&file), camera.width as usize, camera.height as usize, &codes)?;
        frames.push(Frame { analyser_deg: Some(*angle), exposure_s: Some(exposure_s), ..Frame::new(file) });
    }
    let set = FrameSet {
        black: Some(black),
        white: Some(white),
        noise: Some(NoiseModel { full_scale_e: camera.well_e, read_noise_e: camera.read_noise_e }),
        wavelength_nm: Some(config.filter.wavelength_nm),
        geometry: Some(Distances {
            distance_mm: geometry.distance_mm,
            baseline_mm: geometry.baseline_mm,
            pixel_um: Some(bench.pixel_um()),
            camera_px: None,
        }),
        ..FrameSet::new(Kind::Polarization, frames)
    };
    let path = folder.join("frames.json");
    std::fs::write(&path, save(&set)).map_err(|e| Error::output(&path, e))?;
    // Shifts are relative to their mean.
    let shifts: Vec<[f64; 2]> = angles.iter().map(|a| config.shift_px(*a)).collect();
    let mean = [0, 1].map(|k| shifts.iter().map(|s| s[k]).sum::<f64>() / shifts.len() as f64);
    Ok(bench.truth_shifted(mean)?.orientation)
}

/// Switches the display's disc on.
pub(super) fn light(bench: &mut Bench) {
    let pattern = Pattern::Disc { center_mm: [0.0; 2], diameter_mm: bench.config().disc_mm() };
    bench.shine(Shining { pattern, flash: false, covered: false }, Duration::ZERO);
}

/// Code values of black and white.
pub(super) fn levels(config: &BenchConfig) -> [f64; 2] {
    [f64::from(config.camera.black_level), f64::from((1u32 << config.camera.bits) - 1)]
}

/// Exposure in s for which the brightest pixel over a few analyser angles stays below white.
pub(super) fn metered(mut bench: Bench) -> f64 {
    let ([black, white], mut exposure_s) = (levels(bench.config()), 1e-3);
    light(&mut bench);
    for _ in 0..4 {
        let angles = [0.0, 45.0, 90.0, 135.0].into_iter();
        let brightest = angles.filter_map(|a| codes(&mut bench, a, exposure_s)?.into_iter().max()).max().unwrap_or(0);
        let level = (f64::from(brightest) - black).max(1.0) / (white - black);
        exposure_s *= (EXPOSED / level).clamp(0.1, 20.0);
    }
    exposure_s
}

/// Takes one photograph at an angle of the stage.
fn codes(bench: &mut Bench, angle_deg: f64, exposure_s: f64) -> Option<Vec<u16>> {
    several(bench, angle_deg, exposure_s, 1)?.pop()
}

/// Takes photographs at an angle of the stage: the first frames with this exposure that begin after the analyser has
/// settled.
pub(super) fn several(bench: &mut Bench, angle_deg: f64, exposure_s: f64, count: usize) -> Option<Vec<Vec<u16>>> {
    bench.set_camera(exposure_s, 1.0);
    let settled = bench.turn_analyser(angle_deg);
    let mut taken = vec![];
    // The stage and the camera's latency take tens of frames at most.
    for _ in 0..100_000 {
        bench.advance_to(bench.next_frame_at());
        while let Some(frame) = bench.take_frame() {
            if frame.start >= settled && frame.settings.exposure_s == exposure_s {
                taken.push(bench.codes(&frame));
                if taken.len() == count {
                    return Some(taken);
                }
            }
        }
    }
    None
}
