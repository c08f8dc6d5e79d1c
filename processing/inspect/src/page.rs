//! HTML pages of an inspection, each a self-contained file.

use crate::content::{Block, blocks, origin, title};
use crate::defect::Class;
use crate::pictures::{Marked, Shown, marks};
use crate::report::{Report, SheetReport, Verdict};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use nacre_base::calendar::minutes;
use nacre_plot::svg::escape;
use std::fmt::Write;

/// Style sheet for light and dark.
const STYLE: &str = include_str!("page.css");

/// Page of one sheet.
pub fn sheet_page(report: &Report, sheet: &SheetReport, pictures: &[Shown]) -> String {
    let mut body = format!("<header><h1>{}</h1>{}</header>\n", escape(&sheet.sample.name), badge(sheet.verdict));
    for block in blocks(report, sheet) {
        match block {
            Block::Pictures => body.push_str(&figures(pictures, &marks(sheet))),
            other => body.push_str(&html(&other)),
        }
    }
    page(&title(sheet), &body)
}

/// Summary of a folder of sheets.
pub fn batch_page(report: &Report) -> String {
    let accepted = report.sheets.len() - report.rejected;
    let mut body = format!("<header><h1>Inspection of {} sheets</h1></header>\n", report.sheets.len());
    _ = writeln!(
        body,
        "<p>{accepted} accepted, {} rejected; compared with {} on {}.</p>",
        report.rejected,
        escape(&report.reference.name),
        minutes(report.inspected_s as i64)
    );
    body.push_str("<div class=\"wide\"><table><thead><tr><th>Sheet</th><th>Verdict</th>");
    Class::ALL.iter().for_each(|class| _ = write!(body, "<th>{}</th>", class.label()));
    body.push_str("<th>Largest deviation, σ</th><th>Limits exceeded</th></tr></thead><tbody>");
    for sheet in &report.sheets {
        let name = escape(&sheet.sample.name);
        _ = write!(body, "<tr><td><a href=\"{name}/report.html\">{name}</a></td><td>{}</td>", badge(sheet.verdict));
        Class::ALL.iter().for_each(|class| _ = write!(body, "<td>{}</td>", sheet.count(*class)));
        let exceeded = escape(&sheet.exceeded.join("; "));
        _ = write!(body, "<td>{:.1}</td><td>{exceeded}</td></tr>", sheet.largest_deviation);
    }
    body.push_str("</tbody></table></div>\n");
    origin("Reference", &report.reference).iter().for_each(|block| body.push_str(&html(block)));
    page("Inspection", &body)
}

fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{}</title><style>{STYLE}</style></head>\n<body><main>\n{body}</main></body>\n</html>\n",
        escape(title)
    )
}

fn badge(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Accept => "<span class=\"badge accept\">accept</span>",
        Verdict::Reject => "<span class=\"badge reject\">reject</span>",
    }
}

fn html(block: &Block) -> String {
    match block {
        Block::Heading(text) => format!("<h2>{}</h2>\n", escape(text)),
        Block::Subheading(text) => format!("<h3>{}</h3>\n", escape(text)),
        Block::Text(text) => format!("<p>{}</p>\n", escape(text)),
        Block::Warning(text) => format!("<p class=\"warning\">{}</p>\n", escape(text)),
        Block::List(points) => {
            format!("<ul>{}</ul>\n", points.iter().map(|p| format!("<li>{}</li>", escape(p))).collect::<String>())
        }
        Block::Table { head, rows } => {
            let row = |tag: &str, cells: &[String]| {
                let cells: String = cells.iter().map(|c| format!("<{tag}>{}</{tag}>", escape(c))).collect();
                format!("<tr>{cells}</tr>")
            };
            let body: String = rows.iter().map(|cells| row("td", cells)).collect();
            format!(
                "<div class=\"wide\"><table><thead>{}</thead><tbody>{body}</tbody></table></div>\n",
                row("th", head)
            )
        }
        Block::Files(files) => {
            let row = |s: &crate::Signature| {
                format!("<tr><td>{}</td><td><code>{}</code></td></tr>", escape(&s.file), s.sha256)
            };
            let rows: String = files.iter().map(row).collect();
            let head = "<thead><tr><th>File</th><th>SHA-256</th></tr></thead>";
            format!("<table class=\"files\">{head}<tbody>{rows}</tbody></table>\n")
        }
        Block::Pictures => String::new(),
    }
}

/// Pictures as data URIs, with a numbered box around each defect.
fn figures(pictures: &[Shown], marks: &[Marked]) -> String {
    let figure = |shown: &Shown| {
        // Boxes are drawn in thousandths of the longest side, so that lines and numbers look alike in all pictures.
        let unit = 1000.0 / shown.width.max(shown.height) as f64;
        let [w, h] = [shown.width, shown.height].map(|n| n as f64 * unit);
        let boxes: String = marks.iter().map(|m| boxed(m, [w, h])).collect();
        let uri = format!("data:image/png;base64,{}", BASE64_STANDARD.encode(shown.png()));
        format!(
            "<figure><svg viewBox=\"0 0 {w:.1} {h:.1}\" role=\"img\" aria-label=\"{}\">\
             <image href=\"{uri}\" width=\"{w:.1}\" height=\"{h:.1}\"/>{boxes}</svg>\
             <figcaption><b>{}</b><br>{}</figcaption></figure>",
            shown.title, shown.title, shown.text
        )
    };
    format!("<div class=\"pictures\">{}</div>\n", pictures.iter().map(figure).collect::<String>())
}

fn boxed(mark: &Marked, size: [f64; 2]) -> String {
    let [x, y] = [0, 1].map(|k| mark.corner[k] * size[k]);
    let [w, h] = [0, 1].map(|k| mark.size[k] * size[k]);
    // The number stands above the box, or below where the picture ends.
    let base = if y > 34.0 { y - 6.0 } else { y + h + 28.0 };
    format!(
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\"/><text x=\"{x:.1}\" y=\"{base:.1}\">{}</text>",
        mark.number
    )
}
