//! Rendering of an SVG as PNG with built-in fonts.

use nacre_base::{Error, Result};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

/// Renders an SVG at `zoom` pixels per unit as a PNG. Text is set in DejaVu Sans Condensed, regardless of the font that
/// the SVG names.
///
/// # Errors
/// If the SVG is not well-formed, or has no extent.
pub fn png_from_svg(svg: &str, zoom: f32) -> Result<Vec<u8>> {
    let tree = tree(svg)?;
    let side = |length: f32| (length * zoom).round() as u32;
    let (width, height) = (side(tree.size().width()), side(tree.size().height()));
    let mut pixels = Pixmap::new(width, height).ok_or_else(|| broken(format!("{width} × {height} pixels")))?;
    resvg::render(&tree, Transform::from_scale(zoom, zoom), &mut pixels.as_mut());
    pixels.encode_png().map_err(|e| broken(e.to_string()))
}

fn broken(problem: String) -> Error {
    Error::input("SVG", problem, "report this")
}

/// Parses an SVG with the built-in fonts.
pub(crate) fn tree(svg: &str) -> Result<Tree> {
    let mut options = Options { font_family: FAMILY.into(), ..Options::default() };
    let fonts = options.fontdb_mut();
    fonts.load_font_data(dejavu::sans_condensed::regular().to_vec());
    fonts.load_font_data(dejavu::sans_condensed::bold().to_vec());
    fonts.set_sans_serif_family(FAMILY);
    Tree::from_str(svg, &options).map_err(|e| broken(e.to_string()))
}

/// Name of the font family in the font files.
const FAMILY: &str = "DejaVu Sans";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_drawn_and_nonsense_refused() {
        let svg = |text: &str| {
            format!(
                "<svg xmlns='http://www.w3.org/2000/svg' width='40' height='20'><text x='2' y='15'>{text}</text></svg>"
            )
        };
        let drawn = |text: &str| {
            let png = png_from_svg(&svg(text), 2.0).unwrap();
            let image = image::load_from_memory(&png).unwrap().to_rgba8();
            assert_eq!(image.dimensions(), (80, 40));
            image.pixels().filter(|p| p.0[3] > 100).count()
        };
        assert!(drawn("Δn") > 50 && drawn("") == 0);
        assert!(png_from_svg("<svg", 1.0).is_err());
    }
}
