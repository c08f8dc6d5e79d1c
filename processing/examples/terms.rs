//! CPU time of the transforms of a patch of 2048 × 2048 pixels, half a µm deep, at 1 %, for comparison with
//! `benches/peers/terms.py`: `cargo run --release --example terms`.

use nacre_processing::progress::Silent;
use nacre_processing::surface::height::{Quality, Shape, Synthetic};
use nacre_processing::surface::{Method, Settings, slice};
use std::time::Instant;

/// CPU time of this process in seconds, all threads, as the system counts it.
fn used() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    // Fields 14 and 15 of the whole line, in hundredths of a second.
    let ticks = |k: usize| fields.get(k).and_then(|f| f.parse::<f64>().ok()).unwrap_or(f64::NAN);
    (ticks(11) + ticks(12)) / 100.0
}

#[allow(clippy::print_stdout)]
fn main() -> nacre_processing::Result<()> {
    let surface =
        Synthetic { shape: Shape::Fingers, pixels: 2048, pixel_um: 0.05, period_um: 1.2, depth_um: 0.5, angle: 0.4 };
    let field = surface.field()?;
    let quality = Quality::of(&field, 65.0);
    // One direction near to all that 380 to 780 nm and normal incidence reach; densities cost next to nothing.
    for method in [Method::Chebyshev, Method::Fft, Method::Auto] {
        let settings = Settings { method, ..Settings::default() };
        let (cpu, begun) = (used(), Instant::now());
        let found = slice(&field, &quality, &settings, [&[380.0, 780.0], &[-85.0, 0.0, 85.0]], None, &Silent)?;
        println!(
            "{method:?}: {:?} terms, {:.2} CPU-seconds, {:.2} s, measured error {:.2e}",
            found.choice.terms,
            used() - cpu,
            begun.elapsed().as_secs_f64(),
            found.choice.measured_error.unwrap_or(f64::NAN)
        );
    }
    Ok(())
}
