//! CPU time of the transforms of a patch of 2048 × 2048 pixels, 0.5 µm deep, with an error of 1 %, for comparison with
//! `benches/peers/terms.py`. `cargo run --release --example terms` measures slices by each method and a set of terms,
//! with `set` only the set of terms.

mod cpu;

use cpu::used;
use nacre_processing::progress::Silent;
use nacre_processing::surface::height::{Quality, Shape, Synthetic};
use nacre_processing::surface::{Method, Settings, TermSet, TermsRequest, slice};
use std::time::Instant;

#[allow(clippy::print_stdout)]
fn main() -> nacre_processing::Result<()> {
    let surface =
        Synthetic { shape: Shape::Fingers, pixels: 2048, pixel_um: 0.05, period_um: 1.2, depth_um: 0.5, angle: 0.4 };
    let field = surface.field()?;
    let wanted = TermsRequest { extent: 2.0, precision: None };
    // Minimum of several runs, because other programs use the machine, too.
    let mut least = [f64::INFINITY; 2];
    for _ in 0..9 {
        let (cpu, begun) = (used(), Instant::now());
        let set = TermSet::new(&field, &Settings::default(), wanted, &Silent)?;
        least = [least[0].min(used() - cpu), least[1].min(begun.elapsed().as_secs_f64())];
        println!(
            "set of {} terms: {:.2} CPU-seconds and {:.2} s so far, predicted error {:.1e}",
            set.about.terms, least[0], least[1], set.about.predicted_error
        );
    }
    if std::env::args().any(|a| a == "set") {
        return Ok(());
    }
    let quality = Quality::of(&field, 65.0);
    // Includes verification by direct sums. One direction close to the limit for 380 to 780 nm and normal incidence;
    // densities cost almost nothing.
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
