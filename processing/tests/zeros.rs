//! Exact zeros and constant areas, which black subtraction produces, must take no longer than noisy light.
//!
//! The test compares CPU times of the same kernel on both, in turn, and repeats the pair until they agree. A busy
//! machine therefore delays the test without failing it. Subnormal numbers slow these kernels down by a factor of five
//! to a hundred.

#![allow(clippy::panic, clippy::unwrap_used, clippy::print_stdout)]

use nacre_processing::bokeh::deconvolution::{Image, Iterations, Method, Psf, deconvolve};
use nacre_processing::environment::{Environment, Table, facing};
use nacre_processing::image::registration::{Registrar, Resampler};
use nacre_processing::numeric::flush_subnormals;
use nacre_processing::pattern::{Photograph, Settings, Wavelength, lookup};
use nacre_processing::polarimetry::{OrientationMaps, Smoothing, smoothed_orientation};
use nacre_processing::progress::Silent;
use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;

/// Pixels of a row and of a column.
const SIZE: usize = 512;

/// Maximum ratio of times.
const MOST: f64 = 1.3;

/// Maximum number of pairs of runs before the test fails.
const PAIRS: usize = 60;

/// Kinds of light: noise everywhere, half and 95 % exact zeros in one area, and a single value.
const KINDS: [&str; 4] = ["noise", "half zeros", "95 % zeros", "constant"];

/// Light between 0.5 and 1.5, with noise.
fn light(kind: &str) -> Vec<f32> {
    let noise = |i: usize| 0.5 + ((i.wrapping_mul(2_654_435_761) >> 7) % 1009) as f32 / 1009.0;
    let dark_rows = match kind {
        "half zeros" => SIZE / 2,
        "95 % zeros" => SIZE * 95 / 100,
        _ => 0,
    };
    let at = |i: usize| match kind {
        "constant" => 1.0,
        _ if i / SIZE < dark_rows => 0.0,
        _ => noise(i),
    };
    (0..SIZE * SIZE).map(at).collect()
}

/// CPU time of the process in seconds.
fn cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Asserts that a kernel takes no longer for any kind of light than for noise.
fn compare(name: &str, kernel: &dyn Fn(&[f32])) {
    let inputs = KINDS.map(light);
    let mut least = [f64::INFINITY; KINDS.len()];
    for round in 0..PAIRS {
        for (least, input) in least.iter_mut().zip(&inputs) {
            let begun = cpu_s();
            kernel(black_box(input));
            *least = least.min(cpu_s() - begun);
        }
        let worst = least.iter().fold(0.0_f64, |worst, time| worst.max(time / least[0]));
        if round > 1 && worst <= MOST {
            println!("{name}: {:.1} ms with noise, at most {worst:.2} times as much with zeros", 1e3 * least[0]);
            return;
        }
    }
    let ratios = least.map(|time| time / least[0]);
    panic!("{name}: CPU time over that with noise: {:?}", KINDS.iter().zip(ratios).collect::<Vec<_>>());
}

#[test]
fn zeros_cost_nothing() {
    flush_subnormals();
    compare("table", &|light| {
        // A zero order in the centre.
        let middle = SIZE / 2;
        let spot = |i: usize| {
            let square = (i % SIZE).abs_diff(middle).pow(2) + (i / SIZE).abs_diff(middle).pow(2);
            if square < 400 { 1000.0 * (-(square as f32) / 18.0).exp() } else { 0.0 }
        };
        let light = light.iter().enumerate().map(|(i, v)| v + spot(i)).collect();
        let photographs = [Photograph { light, width: SIZE, height: SIZE }];
        let center = Some([middle as f64; 2]);
        let settings = Settings {
            wavelength_nm: Some(Wavelength::Band(560.0)),
            scale: Some(3e-3),
            size: 256,
            center,
            max_error: 1.0,
            ..Settings::default()
        };
        black_box(lookup(&photographs, &settings).unwrap());
    });
    compare("deconvolution", &|light| {
        let image = Image { width: SIZE, height: SIZE, light };
        let psf = Psf::gaussian_within(3.0, 9).unwrap();
        black_box(deconvolve(&image, &psf, None, &Method::default(), Iterations::Count(5), &Silent).unwrap());
    });
    compare("registration", &|light| {
        let mut registrar = Registrar::new(SIZE, SIZE);
        let row = |y: usize, left: usize, values: &mut [f32], _: &mut [u8]| {
            values.copy_from_slice(&light[y * SIZE + left..][..values.len()]);
        };
        (0..4).for_each(|_| registrar.add(row));
        black_box(registrar.polarized(&[0.0, 0.8, 1.6, 2.4]));
    });
    compare("moving a photograph back", &|light| {
        let resampler = Resampler::new([0.3, -0.4], SIZE, SIZE);
        let frame = |y: usize, values: &mut [f32], _: &mut [u8]| values.copy_from_slice(&light[y * SIZE..][..SIZE]);
        let (mut values, mut bad) = (vec![0.0; SIZE], vec![0; SIZE]);
        (0..SIZE).for_each(|y| resampler.row(y, frame, &mut values, &mut bad));
        black_box(values);
    });
    compare("smoothing", &|light| {
        let map = OrientationMaps {
            width: SIZE,
            height: SIZE,
            orientation: light.to_vec(),
            sigma: light.iter().map(|v| 0.01 + 0.01 * v).collect(),
        };
        black_box(smoothed_orientation(&map, Smoothing::LIGHT, &Silent).unwrap());
    });
    compare("environment", &|light| {
        let pixels = light.chunks(8).map(|v| [v[0], v[1], v[2]]).collect();
        let environment = Environment::of(256, 128, pixels).unwrap();
        let table = Table::from_fn(64, 0.8, |[x, y]| [(-40.0 * (x * x + y * y)).exp(); 3]).unwrap();
        black_box(facing(&environment, &table, 0.0, &Silent).unwrap());
    });
}
