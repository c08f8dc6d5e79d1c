//! Whether `auto` is as fast as the fastest method that meets the wanted error: maps, slices and sets of points of several surfaces, by
//! every method, three times each: `cargo run --release --example choose`.

use nacre_processing::Result;
use nacre_processing::progress::Silent;
use nacre_processing::surface::height::{HeightField, Profile, Quality, Shape, Synthetic};
use nacre_processing::surface::{Choice, Method, Settings, Views, map, name, slice};
use std::time::Instant;

const METHODS: [Method; 5] = [Method::Auto, Method::Taylor, Method::Chebyshev, Method::Fft, Method::Nmm];

/// What is computed.
#[derive(Clone, Copy)]
enum Product {
    Map(usize),
    Slice,
    Point,
}

fn surface(shape: Shape, pixels: usize, pixel_um: f64, [period_um, depth_um]: [f64; 2]) -> Result<HeightField> {
    Synthetic { shape, pixels, pixel_um, period_um, depth_um, angle: 0.0 }.field()
}

/// Time in s, and the choice; none where the method refuses.
fn run(field: &HeightField, quality: &Quality, settings: &Settings, product: Product) -> Option<(f64, Choice)> {
    let begun = Instant::now();
    let choice = match product {
        Product::Map(size) => map(field, quality, settings, Views::all(size), &Silent).map(|m| m.choice),
        Product::Slice => {
            let nm: Vec<f64> = (380..=780).step_by(5).map(f64::from).collect();
            let theta: Vec<f64> = (-160..=160).map(|k| 0.5 * f64::from(k)).collect();
            slice(field, quality, settings, [&nm, &theta], None, &Silent).map(|s| s.choice)
        }
        Product::Point => slice(field, quality, settings, [&[550.0], &[10.0]], None, &Silent).map(|s| s.choice),
    };
    choice.ok().map(|choice| (begun.elapsed().as_secs_f64(), choice))
}

#[allow(clippy::print_stdout)]
fn main() -> Result<()> {
    let sinusoid = Shape::Grating(Profile::Sinusoid);
    let samples = [
        ("sinusoid 0.1 µm", surface(sinusoid, 80, 0.08, [1.6, 0.1])?),
        ("blazed 0.3 µm", surface(Shape::Grating(Profile::Blazed), 128, 0.078_125, [2.5, 0.3])?),
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
    let mut worst = 0.0_f64;
    for (sample, field) in &samples {
        let quality = Quality::of(field, 16.0);
        for (what, product) in products {
            for max_error in [0.1, 0.01, 0.001] {
                let mut times = vec![];
                for method in METHODS {
                    let settings = Settings { method, max_error, coherence_um: 16.0, ..Settings::default() };
                    let all: Vec<_> = (0..3).filter_map(|_| run(field, &quality, &settings, product)).collect();
                    let meets = |c: &Choice| c.measured_error.is_none_or(|e| e <= max_error);
                    if let Some((_, choice)) = all.first().filter(|(_, choice)| meets(choice)) {
                        let least = all.iter().map(|(s, _)| *s).fold(f64::INFINITY, f64::min);
                        times.push((method, least, choice.predicted_s, choice.bits));
                    }
                }
                let fastest = times.iter().map(|t| t.1).fold(f64::INFINITY, f64::min);
                let ratio = times.first().map_or(f64::NAN, |t| t.1 / fastest);
                // Below a millisecond the clock decides.
                if fastest > 1e-3 {
                    worst = worst.max(ratio);
                }
                let each: Vec<String> = times
                    .iter()
                    .map(|(m, s, said, bits)| format!("{} {s:.3} s ({said:.3} said, {bits} bits)", name(*m)))
                    .collect();
                println!("{sample}, {what}, {max_error}: {ratio:.2}; {}", each.join(", "));
            }
        }
    }
    println!("worst ratio {worst:.2}");
    Ok(())
}
