//! Several studies in one picture: small panels of error against stress.

use nacre_plot::style::{ALARM, SOFT};

use super::style::{WRONG, color, method_color, methods, shape};
use super::{Point, Summary};
use nacre_plot::svg::{Anchor, Area, Axes, Ruler, Svg, fill, text_width};

const COLUMNS: usize = 4;
const PANEL: [f64; 2] = [310.0, 250.0];

/// Small multiples of the settings' medians. Red rings mark confidently wrong points, hollow marks those with most
/// pixels masked.
pub(super) fn draw(title: &str, studies: &[&Summary]) -> String {
    let rows = studies.len().div_ceil(COLUMNS);
    let columns = studies.len().min(COLUMNS);
    let (width, height) = (24.0 + columns as f64 * PANEL[0], 84.0 + rows as f64 * PANEL[1]);
    let mut svg = Svg::new(width, height);
    svg.text([28.0, 34.0], title, 20.0, Anchor::Start, "font-weight=\"bold\"");
    legend(&mut svg, studies);
    for (i, study) in studies.iter().enumerate() {
        let corner = [(i % COLUMNS) as f64 * PANEL[0], 74.0 + (i / COLUMNS) as f64 * PANEL[1]];
        let area = Area::new(corner[0] + 84.0, corner[1] + 26.0, PANEL[0] - 96.0, PANEL[1] - 84.0);
        panel(&mut svg, area, study, i % COLUMNS == 0);
    }
    svg.finish(title)
}

fn legend(svg: &mut Svg, studies: &[&Summary]) {
    let mut x = 28.0;
    let mut seen: Vec<&str> = vec![];
    for study in studies {
        for method in methods(study) {
            let first = study.settings.iter().position(|s| s.method == method).unwrap_or(0);
            if seen.contains(&method) {
                continue;
            }
            seen.push(method);
            svg.mark([x + 6.0, 56.0], shape(study, first), 5.0, &fill(&method_color(study, first)));
            svg.text([x + 16.0, 60.0], method, 12.5, Anchor::Start, &fill(SOFT));
            x += 34.0 + text_width(method, 12.5);
        }
    }
    svg.circle([x + 6.0, 56.0], 6.0, &format!("fill=\"none\" stroke=\"{ALARM}\" stroke-width=\"1.8\""));
    let text = "over 1 % of the pixels wrong and confident;  hollow: most pixels masked;  dashed: what σ promises";
    svg.text([x + 18.0, 60.0], text, 12.5, Anchor::Start, &fill(SOFT));
}

/// Draws one panel; the first one in a row carries the title of the error axis.
fn panel(svg: &mut Svg, area: Area, summary: &Summary, first: bool) {
    let shown: Vec<usize> = (0..summary.settings.len()).filter(|s| summary.settings[*s].in_sweep).collect();
    let points: Vec<&Point> = summary.points.iter().filter(|p| shown.contains(&p.setting)).collect();
    let stress = |p: &Point| summary.scenes[p.scene].value;
    let x = Ruler::covering(summary.stress.scale, points.iter().map(|p| stress(p)), area.x, area.x + area.w);
    let values = points.iter().flat_map(|p| [p.error.map_or(f64::NAN, |e| e.median), p.predicted.unwrap_or(f64::NAN)]);
    let y = Ruler::covering(summary.error.scale, values, area.y + area.h, area.y);
    let x_title = summary.stress.title();
    let y_title = if first { summary.error.title() } else { String::new() };
    Axes { area, x, y, names: &[], x_title: &x_title, y_title: &y_title, percent: false }.draw(svg);
    svg.text([area.x, area.y - 8.0], &summary.title, 12.5, Anchor::Start, "font-weight=\"bold\"");
    for &setting in &shown {
        let ink = color(summary, setting);
        let mut of: Vec<&&Point> = points.iter().filter(|p| p.setting == setting).collect();
        of.sort_by(|a, b| stress(a).total_cmp(&stress(b)));
        let expected: Vec<[f64; 2]> = of.iter().filter_map(|p| Some([x.at(stress(p)), y.at(p.predicted?)])).collect();
        svg.polyline(&expected, &format!("fill=\"none\" stroke=\"{ink}\" stroke-dasharray=\"4 3\""));
        let line: Vec<[f64; 2]> = of.iter().filter_map(|p| Some([x.at(stress(p)), y.at(p.error?.median)])).collect();
        svg.polyline(&line, &format!("fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.8\""));
        for p in of {
            let Some(error) = p.error else { continue };
            let at = [x.at(stress(p)), y.at(error.median)];
            let inside = if p.masked > 0.5 { "#ffffff" } else { &ink };
            svg.mark(at, shape(summary, setting), 3.2, &format!("{} stroke=\"{ink}\"", fill(inside)));
            if p.wrong > WRONG {
                svg.circle(at, 5.4, &format!("fill=\"none\" stroke=\"{ALARM}\" stroke-width=\"1.5\""));
            }
        }
    }
}
