//! Linear light of a photograph.

/// One channel of a photograph.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Linear light, row by row from the top; NaN is unknown.
    pub light: Vec<f32>,
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
}
