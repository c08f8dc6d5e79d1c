//! Picture of a study: time against error, and error against difficulty.

use nacre_plot::style::{ALARM, INK, SOFT, number};

use super::style::{WRONG, method_color, methods, shape};
use super::{ChartFormat, Scale, Summary, Width, sweep, trade};
use nacre_plot::svg::{Anchor, Area, Svg, bold_width, fill, text_width};

/// Heights of a panel, of the figure title, and of a panel title.
const PANEL: f64 = 440.0;
const TITLE: f64 = 52.0;
const PANEL_TITLE: f64 = 44.0;

/// Width of the figure, and left margin of a panel for ticks and axis title.
struct Form {
    width: f64,
    /// Panels side by side, or stacked.
    beside: bool,
    trade: f64,
    trade_width: f64,
}

impl Form {
    fn of(width: Width) -> Self {
        match width {
            Width::Page => Self { width: 1280.0, beside: true, trade: 92.0, trade_width: 440.0 },
            Width::Double => Self { width: 1060.0, beside: true, trade: 84.0, trade_width: 360.0 },
            Width::Single => Self { width: 520.0, beside: false, trade: 84.0, trade_width: 416.0 },
        }
    }
}

/// Draws the study as SVG.
pub(super) fn draw(summary: &Summary, format: ChartFormat) -> String {
    let form = Form::of(format.width);
    let names = summary.stress.scale == Scale::Names;
    let longest = summary.scenes.iter().map(|s| text_width(&s.label, 12.0)).fold(0.0, f64::max);
    let below = if names { 52.0 + 0.48 * longest } else { 58.0 };
    let head = if format.titles { PANEL_TITLE } else { 12.0 };
    let top = if format.titles { TITLE } else { 0.0 } + head;
    let left = Area::new(form.trade, top, form.trade_width, PANEL);
    let right = if form.beside {
        let x = form.trade + form.trade_width + 1.4 * form.trade;
        Area::new(x, top, form.width - x - 24.0, PANEL)
    } else {
        Area::new(form.trade, top + PANEL + 58.0 + head, form.width - form.trade - 16.0, PANEL)
    };
    let signs = signs(summary);
    let rows = rows(&signs, form.width);
    let first_row = right.y + PANEL + below + 28.0;
    let mut svg = Svg::new(form.width, first_row + 22.0 * rows.len() as f64);
    if format.titles {
        titles(&mut svg, [left, right], summary, names);
    }
    trade::draw(&mut svg, left, summary);
    sweep::draw(&mut svg, right, summary);
    for (k, row) in rows.into_iter().enumerate() {
        for (x, sign) in row {
            let at = [x, first_row + 22.0 * k as f64];
            (sign.draw)(&mut svg, [at[0] + 10.0, at[1] - 4.0]);
            svg.text([at[0] + 26.0, at[1]], &sign.text, 12.0, Anchor::Start, &fill(SOFT));
        }
    }
    match format.width.mm() {
        Some(mm) => svg.finish_for_print(&summary.title, mm),
        None => svg.finish(&summary.title),
    }
}

fn titles(svg: &mut Svg, [left, right]: [Area; 2], summary: &Summary, names: bool) {
    let fitting = |text: &str, size: f64, room: f64| size * (room / bold_width(text, size)).min(1.0);
    let size = fitting(&summary.title, 20.0, right.x + right.w - 28.0);
    svg.text([28.0, 34.0], &summary.title, size, Anchor::Start, "font-weight=\"bold\"");
    let scene = &summary.scenes[summary.reference];
    let value = if scene.label.is_empty() { number(scene.value) } else { scene.label.clone() };
    let unit = match summary.stress.unit.as_str() {
        "" => String::new(),
        "°" | "%" => summary.stress.unit.clone(),
        unit => format!(" {unit}"),
    };
    // The axis shows a cost where it counts photographs instead of time.
    let cost = if summary.time.unit.is_empty() { "Cost" } else { "Time" };
    let title = format!("{cost} against error, where {} = {value}{unit}", summary.stress.name);
    let title = if names { format!("{cost} against error, at “{value}”") } else { title };
    // Long titles use a smaller font, to stay within their panel.
    let size = fitting(&title, 14.5, left.w);
    svg.text([left.x, left.y - 14.0], &title, size, Anchor::Start, "font-weight=\"bold\"");
    svg.text([right.x, right.y - 14.0], "Error, and where it breaks", 14.5, Anchor::Start, "font-weight=\"bold\"");
}

/// Draws a mark at a position.
type Draw = dyn Fn(&mut Svg, [f64; 2]);

/// A legend entry: mark and text.
struct Sign {
    draw: Box<Draw>,
    text: String,
}

impl Sign {
    fn new(text: impl Into<String>, draw: impl Fn(&mut Svg, [f64; 2]) + 'static) -> Self {
        Self { draw: Box::new(draw), text: text.into() }
    }

    /// A horizontal line.
    fn line(text: impl Into<String>, style: String) -> Self {
        Self::new(text, move |svg, [x, y]| svg.line([x - 9.0, y], [x + 9.0, y], &style))
    }

    /// A ring.
    fn ring(text: impl Into<String>, radius: f64, color: &'static str) -> Self {
        let style = format!("fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\"");
        Self::new(text, move |svg, at| svg.circle(at, radius, &style))
    }
}

fn signs(summary: &Summary) -> Vec<Sign> {
    let mut signs = vec![];
    let all = methods(summary);
    if all.len() > 1 {
        for method in all {
            let first = summary.settings.iter().position(|s| s.method == method).unwrap_or(0);
            let (ink, form) = (method_color(summary, first), shape(summary, first));
            signs.push(Sign::new(method, move |svg, at| svg.mark(at, form, 5.0, &fill(&ink))));
        }
    }
    let runs = format!("median of {} runs, bars and bands: quartiles", summary.plan.runs);
    signs.push(Sign::line(runs, format!("stroke=\"{SOFT}\" stroke-width=\"2\"")));
    if summary.points.iter().any(|p| p.predicted.is_some()) {
        let dashed = format!("stroke=\"{SOFT}\" stroke-width=\"1.4\" stroke-dasharray=\"5 4\"");
        signs.push(Sign::line(&summary.predicted, dashed));
    }
    signs.push(Sign::new("front: nothing is faster and better", |svg, [x, y]| {
        let step = [[x - 9.0, y - 6.0], [x - 9.0, y], [x, y], [x, y + 5.0], [x + 9.0, y + 5.0]];
        svg.polyline(&step, "fill=\"none\" stroke=\"#7fa8c4\" stroke-width=\"2\"");
    }));
    if summary.settings.iter().any(|s| s.default) {
        signs.push(Sign::ring("default", 7.0, INK));
    }
    signs.push(Sign::ring(format!("over {} % wrong and confident", number(100.0 * WRONG)), 6.0, ALARM));
    signs
}

/// Distributes legend entries over rows of a given width; returns each with its x position.
fn rows(signs: &[Sign], width: f64) -> Vec<Vec<(f64, &Sign)>> {
    const START: f64 = 28.0;
    let (mut rows, mut x) = (vec![vec![]], START);
    for sign in signs {
        let wide = 26.0 + text_width(&sign.text, 12.0);
        if x > START && x + wide > width - 10.0 {
            rows.push(vec![]);
            x = START;
        }
        if let Some(row) = rows.last_mut() {
            row.push((x, sign));
        }
        x += wide + 18.0;
    }
    rows
}
