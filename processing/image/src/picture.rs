//! Pictures of maps with colours, legend and title.

use rayon::prelude::*;

use super::canvas::{Canvas, Rgb, text_width};
use super::palette::{ColorTable, MASKED, Palette};
use super::scale_bar::ScaleBar;
use nacre_base::vectors::vectorised;

const PAPER: Rgb = [250, 250, 250];
const INK: Rgb = [25, 25, 25];
/// Number of colours for scalars.
const SHADES: usize = 1024;
/// Height of a scale bar with its label and the gap above, in text sizes.
const SCALE_BAR: f32 = 3.0;

/// Viridis, a perceptually uniform colour map from dark (0) to light (1): sixth-order fit by M. Zucker (CC0).
pub fn viridis(t: f32) -> Rgb {
    const C: [[f32; 3]; 7] = [
        [0.277_727_33, 0.005_407_344_5, 0.334_099_8],
        [0.105_093_04, 1.404_613_5, 1.384_590_1],
        [-0.330_861_83, 0.214_847_56, 0.095_095_16],
        [-4.634_230_5, -5.799_101, -19.332_441],
        [6.228_27, 14.179_933, 56.690_55],
        [4.776_385, -13.745_145, -65.353_033],
        [-5.435_456, 4.645_852_6, 26.312_435],
    ];
    let t = t.clamp(0.0, 1.0);
    [0, 1, 2].map(|i| (C.iter().rev().fold(0.0, |sum, c| sum * t + c[i]) * 255.0).round().clamp(0.0, 255.0) as u8)
}

/// Draws the colour wheel of orientations: a ring between the radii `inner` and `radius` (pixels) around (`cx`, `cy`).
///
/// The angle φ, anticlockwise from the right, has the colour of the orientation φ, so each colour appears at both ends
/// of its line. Labels for 0°, 45°, 90° and 135° are outside of the ring. They need about 0.6 · `radius` of room to the
/// right, and a third of that above.
fn wheel(canvas: &mut Canvas, [cx, cy]: [f32; 2], [radius, inner]: [f32; 2], palette: Palette) {
    let reach = radius.ceil() as i64 + 1;
    let (mx, my) = (cx.round() as i64, cy.round() as i64);
    for y in my - reach..=my + reach {
        for x in mx - reach..=mx + reach {
            let (dx, dy) = (x as f32 - cx, cy - y as f32);
            let distance = dx.hypot(dy);
            let coverage = (radius - distance + 0.5).min(distance - inner + 0.5);
            if coverage > 0.0 {
                canvas.blend(x, y, palette.color(dy.atan2(dx)), coverage);
            }
        }
    }
    let size = label_size(radius);
    for (angle, label) in [(0.0_f32, "0°"), (45.0, "45°"), (90.0, "90°"), (135.0, "135°")] {
        let (sin, cos) = angle.to_radians().sin_cos();
        let width = text_width(size, label);
        let (x, y) = (cx + cos * (radius + 0.35 * size), cy - sin * (radius + 0.35 * size));
        // The label touches the ring with the corner or edge that faces it.
        canvas.text(x - width * (1.0 - cos) / 2.0, y - size * (1.0 + sin) / 2.0, size, INK, label);
    }
}

fn label_size(radius: f32) -> f32 {
    (0.3 * radius).max(11.0)
}

/// Draws an orientation map at full resolution with a legend to the right: title, colour wheel, key of masked pixels,
/// scale bar.
///
/// `pixel(column, row)` is an orientation in radians (any branch), or `None` or NaN where masked; several threads call
/// it. Lines of `title` are wrapped to the width of the legend. `pixel_um` is the size of a pixel on the sample;
/// without it there is no scale bar.
pub fn orientation_picture(
    size: [usize; 2],
    pixel: &(dyn Fn(usize, usize) -> Option<f32> + Sync),
    title: &str,
    palette: Palette,
    pixel_um: Option<f64>,
) -> Canvas {
    orientation_rows(size, &by_pixel(pixel), title, palette, pixel_um)
}

/// As [`orientation_picture`], from rows: `fill(row, values)` writes one row, NaN where masked.
pub fn orientation_rows(
    [width, height]: [usize; 2],
    fill: &(dyn Fn(usize, &mut [f32]) + Sync),
    title: &str,
    palette: Palette,
    pixel_um: Option<f64>,
) -> Canvas {
    let legend = Legend::new([width, height], title, 14.0, pixel_um);
    let mut canvas = legend.canvas(width, height);
    paint(&mut canvas, [width, height], fill, palette.table().colors(), ColorTable::index);
    let mut y = legend.title(&mut canvas, width);
    let em = legend.em;
    let radius = 0.28 * legend.width as f32;
    y += 1.5 * em.max(label_size(radius));
    let cx = width as f32 + 0.5 * legend.width as f32;
    wheel(&mut canvas, [cx, y + radius], [radius, 0.5 * radius], palette);
    legend.keys(&mut canvas, width, y + 2.0 * radius + 1.2 * em);
    canvas
}

/// Draws a scalar map at full resolution with a legend to the right: title, colour bar with ticks, key of masked
/// pixels, scale bar.
///
/// `value(column, row)` is `None` or NaN where masked; values outside of `lo..hi` get the colour of the nearer end.
/// `label` names the quantity and its unit. `pixel_um` is the size of a pixel on the sample; without it there is no
/// scale bar.
pub fn scalar_picture(
    size: [usize; 2],
    value: &(dyn Fn(usize, usize) -> Option<f32> + Sync),
    range: [f32; 2],
    label: &str,
    title: &str,
    pixel_um: Option<f64>,
) -> Canvas {
    scalar_rows(size, &by_pixel(value), range, label, title, pixel_um)
}

/// As [`scalar_picture`], from rows: `fill(row, values)` writes one row, NaN where masked.
pub fn scalar_rows(
    [width, height]: [usize; 2],
    fill: &(dyn Fn(usize, &mut [f32]) + Sync),
    [lo, hi]: [f32; 2],
    label: &str,
    title: &str,
    pixel_um: Option<f64>,
) -> Canvas {
    let legend = Legend::new([width, height], &format!("{title}\n\n{label}"), 12.0, pixel_um);
    let mut canvas = legend.canvas(width, height);
    let table: Vec<Rgb> = (0..SHADES).map(|i| viridis(i as f32 / (SHADES - 1) as f32)).collect();
    let scale = if hi > lo { (SHADES - 1) as f32 / (hi - lo) } else { 0.0 };
    let colors: Vec<Rgb> = table.iter().copied().chain([MASKED]).collect();
    let index = |v: f32| {
        let shade = ((v - lo) * scale + 0.5).clamp(0.0, (SHADES - 1) as f32) as i32;
        if v.is_nan() { SHADES as i32 } else { shade }
    };
    paint(&mut canvas, [width, height], fill, &colors, index);
    let em = legend.em;
    let top = (legend.title(&mut canvas, width) + 1.2 * em) as usize;
    let room = canvas.height as f32 - top as f32 - (3.5 + legend.below()) * em;
    let bar = Bar { x: width + em as usize, top, length: room.clamp(6.0 * em, 24.0 * em) as usize, em };
    bar.draw(&mut canvas, &table, lo, hi);
    legend.keys(&mut canvas, width, (top + bar.length) as f32 + 1.2 * em);
    canvas
}

fn by_pixel<'a>(
    pixel: &'a (dyn Fn(usize, usize) -> Option<f32> + Sync),
) -> impl Fn(usize, &mut [f32]) + Sync + use<'a> {
    move |y, row| row.iter_mut().enumerate().for_each(|(x, value)| *value = pixel(x, y).unwrap_or(f32::NAN))
}

/// Colours the map in the upper left corner of the canvas. `index` is the index in `colors` of a value's colour.
fn paint(
    canvas: &mut Canvas,
    [width, height]: [usize; 2],
    fill: &(dyn Fn(usize, &mut [f32]) + Sync),
    colors: &[Rgb],
    index: impl Fn(f32) -> i32 + Sync,
) {
    let stride = 3 * canvas.width;
    let rows = canvas.rgb.par_chunks_exact_mut(stride).take(height).enumerate();
    rows.for_each_init(
        || (vec![0.0; width], vec![0; width]),
        |(values, places), (y, row)| {
            fill(y, values);
            vectorised(
                #[inline(always)]
                || places.iter_mut().zip(&*values).for_each(|(place, value)| *place = index(*value)),
            );
            for (target, place) in row.as_chunks_mut::<3>().0.iter_mut().zip(&*places) {
                *target = colors[*place as usize];
            }
        },
    );
}

/// Legend to the right of a map.
struct Legend {
    /// Text size in pixels.
    em: f32,
    width: usize,
    lines: Vec<String>,
    /// Required height in pixels.
    needed: usize,
    scale_bar: Option<ScaleBar>,
}

impl Legend {
    /// Lays out the legend of a map of `columns` × `height` pixels; `body` is the height of wheel or colour bar with
    /// labels, in text sizes.
    fn new([columns, height]: [usize; 2], title: &str, body: f32, pixel_um: Option<f64>) -> Self {
        let em = (height as f32 / 40.0).clamp(15.0, 120.0);
        let width = (14.0 * em) as usize;
        let room = width as f32 - 2.0 * em;
        let lines = wrap(title, em, room);
        let scale_bar = pixel_um.and_then(|um| ScaleBar::new(um, columns, room.into()));
        let mut legend = Self { em, width, lines, needed: 0, scale_bar };
        legend.needed = (em * (1.0 + 1.25 * legend.lines.len() as f32 + body + legend.below())).ceil() as usize;
        legend
    }

    /// Height of the scale bar, in text sizes.
    fn below(&self) -> f32 {
        if self.scale_bar.is_some() { SCALE_BAR } else { 0.0 }
    }

    fn canvas(&self, width: usize, height: usize) -> Canvas {
        Canvas::new(width + self.width, height.max(self.needed), PAPER)
    }

    /// Draws the title and returns the row below it.
    fn title(&self, canvas: &mut Canvas, left: usize) -> f32 {
        let mut y = self.em;
        for line in &self.lines {
            canvas.text(left as f32 + self.em, y, self.em, INK, line);
            y += 1.25 * self.em;
        }
        y
    }

    /// Draws the key of masked pixels and the scale bar.
    fn keys(&self, canvas: &mut Canvas, left: usize, y: f32) {
        let (x, side) = (left as f32 + self.em, self.em);
        canvas.rectangle(x as usize, y as usize, side as usize, side as usize, MASKED);
        canvas.text(x + 1.5 * side, y, side, INK, "masked");
        if let Some(bar) = &self.scale_bar {
            bar.draw(canvas, [x, y + 2.0 * side], side, INK);
        }
    }
}

/// Wraps text at spaces to a width in pixels; line breaks are kept.
fn wrap(text: &str, size: f32, width: f32) -> Vec<String> {
    let mut lines = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            let longer = if line.is_empty() { word.to_string() } else { format!("{line} {word}") };
            if !line.is_empty() && text_width(size, &longer) > width {
                lines.push(std::mem::replace(&mut line, word.to_string()));
            } else {
                line = longer;
            }
        }
        lines.push(line);
    }
    lines
}

/// Vertical colour bar, the largest value on top.
struct Bar {
    x: usize,
    top: usize,
    length: usize,
    em: f32,
}

impl Bar {
    fn draw(&self, canvas: &mut Canvas, table: &[Rgb], lo: f32, hi: f32) {
        let thick = (1.5 * self.em) as usize;
        let last = self.length.saturating_sub(1).max(1);
        for row in 0..self.length {
            let color = table[(last - row.min(last)) * (table.len() - 1) / last];
            canvas.rectangle(self.x, self.top + row, thick, 1, color);
        }
        let (values, decimals) = ticks(lo, hi, (self.length as f32 / (2.2 * self.em)).clamp(3.0, 8.0));
        let line = (self.em / 12.0).ceil() as usize;
        for value in values {
            let part = if hi > lo { (value - f64::from(lo)) / f64::from(hi - lo) } else { 0.5 };
            let y = self.top as f32 + (1.0 - part as f32) * last as f32;
            canvas.rectangle(self.x + thick, (y - line as f32 / 2.0).round() as usize, thick / 4, line, INK);
            let text = format!("{value:.decimals$}").replace('-', "−");
            canvas.text((self.x + thick) as f32 + 0.6 * self.em, y - 0.5 * self.em, self.em, INK, &text);
        }
    }
}

/// About `count` round values (steps of 1, 2 or 5 times a power of ten) in `lo..=hi`, and their number of decimals.
fn ticks(lo: f32, hi: f32, count: f32) -> (Vec<f64>, usize) {
    let (lo, hi) = (f64::from(lo), f64::from(hi));
    let rough = (hi - lo) / f64::from(count);
    if !rough.is_finite() || rough <= lo.abs().max(hi.abs()) * 1e-9 {
        return (vec![lo], 3);
    }
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough * 0.999).unwrap_or(rough);
    let decimals = (-(step * 1.001).log10().floor()).clamp(0.0, 9.0) as usize;
    let (first, last) = ((lo / step - 1e-6).ceil() as i64, (hi / step + 1e-6).floor() as i64);
    ((first..=last).map(|i| i as f64 * step).collect(), decimals)
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use super::*;

    #[test]
    fn viridis_is_dark_to_light() {
        assert_eq!(viridis(0.0)[2], 85);
        assert!(viridis(1.0)[0] > 245 && viridis(1.0)[2] < 45);
    }

    #[test]
    fn wheel_has_each_colour_at_both_ends_of_its_line() {
        let mut canvas = Canvas::new(201, 201, PAPER);
        wheel(&mut canvas, [100.0; 2], [60.0, 30.0], Palette::Hsv);
        let at = |degrees: f32| {
            let (sin, cos) = (degrees / 360.0 * TAU).sin_cos();
            let (x, y) = ((100.0 + 45.0 * cos).round() as usize, (100.0 - 45.0 * sin).round() as usize);
            <[u8; 3]>::try_from(&canvas.rgb[3 * (y * 201 + x)..][..3]).unwrap()
        };
        assert_eq!(at(0.0), [255, 0, 0]);
        assert_eq!(at(90.0), [0, 255, 255]);
        for degrees in [0.0, 30.0, 45.0, 90.0, 135.0] {
            let (one, other) = (at(degrees), at(degrees + 180.0));
            assert!(one.iter().zip(other).all(|(a, b)| a.abs_diff(b) <= 6), "{degrees}: {one:?} {other:?}");
        }
    }

    #[test]
    fn tick_values_are_round_and_inside() {
        assert_eq!(ticks(0.0, 1.0, 5.0), (vec![0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0], 1));
        assert_eq!(ticks(-10.0, 95.0, 4.0).0, [0.0, 50.0]);
        assert_eq!(ticks(3.0, 3.0, 4.0).0, [3.0]);
        assert_eq!(ticks(f32::NAN, 3.0, 4.0).0.len(), 1);
        assert_eq!(ticks(0.0, 0.004, 4.0).1, 3);
    }

    /// `NACRE_PICTURES=folder` keeps the pictures for inspection.
    #[test]
    fn pictures_of_all_sizes() {
        let keep = std::env::var_os("NACRE_PICTURES").map(std::path::PathBuf::from);
        for (w, h) in [(1, 1), (100, 100), (640, 480), (2048, 1536)] {
            let (cx, cy) = (w as f32 / 2.0, h as f32 / 2.0);
            let angle = |x: usize, y: usize| {
                let (dx, dy) = (x as f32 - cx, cy - y as f32);
                (dx.hypot(dy) < cy && dx.hypot(dy) > 0.2 * cy).then(|| dy.atan2(dx))
            };
            let title = "Orientation of the gratings\nCD, 532 nm, 12 analyser angles";
            let um = Some(25.0);
            let orientation = orientation_picture([w, h], &angle, title, Palette::Cyclic, um);
            let radius = |x: usize, y: usize| angle(x, y).map(|_| (x as f32 - cx).hypot(y as f32 - cy) / cy * 1.9);
            let scalar = scalar_picture([w, h], &radius, [0.35, 1.9], "σ of the orientation (°)", title, um);
            assert!(orientation.width > w && orientation.height >= h && scalar.height >= h);
            assert_eq!(orientation.rgb[..3], MASKED);
            if let Some(folder) = &keep {
                orientation.save_png(&folder.join(format!("orientation_{w}x{h}.png"))).unwrap();
                scalar.save_png(&folder.join(format!("scalar_{w}x{h}.png"))).unwrap();
            }
        }
    }

    #[test]
    fn a_scale_bar_leaves_the_map_as_it_is() {
        let (w, h) = (200, 600);
        let angle = |x: usize, y: usize| Some((x + y) as f32 / 100.0);
        let [with, without] =
            [Some(10.0), None].map(|um| orientation_picture([w, h], &angle, "Orientation", Palette::Cyclic, um));
        assert_eq!([with.width, with.height], [without.width, without.height]);
        let rows = |c: &Canvas| c.rgb.chunks_exact(3 * c.width).flat_map(|r| r[..3 * w].to_vec()).collect::<Vec<_>>();
        assert_eq!(rows(&with), rows(&without));
        // 500 µm are 50 pixels of ink in a row.
        let ink = |c: &Canvas, n| c.rgb.as_chunks::<3>().0.chunk_by(|a, b| a == b).any(|r| r[0] == INK && r.len() == n);
        assert!(ink(&with, 50) && !ink(&without, 50));
    }
}
