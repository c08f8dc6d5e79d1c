//! CPU time of the transforms of a patch of 2048 × 2048 pixels, half a µm deep, at 1 %, for comparison with
//! `benches/peers/terms.py`: `cargo run --release --example terms`.

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
    let begun_cpu = used();
    let begun = Instant::now();
    let wanted = TermsRequest { extent: 2.0, precision: None };
    let set = TermSet::new(&field, &Settings::default(), wanted, &Silent)?;
    println!(
        "set of {} terms: {:.2} CPU-seconds, {:.2} s, predicted error {:.1e}",
        set.about.terms,
        used() - begun_cpu,
        begun.elapsed().as_secs_f64(),
        set.about.predicted_error
    );
    drop(set);
    let quality = Quality::of(&field, 65.0);
    // With the check against direct sums. One direction near to all that 380 to 780 nm and normal incidence reach; densities cost next to nothing.
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
