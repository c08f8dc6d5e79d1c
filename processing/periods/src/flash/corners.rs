//! Corner detection of a sheet that is brighter or darker than its background.

use super::photographs::Photograph;
use nacre_base::statistics::median;
use nacre_base::{Error, Result};

/// Minimum area of a sheet relative to the picture.
const LEAST: f64 = 0.05;

/// Threshold of the sheet, as a fraction of the difference between background and bright level.
const RISE: f32 = 0.12;

/// Iterations of outlier rejection in line fits.
const ROUNDS: usize = 6;

/// Corner pixels, clockwise from the top left, of the largest bright area: intersections of lines fitted to its four
/// borders.
///
/// # Errors
/// `Input` without such an area in the picture.
pub(super) fn find(room: &Photograph) -> Result<[[f64; 2]; 4]> {
    let lost = || {
        let problem = "the corners of the sheet were not found in the photograph by room light";
        Error::input("--corners-px", problem, "give them: top left, top right, bottom right, bottom left as x,y")
    };
    let (width, height) = (room.width, room.height);
    let parted = otsu(&room.light).ok_or_else(lost)?;
    let at = |x: usize, y: usize| room.light[y * width + x];
    // Print may be dark, so the threshold refers to the brightness at the picture's border.
    let border = (0..width)
        .flat_map(|x| [at(x, 0), at(x, height - 1)])
        .chain((0..height).flat_map(|y| [at(0, y), at(width - 1, y)]));
    let ground = median(border.filter(|v| v.is_finite()).collect::<Vec<_>>()).ok_or_else(lost)?;
    let bright_level =
        median(room.light.iter().copied().filter(|v| *v > parted).collect::<Vec<_>>()).ok_or_else(lost)?;
    let threshold = ground + RISE * (bright_level - ground);
    let bright = |x: usize, y: usize| at(x, y) > threshold;
    let count = room.light.iter().filter(|v| **v > threshold).count();
    if bright_level <= ground || (count as f64) < LEAST * (width * height) as f64 {
        return Err(lost());
    }
    // Range of rows and columns that holds most of the area, so that specks elsewhere do not matter.
    let rows: Vec<usize> = (0..height).map(|y| (0..width).filter(|x| bright(*x, y)).count()).collect();
    let columns: Vec<usize> = (0..width).map(|x| (0..height).filter(|y| bright(x, *y)).count()).collect();
    let inner = |counts: &[usize]| {
        let most = counts.iter().copied().max().unwrap_or(0);
        let full: Vec<usize> = (0..counts.len()).filter(|k| 2 * counts[*k] > most).collect();
        Some([*full.first()?, *full.last()?])
    };
    let ([top, bottom], [left, right]) = inner(&rows).zip(inner(&columns)).ok_or_else(lost)?;
    let trim = |from: usize, to: usize| (from + (to - from) / 8)..(to - (to - from) / 8).max(from + 1);
    let from = |length: usize, back: bool, profile: &dyn Fn(usize) -> f32| {
        let found = edge(length, [ground, threshold], &|k| profile(if back { length - 1 - k } else { k }))?;
        Some(if back { (length - 1) as f64 - found } else { found })
    };
    let upright =
        |back| line(trim(top, bottom).filter_map(|y| Some([y as f64, from(width, back, &|x| at(x, y))?])).collect());
    let level =
        |back| line(trim(left, right).filter_map(|x| Some([x as f64, from(height, back, &|y| at(x, y))?])).collect());
    let sides = [level(false), upright(true), level(true), upright(false)];
    let [Some(above), Some(right), Some(below), Some(left)] = sides else { return Err(lost()) };
    // Intersection of x = a + b y and y = c + d x.
    let meet = |[a, b]: [f64; 2], [c, d]: [f64; 2]| {
        let y = (c + d * a) / (1.0 - b * d);
        [a + b * y, y]
    };
    let corners = [meet(left, above), meet(right, above), meet(right, below), meet(left, below)];
    let within = |p: &[f64; 2]| p[0] > 0.5 && p[1] > 0.5 && p[0] < width as f64 - 1.5 && p[1] < height as f64 - 1.5;
    if corners.iter().all(within) { Ok(corners) } else { Err(lost()) }
}

/// Position where a profile crosses the midpoint between background and the level just inside.
fn edge(length: usize, [ground, threshold]: [f32; 2], profile: &dyn Fn(usize) -> f32) -> Option<f64> {
    let first = (0..length).find(|k| profile(*k) > threshold)?;
    let top = (first..(first + 5).min(length)).map(profile).fold(threshold, f32::max);
    let half = 0.5 * (ground + top);
    let inside = (first..length).find(|k| profile(*k) >= half)?;
    let (outer, inner) = (profile(inside.checked_sub(1)?), profile(inside));
    Some(inside as f64 - f64::from((inner - half) / (inner - outer).max(f32::MIN_POSITIVE)))
}

/// Threshold that best separates dark from bright (Otsu 1979).
fn otsu(light: &[f32]) -> Option<f32> {
    const BINS: usize = 256;
    let finite = || light.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite().fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(v), b.max(v)));
    if low >= high {
        return None;
    }
    let mut counts = [0.0_f64; BINS];
    finite().for_each(|v| counts[(((v - low) / (high - low) * BINS as f32) as usize).min(BINS - 1)] += 1.0);
    let all: f64 = counts.iter().sum();
    let mean: f64 = counts.iter().enumerate().map(|(k, n)| k as f64 * n).sum::<f64>() / all;
    let (mut below, mut sum, mut best) = (0.0, 0.0, (0.0, 0));
    for (k, n) in counts.iter().enumerate() {
        below += n;
        sum += k as f64 * n;
        let apart = (mean * below - sum).powi(2) / (below * (all - below)).max(1.0);
        if apart > best.0 {
            best = (apart, k);
        }
    }
    Some(low + (high - low) * (best.1 + 1) as f32 / BINS as f32)
}

/// `[a, b]` of the line v = a + b u through points (u, v), robust against outliers.
fn line(points: Vec<[f64; 2]>) -> Option<[f64; 2]> {
    let mut used = points;
    let mut found = None;
    for _ in 0..ROUNDS {
        let n = used.len() as f64;
        if used.len() < 8 {
            return None;
        }
        let mean = [0, 1].map(|k| used.iter().map(|p| p[k]).sum::<f64>() / n);
        let (uu, uv) = used
            .iter()
            .fold((0.0, 0.0), |(uu, uv), p| (uu + (p[0] - mean[0]).powi(2), uv + (p[0] - mean[0]) * (p[1] - mean[1])));
        let b = if uu > 0.0 { uv / uu } else { 0.0 };
        let a = mean[1] - b * mean[0];
        found = Some([a, b]);
        let off = used.iter().map(|p| (p[1] - a - b * p[0]).abs()).collect::<Vec<f64>>();
        let limit = (3.0 * median(off)?).max(0.7);
        used.retain(|p| (p[1] - a - b * p[0]).abs() <= limit);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_sheet_with_dark_print_is_found() {
        let (width, height) = (240, 200);
        let inside = |x: f64, y: f64| {
            // Rotated by a slope of 1/20.
            let (u, v) = (x + 0.05 * y, y - 0.05 * x);
            (30.0..210.0).contains(&u) && (25.0..165.0).contains(&v)
        };
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            // Dark spots, also at the border, and a bright speck outside.
            let print = if (i * 7919_usize).is_multiple_of(23) { 0.1 } else { 0.6 };
            if inside(x, y) {
                print
            } else if i == 3 * width + 5 {
                0.9
            } else {
                0.03
            }
        };
        let light: Vec<f32> = (0..width * height).map(pixel).collect();
        let room = Photograph { width, height, variance: vec![0.0; light.len()], light };
        let found = find(&room).unwrap();
        // Expected corner: x + 0.05 y = 30 and y - 0.05 x = 25, minus half a pixel, because the first pixel inside
        // counts.
        let meet = |u: f64, v: f64| [(u - 0.05 * v) / 1.0025, (v + 0.05 * u) / 1.0025];
        let corners = [meet(30.0, 25.0), meet(210.0, 25.0), meet(210.0, 165.0), meet(30.0, 165.0)];
        for (a, b) in found.iter().zip(corners) {
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1.2, "{found:?} {corners:?}");
        }
        let flat = Photograph { light: vec![0.5; width * height], variance: vec![0.0; width * height], width, height };
        assert!(find(&flat).is_err());
    }
}
