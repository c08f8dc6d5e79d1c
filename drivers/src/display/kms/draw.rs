//! A pattern as pixels.

use super::tone::Tone;
use crate::Pattern;

/// Parts of a side of a pixel at the disc's edge.
const PARTS: usize = 16;
/// Longest side of a panel in pixels.
pub const MAX_SIDE: usize = 16_384;

/// A panel's pixels and size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Pixels per row, and rows.
    pub pixels: [usize; 2],
    /// Width and height in mm.
    pub size_mm: [f64; 2],
}

impl Geometry {
    /// Says what is wrong with it.
    ///
    /// # Errors
    /// The size, where a panel cannot have it.
    pub fn check(&self) -> Result<(), String> {
        let pixels = self.pixels.iter().all(|p| (1..=MAX_SIDE).contains(p));
        let size = self.size_mm.iter().all(|mm| (1.0..=1e5).contains(mm));
        let [[w, h], [wide, high]] = [self.pixels.map(|p| p as f64), self.size_mm];
        if pixels && size { Ok(()) } else { Err(format!("a panel of {w} × {h} pixels on {wide} × {high} mm")) }
    }
}

/// Draws a pattern, white on black, one value 0xRRGGBB per pixel, row 0 on top. The disc's edge is as bright as the part
/// of each pixel that lies within it.
///
/// # Errors
/// Why it cannot be drawn: it is not on the panel.
pub fn draw(pattern: &Pattern, panel: &Geometry, tone: &Tone) -> Result<Vec<u32>, String> {
    panel.check()?;
    let [width, height] = panel.pixels;
    let mut pixels = vec![0; width * height];
    let Pattern::Disc { center_mm, diameter_mm } = *pattern else { return Ok(pixels) };
    let reach = pattern.reach_mm();
    let fits = (0..2).all(|axis| reach[axis] <= 0.5 * panel.size_mm[axis]);
    if !(fits && diameter_mm > 0.0) {
        let [w, h] = panel.size_mm;
        let [x, y] = center_mm;
        return Err(format!("a disc of {diameter_mm} mm at ({x}, {y}) mm on a panel of {w} × {h} mm"));
    }
    let codes = tone.codes(PARTS * PARTS);
    let pitch = [panel.size_mm[0] / width as f64, panel.size_mm[1] / height as f64];
    // From the panel's upper left corner, to the right and down.
    let center = [0.5 * panel.size_mm[0] + center_mm[0], 0.5 * panel.size_mm[1] - center_mm[1]];
    let disc = Disc { center, radius: 0.5 * diameter_mm, pitch };
    let [columns, rows] = [0, 1].map(|axis| disc.span(axis, panel.pixels[axis]));
    for row in rows {
        for column in columns.clone() {
            let code = u32::from(codes[disc.parts_within(column, row)]);
            pixels[row * width + column] = code << 16 | code << 8 | code;
        }
    }
    Ok(pixels)
}

/// A disc in mm, on pixels of this pitch.
struct Disc {
    center: [f64; 2],
    radius: f64,
    pitch: [f64; 2],
}

impl Disc {
    /// Pixels that it may touch along an axis.
    fn span(&self, axis: usize, count: usize) -> std::ops::Range<usize> {
        let at = |mm: f64| mm / self.pitch[axis];
        let low = at(self.center[axis] - self.radius).floor().max(0.0) as usize;
        let high = at(self.center[axis] + self.radius).ceil().max(0.0) as usize;
        low.min(count)..high.min(count)
    }

    /// Of [`PARTS`]² parts of a pixel, those within.
    fn parts_within(&self, column: usize, row: usize) -> usize {
        let within = |x: f64, y: f64| {
            let [dx, dy] = [x * self.pitch[0] - self.center[0], y * self.pitch[1] - self.center[1]];
            dx * dx + dy * dy <= self.radius * self.radius
        };
        let [x, y] = [column as f64, row as f64];
        // A disc is convex: it has all of a pixel whose corners it has.
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        if corners.iter().all(|[a, b]| within(x + a, y + b)) {
            return PARTS * PARTS;
        }
        let middle = |part: usize| (part as f64 + 0.5) / PARTS as f64;
        let parts = (0..PARTS).flat_map(|a| (0..PARTS).map(move |b| (a, b)));
        parts.filter(|(a, b)| within(x + middle(*a), y + middle(*b))).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PANEL: Geometry = Geometry { pixels: [640, 400], size_mm: [320.0, 240.0] };

    fn disc(x: f64, y: f64, diameter_mm: f64) -> Pattern {
        Pattern::Disc { center_mm: [x, y], diameter_mm }
    }

    /// Area in mm² and middle in mm from the panel's middle, right and up, of what is bright.
    fn seen(pixels: &[u32], panel: &Geometry, tone: &Tone) -> (f64, [f64; 2]) {
        let [w, h] = panel.pixels;
        let pitch = [panel.size_mm[0] / w as f64, panel.size_mm[1] / h as f64];
        let (mut area, mut middle) = (0.0, [0.0; 2]);
        for (i, pixel) in pixels.iter().enumerate() {
            let light = tone.luminance((pixel & 255) as u8) * pitch[0] * pitch[1];
            let at = [(i % w) as f64 + 0.5 - 0.5 * w as f64, 0.5 * h as f64 - (i / w) as f64 - 0.5];
            area += light;
            middle = [0, 1].map(|a| middle[a] + light * at[a] * pitch[a]);
        }
        (area, middle.map(|m| m / area))
    }

    #[test]
    fn a_disc_has_its_area_and_place() {
        for tone in [Tone::Gamma(2.2), Tone::Gamma(1.0)] {
            for (x, y, diameter) in [(0.0, 0.0, 100.0), (40.3, -50.7, 61.9), (-100.0, 60.0, 20.0)] {
                let pixels = draw(&disc(x, y, diameter), &PANEL, &tone).unwrap();
                let (area, middle) = seen(&pixels, &PANEL, &tone);
                let exact = std::f64::consts::PI * diameter * diameter / 4.0;
                assert!((area / exact - 1.0).abs() < 0.002, "{area} mm² for {exact}");
                assert!((middle[0] - x).abs() < 0.02 && (middle[1] - y).abs() < 0.02, "{middle:?} for {x}, {y}");
            }
        }
    }

    #[test]
    fn black_is_black_and_white_is_white() {
        let tone = Tone::default();
        assert!(draw(&Pattern::Black, &PANEL, &tone).unwrap().iter().all(|p| *p == 0));
        let pixels = draw(&disc(0.0, 0.0, 50.0), &PANEL, &tone).unwrap();
        assert_eq!(pixels[200 * 640 + 320], 0xFF_FFFF);
    }

    #[test]
    fn what_is_not_on_the_panel_is_refused() {
        for pattern in [disc(0.0, 100.0, 41.0), disc(150.0, 0.0, 30.0), disc(0.0, 0.0, -1.0), disc(f64::NAN, 0.0, 1.0)]
        {
            assert!(draw(&pattern, &PANEL, &Tone::default()).is_err(), "{pattern:?}");
        }
        assert!(draw(&disc(0.0, 0.0, 240.0), &PANEL, &Tone::default()).is_ok(), "to the edge");
        let none = Geometry { pixels: [0, 5], ..PANEL };
        assert!(draw(&Pattern::Black, &none, &Tone::default()).is_err());
    }

    proptest! {
        #[test]
        fn no_pattern_is_too_wild(x: f64, y: f64, d: f64, w in 0usize..40, h in 0usize..40, mm in -1.0f64..100.0) {
            let panel = Geometry { pixels: [w, h], size_mm: [mm, 0.7 * mm] };
            let _ = draw(&disc(x, y, d), &panel, &Tone::default());
            let _ = draw(&disc(x % 50.0, y % 50.0, d % 50.0), &panel, &Tone::default());
        }
    }
}
