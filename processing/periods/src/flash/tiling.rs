//! Positions of a sheet's tiles, to a small fraction of a pixel.
//!
//! A misalignment by one pixel mixes the light of adjacent polygons at every edge (2018 paper, section 7.2). Tiles of a
//! regular grid are therefore registered individually to the reference tile under room light. With a reference tile
//! alone, its neighbours are found by correlation, then their neighbours, up to the border of the sheet.

use super::photographs::Photograph;
use super::settings::Settings;
use super::view::View;
use nacre_base::{Error, Result};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Search radius relative to the tile's size, for tiles of a grid and for neighbours of a known tile.
const SEARCHED: f64 = 0.06;

/// Minimum correlation of a tile.
const ALIKE: f64 = 0.6;

/// Maximum number of pixels of a tile, and maximum number of copies of all its pixels.
const MOST_PIXELS: usize = 16 << 20;
const MAX_COPIES: usize = 512 << 20;

/// Maximum number of Lucas-Kanade iterations.
const STEPS: usize = 12;

/// Positions of tiles.
#[derive(Clone, Debug)]
pub(super) struct Tiling {
    /// Width of the map in pixels.
    pub width: usize,
    /// Height of the map in pixels.
    pub height: usize,
    /// Pixel size on the sheet in mm.
    pub pitch_mm: f64,
    /// Top left corner of each tile in mm to the right of and above the sheet's centre; the reference comes first.
    pub origins: Vec<[f64; 2]>,
}

/// Result of the registration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    /// Largest displacement of a tile in map pixels.
    pub most_px: f64,
    /// Typical σ of a tile's position in pixels.
    pub sigma_px: f64,
    /// Number of rejected tiles, which resemble no other.
    pub left_out: usize,
}

impl Tiling {
    /// Position on the sheet of a tile's pixel.
    pub fn place(&self, tile: usize, x: usize, y: usize) -> [f64; 2] {
        let [left, top] = self.origins[tile];
        [left + (x as f64 + 0.5) * self.pitch_mm, top - (y as f64 + 0.5) * self.pitch_mm]
    }

    /// Parts of every tile overlapped by others, where the visible tile is unknown: left, top, right and bottom in the
    /// tile's pixels. Overlaps of up to half a pixel are ignored.
    pub fn overlaps(&self) -> Vec<Vec<[f64; 4]>> {
        let size = [self.width as f64, self.height as f64];
        let of = |k: usize| {
            let [left, top] = self.origins[k];
            let others = self.origins.iter().enumerate().filter(|(j, _)| *j != k);
            let part = |(_, o): (usize, &[f64; 2])| {
                let [x, y] = [(o[0] - left) / self.pitch_mm, (top - o[1]) / self.pitch_mm];
                let [x1, y1] = [x + size[0] - 0.5, y + size[1] - 0.5];
                let meets = x + 0.5 < size[0] && y + 0.5 < size[1] && x1 > 0.0 && y1 > 0.0;
                meets.then_some([x + 0.5, y + 0.5, x1, y1])
            };
            others.filter_map(part).collect()
        };
        (0..self.origins.len()).into_par_iter().map(of).collect()
    }

    /// Bounding box of all tiles.
    pub fn extent(&self) -> [[f64; 2]; 2] {
        let size = [self.width as f64 * self.pitch_mm, self.height as f64 * self.pitch_mm];
        let fold =
            |k: usize, pick: fn(f64, f64) -> f64, start: f64| self.origins.iter().map(|o| o[k]).fold(start, pick);
        let low = [fold(0, f64::min, f64::MAX), fold(1, f64::min, f64::MAX) - size[1]];
        [low, [fold(0, f64::max, f64::MIN) + size[0], fold(1, f64::max, f64::MIN)]]
    }

    fn checked(self) -> Result<Self> {
        let (pixels, tiles) = (self.width.saturating_mul(self.height), self.origins.len());
        if self.width.min(self.height) < 2 || pixels > MOST_PIXELS || pixels.saturating_mul(tiles) > MAX_COPIES {
            let problem = format!("make maps of {} × {} pixels of {tiles} tiles", self.width, self.height);
            return Err(Error::input("--tiles, --pixel-mm", problem, "choose other tiles, or a larger --pixel-mm"));
        }
        Ok(self)
    }

    /// Grid of tiles that fills a sheet; the central tile is the reference.
    ///
    /// # Errors
    /// `Input` for too many or too small tiles.
    pub fn grid(size_mm: [f64; 2], [columns, rows]: [usize; 2], pitch_mm: f64) -> Result<Self> {
        let tile = [size_mm[0] / columns as f64, size_mm[1] / rows as f64];
        let corner = |i: usize| {
            [(i % columns) as f64 * tile[0] - 0.5 * size_mm[0], 0.5 * size_mm[1] - (i / columns) as f64 * tile[1]]
        };
        let mut origins: Vec<[f64; 2]> = (0..columns * rows).map(corner).collect();
        let middle = rows / 2 * columns + columns / 2;
        origins.swap(0, middle);
        let width = ((tile[0] / pitch_mm).round() as usize).max(1);
        let pitch_mm = tile[0] / width as f64;
        let height = ((tile[1] / pitch_mm).round() as usize).max(1);
        Self { width, height, pitch_mm, origins }.checked()
    }

    /// One tile, from which the others are found.
    fn one(reference_px: [f64; 4], view: &View, pitch_mm: f64) -> Result<Self> {
        let [x, y, w, h] = reference_px;
        let beyond = || {
            let problem = format!("{reference_px:?} does not lie on the sheet");
            Error::input("--reference-px", problem, "give left, top, width and height of a tile in the photograph")
        };
        let point = |p: [f64; 2]| view.point(p).ok_or_else(beyond);
        let (corner, right, below) = (point([x, y])?, point([x + w, y])?, point([x, y + h])?);
        let (wide, high) = (right[0] - corner[0], corner[1] - below[1]);
        if !(wide > 0.0 && high > 0.0) {
            return Err(beyond());
        }
        let count = |mm: f64| (mm / pitch_mm).round().clamp(1.0, 1e6) as usize;
        Self { width: count(wide), height: count(high), pitch_mm, origins: vec![corner] }.checked()
    }
}

/// Tiles according to the options, registered in the photograph under room light.
///
/// # Errors
/// `Input` for invalid tiles, and for a reference tile without a photograph under room light.
pub(super) fn tiling(
    settings: &Settings,
    view: &View,
    room: Option<&Photograph>,
    image: [usize; 2],
) -> Result<(Tiling, Option<Moved>)> {
    let middle = view.point(image.map(|n| 0.5 * n as f64)).unwrap_or([0.0; 2]);
    let pitch_mm = settings.pixel_mm.or_else(|| view.pixel_mm(middle)).ok_or_else(|| {
        Error::input("geometry", "does not show the sheet in the middle of the picture", "correct it")
    })?;
    if let Some(reference) = settings.reference_px {
        let Some(room) = room else {
            let remedy = "take one with the flash off, or say how many tiles there are";
            return Err(Error::input("--reference-px", "needs a photograph by room light", remedy));
        };
        let mut tiling = Tiling::one(reference, view, pitch_mm)?;
        spread(&mut tiling, view, room);
        let moved = register(&mut tiling, view, room, 0.0);
        return Ok((tiling.checked()?, Some(moved)));
    }
    let size_mm = settings.size_mm.ok_or_else(|| {
        Error::input("--size-mm", "is not known", "give width and height of the sheet in mm, or --reference-px")
    })?;
    let mut tiling = Tiling::grid(size_mm, settings.tiles.unwrap_or([1, 1]), pitch_mm)?;
    let registers = !settings.unregistered && tiling.origins.len() > 1;
    let moved = room.filter(|_| registers).map(|room| register(&mut tiling, view, room, SEARCHED));
    Ok((tiling, moved))
}

/// Resampled patch of a tile's size with a border in pixels.
fn patch(tiling: &Tiling, origin: [f64; 2], border: usize, view: &View, room: &Photograph) -> Vec<f32> {
    let width = tiling.width + 2 * border;
    let at = |k: usize, from: f64, sign: f64| from + sign * (k as f64 + 0.5 - border as f64) * tiling.pitch_mm;
    let pixel = |i: usize| {
        let place = [at(i % width, origin[0], 1.0), at(i / width, origin[1], -1.0)];
        view.pixel(place).map_or(f32::NAN, |p| room.at(p)[0])
    };
    (0..width * (tiling.height + 2 * border)).map(pixel).collect()
}

/// Correlation of a tile with a part of a patch, displaced to the right and down; `None` if less than half is visible.
fn correlation(tile: &[f32], size: [usize; 2], patch: &[f32], border: usize, [dx, dy]: [i64; 2]) -> Option<f64> {
    let across = size[0] + 2 * border;
    let mut sums = [0.0_f64; 6];
    // Every other row suffices for the search.
    for y in (0..size[1]).step_by(if size[1] > 60 { 2 } else { 1 }) {
        let from = (y as i64 + border as i64 + dy) as usize * across + (border as i64 + dx) as usize;
        for (a, b) in tile[y * size[0]..][..size[0]].iter().zip(&patch[from..]) {
            let (a, b) = (f64::from(*a), f64::from(*b));
            if (a + b).is_finite() {
                let terms = [1.0, a, b, a * a, a * b, b * b];
                (0..6).for_each(|k| sums[k] += terms[k]);
            }
        }
    }
    let [n, a, b, aa, ab, bb] = sums;
    if n < 0.2 * tile.len() as f64 {
        return None;
    }
    let (va, vb) = (aa - a * a / n, bb - b * b / n);
    (va > 0.0 && vb > 0.0).then(|| (ab - a * b / n) / (va * vb).sqrt())
}

/// Displacement to the right and down with the highest correlation within a border, and that correlation.
fn nearest(
    tile: &[f32],
    tiling: &Tiling,
    origin: [f64; 2],
    border: usize,
    view: &View,
    room: &Photograph,
) -> ([f64; 2], f64) {
    let size = [tiling.width, tiling.height];
    let patch = patch(tiling, origin, border, view, room);
    let reach = border as i64;
    let all = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| [dx, dy]));
    let with = all.filter_map(|d| correlation(tile, size, &patch, border, d).map(|c| (d, c)));
    let best = with.max_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or(([0.0; 2], -1.0), |(d, c)| (d.map(|v| v as f64), c))
}

fn border(tiling: &Tiling, part: f64) -> usize {
    ((part * tiling.width.max(tiling.height) as f64).ceil() as usize).clamp(5, 40)
}

/// Finds the neighbours of the reference tile, and successively their neighbours.
fn spread(tiling: &mut Tiling, view: &View, room: &Photograph) {
    let tile = patch(tiling, tiling.origins[0], 0, view, room);
    let (reach, pitch) = (border(tiling, SEARCHED), tiling.pitch_mm);
    let size = [tiling.width as f64 * pitch, tiling.height as f64 * pitch];
    let mut queue = VecDeque::from([([0_i64, 0_i64], tiling.origins[0])]);
    let mut seen = vec![[0, 0]];
    while let Some((index, origin)) = queue.pop_front() {
        for [dx, dy] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            let next = [index[0] + dx, index[1] + dy];
            if seen.contains(&next) || seen.len() > 10_000 {
                continue;
            }
            let expected = [origin[0] + dx as f64 * size[0], origin[1] - dy as f64 * size[1]];
            // Only complete tiles count.
            let corners = [[0.0, 0.0], [size[0], 0.0], [0.0, -size[1]], size.map(|s| s)].map(|c| {
                let p = view.pixel([expected[0] + c[0], expected[1] - c[1].abs()]);
                p.is_some_and(|p| {
                    p[0] >= 1.0 && p[1] >= 1.0 && p[0] < room.width as f64 - 2.0 && p[1] < room.height as f64 - 2.0
                })
            });
            if corners.contains(&false) {
                continue;
            }
            seen.push(next);
            let (moved, alike) = nearest(&tile, tiling, expected, reach, view, room);
            if alike >= ALIKE {
                let found = [expected[0] + moved[0] * pitch, expected[1] - moved[1] * pitch];
                tiling.origins.push(found);
                queue.push_back((next, found));
            }
        }
    }
}

/// Registers all tiles to the first one, and then to the mean of all.
fn register(tiling: &mut Tiling, view: &View, room: &Photograph, searched: f64) -> Moved {
    let begun = tiling.origins.clone();
    let mut model = patch(tiling, tiling.origins[0], 0, view, room);
    let mut sigma = vec![0.0; tiling.origins.len()];
    let mut keep = vec![true; tiling.origins.len()];
    for round in 0..2 {
        let of = |k: usize| {
            let mut origin = tiling.origins[k];
            let pitch = tiling.pitch_mm;
            if round == 0 && searched > 0.0 {
                let (moved, alike) = nearest(&model, tiling, origin, border(tiling, searched), view, room);
                if alike < ALIKE {
                    return (origin, f64::NAN);
                }
                origin = [origin[0] + moved[0] * pitch, origin[1] - moved[1] * pitch];
            }
            refined(tiling, &model, origin, view, room)
        };
        let found: Vec<([f64; 2], f64)> = (0..tiling.origins.len()).into_par_iter().map(of).collect();
        for (k, (origin, s)) in found.into_iter().enumerate() {
            keep[k] = s.is_finite() && (round == 0 || keep[k]);
            // The reference tile defines the origin.
            if k > 0 && s.is_finite() {
                (tiling.origins[k], sigma[k]) = (origin, s);
            }
        }
        keep[0] = true;
        model = mean(tiling, &keep, view, room);
    }
    let moves = tiling.origins.iter().zip(&begun).zip(&keep).filter(|(_, keep)| **keep);
    let most = moves.map(|((a, b), _)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
    let mut known: Vec<f64> = sigma.iter().zip(&keep).skip(1).filter(|(_, keep)| **keep).map(|(s, _)| *s).collect();
    known.sort_by(f64::total_cmp);
    let left_out = keep.iter().filter(|k| !**k).count();
    let mut k = 0;
    tiling.origins.retain(|_| {
        k += 1;
        keep[k - 1]
    });
    Moved { most_px: most / tiling.pitch_mm, sigma_px: known.get(known.len() / 2).copied().unwrap_or(0.0), left_out }
}

/// Mean of the tiles, each normalised by its own mean.
fn mean(tiling: &Tiling, keep: &[bool], view: &View, room: &Photograph) -> Vec<f32> {
    let mut sum = vec![[0.0_f32; 2]; tiling.width * tiling.height];
    for (origin, _) in tiling.origins.iter().zip(keep).filter(|(_, keep)| **keep) {
        let patch = patch(tiling, *origin, 0, view, room);
        let known: Vec<f32> = patch.iter().copied().filter(|v| v.is_finite()).collect();
        let level = known.iter().sum::<f32>() / known.len().max(1) as f32;
        for (sum, v) in sum.iter_mut().zip(patch).filter(|(_, v)| v.is_finite() && level > 0.0) {
            sum[0] += v / level;
            sum[1] += 1.0;
        }
    }
    sum.into_iter().map(|[v, n]| v / n).collect()
}

/// Position where a tile matches the model, up to a gain and an offset of brightness (Lucas and Kanade 1981), and its σ
/// in pixels; NaN without convergence.
fn refined(tiling: &Tiling, model: &[f32], mut origin: [f64; 2], view: &View, room: &Photograph) -> ([f64; 2], f64) {
    let (width, height) = (tiling.width, tiling.height);
    let begun = origin;
    let mut sigma = f64::NAN;
    for _ in 0..STEPS {
        let patch = patch(tiling, origin, 1, view, room);
        let across = width + 2;
        let mut a = SMatrix::<f64, 4, 4>::zeros();
        let mut b = SVector::<f64, 4>::zeros();
        let (mut squares, mut count) = (0.0, 0.0);
        for y in 0..height {
            for x in 0..width {
                let i = (y + 1) * across + x + 1;
                let slope = [0.5 * (patch[i + 1] - patch[i - 1]), 0.5 * (patch[i + across] - patch[i - across])];
                let row = SVector::<f64, 4>::new(
                    -f64::from(slope[0]),
                    -f64::from(slope[1]),
                    f64::from(model[y * width + x]),
                    1.0,
                );
                let v = f64::from(patch[i]);
                if v.is_finite() && row.iter().all(|r| r.is_finite()) {
                    a += row * row.transpose();
                    b += row * v;
                    squares += v * v;
                    count += 1.0;
                }
            }
        }
        let Some(inverse) = a.try_inverse() else { return (origin, f64::NAN) };
        let step = inverse * b;
        let left = (squares - step.dot(&b)).max(0.0) / f64::max(count - 4.0, 1.0);
        sigma = (left * inverse[(0, 0)].max(inverse[(1, 1)])).sqrt();
        let d = [step[0].clamp(-1.0, 1.0), step[1].clamp(-1.0, 1.0)];
        origin = [origin[0] + d[0] * tiling.pitch_mm, origin[1] - d[1] * tiling.pitch_mm];
        if d[0].hypot(d[1]) < 1e-3 {
            break;
        }
    }
    let moved = (origin[0] - begun[0]).hypot(origin[1] - begun[1]) / tiling.pitch_mm;
    if moved > 4.0 { (begun, f64::NAN) } else { (origin, sigma) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_overlap_where_others_lie_over_them() {
        // Two adjacent tiles, the second overlapping the first by 3 pixels and displaced by half a pixel; and one below
        // them, beyond a gap.
        let at = |x: f64| Tiling {
            width: 10,
            height: 8,
            pitch_mm: 0.5,
            origins: vec![[0.0, 0.0], [5.0 - x, 0.5], [0.0, -5.0]],
        };
        assert!(at(0.25).overlaps().iter().all(Vec::is_empty));
        let found = at(1.5).overlaps();
        // The second tile begins 7 pixels to the right of and one pixel above the first.
        assert_eq!(found, [vec![[7.5, -0.5, 16.5, 6.5]], vec![[-6.5, 1.5, 2.5, 8.5]], vec![]]);
    }
}
