//! Flat samples: the full integral is a correlation in direction cosines.

use super::correlation::{correlate, cosine, entry, moments};
use super::cosines::solid_angle;
use super::{Environment, Frame, Table};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use rayon::prelude::*;

/// Maximum number of cells along a side of the disc of direction cosines: the table and its transforms then take 1 GiB.
const MOST: usize = 1024;

/// Slices of a cell in the integration of its solid angle.
const SLICES: usize = 16;

/// Radiance reflected by a flat sample into each direction.
pub struct Reflection {
    /// Cells along a side of the square of direction cosines from -1 to 1, x to the right, y upwards.
    pub size: usize,
    /// Row by row from the top; 0 outside the disc.
    pub rgb: Vec<[f32; 3]>,
}

impl Reflection {
    /// Direction of a cell in the sample's frame; `None` outside the disc.
    pub fn direction(size: usize, i: usize) -> Option<[f64; 3]> {
        let [x, y] = [i % size, size - 1 - i / size].map(|k| cosine(size, k));
        let square = x * x + y * y;
        (square < 1.0).then(|| [x, y, (1.0 - square).sqrt()])
    }
}

/// Light of the cells of the disc: direction, and radiance times solid angle. Here `y` increases with the row.
pub(super) fn cells(environment: &Environment, frame: &Frame, size: usize) -> Vec<Option<([f64; 3], [f64; 3])>> {
    let step = 2.0 / size as f64;
    let cell = |i: usize| {
        let [x, y] = [i % size, i / size].map(|k| cosine(size, k));
        let solid = solid_angle([x, y], [step; 2], SLICES);
        // A cell on the rim represents its part above the horizon.
        let length = x.hypot(y).max(1.0) * (1.0 + 1e-9);
        let [x, y] = [x, y].map(|v| if length > 1.0 + 1e-8 { v / length } else { v });
        let light = [x, y, (1.0 - x * x - y * y).max(0.0).sqrt()];
        (solid > 0.0).then(|| (light, environment.radiance(frame.world(light)).map(|v| f64::from(v) * solid)))
    };
    (0..size * size).into_par_iter().map(cell).collect()
}

/// Exact reflection of a flat sample into `size · size` directions.
///
/// # Errors
/// `Input` for a size out of range.
pub fn planar(table: &Table, environment: &Environment, frame: &Frame, size: usize) -> Result<Reflection> {
    if !(4..=MOST).contains(&size) {
        return Err(Error::input("size", format!("is {size}"), format!("give 4 to {MOST} directions along a side")));
    }
    let cells = cells(environment, frame, size);
    let light = |channel: usize| {
        let of = |(direction, power): &([f64; 3], [f64; 3])| moments(direction[2]).map(|m| m * power[channel]);
        cells.iter().map(|cell| cell.as_ref().map_or([0.0; 5], of)).collect()
    };
    let reflected = correlate(size, |h| entry(table.at(h).map(f64::from), h), light, &Silent)?;
    let rgb = (0..size * size).map(|i| {
        let Some(view) = Reflection::direction(size, i) else { return [0.0; 3] };
        reflected.cell((size - 1 - i / size) * size + i % size, view[2]).map(|v| (v / view[2]) as f32)
    });
    Ok(Reflection { size, rgb: rgb.collect() })
}
