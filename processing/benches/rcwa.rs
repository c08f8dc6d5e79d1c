//! Cost of a rigorous solution: aluminium foil 100 nm deep with a period of 1 µm, at 560 nm, TM.

#![allow(clippy::expect_used)]

use nacre_processing::rcwa::{ALUMINIUM, Grating, Light, Orders, Polarization, RatioTable, coordinates, slices};

const FOIL: Grating = Grating { period_um: 1.0, depth_um: 0.1, above: 1.0, below: ALUMINIUM };
const LIGHT: Light = Light { wavelength_nm: 560.0, angle: 0.0 };

fn main() {
    divan::main();
}

#[divan::bench(args = [4, 8, 12, 16])]
fn coordinate_method(harmonics: usize) -> Orders {
    coordinates(&FOIL, &LIGHT, Polarization::Tm, harmonics).expect("a shallow grating")
}

#[divan::bench(args = [(10, 8), (20, 16), (30, 32)], sample_count = 3)]
fn staircase((harmonics, count): (usize, usize)) -> Orders {
    slices(&FOIL, &LIGHT, Polarization::Tm, harmonics, count).expect("a passive grating")
}

#[divan::bench(args = [1e-2, 1e-3], sample_count = 2, sample_size = 1)]
fn table_from_700_to_1000_nm(max_error: f64) -> RatioTable {
    RatioTable::new(&FOIL, [0.7, 1.0], 560.0, max_error).expect("a smooth range")
}
