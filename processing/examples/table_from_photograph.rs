//! Computes a lookup table from one narrow-band photograph of a diffraction pattern (2017 paper, section 4.3): `cargo
//! run --release --example table_from_photograph`. The photograph is simulated: orders of a cross grating with a period
//! of 8 µm.

use nacre_processing::pattern::{Photograph, Settings, Wavelength, lookup};

const SIZE: usize = 501;
const WAVELENGTH_NM: f64 = 550.0;
const PERIOD_NM: f64 = 8000.0;
/// Change of the direction sine per pixel.
const SCALE: f64 = 0.002;

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let middle = 0.5 * (SIZE - 1) as f64;
    let light = (0..SIZE * SIZE).map(|i| {
        let sines = [(i % SIZE) as f64 - middle, (i / SIZE) as f64 - middle].map(|pixels| pixels * SCALE);
        // Gaussian lobes at the orders of the grating equation; higher orders are weaker.
        let order = sines.map(|s| (s * PERIOD_NM / WAVELENGTH_NM).round());
        let off: f64 = sines.iter().zip(order).map(|(s, m)| (s - m * WAVELENGTH_NM / PERIOD_NM).powi(2)).sum();
        ((-0.5 * off / 0.004_f64.powi(2)).exp() / (1.0 + order[0].powi(2) + order[1].powi(2))) as f32
    });
    let photograph = Photograph { light: light.collect(), width: SIZE, height: SIZE };
    let wavelength_nm = Some(Wavelength::Band(WAVELENGTH_NM));
    let settings = Settings { wavelength_nm, scale: Some(SCALE), size: 256, ..Settings::default() };
    let table = lookup(&[photograph], &settings)?;
    println!("zero order at {:.2?} (expected {middle}), {} entries", table.center, table.entries.len());
    println!("error at the rim {:.2} %", 100.0 * table.error.unwrap_or(f64::NAN));
    Ok(())
}
