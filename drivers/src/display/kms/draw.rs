//! Rendering of a pattern to pixels.

use super::tone::Tone;
use crate::Pattern;

/// Subpixels per pixel side at the disc's edge.
const PARTS: usize = 16;
/// Maximum side of a display in pixels.
pub const MAX_SIDE: usize = 16_384;

/// Resolution and size of a display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Width and height in pixels.
    pub pixels: [usize; 2],
    /// Width and height in mm.
    pub size_mm: [f64; 2],
}

impl Geometry {
    /// Checks the geometry.
    ///
    /// # Errors
    /// The size, if no display can have it.
    pub fn check(&self) -> Result<(), String> {
        let pixels = self.pixels.iter().all(|p| (1..=MAX_SIDE).contains(p));
        let size = self.size_mm.iter().all(|mm| (1.0..=1e5).contains(mm));
        let [[w, h], [wide, high]] = [self.pixels.map(|p| p as f64), self.size_mm];
        if pixels && size { Ok(()) } else { Err(format!("a panel of {w} × {h} pixels on {wide} × {high} mm")) }
    }
}

/// Draws a pattern, white on black, one value 0xRRGGBB per pixel, row 0 at the top. At the disc's edge the luminance is
/// the covered fraction of the pixel.
///
/// # Errors
/// The reason why it cannot be drawn: it lies off the display.
pub fn draw(pattern: &Pattern, panel: &Geometry, tone: &Tone) -> Result<Vec<u32>, String> {
    panel.check()?;
    let [width, height] = panel.pixels;
    let mut pixels = vec![0; width * height];
    let (center_mm, diameter_mm) = match *pattern {
        Pattern::Black => return Ok(pixels),
        // The display's tone curve is known here, so the assumed exponent is unused.
        Pattern::Fringes { cycles_per_mm, phase, .. } => {
            fringes(&mut pixels, cycles_per_mm, phase, panel, tone)?;
            return Ok(pixels);
        }
        Pattern::Disc { center_mm, diameter_mm } => (center_mm, diameter_mm),
    };
    let reach = pattern.reach_mm();
    let fits = (0..2).all(|axis| reach[axis] <= 0.5 * panel.size_mm[axis]);
    if !(fits && diameter_mm > 0.0) {
        let [w, h] = panel.size_mm;
        let [x, y] = center_mm;
        return Err(format!("a disc of {diameter_mm} mm at ({x}, {y}) mm on a panel of {w} × {h} mm"));
    }
    let codes = tone.codes(PARTS * PARTS);
    let pitch = [panel.size_mm[0] / width as f64, panel.size_mm[1] / height as f64];
    // From the display's upper left corner, to the right and down.
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

/// Fills the display with fringes.
fn fringes(pixels: &mut [u32], f: [f64; 2], phase: f64, panel: &Geometry, tone: &Tone) -> Result<(), String> {
    const LEVELS: usize = 4096;
    let [width, height] = panel.pixels;
    let pitch = [panel.size_mm[0] / width as f64, panel.size_mm[1] / height as f64];
    // At least four pixels per period are needed; a period of two pixels shows no fringe.
    let fine = phase.is_finite() && (0..2).all(|axis| f[axis].abs() * pitch[axis] <= 0.25);
    if !fine {
        let [x, y] = f;
        return Err(format!("fringes of ({x}, {y}) cycles per mm at phase {phase} on pixels of {:.3} mm", pitch[0]));
    }
    if f == [0.0; 2] {
        // A uniform display must show exactly one code, because a calibration relies on it.
        let code = tone.nearest([Pattern::fringe(f, phase, [0.0; 2])]).first().copied().map_or(0, u32::from);
        pixels.fill(code << 16 | code << 8 | code);
        return Ok(());
    }
    let codes = tone.codes(LEVELS);
    for (row, line) in pixels.chunks_mut(width).enumerate() {
        let y = (0.5 * (height as f64 - 1.0) - row as f64) * pitch[1];
        for (column, pixel) in line.iter_mut().enumerate() {
            let x = (column as f64 - 0.5 * (width as f64 - 1.0)) * pitch[0];
            let level = (Pattern::fringe(f, phase, [x, y]) * LEVELS as f64).round() as usize;
            let code = u32::from(codes[level.min(LEVELS)]);
            *pixel = code << 16 | code << 8 | code;
        }
    }
    Ok(())
}

/// A disc in mm, on pixels of this pitch.
struct Disc {
    center: [f64; 2],
    radius: f64,
    pitch: [f64; 2],
}

impl Disc {
    /// Range of pixels that the disc may touch along an axis.
    fn span(&self, axis: usize, count: usize) -> std::ops::Range<usize> {
        let at = |mm: f64| mm / self.pitch[axis];
        let low = at(self.center[axis] - self.radius).floor().max(0.0) as usize;
        let high = at(self.center[axis] + self.radius).ceil().max(0.0) as usize;
        low.min(count)..high.min(count)
    }

    /// Number of subpixels within the disc, out of [`PARTS`]².
    fn parts_within(&self, column: usize, row: usize) -> usize {
        let distance = |x: f64, y: f64| {
            let [dx, dy] = [x * self.pitch[0] - self.center[0], y * self.pitch[1] - self.center[1]];
            dx.hypot(dy)
        };
        let [x, y] = [column as f64, row as f64];
        let inwards = self.radius - distance(x + 0.5, y + 0.5);
        // Only pixels near the edge need subsampling.
        if inwards.abs() >= 0.5 * self.pitch[0].hypot(self.pitch[1]) {
            return if inwards > 0.0 { PARTS * PARTS } else { 0 };
        }
        let middle = |part: usize| (part as f64 + 0.5) / PARTS as f64;
        let parts = (0..PARTS).flat_map(|a| (0..PARTS).map(move |b| (a, b)));
        parts.filter(|(a, b)| distance(x + middle(*a), y + middle(*b)) <= self.radius).count()
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

    /// Area in mm² and centroid in mm of the bright pixels, measured from the display's centre, right and up.
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

    /// Demodulated as a camera would, the fringes have their frequency, direction and phase.
    #[test]
    fn fringes_have_their_phase_everywhere() {
        let tone = Tone::Gamma(2.2);
        let (f, phase) = ([0.02, -0.013], 0.3);
        let shots: Vec<Vec<u32>> = (0..4)
            .map(|k| {
                let phase = phase + f64::from(k) / 4.0;
                let pattern = Pattern::Fringes { cycles_per_mm: f, phase, gamma: 2.2 };
                draw(&pattern, &PANEL, &tone).unwrap()
            })
            .collect();
        let light = |k: usize, i: usize| tone.luminance((shots[k][i] & 255) as u8);
        for i in (0..640 * 400).step_by(977) {
            let (column, row) = ((i % 640) as f64, (i / 640) as f64);
            let [x, y] = [(column - 319.5) * 0.5, (199.5 - row) * 0.6];
            let seen = (light(3, i) - light(1, i)).atan2(light(0, i) - light(2, i));
            let wanted = std::f64::consts::TAU * (f[0] * x + f[1] * y + phase);
            let off = (seen - wanted).sin().atan2((seen - wanted).cos());
            assert!(off.abs() < 0.03, "{column} {row}: {off}");
        }
        let even = draw(&Pattern::Fringes { cycles_per_mm: [0.0; 2], phase: 0.25, gamma: 2.2 }, &PANEL, &tone).unwrap();
        assert!((tone.luminance((even[7] & 255) as u8) - 0.5).abs() < 0.005);
        for bad in [[0.6, 0.0], [f64::NAN, 0.0]] {
            let pattern = Pattern::Fringes { cycles_per_mm: bad, phase: 0.0, gamma: 2.2 };
            assert!(draw(&pattern, &PANEL, &tone).is_err());
        }
    }

    #[test]
    fn patterns_off_the_panel_are_refused() {
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
