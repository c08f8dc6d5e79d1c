//! Reduction of a mosaic to one pixel per cell of 2 × 2 colour filters, and of several planes to one black level.

use rayon::prelude::*;

use crate::fault::{Decoded, Fault};
use crate::raster::zeroed;

/// Sensor value.
pub(super) trait Value: Copy + Default + PartialOrd + Send + Sync {
    /// Value plus `shift`, within the range of its type.
    fn raised(self, shift: f64) -> Self;
    /// Mean of two values. Integer halves are rounded to even, which preserves the mean over many pixels.
    fn mean(self, other: Self) -> Self;
    fn to_f64(self) -> f64;
}

impl Value for u16 {
    fn raised(self, shift: f64) -> Self {
        // The cast saturates.
        (f64::from(self) + shift).round() as Self
    }

    fn mean(self, other: Self) -> Self {
        let sum = u32::from(self) + u32::from(other);
        let half = sum / 2;
        (half + (sum & half & 1)) as Self
    }

    fn to_f64(self) -> f64 {
        self.into()
    }
}

impl Value for f32 {
    fn raised(self, shift: f64) -> Self {
        self + shift as Self
    }

    fn mean(self, other: Self) -> Self {
        (self + other) / 2.0
    }

    fn to_f64(self) -> f64 {
        self.into()
    }
}

/// Region of the sensor that belongs to the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Area {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// Offsets (row, column) of red, both greens and blue in a cell of the mosaic.
pub(super) type Cell = [[usize; 2]; 4];

/// Values of a sensor with `planes` values per pixel.
pub(super) struct Sensor<'a, T> {
    pub(super) values: &'a [T],
    /// Pixels per row.
    pub(super) width: usize,
    pub(super) planes: usize,
    /// Offsets that equalise the black levels: per plane, or in mosaics per position (row, column) in the cell.
    pub(super) shifts: [f64; 4],
    /// Saturation level.
    pub(super) white: f64,
}

/// Cell of an area, where `color_at` gives the colour of each pixel: 0 red, 1 green, 2 blue.
///
/// # Errors
/// If a cell does not consist of one red, two green and one blue pixel.
pub(super) fn cell(color_at: impl Fn(usize, usize) -> usize) -> Decoded<Cell> {
    let places = |color: usize| {
        [[0, 0], [0, 1], [1, 0], [1, 1]].into_iter().filter(|[y, x]| color_at(*y, *x) == color).collect::<Vec<_>>()
    };
    match (places(0).as_slice(), places(1).as_slice(), places(2).as_slice()) {
        (&[red], &[first, second], &[blue]) => Ok([red, first, second, blue]),
        _ => Err(not_bayer("other colours than one red, two green and one blue")),
    }
}

pub(super) fn not_bayer(found: &str) -> Fault {
    let problem = format!(
        "is a mosaic of {found} per cell of filters; only Bayer mosaics (2 x 2, red, green, green, blue) are read"
    );
    Fault::unusable(problem, "develop it to a linear 16-bit TIFF without white balance")
}

impl<T: Value> Sensor<'_, T> {
    /// One pixel of three values per cell; a last row or column of half cells is dropped.
    pub(super) fn halved(&self, area: Area, cell: Cell) -> Decoded<Vec<T>> {
        let (width, height) = (area.width / 2, area.height / 2);
        let mut out = zeroed::<T>(width * height * 3)?;
        out.par_chunks_exact_mut(width * 3).enumerate().for_each(|(row, out)| {
            for (column, pixel) in out.chunks_exact_mut(3).enumerate() {
                let [red, first, second, blue] = cell.map(|[y, x]| {
                    let value = self.values[(area.top + 2 * row + y) * self.width + area.left + 2 * column + x];
                    (value.to_f64() >= self.white, value.raised(self.shifts[2 * y + x]))
                });
                // A saturated green makes the mean saturated.
                let green = match (first, second) {
                    ((false, a), (false, b)) => a.mean(b),
                    ((_, a), (_, b)) => {
                        if a > b {
                            a
                        } else {
                            b
                        }
                    }
                };
                pixel.copy_from_slice(&[red.1, green, blue.1]);
            }
        });
        Ok(out)
    }

    /// Pixels of an area, unchanged.
    pub(super) fn cropped(&self, area: Area) -> Decoded<Vec<T>> {
        let length = area.width * self.planes;
        let mut out = zeroed::<T>(length * area.height)?;
        out.par_chunks_exact_mut(length).enumerate().for_each(|(row, out)| {
            let at = ((area.top + row) * self.width + area.left) * self.planes;
            for (index, (to, from)) in out.iter_mut().zip(&self.values[at..at + length]).enumerate() {
                *to = from.raised(self.shifts[index % self.planes]);
            }
        });
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sensor of 5 x 5 with a border, whose first colour is green.
    #[test]
    fn cells_are_red_mean_of_greens_blue_at_any_origin() {
        let values: Vec<u16> = (0..25).map(|i| 100 + i * i).collect();
        let sensor = Sensor { values: &values, width: 5, planes: 1, shifts: [0.0; 4], white: 1000.0 };
        // Rows G R / B G from (0, 0); at (1, 0) the pattern is B G / G R.
        let pattern = [[1, 0], [2, 1]];
        let cell = cell(|y, x| pattern[(y + 1) % 2][x % 2]).unwrap();
        let area = Area { left: 0, top: 1, width: 5, height: 4 };
        let at = |y: usize, x: usize| values[y * 5 + x];
        let out = sensor.halved(area, cell).unwrap();
        assert_eq!(out.len(), 2 * 2 * 3);
        assert_eq!(out[..3], [at(2, 1), at(1, 1).mean(at(2, 0)), at(1, 0)]);
        assert_eq!(out[9..], [at(4, 3), at(3, 3).mean(at(4, 2)), at(3, 2)]);
        assert_eq!(sensor.cropped(Area { left: 3, top: 4, width: 2, height: 1 }).unwrap(), [at(4, 3), at(4, 4)]);
    }

    #[test]
    fn means_are_unbiased_and_saturated_greens_stay_saturated() {
        assert_eq!([1_u16.mean(2), 2_u16.mean(3), 4_u16.mean(4), 65_535_u16.mean(65_535)], [2, 2, 4, 65_535]);
        let values = [10_u16, 4000, 200, 30];
        let sensor = Sensor { values: &values, width: 2, planes: 1, shifts: [1.0, 0.0, 3.0, 0.4], white: 4000.0 };
        let cell = cell(|y, x| y + x).unwrap();
        let whole = Area { left: 0, top: 0, width: 2, height: 2 };
        assert_eq!(sensor.halved(whole, cell).unwrap(), [11, 4000, 30]);
    }

    #[test]
    fn other_mosaics_are_refused() {
        for colors in [[1, 1, 1, 1], [0, 1, 2, 3], [0, 1, 1, 0]] {
            assert!(cell(|y, x| colors[2 * y + x]).is_err());
        }
    }
}
