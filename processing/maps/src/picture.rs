//! Maps side by side, for people.

use super::asset::{Kind, Map, Maps};
use nacre_image::{Canvas, orientation_picture, scalar_picture};

/// Longest side of a map in a picture, in pixels.
const LONGEST: usize = 900;

/// One row per kind of map: before on the left, after on the right, in the same colours and, for periods, on the same scale.
pub fn before_and_after(before: &Maps, after: &Maps) -> Canvas {
    side_by_side(&[("before", before), ("after", after)])
}

/// One row per kind of map, one column per set of maps, in the same colours and, for periods, on the same scale.
pub fn side_by_side(all: &[(&str, &Maps)]) -> Canvas {
    let mut rows: Vec<Vec<Canvas>> = vec![];
    for kind in Kind::ALL {
        let range = range(all.iter().filter_map(|(_, maps)| maps.maps.get(&kind)));
        let row: Vec<Canvas> =
            all.iter().filter_map(|(word, maps)| Some(one(maps, maps.maps.get(&kind)?, kind, word, range))).collect();
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

/// Least and most value of maps.
fn range<'a>(maps: impl Iterator<Item = &'a Map>) -> [f32; 2] {
    let values = maps.flat_map(|m| m.value.iter().copied()).filter(|v| v.is_finite());
    let [low, high] = values.fold([f32::MAX, f32::MIN], |[a, b], v| [a.min(v), b.max(v)]);
    if low <= high { [low, high] } else { [0.0, 1.0] }
}

fn one(maps: &Maps, map: &Map, kind: Kind, word: &str, [low, high]: [f32; 2]) -> Canvas {
    // Every so manieth pixel of a large map.
    let step = maps.width.max(maps.height).div_ceil(LONGEST);
    let (width, height) = (maps.width.div_ceil(step), maps.height.div_ceil(step));
    let value = |x: usize, y: usize| Some(map.value[y * step * maps.width + x * step]);
    let size = format!("{word}, {} × {} pixels", maps.width, maps.height);
    match kind {
        Kind::Orientation => orientation_picture(width, height, &value, &format!("Orientation {size}")),
        Kind::Period => scalar_picture(width, height, &value, low, high, "period (µm)", &format!("Period {size}")),
    }
}
