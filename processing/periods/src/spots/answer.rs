//! What a pixel answers to fringes, what is asked of the answer, and what it turns out to be.

/// What is known beforehand, and what is asked of an answer.
#[derive(Clone, Copy, Debug)]
pub struct Demands {
    /// Shortest and longest period in µm.
    pub periods_um: [f64; 2],
    /// Standard deviation of the mirror direction's sines about where the geometry puts it.
    pub mirror_sigma: f64,
    /// Part of a pixel's light that the model may be wrong by, per component of an answer.
    pub model_error: f64,
    /// Mean square residual, in σ, up to which a grating explains a pixel.
    pub most_residual: f64,
    /// Signal of the first orders over its own σ.
    pub least_signal: f64,
    /// Part of the brightest higher order that the first orders must at least be, so that a second order is not taken for a first.
    pub least_first: f64,
    /// How much more the next best explanation must leave over, as χ² over its own mean.
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

/// Why a pixel has no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It has one.
    Resolved,
    /// Saturated, or no number.
    Unusable,
    /// No light that follows the fringes.
    Dark,
    /// Mirrored light only: the first orders are too weak or miss the panel.
    NoOrder,
    /// Light that a single grating does not explain.
    Unexplained,
    /// Two gratings explain it equally well.
    Ambiguous,
}

/// A grating, with one standard deviation of what noise and model make of it.
#[derive(Clone, Copy, Debug)]
pub struct Grating {
    /// Direction of the grating vector in `[0, π)` rad.
    pub orientation: f64,
    /// σ of that in rad.
    pub orientation_sigma: f64,
    /// Period in µm.
    pub period_um: f64,
    /// σ of that in µm.
    pub period_sigma_um: f64,
    /// How far the mirror direction's sines are from where the geometry puts them.
    pub mirror_offset: [f64; 2],
    /// Mean square residual in σ.
    pub residual: f64,
    /// Weight of both first orders over that of all light.
    pub first: f64,
    /// Light of the orders from −3 to 3, the mirrored light in the middle, where the panel is white.
    pub weights: [f32; 7],
}

/// What became of a pixel: a grating, and where two explain it, both.
pub type Solution = (Verdict, Option<Grating>, Option<[Grating; 2]>);

/// An answer of a pixel.
pub struct Answer<'a> {
    /// Real and imaginary part for each fringe, of white light's code.
    pub components: &'a [f32],
    /// Standard deviation of each of these by noise.
    pub sigma: f64,
    /// Its mean light.
    pub mean: f64,
}
