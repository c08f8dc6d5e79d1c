//! How near to the best iteration a deconvolution stops by itself, over scenes, blurs, noises, and point spread functions that are
//! right, too narrow and too wide: `cargo run --release --example stopping`.

use nacre_processing::bokeh::deconvolution::{Deconvolution, Image, Iterations, Method, Noise, Psf, deconvolve};
use nacre_processing::progress::Silent;

const SIDE: usize = 160;
const MARGIN: usize = 48;
const ALL: usize = SIDE + 2 * MARGIN;
const READ_NOISE_E: f64 = 8.0;

/// Iterations that the best one is looked for among.
const LONGEST: usize = 250;

/// Uniform in (0, 1), from a hash.
fn uniform(seed: usize, i: usize) -> f64 {
    let mut z = ((seed as u64) << 40 ^ i as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    for _ in 0..2 {
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
    }
    ((z >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

fn normal(seed: usize, i: usize) -> f64 {
    (-2.0 * uniform(seed, 2 * i).ln()).sqrt() * (std::f64::consts::TAU * uniform(seed, 2 * i + 1)).cos()
}

const SCENES: [&str; 8] = ["sinusoid", "blazed", "rectangular", "lattice", "dots", "rough", "highlight", "two periods"];

/// A scene, larger than what is photographed of it.
fn scene(kind: usize) -> Vec<f64> {
    let period = 9.0 + 15.0 * uniform(50 + kind, 0);
    let (sin, cos) = (180.0 * uniform(50 + kind, 1)).to_radians().sin_cos();
    let dots: Vec<[f64; 3]> = (0..60).map(|k| [0, 1, 2].map(|c| uniform(60 + c, k))).collect();
    let one = |i: usize| {
        let (x, y) = ((i % ALL) as f64, (i / ALL) as f64);
        let (u, v) = ((x * cos + y * sin) / period, (y * cos - x * sin) / period);
        let step = |t: f64, share: f64| f64::from(u8::from(t.rem_euclid(1.0) < share));
        match kind {
            0 => 0.5 + 0.4 * (std::f64::consts::TAU * u).sin(),
            1 => 0.15 + 0.7 * u.rem_euclid(1.0),
            2 => 0.2 + 0.65 * step(u, 0.45),
            3 => 0.15 + 0.7 * step(u, 0.6) * step(v, 0.7),
            4 => {
                let dot = |[a, b, c]: &[f64; 3]| {
                    let square = (x - a * ALL as f64).powi(2) + (y - b * ALL as f64).powi(2);
                    (0.2 + 0.8 * c) * (-square / 4.5).exp()
                };
                0.05 + dots.iter().map(dot).sum::<f64>()
            }
            5 => {
                let wave = |k: usize| {
                    let (fx, fy) = (0.4 * uniform(70, k) - 0.2, 0.4 * uniform(71, k) - 0.2);
                    let phase = std::f64::consts::TAU * (fx * x + fy * y + uniform(72, k));
                    0.004 / (0.02 + fx.hypot(fy)) * phase.sin()
                };
                (0.5 + (0..80).map(wave).sum::<f64>()).max(0.02)
            }
            6 => {
                let radius = (x - 0.5 * ALL as f64).hypot(y - 0.5 * ALL as f64);
                0.02 + (0.25 + 0.55 * step(u, 0.5)) / (1.0 + (radius - 0.38 * SIDE as f64).exp())
            }
            _ => 0.1 + 0.4 * step(u, 0.3) + 0.35 * (2.7 * v).rem_euclid(1.0),
        }
    };
    (0..ALL * ALL).map(one).collect()
}

/// Blurred with a Gaussian, by the definition.
fn blurred(image: &[f64], sigma: f64) -> Vec<f64> {
    let reach = (5.0 * sigma).ceil() as i64;
    let taps: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    let pass = |image: &[f64], step: usize| -> Vec<f64> {
        let at = |i: usize| {
            let place = (i / step % ALL) as i64;
            let tap = |(k, tap): (i64, &f64)| {
                let to = (place + k).clamp(0, ALL as i64 - 1);
                tap * image[(i as i64 + (to - place) * step as i64) as usize]
            };
            (-reach..=reach).zip(&taps).map(tap).sum::<f64>() / sum
        };
        (0..image.len()).map(at).collect()
    };
    pass(&pass(image, 1), ALL)
}

fn cropped(image: &[f64]) -> Vec<f64> {
    (0..SIDE * SIDE).map(|i| image[(i / SIDE + MARGIN) * ALL + i % SIDE + MARGIN]).collect()
}

#[allow(clippy::print_stdout)]
fn main() -> nacre_processing::Result<()> {
    let seed: usize = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(7);
    for (kind, label) in SCENES.iter().enumerate() {
        let sharp = scene(kind);
        let truth = cropped(&sharp);
        for sigma in [1.2, 2.5, 4.0] {
            let soft = cropped(&blurred(&sharp, sigma));
            for full in [300.0, 3000.0, 30_000.0] {
                let floor = (READ_NOISE_E / full).powi(2);
                let noisy = |(i, v): (usize, &f64)| (v + (v / full + floor).sqrt() * normal(seed, i)) as f32;
                let light: Vec<f32> = soft.iter().enumerate().map(noisy).collect();
                let noise = Noise { shot: 1.0 / full, floor };
                let psf = Psf::gaussian(sigma)?;
                let image = Image { width: SIDE, height: SIDE, light: &light };
                let error = |light: &[f32]| {
                    let square: f64 = light.iter().zip(&truth).map(|(f, t)| (f64::from(*f) - t).powi(2)).sum();
                    (square / truth.len() as f64).sqrt()
                };
                let mut steps = Deconvolution::new(&image, &psf, Some(noise), &Method::default())?;
                let mut row = vec![];
                for _ in 0..LONGEST {
                    let e = error(&steps.light());
                    let [m, l] = steps.compare();
                    row.push(format!("{e:.6e},{m:.7},{l:.7}"));
                    steps.update();
                }
                let found = deconvolve(&image, &psf, Some(noise), &Method::default(), Iterations::Auto(LONGEST), &Silent)?;
                println!("{label};{sigma};{full};{};{:.6e};{}", found.iterations, error(&found.light), row.join(" "));
            }
        }
    }
    Ok(())
}
