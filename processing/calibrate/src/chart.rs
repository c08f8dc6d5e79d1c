//! Charts of light over the turn of the analyser.

use crate::malus::Fit;
use crate::turn::Light;
use nacre_base::Result;
use nacre_plot::style::{INK, SOFT};
use nacre_plot::svg::{Anchor, Area, Axes, Ruler, Svg, fill};
use nacre_plot::{Scale, png_from_svg};

/// Size of the chart, and of its panels: margins left, top, right.
const SIZE: [f64; 2] = [760.0, 560.0];
const LEFT: f64 = 84.0;
const TOP: f64 = 64.0;
const WIDTH: f64 = 650.0;
const HEIGHTS: [f64; 2] = [270.0, 130.0];
const GAP: f64 = 26.0;

/// Colours of the series.
const COLORS: [&str; 2] = ["#0b6bb5", "#c65b00"];

/// Enlargement of the picture.
const ZOOM: f32 = 2.0;

/// Number of points of a drawn curve.
const POINTS: usize = 361;

/// A series and its fit.
pub struct Curve<'a> {
    /// Name in the legend.
    pub label: &'a str,
    /// Measurements.
    pub lights: &'a [Light],
    /// Malus' law.
    pub fit: &'a Fit,
}

/// Chart of measurements, fitted law and residuals (PNG).
///
/// # Errors
/// `Output` if it cannot be drawn.
pub fn turn_chart(title: &str, curves: &[Curve]) -> Result<Vec<u8>> {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    svg.text([LEFT, 30.0], title, 18.0, Anchor::Start, "font-weight=\"bold\"");
    let angles = || curves.iter().flat_map(|c| c.lights.iter().map(|l| l.stage_deg));
    let relative = |c: &Curve, light: f64| light / c.fit.parameters[0];
    let x = || Ruler::covering(Scale::Linear, angles(), LEFT, LEFT + WIDTH);
    let lower = TOP + HEIGHTS[0] + GAP;
    let areas = [Area::new(LEFT, TOP, WIDTH, HEIGHTS[0]), Area::new(LEFT, lower, WIDTH, HEIGHTS[1])];
    let light = Axes {
        area: areas[0],
        x: x(),
        y: Ruler::covering(Scale::Linear, [0.0, 2.0], TOP + HEIGHTS[0], TOP),
        names: &[],
        x_title: "",
        y_title: "light / mean",
        percent: false,
    };
    let residuals = || curves.iter().flat_map(|c| c.fit.residuals.iter().map(|r| 100.0 * r));
    let residual = Axes {
        area: areas[1],
        x: x(),
        y: Ruler::covering(Scale::Linear, residuals(), lower + HEIGHTS[1], lower),
        names: &[],
        x_title: "angle of the stage in degrees",
        y_title: "residual in %",
        percent: false,
    };
    light.draw(&mut svg);
    residual.draw(&mut svg);
    for (k, curve) in curves.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let ends = angles().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        let at = |i: usize| ends[0] + (ends[1] - ends[0]) * i as f64 / (POINTS - 1) as f64;
        let law = (0..POINTS).map(|i| [light.x.at(at(i)), light.y.at(relative(curve, curve.fit.light(at(i))))]);
        svg.polyline(&law.collect::<Vec<_>>(), &format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\""));
        for (measured, left) in curve.lights.iter().zip(&curve.fit.residuals) {
            let at = light.x.at(measured.stage_deg);
            svg.mark([at, light.y.at(relative(curve, measured.light))], k, 4.0, &fill(color));
            svg.mark([at, residual.y.at(100.0 * left)], k, 4.0, &fill(color));
        }
        let at = LEFT + 170.0 * k as f64;
        svg.mark([at + 6.0, 49.0], k, 4.5, &fill(color));
        svg.text([at + 16.0, 53.5], curve.label, 13.0, Anchor::Start, &fill(INK));
    }
    let zero = residual.y.at(0.0);
    svg.line([LEFT, zero], [LEFT + WIDTH, zero], &format!("stroke=\"{SOFT}\" stroke-width=\"1\""));
    png_from_svg(&svg.finish(title), ZOOM)
}
