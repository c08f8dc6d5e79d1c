//! Time and result of Richardson-Lucy on 1024 × 1024 pixels with a Gaussian of 31 × 31, for comparison with
//! `benches/peers/deconvolve.py`: `cargo run --release --example deconvolve`.

mod cpu;

use cpu::used;
use nacre_processing::bokeh::deconvolution::{Deconvolution, Image, Iterations, Method, Psf, deconvolve};
use nacre_processing::progress::Silent;
use std::time::Instant;

const SIDE: usize = 1024;
const SIGMA: f64 = 5.0;
const RADIUS: usize = 15;
const ITERATIONS: usize = 30;

/// Positions of compared results, in the centre and at the edges.
const PLACES: [[usize; 2]; 5] = [[512, 512], [300, 700], [0, 0], [1023, 511], [2, 900]];

/// Lines and dots, as in the script.
fn photograph() -> Vec<f32> {
    let light = |x: f64, y: f64| 0.5 + 0.06 * (0.35 * x + 0.15 * y).sin() + 0.1 * (1e-4 * x * y).cos();
    (0..SIDE * SIDE).map(|i| light((i % SIDE) as f64, (i / SIDE) as f64) as f32).collect()
}

#[allow(clippy::print_stdout)]
fn main() -> nacre_processing::Result<()> {
    let light = photograph();
    let image = Image { width: SIDE, height: SIDE, light: &light };
    let psf = Psf::gaussian_within(SIGMA, RADIUS)?;
    let plain = Method { accelerate: false, ..Method::default() };
    for (name, method) in
        [("as scikit-image", Method::textbook()), ("edges unknown", plain), ("and accelerated", Method::default())]
    {
        for _ in 0..3 {
            let (cpu, begun) = (used(), Instant::now());
            let found = deconvolve(&image, &psf, None, &method, Iterations::Count(ITERATIONS), &Silent)?;
            let (cpu, wall) = (used() - cpu, begun.elapsed().as_secs_f64());
            let values = PLACES.map(|[x, y]| format!("{:.5}", found.light[y * SIDE + x])).join(" ");
            println!("{name:16} {cpu:.2} CPU-seconds, {wall:.3} s   {values}");
        }
    }
    let mut steps = Deconvolution::new(&image, &psf, None, &Method::textbook())?;
    let begun = Instant::now();
    (0..ITERATIONS).for_each(|_| {
        steps.compare();
        steps.update();
    });
    println!("iterations alone {:.3} s", begun.elapsed().as_secs_f64());
    Ok(())
}
