//! Detection of the highlight: the light's mirror image in the sheet, which is the zero order. Its width equals that of
//! every lobe. It lies where the half vector has no tangential component, independent of the print.

use super::photographs::Photograph;
use super::view::View;
use rayon::prelude::*;

/// Radius of the analysed region in standard deviations of the highlight.
const REACH: f64 = 3.5;

/// Variance of a Gaussian truncated at that radius, relative to the full variance.
const INSIDE: f64 = 0.986;

/// Maximum number of pixels along each axis.
const MAX_PIXELS: usize = 1200;

/// Number of moment iterations.
const ROUNDS: usize = 8;

/// A detected highlight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Highlight {
    /// Half vector at its centre; zero for a correct geometry.
    pub half: [f64; 2],
    /// Position of its centre on the sheet in mm.
    pub place: [f64; 2],
    /// Standard deviation of the light in its plane in mm.
    pub light_mm: f64,
}

/// Light and position.
type PixelLight = (f64, [f64; 2]);

/// Finds the highlight of a light at a known position, or at a known height; `None` if it is not in the picture.
pub(super) fn find(
    photograph: &Photograph,
    view: &View,
    extent: [[f64; 2]; 2],
    light_mm: Option<[f64; 3]>,
    height_mm: Option<f64>,
) -> Option<Highlight> {
    let all = pixel_lights(photograph, view, extent);
    let peak = brightest(photograph, view, extent)?;
    let light = light_mm.or_else(|| height_mm.map(|height| view.light_at(peak.1, height)))?;
    let step = (photograph.width.max(photograph.height) / MAX_PIXELS + 1) as f64;
    let half_of_peak = 0.5 * peak.0;
    // Positions in the light's plane, relative to the peak.
    let center = view.half(peak.1, light);
    if center.half[0].hypot(center.half[1]) > 0.25 {
        return None;
    }
    let [a, b, c] = center.slope;
    let determinant = a * c - b * b;
    let plane = |half: [f64; 2]| {
        let d = [half[0] - center.half[0], half[1] - center.half[1]];
        [(c * d[0] - b * d[1]) / determinant, (a * d[1] - b * d[0]) / determinant]
    };
    let pixel_mm = view.pixel_mm(peak.1)? * step;
    // Pixel size in the light's plane: scaled by the ratio of both distances to the camera's distance.
    let scale = pixel_mm * (1.0 + light[2] / view.viewer[2]);
    let lit = all.iter().filter(|s| s.0 > half_of_peak).count().max(1) as f64;
    let mut sigma = (lit * scale * scale / (std::f64::consts::TAU * std::f64::consts::LN_2)).sqrt().max(0.5 * scale);
    let mut middle = [0.0; 2];
    let mut place = peak.1;
    let placed: Vec<(f64, [f64; 2], [f64; 2])> =
        all.par_iter().map(|(light_seen, at)| (*light_seen, plane(view.half(*at, light).half), *at)).collect();
    for _ in 0..ROUNDS {
        let distance = |p: &[f64; 2]| (p[0] - middle[0]).hypot(p[1] - middle[1]);
        let mut around: Vec<f64> = placed
            .iter()
            .filter(|s| (REACH * sigma..(REACH + 1.5) * sigma + scale).contains(&distance(&s.1)))
            .map(|s| s.0)
            .collect();
        around.sort_by(f64::total_cmp);
        let base = around.get(around.len() / 3).copied().unwrap_or(0.0);
        let mut sums = [0.0; 6];
        for (seen, at, on_sheet) in placed.iter().filter(|s| distance(&s.1) < REACH * sigma) {
            // Saturated pixels are at least as bright as the peak.
            let weight = (seen.min(peak.0) - base).max(0.0);
            let terms = [1.0, at[0], at[1], distance(at).powi(2), on_sheet[0], on_sheet[1]];
            (0..6).for_each(|k| sums[k] += weight * terms[k]);
        }
        if sums[0] <= 0.0 {
            return None;
        }
        middle = [sums[1] / sums[0], sums[2] / sums[0]];
        place = [sums[4] / sums[0], sums[5] / sums[0]];
        sigma = (0.5 * sums[3] / sums[0] / INSIDE).sqrt().max(0.25 * scale);
    }
    let half = [0, 1].map(|k| center.half[k] + [a * middle[0] + b * middle[1], b * middle[0] + c * middle[1]][k]);
    Some(Highlight { half, place, light_mm: sigma })
}

/// Light and position of pixels on the sheet; saturated pixels are infinitely bright.
fn pixel_lights(photograph: &Photograph, view: &View, [low, high]: [[f64; 2]; 2]) -> Vec<PixelLight> {
    let step = photograph.width.max(photograph.height) / MAX_PIXELS + 1;
    let columns = photograph.width / step;
    let pixel = |i: usize| {
        let (x, y) = (i % columns * step, i / columns * step);
        let at = view.point([x as f64, y as f64])?;
        let light = photograph.light[y * photograph.width + x];
        let inside = (0..2).all(|k| (low[k]..=high[k]).contains(&at[k]));
        inside.then(|| (if light.is_nan() { f64::INFINITY } else { f64::from(light) }, at))
    };
    (0..columns * (photograph.height / step)).into_par_iter().filter_map(pixel).collect()
}

/// Position with the largest mean over 3 × 3 pixels.
fn brightest(photograph: &Photograph, view: &View, [low, high]: [[f64; 2]; 2]) -> Option<PixelLight> {
    let (width, height) = (photograph.width, photograph.height);
    let finite = photograph.light.par_iter().copied().filter(|v| v.is_finite()).max_by(f32::total_cmp)?;
    let at = |x: usize, y: usize| {
        let v = photograph.light[y * width + x];
        if v.is_nan() { 1.5 * f64::from(finite) } else { f64::from(v) }
    };
    let mean = |i: usize| {
        let (x, y) = (i % width, i / width);
        if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
            return None;
        }
        let sum: f64 = (0..9).map(|k| at(x + k % 3 - 1, y + k / 3 - 1)).sum();
        Some((sum / 9.0, i))
    };
    let place = |i: usize| view.point([(i % width) as f64, (i / width) as f64]);
    let inside = |i: usize| place(i).is_some_and(|p| (0..2).all(|k| (low[k]..=high[k]).contains(&p[k])));
    let best = (0..width * height)
        .into_par_iter()
        .filter_map(mean)
        .filter(|(_, i)| inside(*i))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((best.0.min(f64::from(finite)), place(best.1)?))
}
