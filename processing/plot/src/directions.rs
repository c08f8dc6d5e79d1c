//! Maps of directions: axes of direction cosines, rings of equal angle, and a logarithmic colour bar.

use super::style::{FRAME, INK, SOFT, number};
use super::svg::{Anchor, Area, Ruler, Svg, fill, text_width};

/// Angles of the rings from the centre in degrees; the last one is the horizon.
const RINGS: [f64; 6] = [15.0, 30.0, 45.0, 60.0, 75.0, 90.0];

/// Azimuths in degrees at which a ring may have its label, the first visible one counts.
const LABELS: [f64; 8] = [45.0, 60.0, 30.0, 75.0, 15.0, 135.0, 225.0, 315.0];

/// Number of bands of a colour bar.
const BANDS: usize = 128;

/// A square of direction cosines (x, y) = sin θ (cos φ, sin φ), y up.
#[derive(Clone, Copy, Debug)]
pub struct Directions<'a> {
    /// Place of the square on the page.
    pub area: Area,
    /// Direction cosines of its centre.
    pub center: [f64; 2],
    /// Half of its side.
    pub half: f64,
    /// Titles of the axes.
    pub titles: [&'a str; 2],
    /// Whether a ring is the angle θ, `sin θ` from the centre; false if coordinates are not sines.
    pub rings: bool,
}

impl Directions<'_> {
    fn rulers(&self) -> [Ruler; 2] {
        let (a, [x, y], half) = (self.area, self.center, self.half);
        [Ruler::exact(x - half, x + half, a.x, a.x + a.w), Ruler::exact(y - half, y + half, a.y + a.h, a.y)]
    }

    fn shows(&self, at: [f64; 2]) -> bool {
        at.iter().zip(self.center).all(|(v, c)| (v - c).abs() <= self.half * (1.0 + 1e-9))
    }

    /// Draws rings with labels, frame, ticks and titles over a picture of the square. `ink` is legible on the picture.
    pub fn draw(&self, svg: &mut Svg, ink: &str) {
        let (a, [x, y]) = (self.area, self.rulers());
        for degrees in RINGS.into_iter().filter(|_| self.rings) {
            self.ring(svg, degrees, ink);
        }
        svg.rect(a, &format!("fill=\"none\" stroke=\"{FRAME}\""));
        for (value, _) in x.ticks(5) {
            let at = x.at(value);
            svg.line([at, a.y + a.h], [at, a.y + a.h + 5.0], &stroke(INK, 1.0));
            svg.text([at, a.y + a.h + 19.0], &number(value), 12.5, Anchor::Middle, &fill(SOFT));
        }
        for (value, _) in y.ticks(5) {
            let at = y.at(value);
            svg.line([a.x - 5.0, at], [a.x, at], &stroke(INK, 1.0));
            svg.text([a.x - 9.0, at + 4.3], &number(value), 12.5, Anchor::End, &fill(SOFT));
        }
        svg.text([a.x + a.w / 2.0, a.y + a.h + 40.0], self.titles[0], 14.0, Anchor::Middle, "");
        svg.upright([a.x - 52.0, a.y + a.h / 2.0], self.titles[1], 14.0, "");
    }

    /// Draws the visible parts of the ring at an angle, and its label.
    fn ring(&self, svg: &mut Svg, degrees: f64, ink: &str) {
        let ([x, y], radius) = (self.rulers(), degrees.to_radians().sin());
        let on = |azimuth: f64| [radius * azimuth.to_radians().cos(), radius * azimuth.to_radians().sin()];
        // Parts of the ring in a strongly enlarged square are shorter than a degree.
        let step = self.half.clamp(1e-3, 1.0);
        let ring: Vec<[f64; 2]> = (0..=(360.0 / step).round() as usize).map(|k| on(k as f64 * step)).collect();
        let visible = || ring.split(|at| !self.shows(*at)).filter(|run| run.len() > 1);
        for run in visible() {
            let points: Vec<[f64; 2]> = run.iter().map(|at| [x.at(at[0]), y.at(at[1])]).collect();
            svg.polyline(&points, &format!("fill=\"none\" {}", stroke(ink, 0.9)));
        }
        let usual = LABELS.into_iter().map(on).find(|at| self.shows(*at));
        let label = usual.or_else(|| visible().next().map(|run| run[run.len() / 2]));
        if let Some(at) = label.filter(|_| degrees < 90.0) {
            let text = format!("{}°", number(degrees));
            // Within the ring, since beyond the horizon the background is light.
            svg.text([x.at(at[0]) - 4.0, y.at(at[1]) + 13.0], &text, 12.0, Anchor::End, &fill(ink));
        }
    }

    /// Marks a direction with a cross and a word; ignored outside of the square.
    pub fn mark(&self, svg: &mut Svg, at: [f64; 2], word: &str, ink: &str) {
        if !self.shows(at) {
            return;
        }
        let ([x, y], a) = (self.rulers(), self.area);
        let [cx, cy] = [x.at(at[0]), y.at(at[1])];
        svg.line([cx - 6.0, cy], [cx + 6.0, cy], &stroke(ink, 1.4));
        svg.line([cx, cy - 6.0], [cx, cy + 6.0], &stroke(ink, 1.4));
        let fits = cx + 9.0 + text_width(word, 12.0) < a.x + a.w;
        let (left, anchor) = if fits { (cx + 9.0, Anchor::Start) } else { (cx - 9.0, Anchor::End) };
        svg.text([left, cy + 15.0], word, 12.0, anchor, &fill(ink));
    }
}

fn stroke(ink: &str, width: f64) -> String {
    format!("stroke=\"{ink}\" stroke-width=\"{width}\" stroke-opacity=\"0.8\"")
}

/// Draws an upright colour bar with a logarithmic scale, its ticks and the limits of its colours. `color` maps 0 (the
/// lower limit) to 1 (the upper limit) to sRGB.
pub fn log_color_bar(svg: &mut Svg, area: Area, limits: [f64; 2], title: &str, color: &dyn Fn(f64) -> [u8; 3]) {
    let [low, high] = limits;
    let ruler = Ruler::exact_log(low, high, area.y + area.h, area.y);
    let band = area.h / BANDS as f64;
    for k in 0..BANDS {
        let [r, g, b] = color((k as f64 + 0.5) / BANDS as f64);
        // Bands overlap by half a unit, so that no gap between them shows.
        let top = area.y + area.h - (k + 1) as f64 * band;
        svg.rect(Area::new(area.x, top, area.w, band + 0.5), &format!("fill=\"#{r:02x}{g:02x}{b:02x}\""));
    }
    svg.rect(area, &format!("fill=\"none\" stroke=\"{FRAME}\""));
    let right = area.x + area.w;
    let ends = [area.y, area.y + area.h];
    for (value, label) in ruler.ticks((area.h / 40.0) as usize) {
        let y = ruler.at(value);
        svg.line([right, y], [right + if label { 6.0 } else { 3.0 }, y], &stroke(INK, 1.0));
        if label && ends.iter().all(|end| (y - end).abs() > 13.0) {
            svg.text([right + 10.0, y + 4.3], &number(value), 12.5, Anchor::Start, &fill(SOFT));
        }
    }
    for (value, y) in [(high, ends[0]), (low, ends[1])] {
        svg.line([right, y], [right + 8.0, y], &stroke(INK, 1.4));
        svg.text([right + 10.0, y + 4.3], &number(value), 12.5, Anchor::Start, "");
    }
    svg.upright([right + 82.0, area.y + area.h / 2.0], title, 14.0, "");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(center: [f64; 2], half: f64) -> String {
        let mut svg = Svg::new(500.0, 500.0);
        let area = Area::new(60.0, 20.0, 400.0, 400.0);
        let map = Directions { area, center, half, titles: ["x", "y"], rings: true };
        map.draw(&mut svg, "#ffffff");
        map.mark(&mut svg, [-0.5, 0.0], "mirror", "#ffffff");
        svg.finish("map")
    }

    /// Distance of the points of each polyline from a centre on the page.
    fn radii(svg: &str, [cx, cy]: [f64; 2]) -> Vec<f64> {
        let points = svg.lines().filter_map(|line| line.strip_prefix("<polyline points=\"")?.split('"').next());
        let radius = |point: &str| {
            let (x, y) = point.split_once(',').unwrap();
            (x.parse::<f64>().unwrap() - cx).hypot(y.parse::<f64>().unwrap() - cy)
        };
        points.map(|points| radius(points.split(' ').next().unwrap())).collect()
    }

    #[test]
    fn rings_lie_at_the_sines_of_their_angles() {
        let svg = drawn([0.0; 2], 1.0);
        let found = radii(&svg, [260.0, 220.0]);
        assert_eq!(found.len(), 6);
        for (degrees, radius) in RINGS.iter().zip(found) {
            assert!((radius - 200.0 * degrees.to_radians().sin()).abs() < 0.02, "{degrees}: {radius}");
        }
        assert!(["15°", "75°", "mirror"].iter().all(|word| svg.contains(word)));
        // A part of the directions shows the ring that crosses it, and no other.
        let part = drawn([0.5, 0.0], 0.01);
        assert!(part.contains("30°") && !part.contains("45°") && !part.contains("mirror"));
    }

    #[test]
    fn a_colour_bar_names_its_limits_and_decades() {
        let mut svg = Svg::new(200.0, 400.0);
        let color = |t: f64| [(255.0 * t) as u8; 3];
        log_color_bar(&mut svg, Area::new(20.0, 20.0, 20.0, 360.0), [0.0025, 37.0], "BRDF (1/sr)", &color);
        let svg = svg.finish("bar");
        for word in [">0.0025<", ">37<", ">0.1<", ">1<", ">10<", "BRDF (1/sr)"] {
            assert!(svg.contains(word), "{word}");
        }
        assert!(svg.contains("#000000") && svg.contains("#fefefe"));
    }
}
