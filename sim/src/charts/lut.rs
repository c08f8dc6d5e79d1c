//! How a lookup table is added up: orders of known shape, from wide to narrower than a pixel.

use crate::random::{key, uniform};
use nacre_processing::Result;
use nacre_processing::chart::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_processing::color::{Illuminant, Observer};
use nacre_processing::pattern::{MethodChoice, Photograph, Settings, Table, Wavelength, lookup};
use rayon::prelude::*;
use std::time::Instant;

/// Standard deviation of an order in pixels.
const WIDTHS_PX: [f64; 6] = [4.0, 2.5, 2.0, 1.5, 1.0, 0.6];
const REFERENCE: usize = 2;

/// Distance of orders, in pixels, and wavelength of the photograph.
const PITCH_PX: f64 = 32.0;
const BAND_NM: f64 = 680.0;

/// Entries that are compared with the truth.
const COMPARED: usize = 1500;

const METHODS: [(&str, &str, f64, MethodChoice); 11] = [
    ("auto", "auto, 1 %", 1.0, MethodChoice::Auto),
    ("auto", "auto, 0.1 %", 0.5, MethodChoice::Auto),
    ("rays", "rays 2 px", 2.0, MethodChoice::Rays(2.0)),
    ("rays", "rays 1 px", 1.0, MethodChoice::Rays(1.0)),
    ("rays", "rays 0.5 px", 0.5, MethodChoice::Rays(0.5)),
    ("single entries", "single 1 px", 1.0, MethodChoice::Single(1.0)),
    ("single entries", "single 0.5 px", 0.5, MethodChoice::Single(0.5)),
    ("fixed steps (paper)", "20 nm", 20.0, MethodChoice::Fixed(20.0)),
    ("fixed steps (paper)", "10 nm", 10.0, MethodChoice::Fixed(10.0)),
    ("fixed steps (paper)", "5 nm", 5.0, MethodChoice::Fixed(5.0)),
    ("fixed steps (paper)", "1 nm", 1.0, MethodChoice::Fixed(1.0)),
];

/// Methods against the sharpness of the orders.
pub(super) fn study(effort: Effort) -> Study {
    let [pixels, entries] = effort.pick([1000, 512], [300, 128]);
    let setting = |(k, (family, name, knob, _)): (usize, &(&str, &str, f64, MethodChoice))| {
        let setting = Setting::new(family, *name, *knob);
        if k == 0 { setting.as_default() } else { setting }
    };
    Study {
        name: "lut",
        group: "lut",
        title: "Adding up a lookup table".into(),
        question: format!(
            "How fine must wavelengths or rays be? A photograph of {pixels} × {pixels} pixels with Gaussian orders {PITCH_PX} pixels apart, \
             and tables of {entries} × {entries} entries under equal energy, whose truth is summed up from the orders themselves. The \
             error is the root mean square of Y at the rim (beyond 0.6 of the extent), over the table's own there. A table counts as \
             confidently wrong when it is off by more than five times what it says."
        ),
        knob: Axis::log("step", "px or nm"),
        stress: Axis::log("standard deviation of an order", "px"),
        error: Axis::log("relative error at the rim", ""),
        time: Axis::log("time per table", "s"),
        predicted: "the error that the table says it has",
        settings: METHODS.iter().enumerate().map(setting).collect(),
        scenes: WIDTHS_PX.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| run(setting, WIDTHS_PX[scene], pixels, entries, seed)),
    }
}

/// Orders on a turned lattice whose zero order lies somewhere between four pixels.
struct Orders {
    sigma: f64,
    angle: f64,
    center: [f64; 2],
}

impl Orders {
    /// Light at a place in pixels from the zero order.
    fn light(&self, x: f64, y: f64) -> f64 {
        let (sin, cos) = self.angle.sin_cos();
        let (a, b) = ((cos * x + sin * y) / PITCH_PX, (cos * y - sin * x) / PITCH_PX);
        let (m, n) = (a.round(), b.round());
        let square = ((a - m).powi(2) + (b - n).powi(2)) * PITCH_PX * PITCH_PX;
        (-0.5 * square / (self.sigma * self.sigma)).exp() / (1.0 + 0.1 * (m * m + n * n))
    }
}

fn run(setting: usize, sigma: f64, pixels: usize, entries: usize, seed: u64) -> Result<Outcome> {
    let middle = 0.5 * pixels as f64;
    let part = |k: u64| uniform(key(&[seed, k]));
    let orders = Orders { sigma, angle: part(0), center: [middle + part(1), middle + part(2)] };
    // Rows go down, and half vectors point the other way.
    let pixel = |i: usize| {
        let (x, y) = ((i % pixels) as f64 - orders.center[0], orders.center[1] - (i / pixels) as f64);
        orders.light(-x, -y) as f32
    };
    let light: Vec<f32> = (0..pixels * pixels).into_par_iter().map(pixel).collect();
    let (scale, max_error) = (2.0 / pixels as f64, if setting == 1 { 0.001 } else { 0.01 });
    let settings = Settings {
        wavelength_nm: Some(Wavelength::Band(BAND_NM)),
        scale: Some(scale),
        center: Some(orders.center),
        size: entries,
        max_error,
        method: METHODS[setting].3,
        ..Settings::default()
    };
    let begun = Instant::now();
    let table = lookup(&[Photograph { light, width: pixels, height: pixels }], &settings)?;
    let seconds = begun.elapsed().as_secs_f64();
    let error = error(&orders, &table, entries);
    let said = table.whole_error();
    let wrong = said.is_none_or(|said| error > 5.0 * said);
    Ok(Outcome {
        error: Some(error),
        seconds,
        masked: table.entries.iter().filter(|e| e[3] < 0.01).count() as f64 / table.entries.len() as f64,
        wrong: f64::from(u8::from(wrong)),
        predicted: said,
    })
}

/// Against sums over wavelengths 0.1 nm apart of the orders themselves.
fn error(orders: &Orders, table: &Table, size: usize) -> f64 {
    let light = Illuminant::default().spectrum;
    let spectrum: Vec<[f64; 2]> = (0..4700)
        .map(|k| 360.05 + 0.1 * f64::from(k))
        .map(|nm| [BAND_NM / nm, light.at(nm) * Observer::Cie1931.at(nm)[1]])
        .collect();
    let white: f64 = spectrum.iter().map(|s| s[1]).sum();
    let at = |k: usize| table.extent * ((2 * k + 1) as f64 / size as f64 - 1.0) / table.scale;
    let rim = 0.6 * table.extent / table.scale;
    let places = (0..size * size).step_by((size * size / COMPARED).max(1));
    let squares = places.filter(|i| at(i % size).abs() > rim).map(|i| {
        let (u, v) = (at(i % size), at(size - 1 - i / size));
        let sum = |[factor, power]: &[f64; 2]| power * factor.powi(4) * orders.light(u * factor, v * factor);
        let truth = spectrum.iter().map(sum).sum::<f64>() / white;
        [(f64::from(table.entries[i][1]) - truth).powi(2), truth * truth]
    });
    let [off, all] = squares.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    (off / all).sqrt()
}
