//! A polarization session on the virtual bench, written as the folder that reconstructions read.

use crate::bench::Bench;
use nacre_drivers::{Clock, Freshness};
use nacre_processing::frames::{FILE_NAME, Frame, FrameSet, Geometry, Kind, Transfer, save};
use nacre_processing::image::{Attribute, OutputFolder, write_exr, write_png16_gray};
use nacre_processing::polarimetry::NoiseModel;
use nacre_processing::progress::Progress;
use nacre_processing::{Error, Result};
use std::path::PathBuf;
use std::time::Duration;

/// A camera whose queue and lag are this many frames behind is broken.
const MAX_STALE: u32 = 200;

/// Shows the disc and takes one fresh frame at each analyser angle (degrees). Returns how many stale frames were
/// dropped.
///
/// # Errors
/// `Cancelled`; whatever `store` returns; a camera that never delivers a fresh frame.
pub fn capture(
    bench: &mut Bench,
    angles_deg: &[f64],
    progress: &dyn Progress,
    mut store: impl FnMut(usize, Vec<u16>) -> Result<()>,
) -> Result<u64> {
    let camera = bench.config().camera.clone();
    let exposure = Duration::from_secs_f64(bench.exposure_ms() / 1000.0);
    bench.set_camera(exposure.as_secs_f64(), camera.gain);
    bench.show_disc(true);
    let set_at = bench.now();
    let mut freshness = Freshness::default();
    while freshness.first_sequence == 0 {
        let frame = bench.next_frame().stamp();
        freshness.first_sequence = Freshness::first_with_controls(frame, set_at, camera.lag_frames).unwrap_or(0);
    }
    let mut dropped = 0;
    for (i, angle) in angles_deg.iter().enumerate() {
        progress.check()?;
        freshness.steady_since = bench.turn_analyser(*angle);
        bench.wait(freshness.steady_since.saturating_sub(bench.now()));
        let mut stale = 0;
        let frame = loop {
            let frame = bench.next_frame();
            if freshness.accepts(frame.stamp(), exposure, bench.readout()) {
                break frame;
            }
            stale += 1;
            if stale > MAX_STALE {
                let problem = format!("gave {MAX_STALE} stale frames in a row at {angle}°");
                return Err(Error::input("camera", problem, "shorten camera.queue or camera.lag_frames"));
            }
        };
        dropped += u64::from(stale);
        store(i, bench.codes(&frame))?;
        progress.step();
    }
    bench.show_disc(false);
    Ok(dropped)
}

/// Captures a session into `folder`: `frames/`, `frames.json`, `truth.exr` and `bench.toml`. Returns the number of stale
/// frames dropped.
///
/// # Errors
/// `Output` when writing fails; `Cancelled`.
pub fn write_session(
    bench: &mut Bench,
    angles_deg: &[f64],
    folder: &OutputFolder,
    progress: &dyn Progress,
) -> Result<u64> {
    folder.create_dir("frames")?;
    progress.stage("capturing", angles_deg.len() as u64);
    let name = |i: usize| PathBuf::from("frames").join(format!("{i:04}.png"));
    let (width, height) = (bench.config().camera.width as usize, bench.config().camera.height as usize);
    let dropped = capture(bench, angles_deg, progress, |i, codes| {
        write_png16_gray(&folder.path(&name(i).to_string_lossy()), width, height, &codes)
    })?;
    let set = describe(bench, angles_deg, name);
    folder.write(FILE_NAME, save(&set).as_bytes())?;
    write_truth(bench, folder)?;
    let text = toml::to_string(bench.config())
        .map_err(|e| Error::input("bench.toml", format!("cannot be written: {e}"), "report this"))?;
    folder.write("bench.toml", text.as_bytes())?;
    Ok(dropped)
}

fn describe(bench: &Bench, angles_deg: &[f64], name: impl Fn(usize) -> PathBuf) -> FrameSet {
    let config = bench.config();
    let camera = &config.camera;
    let frame = |(i, angle): (usize, &f64)| Frame {
        file: name(i),
        analyser_deg: Some(*angle),
        exposure_s: Some(bench.exposure_ms() / 1000.0),
        gain: Some(camera.gain),
    };
    FrameSet {
        kind: Kind::Polarization,
        frames: angles_deg.iter().enumerate().map(frame).collect(),
        transfer: Transfer::Linear,
        black: Some(camera.black_level.into()),
        white: Some(f64::from((1u32 << camera.bits) - 1)),
        channel: None,
        layout: None,
        noise: Some(NoiseModel { full_scale_e: camera.well_e, read_noise_e: camera.read_noise_e }),
        dark: None,
        flat: None,
        wavelength_nm: Some(config.filter.wavelength_nm),
        band_nm: Some(config.filter.band_nm).filter(|b| *b > 0.0),
        geometry: Some(Geometry {
            distance_mm: config.geometry.distance_mm,
            baseline_mm: config.geometry.baseline_mm,
            pixel_um: Some(bench.pixel_um()),
        }),
    }
}

fn write_truth(bench: &Bench, folder: &OutputFolder) -> Result<()> {
    let (truth, camera) = (bench.truth(), &bench.config().camera);
    let width = camera.width as usize;
    let planes = [&truth.orientation, &truth.period_um, &truth.purity];
    let attributes = [
        ("units", Attribute::Text("orientation: rad; period: um; purity: 0 to 1".into())),
        ("pixel_um", Attribute::Number(bench.pixel_um())),
    ];
    let names = ["orientation", "period", "purity"];
    write_exr(&folder.path("truth.exr"), width, camera.height as usize, &names, &attributes, &|c, y, row| {
        row.copy_from_slice(&planes[c][y * width..][..width]);
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BenchConfig;
    use crate::surface::SampleKind;
    use nacre_processing::polarimetry::{Design, Fit, FrameNoise, angle_difference, orient};
    use nacre_processing::progress::Silent;

    fn small() -> BenchConfig {
        let mut bench = BenchConfig { seed: 5, ..BenchConfig::default() };
        (bench.camera.width, bench.camera.height) = (96, 64);
        bench
    }

    fn frames(config: &BenchConfig, angles: &[f64]) -> Vec<Vec<u16>> {
        let mut frames = vec![];
        capture(&mut Bench::new(config, &Silent).unwrap(), angles, &Silent, |_, codes| {
            frames.push(codes);
            Ok(())
        })
        .unwrap();
        frames
    }

    #[test]
    fn sessions_are_reproducible_to_the_bit_and_repeats_differ() {
        let angles = [0.0, 60.0, 120.0, 120.0];
        let (a, b) = (frames(&small(), &angles), frames(&small(), &angles));
        assert!(a == b);
        assert!(a[2] != a[3], "two exposures of one state have different noise");
        assert!(a != frames(&BenchConfig { seed: 6, ..small() }, &angles));
    }

    /// Without the freshness rule the queue's stale frames would be taken: 12 angles would all show the first.
    #[test]
    fn stale_frames_are_dropped() {
        let mut config = small();
        config.camera.exposure_ms = Some(15.0);
        let mut bench = Bench::new(&config, &Silent).unwrap();
        let dropped = capture(&mut bench, &[0.0, 45.0, 90.0], &Silent, |_, _| Ok(())).unwrap();
        assert!(dropped >= 3 * 4, "{dropped}: at least a full queue of 4 per angle");
        let mut stale = Bench::new(&small(), &Silent).unwrap();
        stale.wait(Duration::from_secs(1));
        stale.show_disc(true);
        stale.wait(Duration::from_secs(1));
        let old = stale.next_frame();
        let codes = stale.codes(&old);
        let mean = codes.iter().map(|&c| f64::from(c)).sum::<f64>() / codes.len() as f64;
        assert!(mean < 80.0, "the oldest frame in the queue was taken before the light was on: {mean}");
    }

    /// 10,000 frames under random changes: with the rule none is stale, without it many are.
    #[test]
    fn no_stale_frame_is_used_whatever_changes() {
        let (mut stale_with, mut stale_without, mut frames) = (0, 0, 0);
        for lag in 1..=4 {
            let mut config = small();
            (config.camera.width, config.camera.height, config.camera.lag_frames) = (2, 2, lag);
            let mut bench = Bench::new(&config, &Silent).unwrap();
            let random = |i: u64, k: u64| crate::random::uniform(crate::random::key(&[lag.into(), i, k]));
            let (mut exposure, mut freshness) = (config.camera.power_on_exposure_s(), Freshness::default());
            for i in 0..2500 {
                if random(i, 0) < 0.3 {
                    exposure = 0.001 + 0.2 * random(i, 1).powi(3);
                    bench.set_camera(exposure, 1.0);
                    let set_at = bench.now();
                    freshness.first_sequence = loop {
                        let stamp = bench.next_frame().stamp();
                        if let Some(first) = Freshness::first_with_controls(stamp, set_at, lag) {
                            break first;
                        }
                    };
                }
                if random(i, 2) < 0.5 {
                    bench.show_disc(random(i, 3) < 0.5);
                    freshness.steady_since = bench.now();
                }
                if random(i, 4) < 0.7 {
                    freshness.steady_since = bench.turn_analyser(180.0 * random(i, 5));
                    let idle = Duration::from_secs_f64(0.3 * random(i, 6));
                    let wait = freshness.steady_since.saturating_sub(bench.now());
                    bench.wait(wait + idle);
                }
                let stale = |f: &crate::Exposed| f.start < freshness.steady_since || f.settings.exposure_s != exposure;
                let mut first = true;
                loop {
                    let frame = bench.next_frame();
                    stale_without += u32::from(std::mem::take(&mut first) && stale(&frame));
                    if freshness.accepts(frame.stamp(), Duration::from_secs_f64(exposure), bench.readout()) {
                        stale_with += u32::from(stale(&frame));
                        frames += 1;
                        break;
                    }
                }
            }
        }
        assert_eq!((frames, stale_with), (10_000, 0));
        assert!(stale_without > 2000, "{stale_without}");
    }

    /// The whole chain against the sample's truth: noise-free in all but name, no film, small angles of incidence.
    #[test]
    fn the_bench_shows_the_orientation_of_its_sample() {
        let mut config = small();
        config.sample.kind = SampleKind::Cd;
        config.camera.well_e = 1e7;
        config.camera.bits = 16;
        config.camera.blur_px = 0.0;
        config.stage.repeatability_deg = 0.0;
        config.film.front_reflection = 0.0;
        config.geometry.baseline_mm = 0.0;
        config.geometry.distance_mm = 5000.0;
        config.panel.disc_mm = Some(1000.0);
        let angles: Vec<f64> = (0..6).map(|k| f64::from(k) * 30.0).collect();
        let bench = Bench::new(&config, &Silent).unwrap();
        let images = frames(&config, &angles);
        let psi: Vec<f64> = angles.iter().map(|a| a.to_radians()).collect();
        let width = config.camera.width as usize;
        let mut fit = Fit::new(width, config.camera.height as usize);
        for (image, psi) in images.iter().zip(&psi) {
            fit.add(*psi, |y, row, _| {
                row.iter_mut().zip(&image[y * width..]).for_each(|(v, c)| *v = f32::from(*c) - 64.0)
            });
        }
        let design = Design::new(&psi).unwrap();
        let noise = [FrameNoise { shot: 0.01, floor: 1.0 }; 6];
        let map = orient(&mut fit.solve(&design), &design, &noise, 0.0);
        let truth = bench.truth();
        let pure: Vec<usize> =
            (0..map.orientation.len()).filter(|&i| truth.purity[i] > 0.999 && map.orientation[i].is_finite()).collect();
        assert!(pure.len() > 2000, "{} pixels", pure.len());
        let difference = |i: &usize| angle_difference(map.orientation[*i].into(), truth.orientation[*i].into());
        let (sin, cos) = pure
            .iter()
            .fold((0.0, 0.0), |(s, c), i| (s + (2.0 * difference(i)).sin(), c + (2.0 * difference(i)).cos()));
        let offset = 0.5 * f64::atan2(sin, cos);
        let mean = pure.iter().map(|i| angle_difference(difference(i), offset).abs()).sum::<f64>() / pure.len() as f64;
        assert!(mean.to_degrees() < 0.1, "{}°", mean.to_degrees());
    }
}
