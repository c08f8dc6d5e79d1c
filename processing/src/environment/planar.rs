//! Flat samples: the full integral is a correlation in direction cosines.
//!
//! `L(ωo) = 1/cos θo ∬ S_d(ωi + ωo) (1 + ωi·ωo)² Li(ωi) / cos θi dx dy` over the direction cosines x, y of ωi. With `ωi·ωo = x xo + y yo + z zo`
//! the square is a sum of ten products of a function of ωi and one of ωo, and each is a correlation.

use super::cosines::solid_angle;
use super::{Environment, Frame, Table};
use crate::{Error, Result};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Cells along a side of the disc of direction cosines at most: eleven transforms of four times as many take 1 GiB.
const MOST: usize = 1024;

/// Parts of a cell in which its solid angle is summed up.
const SLICES: usize = 16;

/// Radiance that a flat sample reflects into each direction.
pub struct Reflection {
    /// Cells along a side of the square of direction cosines from -1 to 1, x to the right, y upwards.
    pub size: usize,
    /// Row by row from the top; 0 outside of the disc.
    pub rgb: Vec<[f32; 3]>,
}

impl Reflection {
    /// Direction of a cell in the sample's frame; none outside of the disc.
    pub fn direction(size: usize, i: usize) -> Option<[f64; 3]> {
        let [x, y] = [i % size, size - 1 - i / size].map(|k| cosine(size, k));
        let square = x * x + y * y;
        (square < 1.0).then(|| [x, y, (1.0 - square).sqrt()])
    }
}

fn cosine(size: usize, k: usize) -> f64 {
    (2.0 * k as f64 + 1.0) / size as f64 - 1.0
}

/// Light of the cells of the disc: direction, and radiance times solid angle; `y` grows with the row here.
pub(super) fn cells(environment: &Environment, frame: &Frame, size: usize) -> Vec<Option<([f64; 3], [f64; 3])>> {
    let step = 2.0 / size as f64;
    let cell = |i: usize| {
        let [x, y] = [i % size, i / size].map(|k| cosine(size, k));
        let solid = solid_angle([x, y], [step; 2], SLICES);
        // A cell on the rim stands for its part above the horizon.
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
    let side = 2 * size;
    let fourier = Fourier::new(side);
    let mut sums = vec![[0.0_f64; 3]; size * size];
    // 1, x, y, z and their products, and how often each comes in (1 + x xo + y yo + z zo)².
    let of = |[x, y, z]: [f64; 3]| [1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z];
    const TIMES: [f64; 10] = [1.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0];
    for channel in 0..3 {
        let mut spectrum = vec![Complex64::default(); side * side];
        for (i, out) in spectrum.iter_mut().enumerate() {
            // ωi + ωo of cells a and b is 2(a + b + 1)/size - 2.
            let h = [i % side, i / side].map(|k| 2.0 * (k as f64 + 1.0) / size as f64 - 2.0);
            *out = Complex64::new(f64::from(table.at(h)[channel]), 0.0);
        }
        fourier.run(&mut spectrum, false);
        let term = |k: usize| {
            let mut light = vec![Complex64::default(); side * side];
            for (i, (direction, power)) in cells.iter().enumerate().filter_map(|(i, c)| Some((i, (*c)?))) {
                light[i / size * side + i % size].re = of(direction)[k] * power[channel];
            }
            fourier.run(&mut light, false);
            light.iter_mut().zip(&spectrum).for_each(|(l, t)| *l = t * l.conj());
            fourier.run(&mut light, true);
            light
        };
        for (k, times) in TIMES.iter().enumerate() {
            let light = term(k);
            for (i, sum) in sums.iter_mut().enumerate() {
                let Some(view) = Reflection::direction(size, i) else { continue };
                let at = (size - 1 - i / size) * side + i % size;
                sum[channel] += times * of(view)[k] / view[2] * light[at].re;
            }
        }
    }
    Ok(Reflection { size, rgb: sums.into_iter().map(|s| s.map(|v| v as f32)).collect() })
}

/// Transforms of squares.
struct Fourier {
    side: usize,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

impl Fourier {
    fn new(side: usize) -> Self {
        let mut planner = FftPlanner::new();
        Self { side, forward: planner.plan_fft_forward(side), inverse: planner.plan_fft_inverse(side) }
    }

    /// In place; forth and back gives what there was.
    fn run(&self, square: &mut [Complex64], back: bool) {
        let (n, plan) = (self.side, if back { &self.inverse } else { &self.forward });
        for _ in 0..2 {
            square.par_chunks_mut(n).for_each(|row| plan.process(row));
            for y in 0..n {
                for x in 0..y {
                    square.swap(y * n + x, x * n + y);
                }
            }
        }
        if back {
            let scale = 1.0 / (n * n) as f64;
            square.par_iter_mut().for_each(|v| *v *= scale);
        }
    }
}
