//! Conversion of an SVG to a PDF of the same size. Text becomes outlines, so no font is embedded; pictures keep their
//! pixels. Supported are the elements of charts: paths of one colour, text, and PNG pictures.

use crate::png::tree;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use nacre_base::{Error, Result};
use pdf_writer::types::{LineCapStyle, LineJoinStyle};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref};
use resvg::tiny_skia::{PathSegment, Pixmap};
use resvg::usvg::{
    FillRule, Group, Image, ImageKind, LineCap, LineJoin, Node, Paint, PaintOrder, Path, Stroke, Transform,
};
use std::io::Write;

/// Points of a PDF per pixel of an SVG.
const POINTS: f32 = 0.75;

/// Numbers of the fixed objects of the file; pictures and opacities follow.
const CATALOG: i32 = 1;
const PAGES: i32 = 2;
const PAGE: i32 = 3;
const CONTENT: i32 = 4;
const OTHERS: i32 = 5;

/// Converts an SVG to a PDF of one page.
///
/// # Errors
/// If the SVG is not well-formed, has no extent, or has elements other than paths of one colour, text and PNG pictures.
pub fn pdf_from_svg(svg: &str) -> Result<Vec<u8>> {
    let tree = tree(svg)?;
    let [width, height] = [tree.size().width(), tree.size().height()].map(|v| v * POINTS);
    let mut page = Page { content: Content::new(), opacities: vec![], pictures: vec![] };
    // The y axis of a PDF points up.
    page.content.transform([POINTS, 0.0, 0.0, -POINTS, 0.0, height]);
    page.group(tree.root())?;
    page.written([width, height])
}

/// Drawing commands of a page.
struct Page {
    content: Content,
    /// Opacities of fills and strokes.
    opacities: Vec<f32>,
    /// Width, height and RGB values of each picture.
    pictures: Vec<(u32, u32, Vec<u8>)>,
}

fn unknown(what: &str) -> Error {
    Error::input("SVG", format!("holds {what}, which a PDF is not made of here"), "report this")
}

impl Page {
    fn group(&mut self, group: &Group) -> Result<()> {
        for node in group.children() {
            match node {
                Node::Group(inside) => self.group(inside)?,
                Node::Path(path) if path.is_visible() => self.path(path)?,
                Node::Path(_) => {}
                Node::Text(text) => self.group(text.flattened())?,
                Node::Image(image) => self.image(image)?,
            }
        }
        Ok(())
    }

    fn path(&mut self, path: &Path) -> Result<()> {
        match path.paint_order() {
            PaintOrder::FillAndStroke => self.fill(path).and_then(|()| self.stroke(path)),
            PaintOrder::StrokeAndFill => self.stroke(path).and_then(|()| self.fill(path)),
        }
    }

    fn fill(&mut self, path: &Path) -> Result<()> {
        // A straight line has no area, but viewers draw a filled one as a hairline.
        let Some(fill) = path.fill().filter(|_| path.data().len() > 2) else { return Ok(()) };
        let [r, g, b] = rgb(fill.paint())?;
        self.begin(path.abs_transform(), fill.opacity().get());
        self.content.set_fill_rgb(r, g, b);
        self.outline(path);
        match fill.rule() {
            FillRule::NonZero => self.content.fill_nonzero(),
            FillRule::EvenOdd => self.content.fill_even_odd(),
        };
        self.content.restore_state();
        Ok(())
    }

    fn stroke(&mut self, path: &Path) -> Result<()> {
        let Some(stroke) = path.stroke() else { return Ok(()) };
        let [r, g, b] = rgb(stroke.paint())?;
        self.begin(path.abs_transform(), stroke.opacity().get());
        self.content.set_stroke_rgb(r, g, b);
        self.pen(stroke);
        self.outline(path);
        self.content.stroke();
        self.content.restore_state();
        Ok(())
    }

    fn pen(&mut self, stroke: &Stroke) {
        self.content.set_line_width(stroke.width().get());
        self.content.set_line_cap(match stroke.linecap() {
            LineCap::Butt => LineCapStyle::ButtCap,
            LineCap::Round => LineCapStyle::RoundCap,
            LineCap::Square => LineCapStyle::ProjectingSquareCap,
        });
        self.content.set_line_join(match stroke.linejoin() {
            LineJoin::Miter | LineJoin::MiterClip => LineJoinStyle::MiterJoin,
            LineJoin::Round => LineJoinStyle::RoundJoin,
            LineJoin::Bevel => LineJoinStyle::BevelJoin,
        });
        if let Some(dashes) = stroke.dasharray() {
            self.content.set_dash_pattern(dashes.iter().copied(), stroke.dashoffset());
        }
    }

    /// Saves the graphics state, and sets a transform and an opacity.
    fn begin(&mut self, at: Transform, opacity: f32) {
        let known = self.opacities.iter().position(|o| *o == opacity).unwrap_or_else(|| {
            self.opacities.push(opacity);
            self.opacities.len() - 1
        });
        self.content.save_state();
        self.content.set_parameters(Name(format!("a{known}").as_bytes()));
        self.content.transform([at.sx, at.ky, at.kx, at.sy, at.tx, at.ty]);
    }

    fn outline(&mut self, path: &Path) {
        let mut last = [0.0; 2];
        for segment in path.data().segments() {
            match segment {
                PathSegment::MoveTo(p) => {
                    self.content.move_to(p.x, p.y);
                    last = [p.x, p.y];
                }
                PathSegment::LineTo(p) => {
                    self.content.line_to(p.x, p.y);
                    last = [p.x, p.y];
                }
                PathSegment::QuadTo(q, p) => {
                    // Degree elevation: the cubic Bézier curve that equals a quadratic one.
                    let near = |end: f32, middle: f32| end + 2.0 / 3.0 * (middle - end);
                    let [x, y] = last;
                    self.content.cubic_to(near(x, q.x), near(y, q.y), near(p.x, q.x), near(p.y, q.y), p.x, p.y);
                    last = [p.x, p.y];
                }
                PathSegment::CubicTo(a, b, p) => {
                    self.content.cubic_to(a.x, a.y, b.x, b.y, p.x, p.y);
                    last = [p.x, p.y];
                }
                PathSegment::Close => {
                    self.content.close_path();
                }
            }
        }
    }

    fn image(&mut self, image: &Image) -> Result<()> {
        let ImageKind::PNG(bytes) = image.kind() else { return Err(unknown("a picture that is no PNG")) };
        let pixels = Pixmap::decode_png(bytes).map_err(|_| unknown("a damaged picture"))?;
        let rgb = pixels.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect();
        self.begin(image.abs_transform(), 1.0);
        // An image fills the unit square, its first row on top.
        let [width, height] = [pixels.width(), pixels.height()];
        self.content.transform([width as f32, 0.0, 0.0, -(height as f32), 0.0, height as f32]);
        self.content.x_object(Name(format!("p{}", self.pictures.len()).as_bytes()));
        self.content.restore_state();
        self.pictures.push((width, height, rgb));
        Ok(())
    }

    fn written(self, [width, height]: [f32; 2]) -> Result<Vec<u8>> {
        let mut pdf = Pdf::new();
        let picture = |k: usize| Ref::new(OTHERS + k as i32);
        pdf.catalog(Ref::new(CATALOG)).pages(Ref::new(PAGES));
        pdf.pages(Ref::new(PAGES)).kids([Ref::new(PAGE)]).count(1);
        let mut page = pdf.page(Ref::new(PAGE));
        page.parent(Ref::new(PAGES)).media_box(Rect::new(0.0, 0.0, width, height)).contents(Ref::new(CONTENT));
        let mut resources = page.resources();
        let mut objects = resources.x_objects();
        for k in 0..self.pictures.len() {
            objects.pair(Name(format!("p{k}").as_bytes()), picture(k));
        }
        objects.finish();
        let mut states = resources.ext_g_states();
        for (k, opacity) in self.opacities.iter().enumerate() {
            let mut state = states.insert(Name(format!("a{k}").as_bytes())).dict();
            state.pair(Name(b"ca"), *opacity).pair(Name(b"CA"), *opacity);
        }
        states.finish();
        resources.finish();
        page.finish();
        pdf.stream(Ref::new(CONTENT), &packed(&self.content.finish())?).filter(Filter::FlateDecode);
        for (k, (width, height, rgb)) in self.pictures.iter().enumerate() {
            let packed = packed(rgb)?;
            let mut object = pdf.image_xobject(picture(k), &packed);
            object.filter(Filter::FlateDecode);
            object.width(*width as i32).height(*height as i32).bits_per_component(8).color_space().device_rgb();
        }
        Ok(pdf.finish())
    }
}

/// Red, green and blue from 0 to 1.
fn rgb(paint: &Paint) -> Result<[f32; 3]> {
    match paint {
        Paint::Color(color) => Ok([color.red, color.green, color.blue].map(|v| f32::from(v) / 255.0)),
        _ => Err(unknown("a gradient")),
    }
}

/// Bytes in the format of `Filter::FlateDecode`.
///
/// # Errors
/// None in practice: compression in memory cannot fail.
pub fn packed(bytes: &[u8]) -> Result<Vec<u8>> {
    let failed = |e: std::io::Error| Error::input("PDF", e.to_string(), "report this");
    let mut packer = ZlibEncoder::new(vec![], Compression::default());
    packer.write_all(bytes).map_err(failed)?;
    packer.finish().map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::svg::{Anchor, Area, Svg};

    /// The page has the size of the SVG in points and one object per element. Malformed SVG and gradients are refused.
    #[test]
    fn pages_are_as_large_as_their_svg() {
        let mut svg = Svg::new(200.0, 100.0);
        svg.rect(Area::new(10.0, 10.0, 50.0, 20.0), "fill=\"#ff0000\" fill-opacity=\"0.5\"");
        svg.text([20.0, 60.0], "Δn = 10°", 12.0, Anchor::Start, "");
        let pdf = pdf_from_svg(&svg.finish("a")).unwrap();
        assert!(pdf.starts_with(b"%PDF-1.") && pdf.ends_with(b"%%EOF"));
        let text = String::from_utf8_lossy(&pdf);
        assert!(text.contains("/MediaBox [0 0 150 75]") && text.contains("/ca 0.5"), "{text}");
        assert!(pdf_from_svg("<svg").is_err());
        let gradient = "<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'><defs><linearGradient id='g'><stop stop-color='red'/>\
                        <stop offset='1' stop-color='blue'/></linearGradient></defs><rect width='9' height='9' fill='url(#g)'/></svg>";
        assert!(pdf_from_svg(gradient).is_err());
    }
}
