//! The report of a sheet as a PDF with the content of its HTML page.

use crate::content::{Block, blocks, title};
use crate::font::{Font, encoded};
use crate::paper::{Color, INK, LEFT, Paper, WIDTH};
use crate::pictures::{Marked, Shown, marks};
use crate::report::{Report, SheetReport, Verdict};
use nacre_base::Result;

/// Colours of verdicts, boxes, secondary text and lines.
const GOOD: Color = [0.09, 0.41, 0.18];
const BAD: Color = [0.64, 0.13, 0.11];
const BOX: Color = [0.9, 0.16, 0.16];
const FAINT: Color = [0.36, 0.38, 0.41];
const LINE: Color = [0.82, 0.83, 0.85];

/// Sizes of text in points.
const TEXT: f32 = 9.5;
const SMALL: f32 = 8.0;

/// Largest and smallest size of the text of tables.
const CELL: f32 = 8.5;
const LEAST_CELL: f32 = 5.0;

/// Gap between columns of a table, and between pictures.
const GAP: f32 = 10.0;

/// Largest height of a picture.
const TALLEST: f32 = 200.0;

/// The report of a sheet.
///
/// # Errors
/// `Output` if a picture cannot be compressed.
pub fn sheet_pdf(report: &Report, sheet: &SheetReport, pictures: &[Shown]) -> Result<Vec<u8>> {
    let mut paper = Paper::new(pictures);
    paper.space(24.0);
    paper.paragraph(&sheet.sample.name, Font::Bold, 20.0, INK, 0.0);
    let (word, color) = match sheet.verdict {
        Verdict::Accept => ("Accept", GOOD),
        Verdict::Reject => ("Reject", BAD),
    };
    paper.space(8.0);
    paper.paragraph(word, Font::Bold, 16.0, color, 0.0);
    paper.space(4.0);
    for block in blocks(report, sheet) {
        match block {
            Block::Heading(text) => heading(&mut paper, &text),
            Block::Subheading(text) => {
                paper.keep(60.0);
                paper.space(8.0);
                paper.paragraph(&text, Font::Bold, 10.5, INK, 0.0);
            }
            Block::Text(text) => paper.paragraph(&text, Font::Plain, TEXT, INK, 0.0),
            Block::Warning(text) => paper.paragraph(&format!("Warning: {text}"), Font::Bold, TEXT, BAD, 0.0),
            Block::List(points) => {
                points.iter().for_each(|p| paper.paragraph(&format!("· {p}"), Font::Plain, TEXT, INK, 8.0));
            }
            Block::Pictures => figures(&mut paper, pictures, &marks(sheet)),
            Block::Table { head, rows } => table(&mut paper, &head, &rows),
            Block::Files(files) => {
                for file in files {
                    paper.keep(26.0);
                    paper.paragraph(&file.file, Font::Plain, SMALL, INK, 0.0);
                    paper.paragraph(&format!("SHA-256 {}", file.sha256), Font::Code, 7.5, FAINT, 8.0);
                }
            }
        }
    }
    paper.finish(&title(sheet))
}

fn heading(paper: &mut Paper, text: &str) {
    paper.keep(80.0);
    paper.space(14.0);
    paper.rectangle([LEFT, paper.top(), WIDTH, 0.5], Some(LINE), None);
    paper.space(6.0);
    paper.paragraph(text, Font::Bold, 13.0, INK, 0.0);
    paper.space(2.0);
}

/// Two pictures beside each other, with their boxes and captions.
fn figures(paper: &mut Paper, pictures: &[Shown], marks: &[Marked]) {
    let column = 0.5 * (WIDTH - GAP);
    for (row, pair) in pictures.chunks(2).enumerate() {
        let sizes = pair.iter().map(|p| {
            let scale = (column / p.width as f32).min(TALLEST / p.height as f32);
            [p.width as f32 * scale, p.height as f32 * scale]
        });
        let sizes: Vec<[f32; 2]> = sizes.collect();
        let tall = sizes.iter().map(|s| s[1]).fold(0.0, f32::max);
        paper.keep(tall + 52.0);
        paper.space(6.0);
        let top = paper.top();
        let mut end = top;
        for (k, (picture, size)) in pair.iter().zip(sizes).enumerate() {
            let left = LEFT + k as f32 * (column + GAP);
            paper.picture(2 * row + k, [left, top, size[0], size[1]]);
            marks.iter().for_each(|mark| boxed(paper, mark, [left, top], size));
            paper.go_to(top - tall - 3.0);
            paper.block(picture.title, Font::Bold, SMALL, INK, [left, column]);
            paper.block(&picture.text, Font::Plain, SMALL, FAINT, [left, column]);
            end = end.min(paper.top());
        }
        paper.go_to(end);
    }
}

fn boxed(paper: &mut Paper, mark: &Marked, [left, top]: [f32; 2], size: [f32; 2]) {
    let [x, y] = [0, 1].map(|k| mark.corner[k] as f32 * size[k]);
    let [w, h] = [0, 1].map(|k| mark.size[k] as f32 * size[k]);
    paper.rectangle([left + x, top - y, w, h], None, Some(BOX));
    let number = mark.number.to_string();
    let wide = Font::Bold.width(number.as_bytes(), 7.0) + 3.0;
    let base = if y > 9.0 { top - y } else { top - y - h - 8.5 };
    paper.rectangle([left + x, base + 8.5, wide, 8.5], Some(BOX), None);
    paper.text(&number, Font::Bold, 7.0, [1.0; 3], [left + x + 1.5, base + 2.0]);
}

/// A table; its text shrinks until all columns fit.
fn table(paper: &mut Paper, head: &[String], rows: &[Vec<String>]) {
    let widest = |k: usize, size: f32| {
        let cells = rows.iter().filter_map(|r| r.get(k)).map(|c| Font::Plain.width(&encoded(c), size));
        cells.fold(head.get(k).map_or(0.0, |c| Font::Bold.width(&encoded(c), size)), f32::max)
    };
    let natural: f32 = (0..head.len()).map(|k| widest(k, CELL)).sum();
    let room = WIDTH - GAP * (head.len() - 1) as f32;
    let size = (CELL * (room / natural).min(1.0)).max(LEAST_CELL);
    let columns: Vec<f32> = (0..head.len()).map(|k| widest(k, size) + GAP).collect();
    let high = 1.7 * size;
    let row = |paper: &mut Paper, cells: &[String], font: Font, color: Color| {
        let (mut left, base) = (LEFT, paper.top() - 1.2 * size);
        for (cell, width) in cells.iter().zip(&columns) {
            paper.text(cell, font, size, color, [left, base]);
            left += width;
        }
        paper.space(high);
        let wide = (columns.iter().sum::<f32>() - GAP).min(WIDTH);
        paper.rectangle([LEFT, paper.top(), wide, 0.4], Some(LINE), None);
    };
    paper.keep(4.0 * high);
    paper.space(4.0);
    row(paper, head, Font::Bold, FAINT);
    for cells in rows {
        // A table that continues on another page repeats its header.
        if paper.keep(high) {
            row(paper, head, Font::Bold, FAINT);
        }
        row(paper, cells, Font::Plain, INK);
    }
    paper.space(4.0);
}
