//! Scale bars.

use super::canvas::{Canvas, Rgb};

/// Longest bar relative to the width of its map. Round lengths differ by factors of 2 or 2.5, so bars take 0.16 to 0.4
/// of the width.
const LONGEST: f64 = 0.4;

/// Scale bar with a length of 1, 2 or 5 times a power of ten.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ScaleBar {
    /// Length in pixels of the picture.
    pub pixels: usize,
    /// Length with its unit, such as `200 µm`.
    pub label: String,
}

impl ScaleBar {
    /// Scale bar for a map of `width` pixels of `pixel_um` µm, at most `room` pixels long; `None` if no round length
    /// has two pixels.
    pub fn new(pixel_um: f64, width: usize, room: f64) -> Option<Self> {
        let most = pixel_um * room.min(LONGEST * width as f64);
        if !(pixel_um > 0.0 && most.is_finite() && most > 0.0) {
            return None;
        }
        let exponent = most.log10().floor() as i32;
        let digit = [5, 2, 1].into_iter().find(|d| f64::from(*d) * 10_f64.powi(exponent) <= most * (1.0 + 1e-9))?;
        let pixels = (f64::from(digit) * 10_f64.powi(exponent) / pixel_um).round() as usize;
        (pixels >= 2).then(|| Self { pixels, label: label(digit, exponent) })
    }

    /// Draws the bar with its upper left corner at (`x`, `y`), and its label of `size` pixels below.
    pub fn draw(&self, canvas: &mut Canvas, [x, y]: [f32; 2], size: f32, color: Rgb) {
        let thick = (0.3 * size).round().max(2.0);
        canvas.rectangle(x as usize, y as usize, self.pixels, thick as usize, color);
        canvas.text(x, y + thick + 0.2 * size, size, color, &self.label);
    }
}

/// Formats `digit · 10^exponent` µm, in mm from 1000 µm on.
fn label(digit: u32, exponent: i32) -> String {
    let (exponent, unit) = if exponent >= 3 { (exponent - 3, "mm") } else { (exponent, "µm") };
    let decimals = exponent.min(0).unsigned_abs() as usize;
    format!("{:.decimals$} {unit}", f64::from(digit) * 10_f64.powi(exponent))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_round_and_about_a_quarter_of_the_width() {
        let of = |um, width| ScaleBar::new(um, width, f64::INFINITY).map(|bar| (bar.pixels, bar.label));
        assert_eq!(of(1.0, 1000), Some((200, "200 µm".into())));
        assert_eq!(of(12.5, 640), Some((160, "2 mm".into())));
        assert_eq!(of(50.0, 50), Some((20, "1 mm".into())));
        assert_eq!(of(0.08, 100), Some((25, "2 µm".into())));
        assert_eq!(of(0.002, 640), Some((250, "0.5 µm".into())));
        assert_eq!(of(1000.0, 2048), Some((500, "500 mm".into())));
        for width in [17, 100, 333, 640, 2048] {
            for um in [0.0031, 0.08, 0.77, 1.0, 4.9, 25.0, 310.0] {
                let bar = ScaleBar::new(um, width, f64::INFINITY).unwrap();
                let (number, unit) = bar.label.split_once(' ').unwrap();
                let length: f64 = number.parse::<f64>().unwrap() * if unit == "mm" { 1000.0 } else { 1.0 };
                assert!((length / um - bar.pixels as f64).abs() <= 0.5, "{bar:?} {um}");
                let part = length / um / width as f64;
                assert!((0.159..0.401).contains(&part), "{part} of {width} pixels of {um} µm");
            }
        }
    }

    #[test]
    fn bars_fit_their_room_or_are_left_out() {
        assert_eq!(ScaleBar::new(1.0, 1000, 120.0).unwrap().pixels, 100);
        for (um, width) in [(0.0, 100), (-1.0, 100), (f64::NAN, 100), (f64::INFINITY, 100), (1.0, 0), (1.0, 3)] {
            assert_eq!(ScaleBar::new(um, width, 100.0), None);
        }
        for um in [f64::MIN_POSITIVE, 1e-300, 1e300, f64::MAX] {
            let _ = ScaleBar::new(um, 100, 100.0);
        }
    }
}
