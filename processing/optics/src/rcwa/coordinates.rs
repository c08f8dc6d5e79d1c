//! Coordinate-transformation (Chandezon) method.

use super::eigen::eigen;
use super::{Grating, I, Light, ONE, Orders, Waves, ZERO, propagates};
use nacre_base::{Error, Result};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex;
use std::f64::consts::PI;

type Matrix = DMatrix<Complex<f64>>;

/// Solves for the smooth profile with `2·harmonics + 1` coupled waves.
///
/// With `u = z - h(x)`, Helmholtz's equation for modes `f(x)·exp(iρu)` becomes
/// `(α² - ρ(αh' + h'α) + ρ²(1 + h'h') - k²) f = 0`. This is one eigenproblem of twice the size per medium, and the
/// boundary is the plane u = 0 (Chandezon et al. 1982). Propagating orders enter as exact plane waves (Li et al. 1999).
/// Continuous across the boundary are f and `w·((1 + h'h')ρ - h'α) f`, where w is 1 in TE and 1/ε in TM.
///
/// # Errors
/// `Input` for unphysical parameters, or if the modes of a very steep profile cannot be separated.
pub fn coordinates(
    grating: &Grating,
    light: &Light,
    polarization: super::Polarization,
    harmonics: usize,
) -> Result<Orders> {
    let waves = Waves::new(grating, light, polarization, harmonics)?;
    let n = waves.count();
    let surface = Surface::new(&waves);
    let (up, down) = (surface.modes(0)?, surface.modes(1)?);
    let mut system = Matrix::zeros(2 * n, 2 * n);
    for j in 0..n {
        for i in 0..n {
            system[(i, j)] = up.field[(i, j)];
            system[(i + n, j)] = up.partner[(i, j)];
            system[(i, j + n)] = -down.field[(i, j)];
            system[(i + n, j + n)] = -down.partner[(i, j)];
        }
    }
    let (field, partner) = surface.plane_wave(0, harmonics, -waves.above[harmonics]);
    let incident = DVector::from_fn(2 * n, |i, _| -if i < n { field[i] } else { partner[i - n] });
    let amplitudes = system.lu().solve(&incident).ok_or_else(inseparable)?;
    let of = |plane_waves: &[usize], offset: usize| {
        let mut all = vec![ZERO; n];
        plane_waves.iter().enumerate().for_each(|(column, order)| all[*order] = amplitudes[offset + column]);
        all
    };
    Ok(Orders {
        reflected: waves.orders(0, &of(&up.plane_waves, 0)),
        transmitted: if waves.lossless() { waves.orders(1, &of(&down.plane_waves, n)) } else { Vec::new() },
    })
}

fn inseparable() -> Error {
    Error::input("grating", "it is too steep for its modes to be told apart", "use the staircase instead")
}

/// Outgoing modes: fields and partners at u = 0 as columns, plane waves first.
struct Modes {
    field: Matrix,
    partner: Matrix,
    plane_waves: Vec<usize>,
}

struct Surface<'a> {
    waves: &'a Waves,
    /// Matrices of h' and 1 + h'h'.
    slope: Matrix,
    metric: Matrix,
}

impl<'a> Surface<'a> {
    fn new(waves: &'a Waves) -> Self {
        let n = waves.count();
        // h' = -(dK/2)·sin Kx has the coefficients ±i·dK/4 at ±K; its square has -(dK/4)² at ±2K and 2(dK/4)² at 0.
        let s = waves.depth * waves.grating / 4.0;
        let slope = Matrix::from_fn(n, n, |i, j| match i as i64 - j as i64 {
            1 => I * s,
            -1 => I * -s,
            _ => ZERO,
        });
        let metric = Matrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
            0 => Complex::from(1.0 + 2.0 * s * s),
            2 => Complex::from(-s * s),
            _ => ZERO,
        });
        Self { waves, slope, metric }
    }

    /// Partner field `w·((1 + h'h')ρ - h'α) f`.
    fn partner(&self, medium: usize, field: &DVector<Complex<f64>>, rho: Complex<f64>) -> DVector<Complex<f64>> {
        let tilted = DVector::from_fn(field.len(), |i, _| field[i] * self.waves.alpha[i]);
        (&self.metric * field * rho - &self.slope * tilted) * self.waves.weight(medium)
    }

    /// Plane wave of order index `j` and vertical wave number `q`; `exp(iqz)` on the surface is a Bessel series.
    fn plane_wave(&self, medium: usize, j: usize, q: Complex<f64>) -> (DVector<Complex<f64>>, DVector<Complex<f64>>) {
        let x = q.re * self.waves.depth / 2.0;
        let field = DVector::from_fn(self.waves.count(), |i, _| {
            let order = i as i32 - j as i32;
            Complex::from_polar(libm::jn(order, x), PI / 2.0 * f64::from(order))
        });
        let partner = self.partner(medium, &field, q);
        (field, partner)
    }

    /// Modes that leave the surface upwards (medium 0) or downwards (medium 1).
    fn modes(&self, medium: usize) -> Result<Modes> {
        let (n, side) = (self.waves.count(), if medium == 0 { 1.0 } else { -1.0 });
        let vertical = if medium == 0 { &self.waves.above } else { &self.waves.below };
        let plane_waves: Vec<usize> = (0..n).filter(|j| propagates(vertical[*j])).collect();
        let (values, vectors) = eigen(self.companion(medium)?)?;
        let mut decaying: Vec<usize> = (0..2 * n).collect();
        decaying.sort_by(|a, b| (side * values[*b].im).total_cmp(&(side * values[*a].im)));
        let (mut field, mut partner) = (Matrix::zeros(n, n), Matrix::zeros(n, n));
        for column in 0..n {
            let (f, g) = match plane_waves.get(column) {
                Some(j) => self.plane_wave(medium, *j, vertical[*j] * side),
                None => {
                    let k = decaying[column - plane_waves.len()];
                    if side * values[k].im <= 0.0 {
                        return Err(inseparable());
                    }
                    let f = vectors.view((0, k), (n, 1)).column(0).into_owned();
                    let f = &f / Complex::from(f.norm());
                    let g = self.partner(medium, &f, values[k]);
                    (f, g)
                }
            };
            field.set_column(column, &f);
            partner.set_column(column, &g);
        }
        Ok(Modes { field, partner, plane_waves })
    }

    /// Companion matrix: the quadratic eigenproblem in ρ as a linear one for (f, ρf).
    fn companion(&self, medium: usize) -> Result<Matrix> {
        let (n, alpha) = (self.waves.count(), &self.waves.alpha);
        let inverse = self.metric.clone().try_inverse().ok_or_else(inseparable)?;
        let beta =
            Matrix::from_fn(n, n, |i, j| if i == j { self.waves.eps[medium] - alpha[i] * alpha[i] } else { ZERO });
        let shear = Matrix::from_fn(n, n, |i, j| self.slope[(i, j)] * (alpha[i] + alpha[j]));
        let (low, high) = (&inverse * beta, inverse * shear);
        Ok(Matrix::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
            (true, true) => ZERO,
            (true, false) => {
                if j - n == i {
                    ONE
                } else {
                    ZERO
                }
            }
            (false, true) => low[(i - n, j)],
            (false, false) => high[(i - n, j - n)],
        }))
    }
}
