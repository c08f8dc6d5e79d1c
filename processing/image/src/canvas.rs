//! RGB canvas for drawing.

use std::path::Path;

use super::font::Font;
use super::write::write_png8;
use nacre_base::Result;

/// sRGB red, green and blue, 0 to 255.
pub type Rgb = [u8; 3];

/// Picture of 8-bit RGB pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Canvas {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `3 · width · height` samples, interleaved, row 0 on top.
    pub rgb: Vec<u8>,
}

impl Canvas {
    /// Creates a picture of one colour.
    pub fn new(width: usize, height: usize, color: Rgb) -> Self {
        let mut canvas = Self { width, height, rgb: vec![0; 3 * width * height] };
        canvas.fill(color);
        canvas
    }

    /// Fills the picture with one colour.
    pub fn fill(&mut self, color: Rgb) {
        self.rgb.as_chunks_mut::<3>().0.fill(color);
    }

    /// Sets one pixel; ignored outside of the picture.
    pub fn set(&mut self, x: usize, y: usize, color: Rgb) {
        self.blend(x as i64, y as i64, color, 1.0);
    }

    /// Fills a rectangle, clipped to the picture.
    pub fn rectangle(&mut self, x: usize, y: usize, width: usize, height: usize, color: Rgb) {
        let (left, right) = (x.min(self.width), (x + width).min(self.width));
        for row in y.min(self.height)..(y + height).min(self.height) {
            let start = row * self.width;
            self.rgb.as_chunks_mut::<3>().0[start + left..start + right].fill(color);
        }
    }

    /// Copies another picture to column `x` and row `y`, clipped to this one.
    pub fn blit(&mut self, other: &Self, x: usize, y: usize) {
        let columns = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = &other.rgb[3 * row * other.width..][..3 * columns];
            self.rgb[3 * ((y + row) * self.width + x.min(self.width))..][..3 * columns].copy_from_slice(from);
        }
    }

    /// Blends a colour into a pixel with a coverage of 0 to 1; ignored outside of the picture.
    pub(super) fn blend(&mut self, x: i64, y: i64, color: Rgb, coverage: f32) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < self.width && y < self.height {
            let pixel = &mut self.rgb[3 * (y * self.width + x)..][..3];
            for (old, new) in pixel.iter_mut().zip(color) {
                let mixed = f32::from(*old) + (f32::from(new) - f32::from(*old)) * coverage.clamp(0.0, 1.0);
                *old = mixed.round() as u8;
            }
        }
    }

    /// Draws one line of text with its top left corner at (`x`, `y`), `size` pixels from ascender to descender.
    pub fn text(&mut self, x: f32, y: f32, size: f32, color: Rgb, text: &str) {
        let Some(font) = Font::new(size) else { return };
        let (mut left, baseline) = (x, y + font.ascent);
        for sign in text.chars() {
            font.draw(sign, left, baseline, |x, y, coverage| self.blend(x, y, color, coverage));
            left += font.advance(sign);
        }
    }

    /// Writes the picture as a PNG.
    ///
    /// # Errors
    /// `Error::Output` if the system refuses.
    pub fn save_png(&self, path: &Path) -> Result<()> {
        write_png8(path, self.width, self.height, 3, &self.rgb)
    }
}

/// Width in pixels of a line drawn by [`Canvas::text`].
pub fn text_width(size: f32, text: &str) -> f32 {
    Font::new(size).map_or(0.0, |font| text.chars().map(|sign| font.advance(sign)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawing_outside_is_clipped() {
        let mut canvas = Canvas::new(8, 4, [9; 3]);
        let other = Canvas::new(5, 5, [1, 2, 3]);
        canvas.blit(&other, 6, 2);
        canvas.blit(&other, 80, 90);
        canvas.rectangle(7, 3, 100, 100, [0; 3]);
        canvas.rectangle(70, 30, 100, 100, [0; 3]);
        canvas.set(100, 100, [0; 3]);
        canvas.text(-5.0, -5.0, 20.0, [0; 3], "Wide µ°");
        canvas.text(1e9, 1e9, 20.0, [0; 3], "far");
        assert_eq!(canvas.rgb.len(), 3 * 8 * 4);
        assert_eq!(&canvas.rgb[3 * (2 * 8 + 6)..][..3], [1, 2, 3]);
    }
}
