//! Font of pictures: glyphs and widths from skrifa, pixel coverage from ab_glyph_rasterizer.

use ab_glyph_rasterizer::{Point, Rasterizer, point};
use skrifa::instance::{LocationRef, Size};
use skrifa::outline::{DrawSettings, OutlinePen};
use skrifa::{FontRef, GlyphId, MetadataProvider};

/// Font at one size.
pub(super) struct Font {
    font: FontRef<'static>,
    /// Pixels per font unit.
    scale: f32,
    /// Distance from the upper edge of a line to its baseline, in pixels.
    pub ascent: f32,
}

impl Font {
    /// Built-in font at `size` pixels from ascender to descender; `None` only if the font's crate is broken.
    pub fn new(size: f32) -> Option<Self> {
        let font = FontRef::new(epaint_default_fonts::UBUNTU_LIGHT).ok()?;
        let metrics = font.metrics(Size::unscaled(), LocationRef::default());
        let scale = size / (metrics.ascent - metrics.descent);
        Some(Self { font, scale, ascent: scale * metrics.ascent })
    }

    /// Glyph of a character; 0 if the font has none.
    fn glyph(&self, sign: char) -> GlyphId {
        self.font.charmap().map(sign).unwrap_or(GlyphId::NOTDEF)
    }

    /// Advance width of a character in pixels. The font has no kerning table.
    pub fn advance(&self, sign: char) -> f32 {
        let metrics = self.font.glyph_metrics(Size::unscaled(), LocationRef::default());
        self.scale * metrics.advance_width(self.glyph(sign)).unwrap_or_default()
    }

    /// Calls `paint` with column, row and coverage (0 to 1) of each pixel of a character whose baseline begins at (`x`,
    /// `y`).
    pub fn draw(&self, sign: char, x: f32, y: f32, mut paint: impl FnMut(i64, i64, f32)) {
        let Some(glyph) = self.font.outline_glyphs().get(self.glyph(sign)) else { return };
        // Whole pixels are added last, so that equal fractions give equal coverage at any position.
        let mut outline = Outline { scale: self.scale, origin: point(x.fract(), y.fract()), ..Outline::default() };
        if glyph.draw(DrawSettings::unhinted(Size::unscaled(), LocationRef::default()), &mut outline).is_err() {
            return;
        }
        let points = || outline.curves.iter().flatten();
        let least = points().fold(point(f32::INFINITY, f32::INFINITY), |l, p| point(l.x.min(p.x), l.y.min(p.y)));
        let most = points().fold(point(0.0, 0.0), |m, p| point(m.x.max(p.x), m.y.max(p.y)));
        if outline.curves.is_empty() {
            return;
        }
        let corner = point(least.x.floor(), least.y.floor());
        let [width, height] = [most.x - corner.x, most.y - corner.y].map(|side| side.ceil().max(1.0) as usize);
        let mut rasterizer = Rasterizer::new(width, height);
        for curve in &outline.curves {
            match curve.iter().map(|p| *p - corner).collect::<Vec<_>>()[..] {
                [a, b] => rasterizer.draw_line(a, b),
                [a, b, c] => rasterizer.draw_quad(a, b, c),
                [a, b, c, d] => rasterizer.draw_cubic(a, b, c, d),
                _ => {}
            }
        }
        let (left, top) = (x.trunc() as i64 + corner.x as i64, y.trunc() as i64 + corner.y as i64);
        rasterizer.for_each_pixel_2d(|dx, dy, coverage| paint(left + i64::from(dx), top + i64::from(dy), coverage));
    }
}

/// Outline in pixels, y down.
#[derive(Default)]
struct Outline {
    scale: f32,
    origin: Point,
    /// Lines, quadratic and cubic curves by their two, three or four points.
    curves: Vec<Vec<Point>>,
    begun: Point,
    last: Point,
}

impl Outline {
    fn at(&self, x: f32, y: f32) -> Point {
        point(self.origin.x + self.scale * x, self.origin.y - self.scale * y)
    }

    fn add(&mut self, points: &[(f32, f32)]) {
        let curve: Vec<Point> = std::iter::once(self.last).chain(points.iter().map(|(x, y)| self.at(*x, *y))).collect();
        self.last = curve.last().copied().unwrap_or(self.last);
        self.curves.push(curve);
    }
}

impl OutlinePen for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.last = self.at(x, y);
        self.begun = self.last;
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.add(&[(x, y)]);
    }

    fn quad_to(&mut self, cx: f32, cy: f32, x: f32, y: f32) {
        self.add(&[(cx, cy), (x, y)]);
    }

    fn curve_to(&mut self, cx0: f32, cy0: f32, cx1: f32, cy1: f32, x: f32, y: f32) {
        self.add(&[(cx0, cy0), (cx1, cy1), (x, y)]);
    }

    fn close(&mut self) {
        self.curves.push(vec![self.last, self.begun]);
        self.last = self.begun;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_sign_that_pictures_need_is_in_the_font() {
        let font = Font::new(20.0).unwrap();
        for sign in "0123456789.,-−+°µλφσπ²·×/()%ABC abc≤≥".chars() {
            assert!(font.glyph(sign) != GlyphId::NOTDEF, "{sign} is missing");
        }
    }

    /// `|` is a rectangle: its coverage adds up to width times height at any position.
    #[test]
    fn coverage_adds_up_to_the_area() {
        let font = Font::new(1000.0).unwrap();
        let inked = |x: f32, y: f32| {
            let (mut sum, mut columns, mut rows) = (0.0, HashSet::new(), HashSet::new());
            font.draw('|', x, y, |x, y, coverage| {
                sum += f64::from(coverage);
                if coverage > 0.5 {
                    columns.insert(x);
                    rows.insert(y);
                }
            });
            (sum, (columns.len() * rows.len()) as f64)
        };
        let (area, sides) = inked(0.0, 800.0);
        assert!(area > 0.0 && (area / sides - 1.0).abs() < 0.03, "{area} {sides}");
        for (x, y) in [(0.3, 800.0), (17.9, 40.6), (-3.25, -0.75)] {
            assert!((inked(x, y).0 / area - 1.0).abs() < 1e-3, "{x} {y}");
        }
    }
}
