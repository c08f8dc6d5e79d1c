//! Score of the points with respect to displacements of a curve.

/// Score of the points with respect to displacements of a curve.
pub(crate) struct Score {
    /// -2 ln likelihood of all points.
    pub misfit: f64,
    /// Scores at the support points.
    pub support: Vec<SupportScore>,
    /// Score for the position of bare metal.
    pub mirror: [f64; 2],
}

/// A support point, and the gradient of the ln likelihood with respect to its position.
#[derive(Clone, Copy)]
pub(crate) struct SupportScore {
    pub theta: f64,
    pub score: [f64; 2],
}
