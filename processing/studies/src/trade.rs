//! Time against error.

use super::style::{WRONG, color, method_color, methods, shape};
use super::{Point, Summary};
use nacre_plot::Labels;
use nacre_plot::style::{ALARM, INK, SOFT};
use nacre_plot::svg::{Anchor, Area, Axes, Ruler, Svg, fill};

/// Draws the settings on the reference scene: median, quartiles, Pareto front, and the default.
pub(super) fn draw(svg: &mut Svg, area: Area, summary: &Summary) {
    let points: Vec<&Point> =
        summary.points.iter().filter(|p| p.scene == summary.reference && p.error.is_some()).collect();
    let times = points.iter().flat_map(|p| [p.seconds.q1, p.seconds.q3]);
    let errors = points.iter().flat_map(|p| p.error.map_or([f64::NAN; 2], |e| [e.q1, e.q3]));
    // A single expected error makes no line and is drawn on the right.
    let lines = points.len() > methods(summary).len();
    let errors = errors.chain(points.iter().filter(|_| lines).filter_map(|p| p.predicted));
    let x = Ruler::covering_closely(times, area.x, area.x + area.w);
    let y = Ruler::covering(summary.error.scale, errors, area.y + area.h, area.y);
    let (x_title, y_title) = (summary.time.title(), summary.error.title());
    Axes { area, x, y, names: &[], x_title: &x_title, y_title: &y_title, percent: false }.draw(svg);
    let at = |p: &Point| [x.at(p.seconds.median), y.at(p.error.map_or(f64::NAN, |e| e.median))];

    let steps = front(svg, area, &points, at);
    for method in methods(summary) {
        let of = |p: &&&Point| summary.settings[p.setting].method == method;
        let line: Vec<[f64; 2]> = points.iter().filter(of).map(|p| at(p)).collect();
        let ink = points.iter().find(of).map_or(SOFT.into(), |p| tone(summary, p.setting));
        svg.polyline(&line, &format!("fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.2\" stroke-opacity=\"0.55\""));
        let expected: Vec<[f64; 2]> = points
            .iter()
            .filter(|_| lines)
            .filter(of)
            .filter_map(|p| Some([x.at(p.seconds.median), y.at(p.predicted?)]))
            .collect();
        svg.polyline(
            &expected,
            &format!("fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.4\" stroke-dasharray=\"5 4\""),
        );
    }
    for p in &points {
        marks(
            svg,
            summary,
            p,
            [x.at(p.seconds.q1), x.at(p.seconds.q3)],
            p.error.map(|e| [y.at(e.q1), y.at(e.q3)]),
            at(p),
        );
    }
    let places: Vec<[f64; 2]> = points.iter().map(|p| at(p)).collect();
    let mut labels = Labels::new(area, &places);
    steps.windows(2).for_each(|pair| labels.avoid(pair[0], pair[1]));
    for p in &points {
        labels.avoid([x.at(p.seconds.q1), at(p)[1]], [x.at(p.seconds.q3), at(p)[1]]);
    }
    // The default's label comes first, to get the best position.
    let mut order: Vec<&&Point> = points.iter().collect();
    order.sort_by_key(|p| !summary.settings[p.setting].default);
    for p in order {
        let setting = &summary.settings[p.setting];
        let text = if setting.default { format!("default: {}", setting.label) } else { setting.label.clone() };
        labels.place(svg, at(p), &text, 12.5, setting.default, &fill(INK));
    }
    if points.is_empty() {
        let middle = [area.x + area.w / 2.0, area.y + area.h / 2.0];
        svg.text(middle, "everything is masked in this scene", 13.0, Anchor::Middle, &fill(SOFT));
    }
}

/// Colour of the line that joins one method's settings; grey if each setting has another colour.
fn tone(summary: &Summary, setting: usize) -> String {
    if methods(summary).len() > 1 { method_color(summary, setting) } else { SOFT.into() }
}

/// Shades the dominated area above and right of the Pareto front. Returns the steps of the front.
fn front(svg: &mut Svg, area: Area, points: &[&Point], at: impl Fn(&Point) -> [f64; 2]) -> Vec<[f64; 2]> {
    let mut front: Vec<[f64; 2]> = points.iter().filter(|p| p.front).map(|p| at(p)).collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (Some(first), Some(last)) = (front.first().copied(), front.last().copied()) else { return vec![] };
    let mut steps = vec![[first[0], area.y]];
    for [x, y] in front {
        let before = steps.last().map_or(y, |p| p[1]);
        if steps.len() > 1 {
            steps.push([x, before]);
        }
        steps.push([x, y]);
    }
    steps.push([area.x + area.w, last[1]]);
    let mut beaten = steps.clone();
    beaten.push([area.x + area.w, area.y]);
    svg.polyline(&beaten, "fill=\"#0072b2\" fill-opacity=\"0.05\" stroke=\"none\"");
    svg.polyline(&steps, "fill=\"none\" stroke=\"#7fa8c4\" stroke-width=\"2\"");
    steps
}

fn marks(svg: &mut Svg, summary: &Summary, p: &Point, xs: [f64; 2], ys: Option<[f64; 2]>, at: [f64; 2]) {
    let ink = color(summary, p.setting);
    let thin = format!("stroke=\"{ink}\" stroke-width=\"1.3\"");
    svg.line([xs[0], at[1]], [xs[1], at[1]], &thin);
    if let Some([low, high]) = ys {
        svg.line([at[0], low], [at[0], high], &thin);
    }
    svg.mark(at, shape(summary, p.setting), 5.0, &format!("{} stroke=\"#ffffff\" stroke-width=\"0.8\"", fill(&ink)));
    if p.wrong > WRONG {
        svg.circle(at, 8.0, &format!("fill=\"none\" stroke=\"{ALARM}\" stroke-width=\"2\""));
    }
    if summary.settings[p.setting].default {
        svg.circle(at, 10.5, &format!("fill=\"none\" stroke=\"{INK}\" stroke-width=\"1.8\""));
    }
}
