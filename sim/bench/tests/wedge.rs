//! A wedged analyser shifts the image as it turns, and registration measures the shift.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use nacre_base::progress::Silent;
use nacre_drivers::Pattern;
use nacre_image::registration::{Registrar, Registration, Shift};
use nacre_sim::{Bench, BenchConfig, Shining};
use std::time::Duration;

fn bench(wedge_px: f64, jitter_px: f64) -> Bench {
    let mut config = BenchConfig { seed: 3, ..BenchConfig::default() };
    (config.camera.width, config.camera.height) = (192, 160);
    config.camera.exposure_ms = Some(15.0);
    (config.analyser.wedge_px, config.analyser.jitter_px) = (wedge_px, jitter_px);
    Bench::new(&config, &Silent).unwrap()
}

/// A photograph at an angle, exposed after everything has settled.
fn photograph(bench: &mut Bench, angle_deg: f64) -> Vec<u16> {
    let steady = bench.turn_analyser(angle_deg);
    loop {
        bench.advance_to(bench.next_frame_at());
        if let Some(frame) = bench.take_frame().filter(|frame| frame.start >= steady) {
            return bench.codes(&frame);
        }
    }
}

fn light_up(bench: &mut Bench) {
    let pattern = Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm: bench.config().disc_mm() };
    bench.shine(Shining { pattern, flash: false, covered: false }, Duration::ZERO);
}

#[test]
fn registration_finds_the_wedge() {
    let angles_deg: Vec<f64> = (0..8).map(|k| 22.5 * f64::from(k)).collect();
    let angles: Vec<f64> = angles_deg.iter().map(|a| a.to_radians()).collect();
    for (wedge_px, jitter_px) in [(0.0, 0.0), (0.3, 0.0), (2.0, 0.2)] {
        let mut bench = bench(wedge_px, jitter_px);
        light_up(&mut bench);
        let mut truth = Vec::new();
        let mut registrar = Registrar::new(192, 160);
        for angle_deg in &angles_deg {
            let codes = photograph(&mut bench, *angle_deg);
            truth.push(bench.config().shift_px(bench.analyser_deg()));
            registrar.add(|y: usize, left: usize, values: &mut [f32], bad: &mut [u8]| {
                for ((value, bad), code) in values.iter_mut().zip(bad).zip(&codes[y * 192 + left..]) {
                    *value = f32::from(*code) - 64.0;
                    *bad |= u8::from(*code >= 4095);
                }
            });
        }
        let Registration::Told(shifts) = registrar.polarized(&angles) else { panic!("{wedge_px} px: cannot tell") };
        let mean = [0, 1].map(|i| truth.iter().map(|t| t[i]).sum::<f64>() / 8.0);
        let square = |(s, t): (&Shift, &[f64; 2])| (s.dx - t[0] + mean[0]).powi(2) + (s.dy - t[1] + mean[1]).powi(2);
        let error = (shifts.iter().zip(&truth).map(square).sum::<f64>() / 16.0).sqrt();
        let sigma = shifts.iter().map(|s| s.sigma).fold(0.0, f64::max);
        println!("wedge {wedge_px} px, jitter {jitter_px} px: error {error:.4} px, σ {sigma:.4} px");
        assert!(error < 0.05, "{wedge_px} px: {error} px, σ {sigma}");
    }
}

/// A photograph shifted by whole pixels equals the unshifted one, except for noise.
#[test]
fn the_image_moves_along_the_analyser() {
    let (mut straight, mut wedged) = (bench(0.0, 0.0), bench(5.0, 0.0));
    for (angle_deg, [dx, dy]) in [(0.0, [5_i64, 0]), (90.0, [0, -5])] {
        let [a, b] = [&mut straight, &mut wedged].map(|bench| {
            light_up(bench);
            photograph(bench, angle_deg)
        });
        let difference = |dx: i64, dy: i64| {
            let pixels = (10..150_i64).flat_map(|y| (10..180_i64).map(move |x| (x, y)));
            pixels
                .map(|(x, y)| a[(y * 192 + x) as usize].abs_diff(b[((y + dy) * 192 + x + dx) as usize]))
                .map(f64::from)
                .sum::<f64>()
        };
        let (right, none, wrong) = (difference(dx, dy), difference(0, 0), difference(-dx, -dy));
        assert!(2.0 * right < none && none < wrong, "{angle_deg}°: {right} {none} {wrong}");
    }
}
