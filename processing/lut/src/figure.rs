//! Figure of a table: its luminance over half vectors on a logarithmic scale, with axes and a colour bar.

use super::table::Grid;
use nacre_base::{Error, Result};
use nacre_image::{encode_png8, viridis};
use nacre_plot::directions::{Directions, log_color_bar};
use nacre_plot::svg::{Anchor, Area, Svg};
use std::path::Path;

/// Side of the embedded picture in pixels.
const SIDE: usize = 640;

/// Largest ratio of the limits of the colour bar.
const RANGE: f64 = 1e6;

/// Colour where nothing was measured.
const UNKNOWN: [u8; 3] = [236, 238, 240];

/// SVG of a table for publications. `luminance` is that of an entry, NaN where nothing was measured.
///
/// # Errors
/// `Output` if the picture cannot be encoded.
pub(super) fn figure(grid: &Grid, luminance: &dyn Fn(usize, usize) -> f32, illuminant: &str) -> Result<String> {
    let all = || (0..grid.size * grid.size).map(|i| f64::from(luminance(i % grid.size, i / grid.size)));
    let (least, most) = all().filter(|y| *y > 0.0).fold((f64::INFINITY, 0.0_f64), |(l, m), y| (l.min(y), m.max(y)));
    let high = if most > 0.0 { most } else { 1.0 };
    let low = if least < 0.99 * high { least.max(high / RANGE) } else { high / 10.0 };
    let color = |y: f32| match y {
        y if y.is_nan() => UNKNOWN,
        y => viridis(((f64::from(y).max(low) / low).ln() / (high / low).ln()) as f32),
    };
    // Rows and columns of the picture are even in the half vector, whatever the warp of the table.
    let entry: Vec<usize> = (0..SIDE).map(|k| grid.entry((2.0 * k as f64 + 1.0) / SIDE as f64 - 1.0)).collect();
    let rgb: Vec<u8> = (0..SIDE * SIDE).flat_map(|k| color(luminance(entry[k % SIDE], entry[k / SIDE]))).collect();
    let png = encode_png8(SIDE, SIDE, 3, &rgb).map_err(|e| Error::output(Path::new("figure"), e))?;
    let mut svg = Svg::new(640.0, 520.0);
    let area = Area::new(76.0, 40.0, 420.0, 420.0);
    svg.image(area, &png);
    let titles = ["half vector ωi + ωo, x", "half vector ωi + ωo, y"];
    Directions { area, center: [0.0; 2], half: grid.extent, titles, rings: false }.draw(&mut svg, "#ffffff");
    let title = format!("Luminance of the lookup table ({illuminant})");
    svg.text([area.x, 24.0], &title, 15.0, Anchor::Start, "");
    let bar = Area::new(area.x + area.w + 18.0, area.y, 20.0, area.h);
    log_color_bar(&mut svg, bar, [low, high], "Y, 1 for an even photograph of 1", &|t| viridis(t as f32));
    Ok(svg.finish(&title))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_undoes_the_warp_and_names_its_limits() {
        let grid = Grid { size: 33, extent: 0.5, warp: 3 };
        for k in 0..grid.size {
            assert_eq!(grid.entry(grid.at(k) / grid.extent), k);
        }
        let light = |x: usize, y: usize| if x == 0 { f32::NAN } else { 0.02 * (1 + y) as f32 };
        let svg = figure(&grid, &light, "D65").unwrap();
        for word in [">0.02<", ">0.66<", ">0.4<", ">−0.4<", "half vector", "D65"] {
            assert!(svg.contains(word), "{word}");
        }
        // Dark and one-valued tables have a scale, too.
        for value in [0.0, 3.0, f32::NAN] {
            assert!(figure(&grid, &|_, _| value, "E").unwrap().contains("Luminance"));
        }
    }
}
