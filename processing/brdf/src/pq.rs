//! Whole repetitions of a patch under an even window (2014 thesis, section 3.6, corrected).
//!
//! The transform of N+1 repetitions is that of one, times `Σ exp(-iwnT)`. The thesis' p and q are 0/0 exactly at the
//! peaks. Dirichlet's kernel `sin((N+1)wT/2)/sin(wT/2)` has the limit N+1 there; its argument is reduced first.
//! Intensities are scaled by p² + q², its square.
//!
//! Between the frequencies of one patch, its transform is interpolated. This is exact with all of them and the kernel
//! `sin(πδL)/(n sin(πδp))`; here it uses the nearest, or is linear.

use super::bank::{Bank, Scratch};
use std::f64::consts::PI;

/// Number of frequencies to either side for the interpolation.
const NEAREST: isize = 4;

/// Power densities of a repeated patch.
pub(super) struct Pq {
    pub bank: Bank<f64>,
    pub pixels: [usize; 2],
    pub size_um: [f64; 2],
    /// Repetitions to the right and up.
    pub repeats: [usize; 2],
    pub linear: bool,
}

/// Numbers of repetitions next to the coherence length.
pub(super) fn repeats(size_um: [f64; 2], coherence_um: f64) -> [usize; 2] {
    size_um.map(|um| ((coherence_um / um).round() as usize).max(1))
}

/// Largest relative interpolation error of lobes as strong as their neighbours. Within a lobe, neighbouring amplitudes
/// have the weight 1/N over their distance. For fainter lobes, the error grows with the root of the ratio.
pub(super) fn interpolation_error(repeats: [usize; 2], linear: bool) -> f64 {
    let worst = |n: usize| if linear { 2.0 / n as f64 } else { 2.0 / (n as f64 * (NEAREST + 1) as f64) };
    worst(repeats[0]) + worst(repeats[1])
}

/// `sin(πnx)/sin(πx)`, stable at integers x, where it is ±n.
pub(super) fn dirichlet(n: usize, x: f64) -> f64 {
    let whole = x.round();
    let rest = x - whole;
    // sin(πn(m + r)) / sin(π(m + r)) = (-1)^(m(n-1)) sin(πnr)/sin(πr)
    let odd = (n as i64 - 1) % 2 != 0 && (whole as i64) % 2 != 0;
    let sign = if odd { -1.0 } else { 1.0 };
    let small = PI * rest;
    let value = if small.abs() < 1e-9 { n as f64 } else { (n as f64 * small).sin() / small.sin() };
    sign * value
}

impl Pq {
    /// Area of all repetitions in µm²: the power density of a mirror at its peak.
    pub(super) fn area_um2(&self) -> f64 {
        (0..2).map(|k| self.size_um[k] * self.repeats[k] as f64).product()
    }

    /// Power density in µm² at a spatial frequency in 1/µm.
    pub(super) fn density(&self, place: [f64; 2], q: f64, scratch: &mut Scratch<f64>) -> f64 {
        let cycles = [place[0] * self.size_um[0], place[1] * self.size_um[1]];
        let axes: [Vec<(isize, [f64; 2])>; 2] = std::array::from_fn(|k| self.axis(k, cycles[k]));
        let mut sum = [0.0; 2];
        for (iy, wy) in &axes[1] {
            for (ix, wx) in &axes[0] {
                let c = self.bank.amplitude_at([*ix, *iy], q, scratch);
                let weight = product(*wx, *wy);
                let part = product(weight, c);
                sum = [sum[0] + part[0], sum[1] + part[1]];
            }
        }
        // |p + iq|² over the number of repetitions, which share the light.
        let gain: f64 =
            (0..2).map(|k| dirichlet(self.repeats[k], cycles[k]).powi(2) / self.repeats[k] as f64).product();
        self.size_um[0] * self.size_um[1] * gain * (sum[0] * sum[0] + sum[1] * sum[1])
    }

    /// Frequencies along an axis, in cycles per patch, and their weights at a position.
    fn axis(&self, axis: usize, cycles: f64) -> Vec<(isize, [f64; 2])> {
        let n = self.pixels[axis];
        if n == 1 {
            return vec![(0, [1.0, 0.0])];
        }
        let near = cycles.floor() as isize;
        let range = if self.linear { near..=near + 1 } else { near + 1 - NEAREST..=near + NEAREST };
        range
            .map(|i| {
                let delta = cycles - i as f64;
                let size = if self.linear { 1.0 - delta.abs() } else { dirichlet(n, delta / n as f64) / n as f64 };
                // The patch begins at its first pixel; rows count downwards.
                let phase = -PI * delta * (n as f64 - 1.0) / n as f64;
                let phase = if axis == 0 { phase } else { -phase };
                (i, [size * phase.cos(), size * phase.sin()])
            })
            .collect()
    }
}

fn product(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dirichlets_kernel_is_the_sum_it_stands_for() {
        for n in [1_usize, 2, 6, 7, 41] {
            for x in [0.0_f64, 1.0, -3.0, 17.0, 0.1, -0.37, 5.0 + 1e-12, 2.0 - 1e-10, 1e6, 123.456] {
                let sum: num_complex::Complex64 = (0..n)
                    .map(|k| num_complex::Complex64::from_polar(1.0, -2.0 * PI * x.rem_euclid(1.0) * k as f64))
                    .sum();
                assert!((dirichlet(n, x).abs() - sum.norm()).abs() < 1e-6 * n as f64, "{n} {x}");
            }
            assert_eq!(dirichlet(n, 3.0).abs(), n as f64);
        }
    }
}
