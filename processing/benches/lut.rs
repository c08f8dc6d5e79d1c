//! Lookup tables of a photograph of 2048² with a black background, as after black subtraction, and of the same
//! photograph with a dim background. Black must cost no more: no subnormal numbers, and no trial interpolation of black
//! regions.

#![allow(clippy::expect_used)]

use nacre_processing::numeric::flush_subnormals;
use nacre_processing::pattern::{Photograph, Settings, Wavelength, lookup};

const SIZE: usize = 2048;

fn main() {
    flush_subnormals();
    divan::main();
}

/// Orders on a lattice of 300 pixels; `background` in units of the zero order.
fn photograph(background: f32) -> Photograph {
    let (center, pitch, sigma) = (0.5 * (SIZE - 1) as f64, 300.0, 2.5);
    let (sin, cos) = 0.3_f64.sin_cos();
    let at = |i: usize| {
        let (x, y) = ((i % SIZE) as f64 - center, (i / SIZE) as f64 - center);
        let (u, v) = ((cos * x + sin * y) / pitch, (cos * y - sin * x) / pitch);
        let (m, n) = (u.round(), v.round());
        let square = ((u - m).powi(2) + (v - n).powi(2)) * pitch * pitch / (sigma * sigma);
        let light = (-0.5 * square).exp() / (1.0 + 20.0 * (m * m + n * n));
        let grain = 1.0 + 0.1 * ((i * 7919) % 101) as f32 / 101.0;
        background * grain + if light < 1e-6 { 0.0 } else { light as f32 }
    };
    Photograph { light: (0..SIZE * SIZE).map(at).collect(), width: SIZE, height: SIZE }
}

#[divan::bench(args = [0.0, 1e-7], sample_count = 5)]
fn table(bencher: divan::Bencher, background: f32) {
    let photographs = [photograph(background)];
    let settings = Settings { wavelength_nm: Some(Wavelength::Band(560.0)), scale: Some(8e-4), ..Settings::default() };
    bencher.bench_local(|| lookup(&photographs, &settings).expect("a table"));
}
