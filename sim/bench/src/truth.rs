//! Ground truth of the sample, as a file.

use crate::bench::Bench;
use nacre_base::Result;
use nacre_image::{Attribute, write_exr};
use std::path::Path;

/// Writes `truth.exr`: orientation (rad), period (µm) and purity of every pixel, without the wedge's shift.
///
/// The wedge's length is an attribute; [`BenchConfig::shift_px`](crate::BenchConfig::shift_px) gives the shift at any
/// angle.
///
/// # Errors
/// `Output` when writing fails.
/// `Output` when writing fails.
pub fn write_truth(bench: &Bench, path: &Path) -> Result<()> {
    let (truth, camera) = (bench.truth(), &bench.config().camera);
    let width = camera.width as usize;
    let planes = [&truth.orientation, &truth.period_um, &truth.purity];
    let attributes = [
        ("units", Attribute::Text("orientation: rad; period: um; purity: 0 to 1".into())),
        ("pixel_um", Attribute::Number(bench.pixel_um())),
        ("wedge_px", Attribute::Number(bench.config().analyser.wedge_px)),
        ("jitter_px", Attribute::Number(bench.config().analyser.jitter_px)),
    ];
    let names = ["orientation", "period", "purity"];
    write_exr(path, width, camera.height as usize, &names, &attributes, &|c, y, row| {
        row.copy_from_slice(&planes[c][y * width..][..width]);
    })
}

/// Tests of the whole bench: frames are fresh and reproducible, and show the sample.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Shining;
    use crate::camera::Exposed;
    use crate::surface::SampleKind;
    use crate::{BenchConfig, random};
    use nacre_base::progress::Silent;
    use nacre_drivers::{Freshness, Pattern};
    use nacre_polarimetry::{Design, Fit, FrameNoise, angle_difference, orient};
    use std::time::Duration;

    fn small() -> BenchConfig {
        let mut bench = BenchConfig { seed: 5, ..BenchConfig::default() };
        (bench.camera.width, bench.camera.height) = (96, 64);
        bench.camera.exposure_ms = Some(15.0);
        bench
    }

    fn disc(diameter_mm: f64) -> Shining {
        Shining { pattern: Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm }, flash: false, covered: false }
    }

    fn next(bench: &mut Bench) -> Exposed {
        loop {
            if let Some(frame) = bench.take_frame() {
                return frame;
            }
            bench.advance_to(bench.next_frame_at());
        }
    }

    /// One fresh frame at each angle, and the number of stale frames dropped.
    fn capture(bench: &mut Bench, shining: Shining, angles_deg: &[f64]) -> (Vec<Vec<u16>>, u32) {
        let exposure = Duration::from_secs_f64(bench.config().camera.power_on_exposure_s());
        let (mut frames, mut dropped) = (vec![], 0);
        bench.shine(shining, Duration::ZERO);
        for angle in angles_deg {
            let steady_since = bench.turn_analyser(*angle);
            bench.advance_to(steady_since);
            let freshness = Freshness { steady_since, first_sequence: 0, duration: exposure + bench.readout() };
            loop {
                let frame = next(bench);
                if freshness.accepts(frame.stamp()) {
                    frames.push(bench.codes(&frame));
                    break;
                }
                dropped += 1;
            }
        }
        (frames, dropped)
    }

    fn frames(config: &BenchConfig, angles_deg: &[f64]) -> Vec<Vec<u16>> {
        let mut bench = Bench::new(config, &Silent).unwrap();
        capture(&mut bench, disc(config.disc_mm()), angles_deg).0
    }

    fn mean(codes: &[u16]) -> f64 {
        codes.iter().map(|&c| f64::from(c)).sum::<f64>() / codes.len() as f64
    }

    #[test]
    fn sessions_are_reproducible_to_the_bit_and_repeats_differ() {
        let angles = [0.0, 60.0, 120.0];
        let (a, b) = (frames(&small(), &angles), frames(&small(), &angles));
        assert!(a == b);
        assert!(a != frames(&BenchConfig { seed: 6, ..small() }, &angles));
        let mut bench = Bench::new(&small(), &Silent).unwrap();
        bench.advance_to(Duration::from_secs(1));
        let [one, two] = [next(&mut bench), next(&mut bench)].map(|f| bench.codes(&f));
        assert!(one != two, "two exposures of one state have different noise");
    }

    #[test]
    fn light_is_what_shines() {
        let mut config = small();
        config.film.front_reflection = 0.0;
        let mut bench = Bench::new(&config, &Silent).unwrap();
        let black = Shining { pattern: Pattern::Black, flash: false, covered: false };
        let mut codes = |shining: Shining| capture(&mut bench, shining, &[30.0]).0.remove(0);
        let mut level = |shining: Shining| mean(&codes(shining)) - 64.0;
        let (covered, ambient) = (level(Shining { covered: true, ..disc(180.0) }), level(black));
        let (whole, half) = (level(disc(180.0)), level(disc(60.0)));
        let flash = level(Shining { flash: true, ..black });
        let both = level(Shining { flash: true, ..disc(180.0) });
        assert!(covered.abs() < 0.1 && ambient > 0.1, "{covered} {ambient}");
        assert!(whole > 1.2 * half && half > 2.0 * ambient, "{whole} {half}");
        // A small lamp lights few orientations, but brightly.
        let glint = |codes: Vec<u16>| codes.into_iter().max().map_or(0.0, |c| f64::from(c) - 64.0);
        let (lit, unlit) = (glint(codes(Shining { flash: true, ..black })), glint(codes(black)));
        assert!(lit > 2.0 * unlit, "{lit} {unlit}");
        assert!((both - (whole + flash - ambient)).abs() < 0.01 * both, "{both} {whole} {flash} {ambient}");
    }

    /// An off-axis disc lights the pixels of one orientation, as the grating equation predicts.
    #[test]
    fn spots_light_the_orientations_they_stand_for() {
        let mut config = small();
        config.sample.period_um = Some(1.0);
        let (distance, half) = (config.geometry.distance_mm, 0.5 * config.geometry.baseline_mm);
        // Grating equation at the centre of the field: sines of the mirror direction and λ/period along the grating
        // vector.
        let spot = |angle: f64| {
            let u = half / half.hypot(distance) + 0.55 * angle.cos();
            let v = 0.55 * angle.sin();
            let [x, y] = [u, v].map(|s| distance * s / (1.0 - u * u - v * v).sqrt());
            Pattern::Disc { center_mm: [x - half, y], diameter_mm: 60.0 }
        };
        let mut bench = Bench::new(&config, &Silent).unwrap();
        let orientation = bench.truth().orientation.clone();
        for angle in [0.0, 0.8, 2.0] {
            let shining = Shining { pattern: spot(angle), ..disc(1.0) };
            let codes = capture(&mut bench, shining, &[0.0]).0.remove(0);
            let median = |near: bool| {
                let mut chosen: Vec<u16> = (0..codes.len())
                    .filter(|&i| {
                        let off = angle_difference(orientation[i].into(), angle).abs();
                        if near { off < 0.1 } else { off > 0.5 }
                    })
                    .map(|i| codes[i])
                    .collect();
                chosen.sort_unstable();
                f64::from(chosen[chosen.len() / 2])
            };
            assert!(median(true) - 64.0 > 5.0 * (median(false) - 64.0).max(1.0), "{angle}: {}", median(true));
        }
    }

    /// Without the freshness rule, the queue's stale frames would be accepted: 12 angles would all show the first.
    #[test]
    fn stale_frames_are_dropped() {
        let mut bench = Bench::new(&small(), &Silent).unwrap();
        let (_, dropped) = capture(&mut bench, disc(180.0), &[0.0, 45.0, 90.0]);
        assert!(dropped >= 3 * 4, "{dropped}: at least a full queue of 4 per angle");
        let mut stale = Bench::new(&small(), &Silent).unwrap();
        stale.advance_to(Duration::from_secs(1));
        stale.shine(disc(180.0), Duration::ZERO);
        stale.advance_to(Duration::from_secs(2));
        let old = next(&mut stale);
        let mean = mean(&stale.codes(&old));
        assert!(mean < 80.0, "the oldest frame in the queue was taken before the light was on: {mean}");
    }

    /// 10,000 frames under random changes: with the freshness rule none is stale, without it many are.
    #[test]
    fn no_stale_frame_is_used_whatever_changes() {
        let (mut stale_with, mut stale_without, mut frames) = (0, 0, 0);
        for lag in 1..=4 {
            let mut config = small();
            (config.camera.width, config.camera.height, config.camera.lag_frames) = (2, 2, lag);
            let mut bench = Bench::new(&config, &Silent).unwrap();
            let random = |i: u64, k: u64| random::uniform(random::key(&[lag.into(), i, k]));
            let (mut exposure, mut freshness) = (config.camera.power_on_exposure_s(), Freshness::default());
            for i in 0..2500 {
                if random(i, 0) < 0.3 {
                    exposure = 0.001 + 0.2 * random(i, 1).powi(3);
                    bench.set_camera(exposure, 1.0);
                    let set_at = bench.now();
                    freshness.first_sequence = loop {
                        let stamp = next(&mut bench).stamp();
                        if let Some(first) = Freshness::first_with_controls(stamp, set_at, lag) {
                            break first;
                        }
                    };
                }
                if random(i, 2) < 0.5 {
                    bench.shine(Shining { covered: random(i, 3) < 0.5, ..disc(180.0) }, Duration::ZERO);
                    freshness.steady_since = bench.now();
                }
                if random(i, 4) < 0.7 {
                    freshness.steady_since = bench.turn_analyser(180.0 * random(i, 5));
                    let idle = Duration::from_secs_f64(0.3 * random(i, 6));
                    bench.advance_to(freshness.steady_since.max(bench.now()) + idle);
                }
                let stale = |f: &Exposed| f.start < freshness.steady_since || f.settings.exposure_s != exposure;
                freshness.duration = Duration::from_secs_f64(exposure) + bench.readout();
                let mut first = true;
                loop {
                    let frame = next(&mut bench);
                    stale_without += u32::from(std::mem::take(&mut first) && stale(&frame));
                    if freshness.accepts(frame.stamp()) {
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

    /// The whole chain against the sample's truth: almost no noise, no film, small angles of incidence.
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
        config.camera.exposure_ms = Some(2000.0);
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
