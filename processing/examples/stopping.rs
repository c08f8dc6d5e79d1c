//! Error of automatically stopped deconvolutions relative to the best iteration, over scenes, blurs, noise levels, and
//! point spread functions of correct, too small and too large width. For comparison, the error of an oracle that stops
//! where the blurred estimate is closest to the noise-free photograph. `cargo run --release --example stopping`.

use nacre_processing::bokeh::deconvolution::{Deconvolution, Image, Iterations, Method, Noise, Psf, deconvolve};
use nacre_processing::progress::Silent;

const SIDE: usize = 160;
const MARGIN: usize = 48;
const ALL: usize = SIDE + 2 * MARGIN;
const READ_NOISE_E: f64 = 8.0;

/// Number of iterations among which the best one is searched.
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

/// A scene larger than its photograph.
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

/// Blurs a square image of this side with a Gaussian, by direct summation.
fn blurred(image: &[f64], side: usize, sigma: f64) -> Vec<f64> {
    let reach = (5.0 * sigma).ceil() as i64;
    let taps: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    let pass = |image: &[f64], step: usize| -> Vec<f64> {
        let at = |i: usize| {
            let place = (i / step % side) as i64;
            let tap = |(k, tap): (i64, &f64)| {
                let to = (place + k).clamp(0, side as i64 - 1);
                tap * image[(i as i64 + (to - place) * step as i64) as usize]
            };
            (-reach..=reach).zip(&taps).map(tap).sum::<f64>() / sum
        };
        (0..image.len()).map(at).collect()
    };
    pass(&pass(image, 1), side)
}

fn cropped(image: &[f64]) -> Vec<f64> {
    (0..SIDE * SIDE).map(|i| image[(i / SIDE + MARGIN) * ALL + i % SIDE + MARGIN]).collect()
}

/// A photograph and its origin.
struct Photograph<'a> {
    truth: &'a [f64],
    /// Blurred scene without noise, and the width of the blur.
    soft: &'a [f64],
    sigma: f64,
    light: &'a [f32],
}

/// Root mean square difference.
fn rms(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (square, count) = pairs.fold((0.0, 0.0), |(sum, n), (a, b)| (sum + (a - b).powi(2), n + 1.0));
    (square / f64::max(count, 1.0)).sqrt()
}

/// Root mean square deviation of the blurred estimate from the noise-free photograph, without edges.
fn astray(light: &[f32], photograph: &Photograph) -> f64 {
    let estimate: Vec<f64> = light.iter().map(|v| f64::from(*v)).collect();
    let again = blurred(&estimate, SIDE, photograph.sigma);
    let edge = (3.0 * photograph.sigma).ceil() as usize;
    let inner = |i: &usize| [i % SIDE, i / SIDE].iter().all(|k| (edge..SIDE - edge).contains(k));
    rms((0..SIDE * SIDE).filter(inner).map(|i| (again[i], photograph.soft[i])))
}

/// Stopping iteration, and errors relative to the minimum error.
struct Stopped {
    at: usize,
    best_at: usize,
    ratio: f64,
    /// Relative error of the oracle that knows the noise-free photograph.
    told: f64,
}

fn stopped(photograph: &Photograph, psf: &Psf, noise: Noise, method: &Method) -> nacre_processing::Result<Stopped> {
    let image = Image { width: SIDE, height: SIDE, light: photograph.light };
    let error = |light: &[f32]| rms(light.iter().map(|v| f64::from(*v)).zip(photograph.truth.iter().copied()));
    let mut steps = Deconvolution::new(&image, psf, Some(noise), method)?;
    let (mut best, mut best_at) = (f64::INFINITY, 0);
    let (mut nearest, mut told) = (f64::INFINITY, f64::INFINITY);
    for k in 1..=LONGEST {
        steps.compare();
        steps.update();
        let light = steps.light();
        let (now, off) = (error(&light), astray(&light, photograph));
        if now < best {
            (best, best_at) = (now, k);
        }
        if off < nearest {
            (nearest, told) = (off, now);
        }
    }
    let found = deconvolve(&image, psf, Some(noise), method, Iterations::Auto(LONGEST), &Silent)?;
    Ok(Stopped { at: found.iterations, best_at, ratio: error(&found.light) / best, told: told / best })
}

#[allow(clippy::print_stdout)]
fn main() -> nacre_processing::Result<()> {
    for (name, accelerate, off) in
        [("noise known", true, 1.0), ("noise known, plain", false, 1.0), ("noise 10 % too small", true, 0.81)]
    {
        for width in [0.8, 0.9, 1.0, 1.1, 1.25] {
            let (mut sum, mut worst, mut above, mut told) = (0.0, 0.0_f64, vec![], 0);
            let mut count = 0;
            for (kind, label) in SCENES.iter().enumerate() {
                let sharp = scene(kind);
                let truth = cropped(&sharp);
                for sigma in [1.2, 2.5, 4.0] {
                    let soft = cropped(&blurred(&sharp, ALL, sigma));
                    for full in [300.0, 3000.0, 30_000.0] {
                        let floor = (READ_NOISE_E / full).powi(2);
                        let noisy = |(i, v): (usize, &f64)| (v + (v / full + floor).sqrt() * normal(7, i)) as f32;
                        let light: Vec<f32> = soft.iter().enumerate().map(noisy).collect();
                        let noise = Noise { shot: off / full, floor: off * floor };
                        let method = Method { accelerate, ..Method::default() };
                        let photograph = Photograph { truth: &truth, soft: &soft, sigma, light: &light };
                        let Stopped { at, best_at, ratio, told: by_truth } =
                            stopped(&photograph, &Psf::gaussian(sigma * width)?, noise, &method)?;
                        (sum, worst, count) = (sum + ratio, worst.max(ratio), count + 1);
                        told += usize::from(by_truth > 1.1);
                        if ratio > 1.1 {
                            above.push(format!(
                                "{label} σ {sigma} {full} e⁻: {ratio:.2} ({at} for {best_at}); told {by_truth:.2}"
                            ));
                        }
                    }
                }
            }
            println!(
                "{name}, PSF {width} as wide: mean {:.3}, worst {worst:.2}, {} of {count} above 1.1; {told}, were it told",
                sum / f64::from(count),
                above.len()
            );
            if accelerate && off == 1.0 && width == 1.0 {
                println!("  {}", above.join("\n  "));
            }
        }
    }
    Ok(())
}
