//! Error against the stress, and below it the fractions of masked and of confidently wrong pixels.

use super::style::{WRONG, color, label, shape};
use super::{Point, Scale, Summary};
use nacre_plot::spread_out;
use nacre_plot::style::ALARM;
use nacre_plot::svg::{Anchor, Area, Axes, Ruler, Svg, fill};

/// Height of one strip of fractions, and the gap above it.
const STRIP: f64 = 58.0;
const GAP: f64 = 26.0;

/// Draws the settings that are marked for the sweep.
pub(super) fn draw(svg: &mut Svg, area: Area, summary: &Summary) {
    let shown: Vec<usize> = (0..summary.settings.len()).filter(|s| summary.settings[*s].in_sweep).collect();
    let label_room = if shown.len() > 1 { 8.0 + longest(summary, &shown) } else { 0.0 };
    let width = area.w - label_room;
    let stress = summary.scenes.iter().map(|s| s.value);
    let x = Ruler::covering(summary.stress.scale, stress, area.x, area.x + width);
    let names: Vec<String> = summary.scenes.iter().map(|s| s.label.clone()).collect();
    let main = Area::new(area.x, area.y, width, area.h - 2.0 * (STRIP + GAP));
    error(svg, main, x, &names, summary, &shown);
    let share = |value: fn(&Point) -> f64, y: f64, title: &str, color: &str, below: &str, svg: &mut Svg| {
        let strip = Area::new(area.x, y, width, STRIP);
        let highest = shown.iter().flat_map(|s| of(summary, *s)).map(value).fold(0.0, f64::max);
        let top = [0.01, 0.05, 0.2, 0.5, 1.0].into_iter().find(|t| highest <= *t).unwrap_or(1.0);
        let y = Ruler::exact(0.0, top, strip.y + strip.h, strip.y);
        Axes { area: strip, x, y, names: &names, x_title: below, y_title: "", percent: true }.draw(svg);
        svg.text([strip.x, strip.y - 6.0], title, 12.5, Anchor::Start, &fill(color));
        shares(svg, x, y, summary, &shown, value);
    };
    let second = main.y + main.h + GAP;
    share(|p| p.masked, second, "share masked", "#1c2430", "", svg);
    let title = summary.stress.title();
    share(|p| p.wrong, second + STRIP + GAP, "share confidently wrong (over 5σ)", ALARM, &title, svg);
}

fn of(summary: &Summary, setting: usize) -> Vec<&Point> {
    let mut points: Vec<&Point> = summary.points.iter().filter(|p| p.setting == setting).collect();
    points.sort_by(|a, b| summary.scenes[a.scene].value.total_cmp(&summary.scenes[b.scene].value));
    points
}

fn longest(summary: &Summary, shown: &[usize]) -> f64 {
    shown.iter().map(|s| nacre_plot::svg::text_width(&label(summary, *s), 12.5)).fold(0.0, f64::max)
}

fn error(svg: &mut Svg, area: Area, x: Ruler, names: &[String], summary: &Summary, shown: &[usize]) {
    let values = shown.iter().flat_map(|s| of(summary, *s)).flat_map(|p| {
        let e = p.error.map_or([f64::NAN; 2], |e| [e.q1, e.q3]);
        [e[0], e[1], p.predicted.unwrap_or(f64::NAN)]
    });
    let y = Ruler::covering(summary.error.scale, values, area.y + area.h, area.y);
    Axes { area, x, y, names, x_title: "", y_title: &summary.error.title(), percent: false }.draw(svg);
    let mut ends = vec![];
    for &setting in shown {
        let ink = color(summary, setting);
        let points = of(summary, setting);
        let at = |p: &Point| x.at(summary.scenes[p.scene].value);
        let expected: Vec<[f64; 2]> = points.iter().filter_map(|p| Some([at(p), y.at(p.predicted?)])).collect();
        svg.polyline(
            &expected,
            &format!("fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.3\" stroke-dasharray=\"5 4\""),
        );
        for run in points.split(|p| p.error.is_none()) {
            curve(svg, run, &at, y, &ink, summary.stress.scale == Scale::Names);
        }
        for p in &points {
            let Some(e) = p.error else { continue };
            let place = [at(p), y.at(e.median)];
            svg.mark(
                place,
                shape(summary, setting),
                4.0,
                &format!("{} stroke=\"#ffffff\" stroke-width=\"0.7\"", fill(&ink)),
            );
            if p.wrong > WRONG {
                svg.circle(place, 6.8, &format!("fill=\"none\" stroke=\"{ALARM}\" stroke-width=\"1.8\""));
            }
        }
        let last = points.iter().rev().find_map(|p| Some([at(p), y.at(p.error?.median)]));
        ends.extend(last.map(|end| (setting, end)));
    }
    if shown.len() > 1 {
        let wanted: Vec<f64> = ends.iter().map(|(_, end)| end[1]).collect();
        for ((setting, end), place) in ends.iter().zip(spread_out(&wanted, 15.0, area.y + 6.0, area.y + area.h - 4.0)) {
            let ink = color(summary, *setting);
            let from = area.x + area.w;
            svg.line([end[0] + 6.0, end[1]], [from + 5.0, place], &format!("stroke=\"{ink}\" stroke-width=\"0.8\""));
            svg.text([from + 8.0, place + 4.4], &label(summary, *setting), 12.5, Anchor::Start, &fill(&ink));
        }
    }
}

/// Draws joined medians and shaded quartiles; named scenes are joined by a faint line only.
fn curve(svg: &mut Svg, run: &[&Point], at: &impl Fn(&Point) -> f64, y: Ruler, ink: &str, faint: bool) {
    let side = |pick: fn(&super::Quartiles) -> f64| -> Vec<[f64; 2]> {
        run.iter().filter_map(|p| Some([at(p), y.at(pick(&p.error?))])).collect()
    };
    let mut band = side(|e| e.q1);
    band.extend(side(|e| e.q3).into_iter().rev());
    if run.len() > 1 && !faint {
        svg.polyline(&band, &format!("fill=\"{ink}\" fill-opacity=\"0.16\" stroke=\"none\""));
    }
    let strength = if faint { 0.25 } else { 1.0 };
    let style = format!("fill=\"none\" stroke=\"{ink}\" stroke-width=\"2\" stroke-opacity=\"{strength}\"");
    svg.polyline(&side(|e| e.median), &style);
}

fn shares(svg: &mut Svg, x: Ruler, y: Ruler, summary: &Summary, shown: &[usize], value: fn(&Point) -> f64) {
    for &setting in shown {
        let ink = color(summary, setting);
        let points = of(summary, setting);
        let line: Vec<[f64; 2]> =
            points.iter().map(|p| [x.at(summary.scenes[p.scene].value), y.at(value(p))]).collect();
        svg.polyline(&line, &format!("fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.6\""));
        for place in line {
            svg.mark(place, shape(summary, setting), 2.6, &fill(&ink));
        }
    }
}
