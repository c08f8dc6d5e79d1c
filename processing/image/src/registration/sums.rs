//! Sums over tiles, from which shifts and their deviations are estimated.

/// Sums over the pixels of tiles.
#[derive(Clone, Debug)]
pub(super) struct Sums {
    /// Derivative of half the sum of squares with respect to the shifts, `[x0, y0, x1, y1, …]`.
    pub(super) slope: Vec<f64>,
    /// Moments of the gradients of (A, C, S): 6×6, rows and columns `[A.x, A.y, C.x, C.y, S.x, S.y]`.
    pub(super) gradient: [[f64; 6]; 6],
    /// Moments of the gradient of the residuals, summed over frames: xx, xy, yy.
    pub(super) noise: [f64; 3],
    /// Sum of squared residuals.
    pub(super) square: f64,
    /// Sum of C² + S².
    pub(super) modulation: f64,
    /// Number of pixels that are usable in all frames.
    pub(super) pixels: usize,
}

impl Sums {
    pub(super) fn new(frames: usize) -> Self {
        let (slope, gradient) = (vec![0.0; 2 * frames], [[0.0; 6]; 6]);
        Self { slope, gradient, noise: [0.0; 3], square: 0.0, modulation: 0.0, pixels: 0 }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.slope.iter_mut().zip(&other.slope).for_each(|(a, b)| *a += b);
        let all = self.gradient.as_flattened_mut().iter_mut().zip(other.gradient.as_flattened());
        all.chain(self.noise.iter_mut().zip(&other.noise)).for_each(|(a, b)| *a += b);
        self.square += other.square;
        self.modulation += other.modulation;
        self.pixels += other.pixels;
    }
}
