//! Joint fit of all shifts, to a few thousandths of a pixel: minimises the residual of the scene's model.

use super::scene::Scene;
use super::sums::Sums;
use super::tile::Tile;
use super::windows::Windows;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Smallest side of a tile in pixels.
const SMALLEST_TILE: usize = 6;

/// Approximate side of a tile in pixels. The scatter between tiles gives σ.
const TILE: usize = 48;

/// Margin in pixels between a tile and the border of its window: smoothing, kernel, gradient, and changes of the
/// shifts.
const RIM: usize = 9;

/// Initial number of tiles, those of most texture. It is quadrupled until σ is small enough.
const FIRST_TILES: usize = 48;

/// Approximate number of frames by which tiles are chosen.
const LOOKED_AT: usize = 4;

/// σ in pixels at which no more tiles are added: the kernel's error then dominates the noise.
const ENOUGH: f64 = 0.01;

/// Largest change of a shift from its starting value, in pixels.
const PULL: f64 = 2.0;

/// Smallest number of tiles for an estimate of the scatter.
const FEWEST: usize = 4;

/// Minimum of the residual.
pub(super) struct Minimum {
    /// Shifts with zero mean.
    pub(super) shifts: Vec<[f64; 2]>,
    /// Mean square residual.
    left: f64,
    scene: Scene,
}

impl Minimum {
    /// Whether the shifts agree with the peaks of correlations, which are accurate to half a pixel.
    pub(super) fn is_at(&self, peaks: &[[f64; 2]]) -> bool {
        let apart = self.shifts.as_flattened().iter().zip(peaks.as_flattened()).map(|(a, b)| (a - b).abs());
        apart.fold(0.0, f64::max) < 0.5
    }
}

/// Minimum next to zero shifts, found at a quarter of the size first, where the range of convergence is four times as
/// large.
pub(super) fn from_nothing(windows: &Windows, scene: &Scene) -> Option<Minimum> {
    let mut levels: Vec<Windows> = windows.halved().into_iter().collect();
    levels.extend(levels.first().and_then(Windows::halved));
    let mut shifts = vec![[0.0; 2]; windows.frames()];
    for level in (1..=levels.len()).rev() {
        let scale = f64::from(1 << level);
        let start: Vec<[f64; 2]> = shifts.iter().map(|s| s.map(|d| d / scale)).collect();
        if let Some(found) = minimum(&levels[level - 1], &start, scene) {
            shifts = found.shifts.iter().map(|s| s.map(|d| d * scale)).collect();
        }
    }
    minimum(windows, &shifts, scene)
}

/// Minimum next to these shifts.
pub(super) fn minimum(windows: &Windows, start: &[[f64; 2]], scene: &Scene) -> Option<Minimum> {
    let mut shifts = centred(start.to_vec());
    let tiles = tiles(windows, &shifts);
    let count = FIRST_TILES.min(tiles.len());
    if count < FEWEST {
        return None;
    }
    let mut scene = scene.clone();
    let all = total(&settle(windows, &tiles[..count], &mut scene, &mut shifts)?, shifts.len());
    (all.pixels > 0).then(|| Minimum { shifts, left: all.square / all.pixels as f64, scene })
}

/// Minimum with the smaller residual.
pub(super) fn better(a: Option<Minimum>, b: Option<Minimum>) -> Option<Minimum> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.left < a.left { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// Shifts with zero mean, and σ of each (the larger of both directions), from as many tiles as needed; `None` if tiles
/// do not agree on a minimum.
pub(super) fn refine(windows: &Windows, from: Minimum) -> Option<Vec<([f64; 2], f64)>> {
    let Minimum { mut shifts, mut scene, .. } = from;
    let tiles = tiles(windows, &shifts);
    let mut count = FIRST_TILES.min(tiles.len());
    loop {
        let settled = settle(windows, &tiles[..count], &mut scene, &mut shifts)?;
        match deviations(&settled, &scene) {
            Some(sigma) if count == tiles.len() || sigma.iter().all(|s| *s < ENOUGH) => {
                return Some(shifts.into_iter().zip(sigma).collect());
            }
            None if count == tiles.len() => return None,
            _ => count = (4 * count).min(tiles.len()),
        }
    }
}

/// Gauss-Newton iterations until all shifts change by less than 0.001 px; returns the final sums of each tile.
fn settle(windows: &Windows, tiles: &[Tile], scene: &mut Scene, shifts: &mut Vec<[f64; 2]>) -> Option<Vec<Sums>> {
    const STEPS: usize = 20;
    let start = shifts.clone();
    for _ in 0..STEPS {
        let sums: Vec<Sums> = tiles.par_iter().map(|tile| tile.sums(windows, scene, shifts)).collect();
        let all = total(&sums, shifts.len());
        let curvature = gauged(scene.curvature(&all, false));
        let step = curvature.cholesky()?.solve(&DVector::from_vec(all.slope.clone()));
        let largest = step.amax();
        if !largest.is_finite() {
            return None;
        }
        if largest < 1e-3 {
            return Some(sums);
        }
        // Steps are limited to a pixel, beyond which gradients are meaningless.
        let scale = largest.recip().min(1.0);
        for (k, shift) in shifts.iter_mut().enumerate() {
            shift[0] -= scale * step[2 * k];
            shift[1] -= scale * step[2 * k + 1];
        }
        *shifts = centred(std::mem::take(shifts));
        let moved = shifts.as_flattened().iter().zip(start.as_flattened());
        if moved.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())) > PULL {
            return None;
        }
        *scene = scene.adapted(&all);
    }
    None
}

/// Standard deviations of the shifts by the sandwich estimator over tiles (Huber 1967), which covers any deviation of a
/// tile from the model, not only noise. `None` if the texture is within the noise.
fn deviations(sums: &[Sums], scene: &Scene) -> Option<Vec<f64>> {
    let n = scene.rows.len();
    let all = total(sums, n);
    let inverse = gauged(scene.curvature(&all, true)).cholesky()?.inverse();
    let mut evidence = DMatrix::zeros(2 * n, 2 * n);
    for tile in sums {
        let slope = DVector::from_column_slice(&tile.slope);
        evidence.ger(1.0, &slope, &slope, 1.0);
    }
    let covariance = &inverse * evidence * &inverse;
    Some((0..n).map(|k| covariance[(2 * k, 2 * k)].max(covariance[(2 * k + 1, 2 * k + 1)]).sqrt()).collect())
}

fn total(sums: &[Sums], frames: usize) -> Sums {
    sums.iter().fold(Sums::new(frames), |mut all, tile| {
        all.add(tile);
        all
    })
}

/// Fixes the gauge: a common shift of all frames changes nothing, so it is kept at zero.
fn gauged(mut curvature: DMatrix<f64>) -> DMatrix<f64> {
    let size = curvature.nrows();
    let weight = curvature.trace() / size.max(1) as f64;
    for (i, j) in (0..size).flat_map(|i| (i % 2..size).step_by(2).map(move |j| (i, j))) {
        curvature[(i, j)] += weight;
    }
    curvature
}

pub(super) fn centred(mut shifts: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let n = shifts.len().max(1) as f64;
    for axis in 0..2 {
        let mean = shifts.iter().map(|s| s[axis]).sum::<f64>() / n;
        shifts.iter_mut().for_each(|s| s[axis] -= mean);
    }
    shifts
}

/// Tiles that stay inside their windows under these shifts, those of most texture first.
fn tiles(windows: &Windows, shifts: &[[f64; 2]]) -> Vec<Tile> {
    let rim = RIM + shifts.as_flattened().iter().fold(0.0_f64, |a, s| a.max(s.abs())).ceil() as usize;
    let inside = windows.side.saturating_sub(2 * rim);
    // At least three along each side, so that small windows have several tiles too.
    let along = (inside / TILE).max(3);
    let side = inside / along;
    if side < SMALLEST_TILE {
        return Vec::new();
    }
    let places = |w: usize| {
        let corner = move |k: usize| rim + k * side;
        (0..along * along).map(move |k| Tile { window: w, corner: [corner(k % along), corner(k / along)], side })
    };
    let all: Vec<Tile> = (0..windows.count()).flat_map(places).collect();
    let textured = all.into_par_iter().map(|tile| {
        // A few frames suffice to locate edges.
        let step = windows.frames().div_ceil(LOOKED_AT).max(1);
        let texture: f64 = (0..windows.frames()).step_by(step).map(|k| tile.texture(windows, k)).sum();
        (texture, tile)
    });
    let mut sorted: Vec<(f64, Tile)> = textured.filter(|(texture, _)| *texture > 0.0).collect();
    sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
    sorted.into_iter().map(|(_, tile)| tile).collect()
}
