//! Figure of a map of directions: its colours, and its luminance on a logarithmic scale, with angles and a colour bar.

use super::brdf::Map;
use super::output::codes;
use super::settings::{Normalisation, Settings};
use nacre_base::{Error, Result};
use nacre_image::{encode_png8, viridis};
use nacre_plot::directions::{Directions, log_color_bar};
use nacre_plot::svg::{Anchor, Area, Svg};
use std::path::Path;

/// Largest side of the embedded pictures in pixels; larger maps are averaged.
const SIDE: usize = 1024;

/// Largest ratio of the limits of the colour bar.
const RANGE: f64 = 1e6;

/// Colour of directions below the surface.
const BELOW: [u8; 3] = [236, 238, 240];

/// Side and left edges of the two squares, in units of the page.
const SQUARE: f64 = 420.0;
const LEFT: [f64; 2] = [76.0, 586.0];
const TOP: f64 = 56.0;

/// SVG of a map for publications.
///
/// # Errors
/// `Input` if a picture cannot be encoded.
pub fn figure(map: &Map, settings: &Settings) -> Result<String> {
    let mut svg = Svg::new(1180.0, 548.0);
    let limits = limits(map);
    let [colors, shades] = [codes(map), luminance(map, limits)].map(|rgb| encoded(&rgb, map.size));
    let [theta, phi] = settings.light_deg;
    let title = format!(
        "Light from θ = {theta}°, φ = {phi}° ({}), coherence {} µm",
        settings.illuminant, settings.coherence_um
    );
    let light = [phi.to_radians().cos(), phi.to_radians().sin()].map(|v| theta.to_radians().sin() * v);
    let panels = [(colors?, "Colours, brightest parts compressed"), (shades?, "Luminance")];
    for ((png, name), left) in panels.iter().zip(LEFT) {
        let area = Area::new(left, TOP, SQUARE, SQUARE);
        svg.image(area, png);
        svg.text([left, TOP - 10.0], name, 14.0, Anchor::Start, "");
        let titles = ["sin θ cos φ", "sin θ sin φ"];
        let frame = Directions { area, center: map.views.center, half: map.views.half, titles, rings: true };
        frame.draw(&mut svg, "#ffffff");
        frame.mark(&mut svg, light.map(|v| -v), "mirror", "#ffffff");
    }
    svg.text([LEFT[0], 22.0], &title, 15.0, Anchor::Start, "");
    let unit = match settings.normalisation {
        Normalisation::Brdf => "BRDF, luminance (1/sr)",
        Normalisation::Relative => "reflectance relative to a mirror, luminance",
    };
    let bar = Area::new(LEFT[1] + SQUARE + 18.0, TOP, 20.0, SQUARE);
    log_color_bar(&mut svg, bar, limits, unit, &|t| viridis(t as f32));
    Ok(svg.finish(&format!("BRDF over directions of view. {title}")))
}

/// Smallest and largest luminance of the colour bar.
fn limits(map: &Map) -> [f64; 2] {
    let lit = || map.xyz.iter().map(|v| f64::from(v[1])).filter(|y| *y > 0.0);
    let high = lit().fold(0.0, f64::max);
    if high == 0.0 {
        return [0.1, 1.0];
    }
    let low = lit().fold(high, f64::min).max(high / RANGE);
    // A uniform map still has a scale.
    if low < 0.99 * high { [low, high] } else { [high / 10.0, high] }
}

fn luminance(map: &Map, [low, high]: [f64; 2]) -> Vec<u8> {
    let color = |y: f32| match y {
        y if y.is_nan() => BELOW,
        y => viridis(((f64::from(y).max(low) / low).ln() / (high / low).ln()) as f32),
    };
    map.xyz.iter().flat_map(|v| color(v[1])).collect()
}

/// A square picture as a PNG, averaged to at most [`SIDE`] pixels.
fn encoded(rgb: &[u8], size: usize) -> Result<Vec<u8>> {
    let step = size.div_ceil(SIDE);
    let side = size / step;
    let mean = |x: usize, y: usize, c: usize| {
        let block =
            (0..step * step).map(|k| u32::from(rgb[3 * ((y * step + k / step) * size + x * step + k % step) + c]));
        (block.sum::<u32>() / (step * step) as u32) as u8
    };
    let small: Vec<u8> = (0..side * side).flat_map(|k| [0, 1, 2].map(|c| mean(k % side, k / side, c))).collect();
    encode_png8(side, side, 3, &small).map_err(|e| Error::output(Path::new("figure"), e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{Views, map};
    use crate::height::{Profile, Quality, Shape, Synthetic};
    use nacre_base::progress::Silent;
    use nacre_plot::png_from_svg;

    #[test]
    fn a_figure_has_angles_and_the_limits_of_its_colours() {
        let shape = Shape::Grating(Profile::Sinusoid);
        let field = Synthetic { shape, pixels: 64, pixel_um: 0.1, period_um: 1.6, depth_um: 0.2, angle: 0.0 };
        let field = field.field().unwrap();
        let quality = Quality::of(&field, 20.0);
        let settings = Settings { coherence_um: 20.0, ..Settings::default() };
        let map = map(&field, &quality, &settings, Views::all(64), &Silent).unwrap();
        let [low, high] = limits(&map);
        let most = map.xyz.iter().map(|v| v[1]).filter(|y| y.is_finite()).fold(0.0, f32::max);
        assert!(high == f64::from(most) && low > 0.0 && low >= high / RANGE);
        let svg = figure(&map, &settings).unwrap();
        for word in ["30°", "75°", "mirror", "sin θ cos φ", "1/sr", &nacre_plot::style::number(high)] {
            assert!(svg.contains(word), "{word}");
        }
        if let Some(folder) = std::env::var_os("NACRE_PICTURES") {
            let png = png_from_svg(&svg, 1.0).unwrap();
            std::fs::write(Path::new(&folder).join("brdf-figure.png"), png).unwrap();
        }
    }

    #[test]
    fn large_maps_are_averaged() {
        let rgb: Vec<u8> = (0..2048 * 2048).flat_map(|k| [if k % 2 == 0 { 0 } else { 200 }; 3]).collect();
        let png = encoded(&rgb, 2048).unwrap();
        let small = image::load_from_memory(&png).unwrap().into_rgb8();
        assert!(small.width() == 1024 && small.pixels().all(|p| p.0 == [100; 3]));
    }
}
