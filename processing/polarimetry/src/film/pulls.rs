//! How the likelihood of points changes as a curve moves.

/// How points pull at a curve.
pub(crate) struct Pulls {
    /// -2 ln likelihood of all points.
    pub misfit: f64,
    /// At its places.
    pub places: Vec<Place>,
    /// At metal without a grating.
    pub mirror: [f64; 2],
}

/// A place of a curve, and the slope of the ln likelihood of the points as it moves.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub theta: f64,
    pub pull: [f64; 2],
}
