//! The picture of a study: time against error on the left, error against difficulty on the right.

use nacre_plot::style::{ALARM, INK, SOFT, number};

use super::style::{WRONG, color, methods, shape};
use super::{Scale, Summary, sweep, trade};
use nacre_plot::svg::{Anchor, Area, Svg, bold_width, fill, text_width};

const WIDTH: f64 = 1280.0;
const PANEL: f64 = 440.0;

/// The study as an SVG.
pub(super) fn draw(summary: &Summary) -> String {
    let names = summary.stress.scale == Scale::Names;
    let longest = summary.scenes.iter().map(|s| text_width(&s.label, 12.0)).fold(0.0, f64::max);
    let below = if names { 52.0 + 0.48 * longest } else { 58.0 };
    let height = 96.0 + PANEL + below + 68.0;
    let mut svg = Svg::new(WIDTH, height);
    svg.text([28.0, 34.0], &summary.title, 20.0, Anchor::Start, "font-weight=\"bold\"");
    let scene = &summary.scenes[summary.reference];
    let value = if scene.label.is_empty() { number(scene.value) } else { scene.label.clone() };
    let unit = match summary.stress.unit.as_str() {
        "" => String::new(),
        "°" | "%" => summary.stress.unit.clone(),
        unit => format!(" {unit}"),
    };
    let left = Area::new(92.0, 96.0, 440.0, PANEL);
    let right = Area::new(660.0, 96.0, WIDTH - 660.0 - 24.0, PANEL);
    let title = format!("Time against error, where {} = {value}{unit}", summary.stress.name);
    let title = if names { format!("Time against error, at “{value}”") } else { title };
    // Long ones are written smaller, so that they end with their panel.
    let size = 14.5 * (left.w / bold_width(&title, 14.5)).min(1.0);
    svg.text([left.x, 82.0], &title, size, Anchor::Start, "font-weight=\"bold\"");
    svg.text([right.x, 82.0], "Error, and where it breaks", 14.5, Anchor::Start, "font-weight=\"bold\"");
    trade::draw(&mut svg, left, summary);
    sweep::draw(&mut svg, right, summary);
    legend(&mut svg, height - 40.0, summary);
    svg.finish(&summary.title)
}

/// What the signs mean, in one or two rows.
fn legend(svg: &mut Svg, y: f64, summary: &Summary) {
    let (mut x, mut y) = (28.0, y);
    let mut entry = |svg: &mut Svg, sign: &dyn Fn(&mut Svg, [f64; 2]), text: &str| {
        if x + 26.0 + text_width(text, 12.0) > WIDTH - 10.0 {
            (x, y) = (28.0, y + 22.0);
        }
        sign(svg, [x + 10.0, y - 4.0]);
        svg.text([x + 26.0, y], text, 12.0, Anchor::Start, &fill(SOFT));
        x += 26.0 + text_width(text, 12.0) + 18.0;
    };
    let all = methods(summary);
    if all.len() > 1 {
        for method in all {
            let first = summary.settings.iter().position(|s| s.method == method).unwrap_or(0);
            let (ink, form) = (color(summary, first), shape(summary, first));
            entry(svg, &|svg, at| svg.mark(at, form, 5.0, &fill(ink)), method);
        }
    }
    let runs = format!("median of {} runs, bars and bands: quartiles", summary.plan.runs);
    entry(
        svg,
        &|svg, [x, y]| svg.line([x - 9.0, y], [x + 9.0, y], &format!("stroke=\"{SOFT}\" stroke-width=\"2\"")),
        &runs,
    );
    if summary.points.iter().any(|p| p.predicted.is_some()) {
        let dashed = format!("stroke=\"{SOFT}\" stroke-width=\"1.4\" stroke-dasharray=\"5 4\"");
        entry(svg, &|svg, [x, y]| svg.line([x - 9.0, y], [x + 9.0, y], &dashed), &summary.predicted);
    }
    entry(
        svg,
        &|svg, [x, y]| {
            let step = [[x - 9.0, y - 6.0], [x - 9.0, y], [x, y], [x, y + 5.0], [x + 9.0, y + 5.0]];
            svg.polyline(&step, "fill=\"none\" stroke=\"#7fa8c4\" stroke-width=\"2\"");
        },
        "front: nothing is faster and better",
    );
    if summary.settings.iter().any(|s| s.default) {
        entry(
            svg,
            &|svg, at| svg.circle(at, 7.0, &format!("fill=\"none\" stroke=\"{INK}\" stroke-width=\"1.8\"")),
            "default",
        );
    }
    let ring = format!("fill=\"none\" stroke=\"{ALARM}\" stroke-width=\"1.8\"");
    let text = format!("over {} of the pixels wrong and confident", format_args!("{} %", number(100.0 * WRONG)));
    entry(svg, &|svg, at| svg.circle(at, 6.0, &ring), &text);
}
