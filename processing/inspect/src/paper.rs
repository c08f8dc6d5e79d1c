//! Pages of a PDF that are filled from top to bottom.

use crate::font::{Font, encoded};
use crate::pictures::Shown;
use nacre_base::Result;
use nacre_plot::packed;
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

/// Size of a page (A4) in points.
const PAGE: [f32; 2] = [595.0, 842.0];

/// Left margin.
pub const LEFT: f32 = 46.0;

/// Width between the margins.
pub const WIDTH: f32 = PAGE[0] - 2.0 * LEFT;

/// Distance of the first and the last line from the edges.
const HEAD: f32 = 40.0;
const FOOT: f32 = 56.0;

/// Red, green and blue from 0 to 1.
pub type Color = [f32; 3];

/// Colour of text.
pub const INK: Color = [0.11, 0.11, 0.13];

/// Numbers of the fixed objects of the file; fonts, pictures and pages follow.
const CATALOG: Ref = Ref::new(1);
const PAGES: Ref = Ref::new(2);
const ABOUT: Ref = Ref::new(3);
const FONTS: i32 = 4;
const PICTURES: i32 = FONTS + Font::ALL.len() as i32;

/// Pages of a report.
pub struct Paper<'a> {
    /// Pages that are full.
    full: Vec<Content>,
    page: Content,
    /// Height of the next line above the lower edge.
    top: f32,
    pictures: &'a [Shown],
}

impl<'a> Paper<'a> {
    /// Empty paper for text and these pictures.
    pub fn new(pictures: &'a [Shown]) -> Self {
        Self { full: vec![], page: Content::new(), top: PAGE[1] - HEAD, pictures }
    }

    /// Height of the next line above the lower edge.
    pub fn top(&self) -> f32 {
        self.top
    }

    /// Continues at this height.
    pub fn go_to(&mut self, top: f32) {
        self.top = top;
    }

    /// Leaves some height empty.
    pub fn space(&mut self, height: f32) {
        self.top -= height;
    }

    /// Begins a page unless this height is left; answers whether it did.
    pub fn keep(&mut self, height: f32) -> bool {
        let full = self.top - height < FOOT;
        if full {
            self.full.push(std::mem::replace(&mut self.page, Content::new()));
            self.top = PAGE[1] - HEAD;
        }
        full
    }

    /// Writes text with the left end of its base line at a point.
    pub fn text(&mut self, text: &str, font: Font, size: f32, color: Color, at: [f32; 2]) {
        write_text(&mut self.page, &encoded(text), font, size, color, at);
    }

    /// Writes a paragraph, broken at spaces.
    pub fn paragraph(&mut self, text: &str, font: Font, size: f32, color: Color, indent: f32) {
        self.block(text, font, size, color, [LEFT + indent, WIDTH - indent]);
        self.space(2.0);
    }

    /// Writes text, broken at spaces, from a left end within a width.
    pub fn block(&mut self, text: &str, font: Font, size: f32, color: Color, [left, width]: [f32; 2]) {
        for line in broken(&encoded(text), font, size, width) {
            self.keep(1.35 * size);
            self.space(1.35 * size);
            let at = [left, self.top + 0.3 * size];
            write_text(&mut self.page, &line, font, size, color, at);
        }
    }

    /// Draws a rectangle, given by left, top, width and height, filled, as an outline, or both.
    pub fn rectangle(&mut self, [left, top, width, height]: [f32; 4], fill: Option<Color>, line: Option<Color>) {
        let page = &mut self.page;
        if let Some([r, g, b]) = fill {
            page.set_fill_rgb(r, g, b).rect(left, top - height, width, height).fill_nonzero();
        }
        if let Some([r, g, b]) = line {
            page.set_stroke_rgb(r, g, b).set_line_width(1.0).rect(left, top - height, width, height).stroke();
        }
    }

    /// Draws a picture by its index.
    pub fn picture(&mut self, index: usize, [left, top, width, height]: [f32; 4]) {
        let page = &mut self.page;
        page.save_state().transform([width, 0.0, 0.0, height, left, top - height]);
        page.x_object(Name(picture_key(index).as_bytes())).restore_state();
    }

    /// The file, with title and page numbers at the foot of each page.
    ///
    /// # Errors
    /// `Output` if the compression fails.
    pub fn finish(mut self, title: &str) -> Result<Vec<u8>> {
        let mut pdf = Pdf::new();
        self.full.push(self.page);
        let count = self.full.len();
        let first_page = PICTURES + self.pictures.len() as i32;
        let page_ref = |k: usize| Ref::new(first_page + 2 * k as i32);
        pdf.catalog(CATALOG).pages(PAGES);
        pdf.document_info(ABOUT).title(TextStr(title)).creator(TextStr("Nacre"));
        pdf.pages(PAGES).kids((0..count).map(page_ref)).count(count as i32);
        for (k, font) in Font::ALL.into_iter().enumerate() {
            let mut object = pdf.type1_font(Ref::new(FONTS + k as i32));
            object.base_font(Name(font.base())).encoding_predefined(Name(b"WinAnsiEncoding"));
        }
        for (k, picture) in self.pictures.iter().enumerate() {
            let packed = packed(&picture.rgb)?;
            let mut object = pdf.image_xobject(Ref::new(PICTURES + k as i32), &packed);
            object.filter(Filter::FlateDecode);
            object.width(picture.width as i32).height(picture.height as i32);
            object.bits_per_component(8).color_space().device_rgb();
        }
        for (k, mut content) in self.full.into_iter().enumerate() {
            footer(&mut content, title, [k + 1, count]);
            let content_ref = Ref::new(page_ref(k).get() + 1);
            let mut page = pdf.page(page_ref(k));
            page.parent(PAGES).media_box(Rect::new(0.0, 0.0, PAGE[0], PAGE[1])).contents(content_ref);
            let mut resources = page.resources();
            let mut fonts = resources.fonts();
            for (k, font) in Font::ALL.into_iter().enumerate() {
                fonts.pair(Name(font.key()), Ref::new(FONTS + k as i32));
            }
            fonts.finish();
            let mut objects = resources.x_objects();
            for k in 0..self.pictures.len() {
                objects.pair(Name(picture_key(k).as_bytes()), Ref::new(PICTURES + k as i32));
            }
            objects.finish();
            resources.finish();
            page.finish();
            pdf.stream(content_ref, &packed(&content.finish())?).filter(Filter::FlateDecode);
        }
        Ok(pdf.finish())
    }
}

fn picture_key(index: usize) -> String {
    format!("P{index}")
}

fn footer(page: &mut Content, title: &str, [number, count]: [usize; 2]) {
    const SIZE: f32 = 8.0;
    const COLOR: Color = [0.36, 0.38, 0.41];
    write_text(page, &encoded(title), Font::Plain, SIZE, COLOR, [LEFT, 30.0]);
    let numbers = encoded(&format!("page {number} of {count}"));
    let right = LEFT + WIDTH - Font::Plain.width(&numbers, SIZE);
    write_text(page, &numbers, Font::Plain, SIZE, COLOR, [right, 30.0]);
}

fn write_text(page: &mut Content, text: &[u8], font: Font, size: f32, [r, g, b]: Color, [x, y]: [f32; 2]) {
    page.begin_text().set_fill_rgb(r, g, b).set_font(Name(font.key()), size);
    page.next_line(x, y).show(Str(text)).end_text();
}

/// Breaks text at spaces into lines of a width, and words that are longer anywhere.
fn broken(text: &[u8], font: Font, size: f32, width: f32) -> Vec<Vec<u8>> {
    let mut lines = vec![vec![]];
    for word in text.split(|c| *c == b' ').filter(|w| !w.is_empty()) {
        let line: Vec<u8> = lines.pop().unwrap_or_default();
        let joined = if line.is_empty() { word.to_vec() } else { [line.as_slice(), b" ", word].concat() };
        if font.width(&joined, size) <= width {
            lines.push(joined);
            continue;
        }
        if !line.is_empty() {
            lines.push(line);
        }
        let mut rest = word;
        while font.width(rest, size) > width && rest.len() > 1 {
            let fits = (1..rest.len()).rev().find(|n| font.width(&rest[..*n], size) <= width).unwrap_or(1);
            lines.push(rest[..fits].to_vec());
            rest = &rest[fits..];
        }
        lines.push(rest.to_vec());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_breaks_at_spaces_and_long_words_anywhere() {
        let lines = broken(b"aaa bbb  cccccccc d", Font::Code, 10.0, 42.0);
        assert_eq!(lines, [&b"aaa bbb"[..], b"ccccccc", b"c d"]);
        assert_eq!(broken(b"", Font::Plain, 10.0, 42.0), [b""]);
    }
}
