//! Robust fits of smooth backgrounds, and robust noise of regions.

use crate::refine::tukey;
use nacre_base::statistics::quantile;
use nalgebra::{DMatrix, DVector};
use num_complex::{Complex32, Complex64};

/// Rounds of reweighting.
const ROUNDS: usize = 6;

/// Relative ridge that decides between terms that the data do not tell apart.
const RIDGE: f64 = 1e-6;

/// Side of the squares in which noise is estimated, in pixels.
const SQUARE: usize = 32;

/// Smallest noise relative to the stated one. Systematic errors that both sheets share cancel in their difference.
const LEAST_SCALE: f32 = 0.1;

/// Smallest share of a square that must be compared.
const FILLED: f64 = 0.25;

/// Coefficients of terms by reweighted least squares: `terms(i, row)` fills the row of pixel `i`, which has the value
/// `wanted(i)` with the standard deviation `sigma(i)` per component. `None` for fewer pixels than terms.
pub fn fitted(
    pixels: &[usize],
    terms: &dyn Fn(usize, &mut Vec<Complex64>),
    wanted: &dyn Fn(usize) -> Complex64,
    sigma: &dyn Fn(usize) -> f64,
) -> Option<Vec<Complex64>> {
    let mut row = vec![];
    terms(*pixels.first()?, &mut row);
    let count = row.len();
    let mut weights = vec![1.0; pixels.len()];
    let mut solution = vec![];
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (DMatrix::<Complex64>::zeros(count, count), DVector::<Complex64>::zeros(count));
        for (i, weight) in pixels.iter().zip(&weights).filter(|(_, weight)| **weight > 0.0) {
            terms(*i, &mut row);
            let (value, weight) = (wanted(*i), weight / sigma(*i).powi(2));
            for j in 0..count {
                right[j] += row[j].conj() * value * weight;
                for k in 0..count {
                    normal[(j, k)] += row[j].conj() * row[k] * weight;
                }
            }
        }
        let ridge = RIDGE * normal[(0, 0)].re;
        (0..count).for_each(|k| normal[(k, k)] += ridge);
        solution = normal.lu().solve(&right)?.iter().copied().collect();
        let mut residual = |i: &usize| {
            terms(*i, &mut row);
            (wanted(*i) - dot(&solution, &row)).norm() / sigma(*i)
        };
        let residuals: Vec<f64> = pixels.iter().map(&mut residual).collect();
        // The median of a Rayleigh distribution is 1.1774 standard deviations of a component.
        let scale = quantile(&mut residuals.clone(), 0.5).map_or(1.0, |m| (m / 1.1774).max(1e-6));
        weights = residuals.iter().map(|r| f64::from(tukey((r / scale) as f32))).collect();
    }
    Some(solution)
}

/// Value of a fit for a row of terms.
pub fn dot(solution: &[Complex64], row: &[Complex64]) -> Complex64 {
    solution.iter().zip(row).map(|(a, b)| a * b).sum()
}

/// Products of powers up to a degree.
pub fn powers([u, v]: [f64; 2], degree: i32) -> impl Iterator<Item = f64> {
    (0..=degree).flat_map(move |d| (0..=d).map(move |k| u.powi(d - k) * v.powi(k)))
}

/// Local noise relative to the stated one: median of `|deviation| / median of its distribution` in squares,
/// interpolated between their middles. `deviation(i)` is `None` where nothing is compared.
pub fn local_scale(
    [width, height]: [usize; 2],
    deviation: &dyn Fn(usize) -> Option<f32>,
    of_median: f32,
) -> impl Fn(usize) -> f32 + use<> {
    let (columns, rows) = (width.div_ceil(SQUARE), height.div_ceil(SQUARE));
    let all = |x: usize, y: usize| {
        let (right, bottom) = ((SQUARE * (x + 1)).min(width), (SQUARE * (y + 1)).min(height));
        let pixels = (SQUARE * y..bottom).flat_map(move |row| (SQUARE * x..right).map(move |c| row * width + c));
        let mut found: Vec<f32> = pixels.filter_map(deviation).collect();
        let enough = found.len() as f64 >= FILLED * ((right - SQUARE * x) * (bottom - SQUARE * y)) as f64;
        quantile(&mut found, 0.5).filter(|_| enough).map(|m| (m / of_median).max(LEAST_SCALE))
    };
    let mut table: Vec<Option<f32>> = (0..columns * rows).map(|k| all(k % columns, k / columns)).collect();
    let mut known: Vec<f32> = table.iter().copied().flatten().collect();
    let usual = quantile(&mut known, 0.5).unwrap_or(1.0);
    table.iter_mut().for_each(|t| *t = t.or(Some(usual)));
    let table: Vec<f32> = table.into_iter().map(|t| t.unwrap_or(usual)).collect();
    move |i| {
        let place = |k: usize, count: usize| {
            let at = ((k as f32 + 0.5) / SQUARE as f32 - 0.5).clamp(0.0, count as f32 - 1.0);
            let low = (at as usize).min(count.saturating_sub(2));
            (low, (low + 1).min(count - 1), at - low as f32)
        };
        let ((x0, x1, tx), (y0, y1, ty)) = (place(i % width, columns), place(i / width, rows));
        let at = |x: usize, y: usize| table[y * columns + x];
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        mix(mix(at(x0, y0), at(x1, y0), tx), mix(at(x0, y1), at(x1, y1), tx), ty)
    }
}

/// A complex number in double precision.
pub fn double(c: Complex32) -> Complex64 {
    Complex64::new(c.re.into(), c.im.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_bend_a_background() {
        let pixels: Vec<usize> = (0..2000).collect();
        let terms = |i: usize, row: &mut Vec<Complex64>| {
            row.clear();
            row.extend(powers([i as f64 / 1000.0 - 1.0, 0.3], 2).map(Complex64::from));
        };
        let truth = |i: usize| Complex64::new(1.0 + 0.2 * (i as f64 / 1000.0 - 1.0), 0.0);
        let noise = |i: usize| 0.01 * (((i * 7919) % 200) as f64 / 100.0 - 1.0);
        let wanted = |i: usize| truth(i) + if i.is_multiple_of(10) { 3.0 } else { noise(i) };
        let found = fitted(&pixels, &terms, &wanted, &|_| 0.01).unwrap();
        for i in [0, 700, 1999] {
            let mut row = vec![];
            terms(i, &mut row);
            assert!((dot(&found, &row) - truth(i)).norm() < 0.003, "{i}");
        }
    }

    #[test]
    fn noise_is_estimated_where_it_is() {
        let scale = local_scale([128, 64], &|i| Some(if i % 128 < 64 { 1.0 } else { 4.0 }), 1.0);
        assert!((scale(5) - 1.0).abs() < 1e-6 && (scale(127) - 4.0).abs() < 1e-6);
    }
}
