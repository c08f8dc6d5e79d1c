//! A texture as a card takes it.

/// A texture of 32-bit floats, row by row, the first row at 0.
#[derive(Clone, Debug)]
pub struct Texture {
    /// What the shader calls it.
    pub name: &'static str,
    /// Texels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One or four numbers of a texel.
    pub channels: usize,
    /// The numbers.
    pub values: Vec<f32>,
}

impl Texture {
    pub(super) fn new(name: &'static str, width: usize, channels: usize, values: Vec<f32>) -> Self {
        Self { name, width, height: values.len() / (width * channels).max(1), channels, values }
    }

    /// One that is not looked at.
    pub(super) fn none(name: &'static str, channels: usize) -> Self {
        // Rows are interpolated between: two of them.
        Self::new(name, 2, channels, vec![0.0; 4 * channels])
    }
}
