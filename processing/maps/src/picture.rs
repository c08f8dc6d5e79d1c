//! Pictures of maps side by side.

use super::asset::{Kind, Map, Maps};
use super::compare::pixel_um;
use nacre_image::{Canvas, Palette, orientation_picture, scalar_picture};

/// Longest side of a map in a picture, in pixels.
const LONGEST: usize = 900;

/// One row per kind of map: before on the left, after on the right, with a common colour scale.
pub fn before_and_after(before: &Maps, after: &Maps, palette: Palette, scale_bar: bool) -> Canvas {
    side_by_side(&[("before", before), ("after", after)], palette, scale_bar)
}

/// One row per kind of map, one column per set of maps, with a common colour scale. Maps with `pixel_um` get a scale
/// bar on request.
pub fn side_by_side(all: &[(&str, &Maps)], palette: Palette, scale_bar: bool) -> Canvas {
    let mut rows: Vec<Vec<Canvas>> = vec![];
    for kind in Kind::ALL {
        let range = range(all.iter().filter_map(|(_, maps)| maps.maps.get(&kind)));
        let draw = |(word, maps): &(&str, &Maps)| {
            let bar_um = pixel_um(maps).filter(|_| scale_bar);
            Some(one(maps, maps.maps.get(&kind)?, kind, word, range, palette, bar_um))
        };
        let row: Vec<Canvas> = all.iter().filter_map(draw).collect();
        if !row.is_empty() {
            rows.push(row);
        }
    }
    let width = rows.iter().map(|row| row.iter().map(|c| c.width).sum::<usize>()).max().unwrap_or(1);
    let height = rows.iter().map(|row| row.iter().map(|c| c.height).max().unwrap_or(1)).sum::<usize>().max(1);
    let mut canvas = Canvas::new(width, height, [250, 250, 250]);
    let mut y = 0;
    for row in &rows {
        let mut x = 0;
        for picture in row {
            canvas.blit(picture, x, y);
            x += picture.width;
        }
        y += row.iter().map(|c| c.height).max().unwrap_or(0);
    }
    canvas
}

/// Minimum and maximum value of maps.
fn range<'a>(maps: impl Iterator<Item = &'a Map>) -> [f32; 2] {
    let values = maps.flat_map(|m| m.value.iter().copied()).filter(|v| v.is_finite());
    let [low, high] = values.fold([f32::MAX, f32::MIN], |[a, b], v| [a.min(v), b.max(v)]);
    if low <= high { [low, high] } else { [0.0, 1.0] }
}

fn one(
    maps: &Maps,
    map: &Map,
    kind: Kind,
    word: &str,
    range: [f32; 2],
    palette: Palette,
    pixel_um: Option<f64>,
) -> Canvas {
    // Large maps are subsampled.
    let step = maps.width.max(maps.height).div_ceil(LONGEST);
    let shown = [maps.width.div_ceil(step), maps.height.div_ceil(step)];
    let value = |x: usize, y: usize| Some(map.value[y * step * maps.width + x * step]);
    let size = format!("{word}, {} × {} pixels", maps.width, maps.height);
    let bar_um = pixel_um.map(|um| um * step as f64);
    match kind {
        Kind::Orientation => orientation_picture(shown, &value, &format!("Orientation {size}"), palette, bar_um),
        Kind::Period => scalar_picture(shown, &value, range, "period (µm)", &format!("Period {size}"), bar_um),
    }
}
