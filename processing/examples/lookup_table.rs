//! Time and error of a lookup table of 2048² entries from a photograph of 1000², for comparison with
//! `benches/peers/lookup_table.py`: `cargo run --release --example lookup_table [auto|rays=1|fixed=5|…]`.

mod cpu;

use cpu::used;
use nacre_processing::operation::{Entry, Registered};
use nacre_processing::pattern::{MethodChoice, Photograph, Settings, Wavelength, lookup};
use std::time::Instant;

const SIZE: usize = 1000;
const SCALE: f64 = 0.002;
const CENTER: f64 = 499.5;

/// Gaussian orders on a lattice, as in the peer.
fn light(u: f64, v: f64) -> f64 {
    const PITCH: f64 = 0.085;
    const SIGMA: f64 = 0.004;
    let (m, n) = ((u / PITCH).round(), (v / PITCH).round());
    let square = (u - m * PITCH).powi(2) + (v - n * PITCH).powi(2);
    (-0.5 * square / (SIGMA * SIGMA)).exp() / (1.0 + 0.1 * (m * m + n * n))
}

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let word = std::env::args().nth(1).unwrap_or("auto".into());
    let fields = Entry::<Settings>::NEW.fields();
    let method = fields.list.iter().find(|f| f.name() == "method").ok_or("no such option")?.value(&word)?;
    let method: MethodChoice = serde_json::from_value(method)?;
    let at = |i: usize| light(((i % SIZE) as f64 - CENTER) * SCALE, ((i / SIZE) as f64 - CENTER) * SCALE) as f32;
    let photograph = Photograph { light: (0..SIZE * SIZE).map(at).collect(), width: SIZE, height: SIZE };
    let settings = Settings {
        wavelength_nm: Some(Wavelength::Band(680.0)),
        scale: Some(SCALE),
        extent: Some(1.0),
        center: Some([CENTER; 2]),
        size: 2048,
        method,
        ..Settings::default()
    };
    let (cpu, begun) = (used(), Instant::now());
    let table = lookup(&[photograph], &settings)?;
    println!("{:.2} CPU-seconds, {:.2} s", used() - cpu, begun.elapsed().as_secs_f64());
    println!("rim, against a finer sum: {:.3} %", 100.0 * table.error.unwrap_or(f64::NAN));
    println!("{:?}", table.choice);
    Ok(())
}
