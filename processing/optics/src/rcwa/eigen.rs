//! Eigenvectors of a general complex matrix from its Schur form.

use nacre_base::{Error, Result};
use nalgebra::{DMatrix, Schur};
use num_complex::Complex;

type Matrix = DMatrix<Complex<f64>>;

/// Limit of QR sweeps per row; two or three per eigenvalue are usual.
const SWEEPS_PER_ROW: usize = 100;

/// Eigenvalues and unit eigenvectors (as columns) of a square matrix.
///
/// # Errors
/// If the QR iteration does not converge.
pub(super) fn eigen(matrix: Matrix) -> Result<(Vec<Complex<f64>>, Matrix)> {
    let n = matrix.nrows();
    let schur = Schur::try_new(matrix, f64::EPSILON, SWEEPS_PER_ROW * n)
        .ok_or_else(|| Error::input("grating", "its modes were not found", "change the number of harmonics"))?;
    let (q, t) = schur.unpack();
    let tiny = f64::EPSILON * t.iter().map(|c| c.norm()).fold(0.0, f64::max);
    let mut vectors = DMatrix::zeros(n, n);
    for k in 0..n {
        let value = t[(k, k)];
        vectors[(k, k)] = Complex::from(1.0);
        for i in (0..k).rev() {
            let sum: Complex<f64> = (i + 1..=k).map(|j| t[(i, j)] * vectors[(j, k)]).sum();
            let gap = t[(i, i)] - value;
            // A gap of zero between equal eigenvalues is replaced by a rounding error, as in LAPACK.
            vectors[(i, k)] = -sum / if gap.norm() < tiny { Complex::from(tiny) } else { gap };
        }
    }
    let mut vectors = q * vectors;
    vectors.column_iter_mut().for_each(|mut column| {
        column.unscale_mut(column.norm());
    });
    Ok(((0..n).map(|k| t[(k, k)]).collect(), vectors))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_solve_the_eigenproblem() {
        let n = 30;
        let a = DMatrix::from_fn(n, n, |i, j| {
            Complex::new(((i * 7 + j * 3) % 11) as f64 - 5.0, ((i * 5 + j * 13) % 17) as f64 - 8.0)
        });
        let (values, vectors) = eigen(a.clone()).unwrap();
        for (k, value) in values.iter().enumerate() {
            let v = vectors.column(k).into_owned();
            assert!((&a * &v - v * *value).norm() < 1e-11 * a.norm(), "{k}");
        }
        let trace: Complex<f64> = values.iter().sum();
        assert!((trace - a.trace()).norm() < 1e-10);
    }
}
