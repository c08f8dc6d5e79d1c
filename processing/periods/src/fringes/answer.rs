//! Response of a pixel to fringes, requirements on it, and its interpretation.

/// Prior knowledge, and requirements on a pixel's response.
#[derive(Clone, Copy, Debug)]
pub struct Demands {
    /// Shortest and longest period in µm.
    pub periods_um: [f64; 2],
    /// Standard deviation of the mirror direction's sines about the direction from the geometry.
    pub mirror_sigma: f64,
    /// Relative model error of a pixel's light, per component of a response.
    pub model_error: f64,
    /// Maximum reduced χ² of a grating.
    pub most_residual: f64,
    /// Minimum signal-to-noise ratio of the first orders.
    pub least_signal: f64,
    /// Minimum first order relative to the brightest higher order, so that a second order is not taken for a first.
    pub least_first: f64,
    /// Minimum χ² difference to the next best explanation, relative to its mean.
    pub least_margin: f64,
}

impl Default for Demands {
    fn default() -> Self {
        Self {
            periods_um: [0.7, 4.0],
            mirror_sigma: 0.004,
            model_error: 0.006,
            most_residual: 2.0,
            least_signal: 8.0,
            least_first: 0.4,
            least_margin: 2.0,
        }
    }
}

/// Classification of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// A single grating explains the light.
    Resolved,
    /// Saturated, or not a number.
    Unusable,
    /// No light that follows the fringes.
    Dark,
    /// Mirrored light only: first orders are too weak or miss the panel.
    NoOrder,
    /// No single grating explains the light.
    Unexplained,
    /// Two gratings explain the light equally well.
    Ambiguous,
}

/// A grating with standard deviations from noise and model error.
#[derive(Clone, Copy, Debug)]
pub struct Grating {
    /// Direction of the grating vector in `[0, π)` rad.
    pub orientation: f64,
    /// Standard deviation of `orientation` in rad.
    pub orientation_sigma: f64,
    /// Period in µm.
    pub period_um: f64,
    /// Standard deviation of `period_um`.
    pub period_sigma_um: f64,
    /// Deviation of the mirror direction's sines from the direction of the geometry.
    pub mirror_offset: [f64; 2],
    /// Reduced χ².
    pub residual: f64,
    /// Fraction of the light in both first orders.
    pub first: f64,
    /// Light of the orders −3 to 3, with the mirrored light in the middle, for a white panel.
    pub weights: [f32; 7],
}

/// Result of a pixel: classification, grating, and the two gratings of an ambiguous pixel.
pub type Solution = (Verdict, Option<Grating>, Option<[Grating; 2]>);

/// Response of a pixel.
pub struct Answer<'a> {
    /// Real and imaginary part for each fringe, relative to the code of white.
    pub components: &'a [f32],
    /// Standard deviation of each component due to noise.
    pub sigma: f64,
    /// Mean light.
    pub mean: f64,
}
