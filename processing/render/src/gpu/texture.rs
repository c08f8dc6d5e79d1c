//! Textures for graphics cards.

/// A texture of 32-bit floats, row by row; the first row is at 0.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Name in the shader.
    pub name: &'static str,
    /// Texels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Numbers per texel: one or four.
    pub channels: usize,
    /// The numbers.
    pub values: Vec<f32>,
}

impl Texture {
    pub(super) fn new(name: &'static str, width: usize, channels: usize, values: Vec<f32>) -> Self {
        Self { name, width, height: values.len() / (width * channels).max(1), channels, values }
    }

    /// A placeholder that the shaders do not read.
    pub(super) fn none(name: &'static str, channels: usize) -> Self {
        // Rows are interpolated, so two are needed.
        Self::new(name, 2, channels, vec![0.0; 4 * channels])
    }
}
