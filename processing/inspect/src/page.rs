//! HTML pages of an inspection, each a self-contained file.

use crate::defect::{Class, Defect};
use crate::inspection::Inspection;
use crate::pictures::pictures;
use crate::report::{Differs, Report, SheetReport, Verdict};
use crate::sheet::Origin;
use std::fmt::Write;

/// Style sheet for light and dark.
const STYLE: &str = include_str!("page.css");

/// Page of one sheet.
pub fn sheet_page(report: &Report, sheet: &SheetReport, found: &Inspection) -> String {
    let mut body = format!("<header><h1>{}</h1>{}</header>\n", escaped(&sheet.sample.name), badge(sheet.verdict));
    _ = writeln!(body, "<p>Compared with {} on {}.</p>", escaped(&report.reference.name), time(report.inspected_s));
    if !sheet.exceeded.is_empty() {
        body.push_str("<h2>Limits exceeded</h2>\n<ul>");
        sheet.exceeded.iter().for_each(|e| _ = write!(body, "<li>{}</li>", escaped(e)));
        body.push_str("</ul>\n");
    }
    body.push_str("<h2>Pictures</h2>\n<div class=\"pictures\">");
    for shown in pictures(found) {
        _ = write!(
            body,
            "<figure><img src=\"{}\" alt=\"{}\"><figcaption><b>{}</b><br>{}</figcaption></figure>",
            shown.uri, shown.title, shown.title, shown.text
        );
    }
    body.push_str("</div>\n<h2>Defects</h2>\n");
    body.push_str(&defects(&sheet.defects));
    body.push_str("<h2>Differences</h2>\n");
    body.push_str(&differences(report, sheet));
    body.push_str("<h2>Registration</h2>\n");
    body.push_str(&registration(sheet));
    body.push_str("<h2>Inputs</h2>\n");
    body.push_str(&origin("Reference", &report.reference));
    body.push_str(&origin("Sample", &sheet.sample));
    if let Some(sha256) = &report.limits_sha256 {
        _ = writeln!(body, "<p>Limits: SHA-256 <code>{sha256}</code></p>");
    }
    for warning in &sheet.warnings {
        _ = writeln!(body, "<p class=\"warning\">{}</p>", escaped(warning));
    }
    page(&format!("Inspection of {}", sheet.sample.name), &body)
}

/// Summary of a folder of sheets.
pub fn batch_page(report: &Report) -> String {
    let accepted = report.sheets.len() - report.rejected;
    let mut body = format!("<header><h1>Inspection of {} sheets</h1></header>\n", report.sheets.len());
    _ = writeln!(
        body,
        "<p>{accepted} accepted, {} rejected; compared with {} on {}.</p>",
        report.rejected,
        escaped(&report.reference.name),
        time(report.inspected_s)
    );
    body.push_str("<div class=\"wide\"><table><thead><tr><th>Sheet</th><th>Verdict</th>");
    Class::ALL.iter().for_each(|class| _ = write!(body, "<th>{}</th>", class.label()));
    body.push_str("<th>Largest deviation, σ</th><th>Limits exceeded</th></tr></thead><tbody>");
    for sheet in &report.sheets {
        let name = escaped(&sheet.sample.name);
        _ = write!(body, "<tr><td><a href=\"{name}/report.html\">{name}</a></td><td>{}</td>", badge(sheet.verdict));
        Class::ALL.iter().for_each(|class| _ = write!(body, "<td>{}</td>", sheet.count(*class)));
        let exceeded = escaped(&sheet.exceeded.join("; "));
        _ = write!(body, "<td>{:.1}</td><td>{exceeded}</td></tr>", sheet.largest_deviation);
    }
    body.push_str("</tbody></table></div>\n");
    body.push_str(&origin("Reference", &report.reference));
    page("Inspection", &body)
}

fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{}</title><style>{STYLE}</style></head>\n<body><main>\n{body}</main></body>\n</html>\n",
        escaped(title)
    )
}

fn badge(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Accept => "<span class=\"badge accept\">accept</span>",
        Verdict::Reject => "<span class=\"badge reject\">reject</span>",
    }
}

fn defects(all: &[Defect]) -> String {
    if all.is_empty() {
        return "<p>None.</p>\n".into();
    }
    let mut text = String::from(
        "<div class=\"wide\"><table><thead><tr><th>Class</th><th>Column, row</th><th>Area</th><th>Length × width</th>\
         <th>Deviation, σ</th><th>Orientation</th><th>Polarization</th><th>Brightness</th><th>Period</th></tr></thead><tbody>",
    );
    let share = |value: Option<f64>| value.map_or("–".into(), |v| format!("{:.0} %", 100.0 * v));
    for defect in all {
        let area = match defect.area_mm2 {
            Some(mm2) => format!("{mm2:.3} mm²"),
            None => format!("{:.0} px", defect.area_px),
        };
        let size = match defect.size_mm {
            Some([length, width]) => format!("{length:.2} × {width:.2} mm"),
            None => format!("{:.1} × {:.1} px", defect.size_px[0], defect.size_px[1]),
        };
        let turned = defect.orientation_deg.map_or("–".into(), |d| format!("{d:+.1}°"));
        _ = write!(
            text,
            "<tr><td>{}</td><td>{:.0}, {:.0}</td><td>{area}</td><td>{size}</td><td>{:.1}</td><td>{turned}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            defect.class.label(),
            defect.at_px[0],
            defect.at_px[1],
            defect.deviation,
            share(Some(defect.polarization)),
            share(defect.brightness),
            share(defect.period)
        );
    }
    text + "</tbody></table></div>\n<p>Polarization, brightness and period are relative to the reference.</p>\n"
}

fn differences(report: &Report, sheet: &SheetReport) -> String {
    let (all, limits) = (&sheet.differences, &report.limits.sheet);
    let mut text = String::from(
        "<div class=\"wide\"><table><thead><tr><th>Quantity</th><th>Root mean square</th><th>σ of a pixel</th>\
         <th>Beyond 3 σ</th><th>Limit</th></tr></thead><tbody>",
    );
    let mut row = |name: &str, differs: Option<Differs>, limit: Option<f64>, unit: &str| {
        let limit = limit.map_or("–".into(), |l| format!("{l:.4}{unit}"));
        match differs {
            Some(d) => {
                _ = write!(
                    text,
                    "<tr><td>{name}</td><td>{:.4}{unit}</td><td>{:.4}{unit}</td><td>{:.3} %</td><td>{limit}</td></tr>",
                    d.rms,
                    d.sigma,
                    100.0 * d.beyond
                );
            }
            None => _ = write!(text, "<tr><td>{name}</td><td colspan=\"3\">not compared</td><td>{limit}</td></tr>"),
        }
    };
    row("Orientation", all.orientation_deg, limits.max_orientation_deg, "°");
    row("Presence (degree of polarization)", all.presence, limits.max_presence, "");
    row("Brightness (logarithm)", all.brightness, limits.max_brightness, "");
    row("Period (logarithm)", all.period, limits.max_period, "");
    text.push_str("</tbody></table></div>\n");
    let trained = match report.limits.samples {
        0 => String::new(),
        n => format!(" Limits from {n} good samples."),
    };
    _ = writeln!(
        text,
        "<p>Threshold of defects {:.2} σ and {} pixels, for {} false alarms per sheet.{trained}</p>",
        sheet.threshold, report.min_area_px, report.false_alarms
    );
    let counts =
        report.limits.defects.iter().filter_map(|(class, l)| Some(format!("{} {}", l.max_count?, class.label())));
    let counts: Vec<String> = counts.collect();
    text + &format!("<p>Accepted defects: {}.</p>\n", if counts.is_empty() { "any".into() } else { counts.join(", ") })
}

fn registration(sheet: &SheetReport) -> String {
    let r = &sheet.registration;
    let shift = match r.shift_mm {
        Some([x, y]) => format!("{x:.3} mm right, {y:.3} mm down"),
        None => format!("{:.2} px right, {:.2} px down", r.shift_px[0], r.shift_px[1]),
    };
    format!(
        "<p>{} · turned {:.3}° · shifted {shift} (σ {:.3} px) · scale {:.5} · {:.1} % of the reference seen · orientations off by {:.3}° ± {:.3}°</p>\n",
        r.kind,
        r.turn_deg,
        r.sigma_px,
        r.scale,
        100.0 * r.overlap,
        sheet.offset_deg,
        sheet.offset_sigma_deg
    )
}

fn origin(title: &str, origin: &Origin) -> String {
    let mut text = format!("<h3>{title}: {}</h3>\n", escaped(&origin.name));
    if let Some(captured) = origin.captured_s {
        _ = writeln!(text, "<p>Captured {}.</p>", time(captured));
    }
    if !origin.devices.is_empty() {
        let devices: Vec<String> = origin.devices.iter().map(|d| escaped(d)).collect();
        _ = writeln!(text, "<p>Devices: {}</p>", devices.join("; "));
    }
    text.push_str("<table class=\"files\"><tbody>");
    for file in &origin.files {
        _ = write!(text, "<tr><td>{}</td><td><code>{}</code></td></tr>", escaped(&file.file), file.sha256);
    }
    text + "</tbody></table>\n"
}

/// Date and time in UTC (civil calendar from days, Hinnant 2021).
fn time(unix_s: u64) -> String {
    let (days, second) = (unix_s / 86_400, unix_s % 86_400);
    let z = days + 719_468;
    let (era, day_of_era) = (z / 146_097, z % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year_of_era + 400 * era + u64::from(month <= 2);
    format!("{year}-{month:02}-{day:02} {:02}:{:02} UTC", second / 3600, second / 60 % 60)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_dates_in_utc() {
        assert_eq!(time(0), "1970-01-01 00:00 UTC");
        assert_eq!(time(951_827_696), "2000-02-29 12:34 UTC");
        assert_eq!(time(1_795_982_876), "2026-11-29 20:07 UTC");
    }

    #[test]
    fn names_cannot_break_the_page() {
        assert_eq!(escaped("<b>\"&"), "&lt;b&gt;&quot;&amp;");
    }
}
