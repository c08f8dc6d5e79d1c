//! SVG writer with the parts of a chart: rulers with round ticks, axes and marks.
//!
//! Plotting crates allow too little control over direct labels, shares below a curve and fonts.

use super::Scale;
use super::style::{FRAME, GRID, INK, SOFT, number};
use skrifa::instance::{LocationRef, Size};
use skrifa::{FontRef, GlyphId, MetadataProvider};
use std::fmt::Write;

/// Rectangle, y down.
#[derive(Clone, Copy, Debug)]
pub struct Area {
    /// Left edge.
    pub x: f64,
    /// Upper edge.
    pub y: f64,
    /// Width.
    pub w: f64,
    /// Height.
    pub h: f64,
}

impl Area {
    /// Creates a rectangle from its upper left corner, width and height.
    pub fn new(x: f64, y: f64, w: f64, h: f64) -> Self {
        Self { x, y, w, h }
    }

    /// Area of the intersection of two rectangles.
    pub fn overlap(&self, o: &Self) -> f64 {
        let length = |a: f64, la: f64, b: f64, lb: f64| ((a + la).min(b + lb) - a.max(b)).max(0.0);
        length(self.x, self.w, o.x, o.w) * length(self.y, self.h, o.y, o.h)
    }
}

/// SVG under construction. `style` arguments are attributes such as `stroke="#000" fill="none"`.
pub struct Svg {
    width: f64,
    height: f64,
    body: String,
}

/// Alignment of text to its point.
#[derive(Clone, Copy)]
pub enum Anchor {
    /// The text begins at the point.
    Start,
    /// The text is centred on the point.
    Middle,
    /// The text ends at the point.
    End,
}

impl Svg {
    /// Creates a white page of this size.
    pub fn new(width: f64, height: f64) -> Self {
        let mut svg = Self { width, height, body: String::new() };
        svg.rect(Area::new(0.0, 0.0, width, height), "fill=\"#ffffff\"");
        svg
    }

    /// Adds a rectangle.
    pub fn rect(&mut self, a: Area, style: &str) {
        let _ = writeln!(
            self.body,
            "<rect x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{:.2}\" {style}/>",
            a.x, a.y, a.w, a.h
        );
    }

    /// Adds a line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], style: &str) {
        let ([x1, y1], [x2, y2]) = (from, to);
        let _ = writeln!(self.body, "<line x1=\"{x1:.2}\" y1=\"{y1:.2}\" x2=\"{x2:.2}\" y2=\"{y2:.2}\" {style}/>");
    }

    /// Adds a line through points, closed if `style` fills it.
    pub fn polyline(&mut self, points: &[[f64; 2]], style: &str) {
        let list: Vec<String> = points.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect();
        let _ = writeln!(self.body, "<polyline points=\"{}\" {style}/>", list.join(" "));
    }

    /// Adds a circle of radius `r`.
    pub fn circle(&mut self, [x, y]: [f64; 2], r: f64, style: &str) {
        let _ = writeln!(self.body, "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{r:.2}\" {style}/>");
    }

    /// Adds a mark of one of seven shapes (`shape` modulo 7) with radius `r`.
    pub fn mark(&mut self, [x, y]: [f64; 2], shape: usize, r: f64, style: &str) {
        let corners: &[(f64, f64)] = match shape % 7 {
            0 => return self.circle([x, y], r, style),
            1 => &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
            2 => &[(0.0, -1.25), (1.1, 0.8), (-1.1, 0.8)],
            3 => &[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)],
            4 => &[(0.0, 1.25), (1.1, -0.8), (-1.1, -0.8)],
            5 => &[(-1.2, -0.4), (0.0, -1.25), (1.2, -0.4), (0.75, 1.0), (-0.75, 1.0)],
            _ => &[(-0.5, -1.2), (0.5, -1.2), (1.2, 0.0), (0.5, 1.2), (-0.5, 1.2), (-1.2, 0.0)],
        };
        let list: Vec<String> = corners.iter().map(|(u, v)| format!("{:.2},{:.2}", x + u * r, y + v * r)).collect();
        let _ = writeln!(self.body, "<polygon points=\"{}\" {style}/>", list.join(" "));
    }

    /// Adds one line of text, escaped for XML.
    pub fn text(&mut self, [x, y]: [f64; 2], text: &str, size: f64, anchor: Anchor, style: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let fill = if style.contains("fill=") { String::new() } else { format!(" fill=\"{INK}\"") };
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" text-anchor=\"{anchor}\"{fill} {style}>{}</text>",
            escape(text)
        );
    }

    /// Adds text with a white outline, legible across lines.
    pub fn text_on_lines(&mut self, at: [f64; 2], text: &str, size: f64, anchor: Anchor, style: &str) {
        let rim = "stroke=\"#ffffff\" stroke-opacity=\"0.85\" stroke-width=\"3.5\" stroke-linejoin=\"round\" paint-order=\"stroke\"";
        self.text(at, text, size, anchor, &format!("{style} {rim}"));
    }

    /// Adds text that reads upwards, centred on the point.
    pub fn upright(&mut self, [x, y]: [f64; 2], text: &str, size: f64, style: &str) {
        let turn = format!("transform=\"rotate(-90 {x:.2} {y:.2})\" {style}");
        self.text([x, y], text, size, Anchor::Middle, &turn);
    }

    /// Adds a PNG without smoothing: its pixels stay visible when enlarged.
    pub fn image(&mut self, a: Area, png: &[u8]) {
        use base64::Engine;
        let data = base64::engine::general_purpose::STANDARD.encode(png);
        let _ = writeln!(
            self.body,
            "<image x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{:.2}\" preserveAspectRatio=\"none\" \
             image-rendering=\"optimizeSpeed\" href=\"data:image/png;base64,{data}\"/>",
            a.x, a.y, a.w, a.h
        );
    }

    /// Text of the SVG file; screen readers read `about`.
    pub fn finish(self, about: &str) -> String {
        let size = [self.width, self.height].map(|v| v.to_string());
        self.sized(about, size)
    }

    /// Text of the SVG file with a printed width in mm.
    pub fn finish_for_print(self, about: &str, width_mm: f64) -> String {
        let size = [width_mm, width_mm * self.height / self.width].map(|v| format!("{v:.3}mm"));
        self.sized(about, size)
    }

    fn sized(self, about: &str, [wide, high]: [String; 2]) -> String {
        let Self { width, height, body } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{wide}\" \
             height=\"{high}\" role=\"img\" font-family=\"'DejaVu Sans Condensed', 'DejaVu Sans', Arial, Helvetica, \
             sans-serif\" font-stretch=\"condensed\">\n<title>{}</title>\n{body}</svg>\n",
            escape(about)
        )
    }
}

/// Escapes text for XML and HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Width of a line of text, in the units of `size`.
pub fn text_width(text: &str, size: f64) -> f64 {
    width_in(dejavu::sans_condensed::regular(), text, size)
}

/// Width of a line of bold text, in the units of `size`.
pub fn bold_width(text: &str, size: f64) -> f64 {
    width_in(dejavu::sans_condensed::bold(), text, size)
}

fn width_in(font: &[u8], text: &str, size: f64) -> f64 {
    // The tests of the font's crate rule out a missing font; the fallback is an average width.
    let Ok(font) = FontRef::new(font) else {
        return 0.55 * size * text.chars().count() as f64;
    };
    let (unscaled, location) = (Size::unscaled(), LocationRef::default());
    let (charmap, metrics) = (font.charmap(), font.glyph_metrics(unscaled, location));
    let advance = |sign| metrics.advance_width(charmap.map(sign).unwrap_or(GlyphId::NOTDEF)).unwrap_or_default();
    let units: f32 = text.chars().map(advance).sum();
    f64::from(units) * size / f64::from(font.metrics(unscaled, location).units_per_em)
}

/// Maps values to positions along an axis.
#[derive(Clone, Copy, Debug)]
pub struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Ruler {
    /// Covers the finite values with a small margin. Logarithmic rulers ignore values of 0 and below.
    pub fn covering(scale: Scale, values: impl IntoIterator<Item = f64>, from: f64, to: f64) -> Self {
        let (low, high) = extent(scale, values);
        let (low, high) = match scale {
            Scale::Log => {
                let room = (high / low).powf(0.07).max(1.3);
                (low / room, high * room)
            }
            Scale::Linear => {
                let room = 0.04 * (high - low).max(1e-12);
                (low - room, high + room)
            }
            Scale::Names => (low - 0.5, high + 0.5),
        };
        Self { scale, low, high, from, to }
    }

    /// Covers the logarithms of `values` with a smaller margin, so that similar values are distinguishable.
    pub fn covering_closely(values: impl IntoIterator<Item = f64>, from: f64, to: f64) -> Self {
        let (low, high) = extent(Scale::Log, values);
        // Equal values are centred.
        let room = if high > 1.02 * low { (high / low).powf(0.12) } else { 1.3 };
        Self { scale: Scale::Log, low: low / room, high: high * room, from, to }
    }

    /// Linear ruler from exactly `low` to `high`.
    pub fn exact(low: f64, high: f64, from: f64, to: f64) -> Self {
        Self { scale: Scale::Linear, low, high, from, to }
    }

    /// Logarithmic ruler from exactly `low` to `high`, both above 0.
    pub fn exact_log(low: f64, high: f64, from: f64, to: f64) -> Self {
        Self { scale: Scale::Log, low, high, from, to }
    }

    /// Position of a value; values out of range are clamped to the ends.
    pub fn at(&self, value: f64) -> f64 {
        let share = if self.scale == Scale::Log {
            (value.max(self.low) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        self.from + share.clamp(0.0, 1.0) * (self.to - self.from)
    }

    /// Ticks as (value, whether it has a label). `room` is the number of labels that fit.
    pub fn ticks(&self, room: usize) -> Vec<(f64, bool)> {
        match self.scale {
            Scale::Log => Some(self.log_ticks(room))
                .filter(|ticks| ticks.iter().filter(|t| t.1).count() > 1)
                .unwrap_or_else(|| self.linear_ticks(room).into_iter().map(|v| (v, true)).collect()),
            _ => self.linear_ticks(room).into_iter().map(|v| (v, true)).collect(),
        }
    }

    fn linear_ticks(&self, room: usize) -> Vec<f64> {
        let rough = (self.high - self.low) / room.max(1) as f64;
        let power = 10f64.powf(rough.log10().floor());
        // Steps such as 15, 30 and 90 suit degrees; other ranges use 1, 2 and 5.
        let steps: &[f64] =
            if self.high - self.low > 50.0 { &[1.0, 1.5, 3.0, 4.5, 9.0] } else { &[1.0, 2.0, 2.5, 5.0, 10.0] };
        let step = steps.iter().map(|s| s * power).find(|s| *s >= rough).unwrap_or(10.0 * power);
        let first = (self.low / step - 1e-9).ceil() as i64;
        (first..).map(|k| k as f64 * step).take_while(|v| *v <= self.high + 1e-9 * step).collect()
    }

    fn log_ticks(&self, room: usize) -> Vec<(f64, bool)> {
        let decades = (self.high / self.low).log10();
        let labelled: &[f64] = if decades < 0.6 {
            &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]
        } else if 4.0 * decades < room as f64 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let stride = (decades / room.max(1) as f64).ceil().max(1.0) as i32;
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let mut ticks = vec![];
        for power in first..=last {
            for m in [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0] {
                let value = m * 10f64.powi(power);
                let label = labelled.contains(&m) && power.rem_euclid(stride) == 0;
                if (self.low..=self.high).contains(&value) && (label || (m != 1.5 && decades < 8.0) || m == 1.0) {
                    ticks.push((value, label));
                }
            }
        }
        ticks
    }
}

/// Minimum and maximum of the values that can be drawn.
fn extent(scale: Scale, values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let usable = values.into_iter().filter(|v| v.is_finite() && (scale != Scale::Log || *v > 0.0));
    let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high { (1.0, 10.0) } else { (low, high) }
}

/// Frame of a panel with grid, ticks and titles.
pub struct Axes<'a> {
    /// Area of the panel.
    pub area: Area,
    /// Horizontal ruler.
    pub x: Ruler,
    /// Vertical ruler.
    pub y: Ruler,
    /// Names of the categories, if x has [`Scale::Names`].
    pub names: &'a [String],
    /// Title of the horizontal axis; empty if the panel below carries it.
    pub x_title: &'a str,
    /// Title of the vertical axis.
    pub y_title: &'a str,
    /// Whether the vertical axis shows fractions in per cent.
    pub percent: bool,
}

impl Axes<'_> {
    /// Draws grid, frame, ticks and titles.
    pub fn draw(&self, svg: &mut Svg) {
        let a = self.area;
        svg.rect(a, "fill=\"#fcfdfe\"");
        let named = self.x.scale == Scale::Names;
        let columns = (a.w / 62.0) as usize;
        let x_ticks = if named { vec![] } else { self.x.ticks(columns) };
        for (value, label) in x_ticks {
            let x = self.x.at(value);
            svg.line([x, a.y], [x, a.y + a.h], &grid(label));
            if label && !self.x_title.is_empty() {
                svg.text([x, a.y + a.h + 18.0], &number(value), 12.5, Anchor::Middle, &fill(SOFT));
            }
        }
        for (value, label) in self.y.ticks((a.h / 26.0) as usize) {
            let y = self.y.at(value);
            svg.line([a.x, y], [a.x + a.w, y], &grid(label));
            if label {
                let text = if self.percent { format!("{} %", number(100.0 * value)) } else { number(value) };
                svg.text([a.x - 7.0, y + 4.3], &text, 12.5, Anchor::End, &fill(SOFT));
            }
        }
        svg.rect(a, &format!("fill=\"none\" stroke=\"{FRAME}\""));
        self.titles(svg, named);
    }

    fn titles(&self, svg: &mut Svg, named: bool) {
        let a = self.area;
        if !self.x_title.is_empty() {
            let mut below = 40.0;
            if named {
                for (i, name) in self.names.iter().enumerate() {
                    let (x, y) = (self.x.at(i as f64), a.y + a.h + 14.0);
                    let turn = format!("{} transform=\"rotate(-28 {x:.2} {y:.2})\"", fill(SOFT));
                    svg.text([x + 4.0, y], name, 12.0, Anchor::End, &turn);
                }
                let longest = self.names.iter().map(|n| text_width(n, 12.0)).fold(0.0, f64::max);
                below = 34.0 + 0.48 * longest;
            }
            svg.text([a.x + a.w / 2.0, a.y + a.h + below], self.x_title, 14.0, Anchor::Middle, "");
        }
        svg.upright([a.x - 56.0, a.y + a.h / 2.0], self.y_title, 14.0, "");
    }
}

fn grid(major: bool) -> String {
    format!("stroke=\"{GRID}\" stroke-width=\"{}\"", if major { 1.2 } else { 0.5 })
}

/// Attribute that fills a shape with a colour.
pub fn fill(color: &str) -> String {
    format!("fill=\"{color}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let ruler = Ruler::covering(Scale::Log, [0.02, 30.0], 0.0, 100.0);
        let labels: Vec<f64> = ruler.ticks(8).into_iter().filter(|t| t.1).map(|t| t.0).collect();
        assert_eq!(labels.iter().map(|v| number(*v)).collect::<Vec<_>>(), ["0.1", "1", "10"]);
        assert!(ruler.at(0.02) > 0.0 && ruler.at(30.0) < 100.0 && ruler.at(-1.0) == 0.0);
        // A narrow range has at least two labels, and similar values are distinguishable.
        let narrow = Ruler::covering_closely([3.1, 3.3], 0.0, 100.0);
        assert!(narrow.ticks(6).iter().filter(|t| t.1).count() >= 2);
        assert!(narrow.at(3.3) - narrow.at(3.1) > 60.0);
        assert_eq!(Ruler::covering_closely([2.0], 0.0, 100.0).at(2.0).round(), 50.0);
        let degrees = Ruler::covering(Scale::Linear, [0.0, 180.0], 0.0, 100.0);
        assert_eq!(degrees.linear_ticks(7), [0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0]);
    }

    #[test]
    fn text_of_any_kind_is_escaped() {
        let mut svg = Svg::new(10.0, 10.0);
        svg.text([0.0, 0.0], "a < b & \"c\"", 10.0, Anchor::Start, "");
        assert!(super::super::png_from_svg(&svg.finish("<&>"), 1.0).is_ok());
    }
}
