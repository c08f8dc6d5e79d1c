//! Blurring with a point spread function, by the way that suits it, and what is done with the blurred rows.

use super::kernel::{Rows, Scratch, convolve};
use super::plane::Plane;
use super::psf::{Psf, Shape};
use nacre_image::Convolution;
use rayon::prelude::*;
use std::ops::Range;

/// A point spread function, ready for images of one size.
pub(super) enum Blur {
    Separable(Vec<f32>),
    Any(Box<Convolution>),
}

/// Sums over an image that fall off while its rows are written.
pub(super) type Sums = [f64; 2];

/// What makes something of blurred rows, and is done with a number of them.
pub(super) trait Work: Rows + Send {
    /// The rows it wants.
    fn rows(&self) -> Range<usize>;
    /// What it summed up.
    fn sums(&self) -> Sums;
}

impl Blur {
    /// For images of `size` (width, height).
    pub(super) fn new(psf: &Psf, size: [usize; 2]) -> Self {
        match &psf.0 {
            Shape::Separable(half) => Self::Separable(half.clone()),
            Shape::Any { width, height, values } => {
                Self::Any(Box::new(Convolution::new(size, [*width, *height], values)))
            }
        }
    }

    /// Zeros that an image needs around it.
    pub(super) fn zeros(&self) -> usize {
        match self {
            Self::Separable(half) => half.len() - 1,
            Self::Any(_) => 0,
        }
    }

    /// Blurs `input` (`adjoint`: with the mirrored function) and gives each its rows; the sums of all, in the order of rows
    /// whatever the number of threads.
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
