//! An image with zero padding, so that the inner loops of a convolution need no bounds handling.

use rayon::prelude::*;

/// Rows per thread and task: with their neighbourhood they fit into the thread's own cache.
pub(super) const BAND: usize = 32;

/// Columns are computed in groups of this size; the last group extends into the padding on the right.
pub(super) const GROUP: usize = 32;

/// `width · height` values, top row first, with at least `radius` zeros on every side.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    /// Zeros to the left of a row.
    left: usize,
    /// Rows of zeros at the top.
    above: usize,
    /// Distance of adjacent rows in values.
    pub stride: usize,
    pub values: Vec<f32>,
}

impl Plane {
    /// Creates a plane of zeros.
    pub(super) fn new(width: usize, height: usize, radius: usize) -> Self {
        let left = radius.next_multiple_of(16);
        let mut stride = width.next_multiple_of(GROUP) + 2 * left;
        // A row distance that is a multiple of 1 KiB would map all rows to a few cache sets.
        if stride.is_multiple_of(256) {
            stride += GROUP;
        }
        // The last row has a partner below it, and its last group ends right of its padding.
        let length = stride * (height + 2 * radius + 1) + GROUP;
        Self { width, height, left, above: radius, stride, values: vec![0.0; length] }
    }

    /// Index of a row's first value.
    pub(super) fn start(&self, y: usize) -> usize {
        (y + self.above) * self.stride + self.left
    }

    /// A row without its padding.
    pub(super) fn row(&self, y: usize) -> &[f32] {
        let start = self.start(y);
        &self.values[start..start + self.width]
    }

    /// A row without its padding.
    pub(super) fn row_mut(&mut self, y: usize) -> &mut [f32] {
        let start = self.start(y);
        &mut self.values[start..start + self.width]
    }

    /// Bands of rows, from the top.
    pub(super) fn bands(&mut self) -> impl IndexedParallelIterator<Item = Band<'_>> {
        let (width, stride, left) = (self.width, self.stride, self.left);
        let rows = &mut self.values[self.above * stride..(self.above + self.height) * stride];
        let band = move |(k, values)| Band { first: k * BAND, width, stride, left, values };
        rows.par_chunks_mut(BAND * stride).enumerate().map(band)
    }
}

/// Writable rows of a plane.
pub(super) struct Band<'a> {
    /// Index of the band's first row in the plane.
    pub first: usize,
    width: usize,
    stride: usize,
    left: usize,
    values: &'a mut [f32],
}

impl Band<'_> {
    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.values.len() / self.stride
    }

    /// A row by its index in the plane.
    #[inline(always)]
    pub(super) fn row(&mut self, y: usize) -> &mut [f32] {
        let start = (y - self.first) * self.stride + self.left;
        &mut self.values[start..start + self.width]
    }
}
