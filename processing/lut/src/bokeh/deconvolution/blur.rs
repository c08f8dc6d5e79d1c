//! Convolution with a point spread function, separable or general, and operations on the convolved rows.

use super::kernel::{Rows, Scratch, convolve};
use super::plane::Plane;
use super::psf::{Psf, Shape};
use nacre_image::Convolution;
use rayon::prelude::*;
use std::ops::Range;

/// A point spread function prepared for images of one size.
pub(super) enum Blur {
    Separable(Vec<f32>),
    Any(Box<Convolution>),
}

/// Sums over an image, accumulated while its rows are written.
pub(super) type Sums = [f64; 2];

/// An operation on a range of convolved rows.
pub(super) trait Work: Rows + Send {
    /// Range of rows that the operation needs.
    fn rows(&self) -> Range<usize>;
    /// Accumulated sums.
    fn sums(&self) -> Sums;
}

impl Blur {
    /// Prepares for images of `size` (width, height).
    pub(super) fn new(psf: &Psf, size: [usize; 2]) -> Self {
        match &psf.0 {
            Shape::Separable(half) => Self::Separable(half.clone()),
            Shape::Any { width, height, values } => {
                Self::Any(Box::new(Convolution::new(size, [*width, *height], values)))
            }
        }
    }

    /// Zero padding that an image needs on every side, in pixels.
    pub(super) fn zeros(&self) -> usize {
        match self {
            Self::Separable(half) => half.len() - 1,
            Self::Any(_) => 0,
        }
    }

    /// Convolves `input` with the point spread function (`adjoint`: with the mirrored one) and passes each operation
    /// its rows. Returns the sums of all operations, added in row order, so that the result does not depend on the
    /// number of threads.
    pub(super) fn apply<W: Work>(
        &self,
        input: &Plane,
        adjoint: bool,
        works: impl IndexedParallelIterator<Item = W>,
    ) -> Sums {
        let all: Vec<Sums> = match self {
            Self::Separable(half) => works
                .map_init(Scratch::default, |scratch, mut work| {
                    convolve(input, half, work.rows(), scratch, &mut work);
                    work.sums()
                })
                .collect(),
            Self::Any(fourier) => {
                let fill = |y: usize, row: &mut [f32]| {
                    if y < input.height {
                        row[..input.width].copy_from_slice(input.row(y));
                    }
                };
                let (image, stride) = (fourier.convolved(&fill, adjoint), fourier.stride());
                let one = |mut work: W| {
                    work.rows().for_each(|y| work.row(y, &image[y * stride..][..input.width]));
                    work.sums()
                };
                works.map(one).collect()
            }
        };
        all.iter().fold([0.0; 2], |sum, band| [sum[0] + band[0], sum[1] + band[1]])
    }
}
