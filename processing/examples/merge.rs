//! Time and error of merging five photographs of 4096 × 3072 RGB, for comparison with `benches/peers/merge.py`:
//! `cargo run --release --example merge`.

mod cpu;

use cpu::used;
use nacre_processing::frames::{Frame, FrameSet, Kind, Transfer};
use nacre_processing::hdr::merge;
use nacre_processing::image::{Raster, Samples};
use std::time::Instant;

const WIDTH: usize = 4096;
const HEIGHT: usize = 3072;
const TIMES: [f64; 5] = [1.0 / 256.0, 1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0, 1.0];

fn light(x: usize, y: usize) -> f64 {
    let place = (x as f64 + 0.37 * (1.7 * y as f64).sin()) / WIDTH as f64;
    0.2 * 1250_f64.powf(place.clamp(0.0, 1.0))
}

fn photograph(time: f64) -> Raster {
    let code = |x: usize, y: usize| (255.0 * (light(x, y) * time).min(1.0).powf(1.0 / 2.2)).round() as u8;
    let samples = (0..HEIGHT).flat_map(|y| (0..WIDTH).flat_map(move |x| [code(x, y); 3])).collect();
    Raster { width: WIDTH, height: HEIGHT, channels: 3, samples: Samples::U8(samples) }
}

#[allow(clippy::print_stdout)]
fn main() -> nacre_processing::Result<()> {
    let frames = TIMES.iter().map(|t| Frame { exposure_s: Some(*t), ..Frame::new("in memory") }).collect();
    let set = FrameSet { transfer: Transfer::Gamma(2.2), ..FrameSet::new(Kind::Exposures, frames) };
    let rasters: Vec<Raster> = TIMES.iter().map(|t| photograph(*t)).collect();
    let (cpu, begun) = (used(), Instant::now());
    let merged = merge(set, rasters)?;
    println!("{:.2} CPU-seconds, {:.2} s", used() - cpu, begun.elapsed().as_secs_f64());
    let (mut square, mut count) = (0.0, 0.0);
    for (i, [found, _]) in merged.samples.iter().step_by(3).enumerate() {
        let truth = light(i % WIDTH, i / WIDTH);
        if truth > 0.25 && found.is_finite() {
            square += (f64::from(*found) / truth - 1.0).powi(2);
            count += 1.0;
        }
    }
    println!("RMS {:.3} %", 100.0 * f64::sqrt(square / count));
    Ok(())
}
