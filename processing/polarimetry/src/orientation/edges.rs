//! Edges between orientations: there the lens mixes both orientations, an error that σ from noise does not include.

use crate::OrientationMaps;
use nacre_base::vector_atan::folded;
use nacre_base::vectors::vectorised;
use rayon::prelude::*;
use std::f32::consts::FRAC_PI_2;

/// Second difference in standard deviations up to which it counts as noise; one pixel in thousands exceeds it by
/// chance.
const JUMP: f32 = 4.0;

/// Largest error of a mixed pixel relative to the second difference, there or in a neighbour: halfway up an edge it is
/// half of it.
const MIXED: f32 = 0.5;

/// Increases σ at jumps of the orientation (0 to π). Second differences vanish for linear changes, where σ is kept.
pub(crate) fn widen_at_edges(map: &mut OrientationMaps) {
    let OrientationMaps { width, height, orientation, sigma } = map;
    let (width, height) = (*width, *height);
    if width < 3 || height < 3 {
        return;
    }
    let row = |y: usize| &orientation[y * width..][..width];
    let scratch = || (vec![0.0; width], vec![0.0; width]);
    sigma.par_chunks_mut(width).enumerate().for_each_init(scratch, |(across, most), (y, sigma)| {
        vectorised(
            #[inline(always)]
            || {
                across.fill(0.0);
                raise(across, [row(y), &row(y)[1..], &row(y)[2..]], 1);
                // The neighbours' second differences count, too.
                most.copy_from_slice(across);
                for (most, before) in most[1..].iter_mut().zip(&*across) {
                    *most = most.max(*before);
                }
                for (most, after) in most.iter_mut().zip(&across[1..]) {
                    *most = most.max(*after);
                }
                for k in y.saturating_sub(1).max(1)..=(y + 1).min(height - 2) {
                    raise(most, [row(k - 1), row(k), row(k + 1)], 0);
                }
                for (sigma, most) in sigma.iter_mut().zip(&*most) {
                    *sigma = widened(*sigma, *most);
                }
            },
        );
    });
}

/// Increases σ for photographs that are shifted relative to each other by `apart_px` (root mean square): by the change
/// of the orientation over that distance.
///
/// Photograph k shows a pixel as if its analyser angle were off by g d_k, where g is the change of the orientation per
/// pixel. Small angle errors with zero sum cause an orientation error of at most their root mean square over √2.
pub(crate) fn widen_where_apart(map: &mut OrientationMaps, apart_px: f32) {
    let OrientationMaps { width, orientation, sigma, .. } = map;
    let width = *width;
    if apart_px <= 0.0 {
        return;
    }
    // Where photographs contradict each other σ exceeds that of noise, which is estimated from the pixel with the
    // smallest σ.
    let noise = sigma.iter().copied().fold(FRAC_PI_2, f32::min);
    let rows: Vec<&[f32]> = orientation.chunks(width).collect();
    let beside = |x: usize, y: usize| rows.get(y).and_then(|row| row.get(x)).copied().unwrap_or(f32::NAN);
    sigma.par_chunks_mut(width).enumerate().for_each(|(y, sigma)| {
        for (x, sigma) in sigma.iter_mut().enumerate() {
            let here = rows[y][x];
            let turn = |x: usize, y: usize| turned(beside(x, y), here).powi(2);
            // The steeper of two sides; a masked neighbour is ignored.
            let across = turn(x + 1, y).max(turn(x.wrapping_sub(1), y)).max(0.0);
            let along = turn(x, y + 1).max(turn(x, y.wrapping_sub(1))).max(0.0);
            let slope = (across + along - 4.0 * noise * noise).max(0.0);
            *sigma = (*sigma * *sigma + 0.5 * apart_px * apart_px * slope).sqrt().min(FRAC_PI_2);
        }
    });
}

/// Smallest signed difference of two orientations in [0, π).
#[inline(always)]
fn turned(a: f32, b: f32) -> f32 {
    folded(a - b + FRAC_PI_2) - FRAC_PI_2
}

/// Raises values, from the `first` on, to the second differences of three runs of orientations; masked ones are
/// ignored.
#[inline(always)]
fn raise(values: &mut [f32], [before, here, after]: [&[f32]; 3], first: usize) {
    let runs = before.iter().zip(here).zip(after);
    for (value, ((before, here), after)) in values[first..].iter_mut().zip(runs) {
        let bend = (turned(*after, *here) + turned(*before, *here)).abs();
        *value = if bend > *value { bend } else { *value };
    }
}

/// The variance of a second difference is six times that of a pixel. The possible contribution of noise is subtracted,
/// so that mere noise hardly increases σ.
#[inline(always)]
fn widened(sigma: f32, bend: f32) -> f32 {
    let beyond = bend * bend - JUMP * JUMP * 6.0 * sigma * sigma;
    if beyond > 0.0 { (sigma * sigma + MIXED * MIXED * beyond).sqrt().min(FRAC_PI_2) } else { sigma }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle_difference;
    use crate::synthetic;
    use std::f32::consts::PI;

    fn map(width: usize, height: usize, of: impl Fn(usize, usize) -> f32) -> OrientationMaps {
        let orientation = (0..width * height).map(|i| of(i % width, i / width)).collect();
        OrientationMaps { width, height, orientation, sigma: vec![0.002; width * height] }
    }

    /// A pixel halfway up an edge and its neighbours have a σ that covers their error; pixels farther away, and masked
    /// ones, are unchanged.
    #[test]
    fn mixed_pixels_have_larger_sigma() {
        let mut edge = map(9, 5, |x, _| [0.3, 0.3, 0.3, 0.3, 0.5, 0.7, 0.7, 0.7, f32::NAN][x]);
        widen_at_edges(&mut edge);
        let row = &edge.sigma[18..27];
        assert!(row[3..6].iter().all(|s| *s > 0.09), "{row:?}");
        assert!([0, 1, 7, 8].iter().all(|x| row[*x] == 0.002), "{row:?}");
    }

    /// Linearly changing orientations, also across 180°, and noise are not edges.
    #[test]
    fn even_turns_and_noise_are_no_edges() {
        let noise = |x: usize, y: usize| 0.002 * synthetic::normal(5, (x + 1000 * y) as u64) as f32;
        let mut turning = map(200, 200, |x, y| (0.02 * x as f32 + 0.01 * y as f32 + noise(x, y)).rem_euclid(PI));
        widen_at_edges(&mut turning);
        let widened = turning.sigma.iter().filter(|s| **s > 0.002).count();
        // 40,000 pixels with six second differences each, of which 6e-5 exceed 4 standard deviations: about 15.
        assert!(widened < 40, "{widened}");
    }

    /// Shifted photographs increase σ as defined for linear changes and at an edge, but not for uniform orientation or
    /// without shifts. Beside a masked pixel the other side is used.
    #[test]
    fn photographs_that_are_left_apart_widen_where_orientations_turn() {
        let of = |x: usize, y: usize| match (x, y) {
            (9, _) => f32::NAN,
            (x, 0..6) => 0.1 * x as f32,
            _ => 1.0,
        };
        let mut apart = map(10, 12, |x, y| of(x, y).rem_euclid(PI));
        widen_where_apart(&mut apart, 2.0);
        let expected = |slope: f32| (0.002_f32.powi(2) + 0.5 * 4.0 * (slope - 4.0 * 0.002_f32.powi(2))).sqrt();
        for (x, slope) in [(0, 0.01), (4, 0.01), (8, 0.01)] {
            assert!((apart.sigma[20 + x] - expected(slope)).abs() < 1e-5, "{x}: {}", apart.sigma[20 + x]);
        }
        assert!((apart.sigma[54] - expected(0.01 + 0.36)).abs() < 1e-5, "{}", apart.sigma[54]);
        assert!((apart.sigma[64] - expected(0.36)).abs() < 1e-5, "{}", apart.sigma[64]);
        assert_eq!(apart.sigma[94], 0.002);
        let mut together = map(10, 12, of);
        widen_where_apart(&mut together, 0.0);
        assert!(together.sigma.iter().all(|s| *s == 0.002));
    }

    /// Compared with the definition in double precision: random orientations, a ninth of them masked, including the
    /// edges of the map.
    #[test]
    fn sigma_is_widened_by_the_largest_second_difference_around() {
        const SIDES: [usize; 2] = [23, 11];
        let of = |x: usize, y: usize| {
            let at = (x + 100 * y) as u64;
            if synthetic::uniform(3, at) < 1.0 / 9.0 { f32::NAN } else { PI * synthetic::uniform(4, at) as f32 }
        };
        let mut found = map(SIDES[0], SIDES[1], of);
        widen_at_edges(&mut found);
        let bend = |[x, y]: [usize; 2], axis: usize| {
            let beside = |by: isize| {
                let mut at = [x, y];
                at[axis] = at[axis].checked_add_signed(by).filter(|k| *k < SIDES[axis])?;
                Some(angle_difference(f64::from(of(at[0], at[1])), f64::from(of(x, y))))
            };
            let bend = Some(beside(-1)? + beside(1)?).filter(|b| b.is_finite())?;
            Some(bend.abs())
        };
        for (y, row) in found.sigma.chunks(SIDES[0]).enumerate() {
            for (x, sigma) in row.iter().enumerate() {
                let near = |axis: usize| {
                    (-1..=1).filter_map(move |by| {
                        let mut at = [x, y];
                        at[axis] = at[axis].checked_add_signed(by).filter(|k| *k < SIDES[axis])?;
                        bend(at, axis)
                    })
                };
                let most = near(0).chain(near(1)).fold(0.0, f64::max);
                let variance = f64::from(0.002_f32).powi(2);
                let beyond = (most * most - 96.0 * variance).max(0.0);
                let wanted = (variance + 0.25 * beyond).sqrt().min(std::f64::consts::FRAC_PI_2);
                // Single precision changes differences by at most 4e-7 rad.
                assert!((f64::from(*sigma) - wanted).abs() < 1e-6, "({x}, {y}): {sigma} {wanted}");
            }
        }
    }
}
