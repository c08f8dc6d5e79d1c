//! Low-rank approximation of matrices.

use nacre_base::random::Stream;
use nalgebra::DMatrix;

/// Oversampling of the sketch, and number of power iterations (Halko, Martinsson and Tropp 2011, section 4.5).
const MORE: usize = 12;
const SHARPENED: usize = 3;

/// Number of updates of a non-negative factorisation.
const UPDATES: usize = 300;

/// `left · rightᵀ`, both scaled by the square root of the singular value.
pub(super) struct Product {
    /// Singular value.
    pub sigma: f64,
    /// One value per row.
    pub left: Vec<f64>,
    /// One value per column.
    pub right: Vec<f64>,
}

/// The largest singular values and their vectors, by a randomised sketch with a fixed seed. The sum over `right` is
/// non-negative, which fixes the signs.
pub(super) fn decompose(matrix: &DMatrix<f64>, most: usize) -> Vec<Product> {
    let (rows, columns) = matrix.shape();
    let width = (most + MORE).min(rows).min(columns);
    let mut random = Stream::of(0);
    let mut q = DMatrix::from_fn(columns, width, |_, _| 2.0 * random.next() - 1.0);
    q = (matrix * q).qr().q();
    for _ in 0..SHARPENED {
        let back = matrix.tr_mul(&q).qr().q();
        q = (matrix * back).qr().q();
    }
    // A small matrix: as many rows as the sketch has columns.
    let svd = q.tr_mul(matrix).svd(true, true);
    let (Some(u), Some(vt)) = (svd.u, svd.v_t) else { return vec![] };
    let left = q * u;
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let product = |k: usize| {
        let sigma = svd.singular_values[k];
        let sign = if vt.row(k).sum() < 0.0 { -1.0 } else { 1.0 };
        let scale = sign * sigma.sqrt();
        Product {
            sigma,
            left: left.column(k).iter().map(|v| v * scale).collect(),
            right: vt.row(k).iter().map(|v| v * scale).collect(),
        }
    };
    order.into_iter().take(most).map(product).collect()
}

/// Non-negative terms (Lee and Seung 2001: multiplicative updates, started from the magnitudes of the singular
/// vectors). `sigma` is the norm of a term.
pub(super) fn nonnegative(matrix: &DMatrix<f64>, rank: usize) -> Vec<Product> {
    let target = matrix.map(|v| v.max(0.0));
    let start = decompose(&target, rank);
    let tiny = 1e-9 * target.max().max(f64::MIN_POSITIVE).sqrt();
    let mut w = DMatrix::from_fn(matrix.nrows(), start.len(), |i, k| start[k].left[i].abs() + tiny);
    let mut h = DMatrix::from_fn(start.len(), matrix.ncols(), |k, j| start[k].right[j].abs() + tiny);
    let update = |old: &mut DMatrix<f64>, up: DMatrix<f64>, down: DMatrix<f64>| {
        old.iter_mut().zip(up.iter().zip(&down)).for_each(|(v, (u, d))| *v *= u / d.max(f64::MIN_POSITIVE));
    };
    for _ in 0..UPDATES {
        let (up, square) = (w.tr_mul(&target), w.tr_mul(&w));
        let down = square * &h;
        update(&mut h, up, down);
        let (up, square) = (&target * h.transpose(), &h * h.transpose());
        let down = &w * square;
        update(&mut w, up, down);
    }
    let mut products: Vec<Product> = (0..start.len())
        .map(|k| {
            let (a, b) = (w.column(k).norm(), h.row(k).norm());
            let balance = (b / a.max(f64::MIN_POSITIVE)).sqrt().max(f64::MIN_POSITIVE);
            Product {
                sigma: a * b,
                left: w.column(k).iter().map(|v| v * balance).collect(),
                right: h.row(k).iter().map(|v| v / balance).collect(),
            }
        })
        .collect();
    products.sort_by(|a, b| b.sigma.total_cmp(&a.sigma));
    products
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rebuilt(products: &[Product], rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |i, j| products.iter().map(|p| p.left[i] * p.right[j]).sum())
    }

    #[test]
    fn discarded_values_are_the_error() {
        let mut random = Stream::of(1);
        let matrix =
            DMatrix::from_fn(60, 45, |i, j| (2.0 * random.next() - 1.0) / (1.0 + (i as f64 - j as f64).powi(2)));
        let all = matrix.clone().svd(false, false).singular_values;
        for rank in [1, 5, 20] {
            let products = decompose(&matrix, rank);
            let error = (&matrix - rebuilt(&products, 60, 45)).norm();
            let least = all.iter().skip(rank).map(|s| s * s).sum::<f64>().sqrt();
            assert!(error < 1.02 * least && error > 0.999_999 * least, "{rank}: {error} {least}");
            assert!(products.iter().all(|p| p.right.iter().sum::<f64>() >= 0.0));
        }
    }

    #[test]
    fn products_are_found_again() {
        let matrix = DMatrix::from_fn(50, 40, |i, j| {
            (i as f64).sin().abs() * (j as f64 * 0.3).cos().abs() + 0.01 * (i * j) as f64
        });
        assert!((&matrix - rebuilt(&decompose(&matrix, 2), 50, 40)).norm() < 1e-9 * matrix.norm());
        let positive = nonnegative(&matrix, 2);
        assert!((&matrix - rebuilt(&positive, 50, 40)).norm() < 0.01 * matrix.norm());
        assert!(positive.iter().all(|p| p.left.iter().chain(&p.right).all(|v| *v >= 0.0)));
        assert!(decompose(&DMatrix::zeros(8, 8), 2).iter().all(|p| p.sigma == 0.0));
    }
}
