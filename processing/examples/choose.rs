//! Tests whether `auto` meets the requested error and is as fast as the fastest sufficient method: maps, slices and
//! points of several surfaces, by every method. Times are the minimum CPU time of several runs. `cargo run --release
//! --example choose`, optionally with parts of samples' names.

use nacre_processing::Result;
use nacre_processing::progress::Silent;
use nacre_processing::surface::height::{HeightField, Profile, Quality, Shape, Synthetic};
use nacre_processing::surface::{Choice, Method, Settings, Views, map, name, slice};
use std::fs;

/// Minimum number of runs per method, and minimum total time of the runs in s.
const RUNS: usize = 3;
const LEAST_S: f64 = 0.06;

const METHODS: [Method; 5] = [Method::Auto, Method::Taylor, Method::Chebyshev, Method::Fft, Method::Nmm];

/// Computed product.
#[derive(Clone, Copy)]
enum Product {
    Map(usize),
    Slice,
    Point,
}

fn surface(shape: Shape, pixels: usize, pixel_um: f64, [period_um, depth_um]: [f64; 2]) -> Result<HeightField> {
    Synthetic { shape, pixels, pixel_um, period_um, depth_um, angle: 0.0 }.field()
}

/// CPU time of all threads in s, to about one scheduler tick.
fn used() -> f64 {
    let tasks = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let time = |task: fs::DirEntry| -> Option<f64> {
        fs::read_to_string(task.path().join("schedstat")).ok()?.split_whitespace().next()?.parse().ok()
    };
    tasks.filter_map(time).sum::<f64>() * 1e-9
}

/// The choice; `None` if the method rejects the task.
fn run(field: &HeightField, quality: &Quality, settings: &Settings, product: Product) -> Option<Choice> {
    let choice = match product {
        Product::Map(size) => map(field, quality, settings, Views::all(size), &Silent).map(|m| m.choice),
        Product::Slice => {
            let nm: Vec<f64> = (380..=780).step_by(5).map(f64::from).collect();
            let theta: Vec<f64> = (-160..=160).map(|k| 0.5 * f64::from(k)).collect();
            slice(field, quality, settings, [&nm, &theta], None, &Silent).map(|s| s.choice)
        }
        Product::Point => slice(field, quality, settings, [&[550.0], &[10.0]], None, &Silent).map(|s| s.choice),
    };
    choice.ok()
}

#[allow(clippy::print_stdout)]
fn main() -> Result<()> {
    let sinusoid = Shape::Grating(Profile::Sinusoid);
    let samples = [
        ("sinusoid 0.1 µm", surface(sinusoid, 80, 0.08, [1.6, 0.1])?),
        ("blazed 0.3 µm", surface(Shape::Grating(Profile::Blazed), 128, 0.078_125, [2.5, 0.3])?),
        (
            "rectangular 0.2 µm",
            surface(Shape::Grating(Profile::Rectangular { duty: 0.4 }), 128, 0.078_125, [2.5, 0.2])?,
        ),
        ("two regions 0.3 µm", surface(Shape::TwoRegions, 256, 0.08, [1.28, 0.3])?),
        ("fingers 0.4 µm", surface(Shape::Fingers, 256, 0.09, [1.2, 0.4])?),
        ("fingers 2 µm", surface(Shape::Fingers, 256, 0.09, [1.2, 2.0])?),
        ("fingers 4 µm", surface(Shape::Fingers, 512, 0.09, [1.2, 4.0])?),
        ("disc 0.12 µm", surface(Shape::Cd, 512, 0.08, [1.6, 0.12])?),
    ];
    let products = [
        ("map 128", Product::Map(128)),
        ("map 512", Product::Map(512)),
        ("slice", Product::Slice),
        ("point", Product::Point),
    ];
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let asked = |sample: &str| wanted.is_empty() || wanted.iter().any(|w| sample.contains(w));
    let (mut worst, mut missed) = (0.0_f64, 0);
    for (sample, field) in samples.iter().filter(|s| asked(s.0)) {
        let quality = Quality::of(field, 16.0);
        for (what, product) in products {
            for max_error in [0.1, 0.01, 0.001] {
                // Methods alternate, so that other load on the machine affects all of them alike.
                let mut times = METHODS.map(|_| f64::INFINITY);
                let mut choices = METHODS.map(|_| None);
                for _ in 0..RUNS {
                    for (k, method) in METHODS.into_iter().enumerate() {
                        let settings = Settings { method, max_error, coherence_um: 16.0, ..Settings::default() };
                        let (begun, mut count) = (used(), 0.0);
                        while count < 1.0 || (used() - begun < LEAST_S && count < 100.0) {
                            choices[k] = run(field, &quality, &settings, product);
                            count += 1.0;
                            if choices[k].is_none() {
                                break;
                            }
                        }
                        times[k] = times[k].min((used() - begun) / count);
                    }
                }
                let meets = |c: &Choice| c.measured_error.is_none_or(|e| e <= max_error);
                missed += usize::from(!choices[0].as_ref().is_some_and(meets));
                let good = || (0..METHODS.len()).filter(|k| choices[*k].as_ref().is_some_and(meets));
                let fastest = good().map(|k| times[k]).fold(f64::INFINITY, f64::min);
                let ratio = times[0] / fastest;
                worst = worst.max(ratio);
                let each: Vec<String> = good()
                    .filter_map(|k| choices[k].as_ref().map(|c| (k, c)))
                    .map(|(k, c)| {
                        let (terms, bits) = (c.terms.unwrap_or(0), c.bits);
                        let by = name(METHODS[k]);
                        format!(
                            "{by} {:.2} ms ({:.2} said, {terms} in {bits} bits)",
                            1e3 * times[k],
                            1e3 * c.predicted_s
                        )
                    })
                    .collect();
                println!("{sample}, {what}, {max_error}: {ratio:.2}; {}", each.join(", "));
            }
        }
    }
    println!("worst ratio {worst:.2}; auto missed the wanted error {missed} times");
    Ok(())
}
