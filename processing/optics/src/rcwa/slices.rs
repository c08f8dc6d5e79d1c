//! Rigorous coupled-wave analysis of a staircase of slices, joined from the bottom up.

use super::{Grating, I, Light, ONE, Orders, Polarization, Waves, ZERO};
use nacre_base::{Error, Result};
use nalgebra::DMatrix;
use num_complex::Complex;
use std::f64::consts::PI;

type Matrix = DMatrix<Complex<f64>>;

/// Largest 1-norm of `A·d²` per step: keeps the power series below accurate to rounding.
const LARGEST_STEP: f64 = 1.0;

/// Solves for a staircase of `count` slices with `2·harmonics + 1` coupled waves.
///
/// In a slice, the field f along the grooves and its partner g (`-i ∂f/∂z`, in TM divided by ε) obey `∂f/∂z = i P⁻¹ g`
/// and `∂g/∂z = -i M f`. In TE `M = α² - [ε]` and `P = 1`; in TM `M = α[ε]⁻¹α - 1` and `P = [1/ε]`. By Li's rules, εEx
/// and Ez are continuous across vertical walls.
///
/// The admittance Y, `g = Y f`, starts with the value of the substrate and is propagated upwards. Fields that decay
/// downwards grow upwards, so the wanted solution dominates and errors die out. `cosh` and `sinh` of `√(P⁻¹M)·d` are
/// power series, without eigenvectors.
///
/// # Errors
/// `Input` for unphysical parameters, or for a resonance at which the admittance is infinite.
pub fn slices(
    grating: &Grating,
    light: &Light,
    polarization: Polarization,
    harmonics: usize,
    count: usize,
) -> Result<Orders> {
    let waves = Waves::new(grating, light, polarization, harmonics)?;
    let n = waves.count();
    let diagonal = |medium: usize, q: &[Complex<f64>]| {
        Matrix::from_fn(n, n, |i, j| if i == j { q[i] * waves.weight(medium) } else { ZERO })
    };
    let mut admittance = -diagonal(1, &waves.below);
    let mut through = waves.lossless().then(|| Matrix::identity(n, n));
    for j in (0..count).rev() {
        // Stairs of equal width along x: lowest near crests and troughs, where the width of the metal changes fastest
        // with height.
        let height = |j: usize| 0.5 * waves.depth * (PI * j as f64 / count as f64).cos();
        let thickness = height(j) - height(j + 1);
        if thickness > 0.0 {
            Slice::new(&waves, (j as f64 + 0.5) / count as f64).climb(thickness, &mut admittance, &mut through)?;
        }
    }
    let top = diagonal(0, &waves.above);
    let (up, down) = (&top - &admittance, (&top + &admittance).column(harmonics).into_owned());
    let reflected = up.lu().solve(&down).ok_or_else(resonance)?;
    let half = 0.5 * waves.depth;
    let shift = |q: Complex<f64>| (-I * (q + waves.above[harmonics]) * half).exp();
    let r: Vec<_> = (0..n).map(|j| reflected[j] * shift(waves.above[j])).collect();
    let transmitted = through.map_or(Vec::new(), |through| {
        let mut field = reflected;
        field[harmonics] += ONE;
        let below = through * field;
        let t: Vec<_> = (0..n).map(|j| below[j] * shift(waves.below[j])).collect();
        waves.orders(1, &t)
    });
    Ok(Orders { reflected: waves.orders(0, &r), transmitted })
}

fn resonance() -> Error {
    let problem = "the grating resonates and its admittance is infinite";
    Error::input("grating", problem, "change wavelength, angle or harmonics a little")
}

/// Matrices of a slice, common to all heights in it.
struct Slice {
    /// P⁻¹, M and A = P⁻¹M.
    inverse: Option<Matrix>,
    m: Matrix,
    a: Matrix,
}

impl Slice {
    /// Slice of which a fraction `filling` around x = 0 is the lower medium.
    fn new(waves: &Waves, filling: f64) -> Self {
        let n = waves.count();
        let series = |above: Complex<f64>, below: Complex<f64>| {
            Matrix::from_fn(n, n, |i, j| {
                let q = PI * i.abs_diff(j) as f64;
                let share = if i == j { filling } else { (q * filling).sin() / q };
                (below - above) * share + if i == j { above } else { ZERO }
            })
        };
        let [above, below] = waves.eps;
        let eps = series(above, below);
        let alpha = |i: usize| Complex::from(waves.alpha[i]);
        match waves.polarization {
            Polarization::Te => {
                let m = Matrix::from_fn(n, n, |i, j| -eps[(i, j)] + if i == j { alpha(i) * alpha(i) } else { ZERO });
                Self { inverse: None, a: m.clone(), m }
            }
            Polarization::Tm => {
                // Both Toeplitz matrices describe a passive medium, so they are invertible.
                let invert = |m: Matrix| m.try_inverse().unwrap_or_else(|| Matrix::identity(n, n));
                let (across, along) = (invert(series(ONE / above, ONE / below)), invert(eps));
                let unit = |i, j| if i == j { ONE } else { ZERO };
                let m = Matrix::from_fn(n, n, |i, j| alpha(i) * along[(i, j)] * alpha(j) - unit(i, j));
                Self { a: &across * &m, m, inverse: Some(across) }
            }
        }
    }

    /// Propagates the admittance up by `thickness`, and the transmission matrix with it, in steps for which the series
    /// converges.
    fn climb(&self, thickness: f64, admittance: &mut Matrix, through: &mut Option<Matrix>) -> Result<()> {
        let norm = (0..self.a.ncols()).map(|j| self.a.column(j).iter().map(|c| c.norm()).sum()).fold(0.0, f64::max);
        let steps = (thickness * (norm / LARGEST_STEP).sqrt()).ceil().max(1.0);
        let (cosh, sinh) = hyperbolic(&self.a, thickness / steps);
        // P·cosh·P⁻¹ is the transpose of cosh, because P and M are symmetric.
        let (down, cosh_t) = (&self.m * &sinh * -I, cosh.transpose());
        let side = self.inverse.as_ref().map_or_else(|| sinh.clone(), |p| &sinh * p) * I;
        for _ in 0..steps as usize {
            let field = (&cosh + &side * &*admittance).transpose().lu();
            let partner = (&down + &cosh_t * &*admittance).transpose();
            *admittance = field.solve(&partner).ok_or_else(resonance)?.transpose();
            if let Some(through) = through {
                *through = field.solve(&through.transpose()).ok_or_else(resonance)?.transpose();
            }
        }
        Ok(())
    }
}

/// Series of `cosh(√A d)` and `sinh(√A d)/√A` for ‖A d²‖ ≤ 1: nine terms each; the next would be 1/18! = 2e-16.
fn hyperbolic(a: &Matrix, d: f64) -> (Matrix, Matrix) {
    let x = a * Complex::from(d * d);
    let (x2, n) = (&x * &x, x.nrows());
    let x3 = &x2 * &x;
    let series = |odd: u32| {
        let factor = |k: u32| Complex::from(1.0 / (1..=2 * k + odd).map(f64::from).product::<f64>());
        let block = |k: u32| {
            let mut sum = &x * factor(k + 1) + &x2 * factor(k + 2);
            (0..n).for_each(|i| sum[(i, i)] += factor(k));
            sum
        };
        block(0) + &x3 * (block(3) + &x3 * block(6))
    };
    (series(0), series(1) * Complex::from(d))
}
