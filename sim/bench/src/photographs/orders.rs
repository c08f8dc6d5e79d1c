//! Diffraction orders of a homogeneous surface and their efficiencies.
//!
//! Scalar diffraction by a phase profile: a ray with `w = cos θi + cos θr` sees the phase `2π h w / λ`. There is no
//! expansion in powers of the depth.

use num_complex::Complex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A homogeneous surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Surface {
    /// Rectangular cells on a ground, such as an LCD behind its glass.
    Lattice {
        /// Pitch along x and y in µm.
        pitch_um: [f64; 2],
        /// Fill factor of a cell along x and y, as a fraction of the pitch.
        fill: [f64; 2],
        /// Reflected amplitude of the cells, and of the ground between them.
        amplitude: [f64; 2],
        /// Depth of the cells below the ground in µm.
        depth_um: f64,
    },
    /// Straight grooves.
    Grating {
        /// Profile of the grooves.
        profile: Profile,
        /// Period in µm.
        period_um: f64,
        /// Peak-to-peak depth in µm.
        depth_um: f64,
        /// Direction of the grating vector in degrees, anticlockwise from the right.
        angle_deg: f64,
    },
    /// Holographic paper: patches of straight grooves below the resolution, with uniformly spaced directions over
    /// 180°.
    Paper {
        /// Period in µm.
        period_um: f64,
        /// Peak-to-peak depth of the sinusoidal grooves in µm.
        depth_um: f64,
        /// Number of directions.
        directions: u32,
    },
}

/// Profile of grooves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// A sinusoid.
    Sinusoid,
    /// Sawtooth: a linear rise and a vertical drop.
    Blazed,
    /// Pits half as wide as the period, as in a compact disc.
    Rectangular,
}

/// Samples of a profile per period.
const SAMPLES: usize = 1024;

/// Highest diffraction order.
const HIGHEST: i32 = 256;

/// Number of values of w/λ at which efficiencies are computed; between them they are interpolated.
const NODES: usize = 33;

/// Energy of each order relative to the incident light.
pub(super) struct Orders {
    /// Patches: direction of the first axis in rad, and fraction of the area.
    pub patches: Vec<[f64; 2]>,
    /// Period along the patches' axes in µm; infinite without periodicity.
    pub pitch_um: [f64; 2],
    /// Smallest and largest w/λ in 1/µm.
    range: [f64; 2],
    /// Highest orders along the axes.
    count: [i32; 2],
    /// Energies by node, order along y, order along x.
    energy: Vec<f64>,
}

impl Surface {
    /// Orders for w/λ within `range` in 1/µm, up to direction cosines `reach` at the shortest wavelength `least_um`.
    pub(super) fn orders(&self, range: [f64; 2], reach: f64, least_um: f64) -> Orders {
        let pitch_um = match *self {
            Self::Lattice { pitch_um, .. } => pitch_um,
            Self::Grating { period_um, .. } | Self::Paper { period_um, .. } => [period_um, f64::INFINITY],
        };
        let count =
            pitch_um.map(|p| if p.is_finite() { ((reach * p / least_um).ceil() as i32).min(HIGHEST) } else { 0 });
        let patches = match *self {
            Self::Lattice { .. } => vec![[0.0, 1.0]],
            Self::Grating { angle_deg, .. } => vec![[angle_deg.to_radians(), 1.0]],
            Self::Paper { directions, .. } => {
                let n = f64::from(directions.max(1));
                (0..directions.max(1)).map(|k| [PI * f64::from(k) / n, 1.0 / n]).collect()
            }
        };
        let node = |i: usize| range[0] + (range[1] - range[0]) * i as f64 / (NODES - 1) as f64;
        let energy = (0..NODES).flat_map(|i| self.energy(node(i), count)).collect();
        Orders { patches, pitch_um, range, count, energy }
    }

    /// Energy of all orders at one value of w/λ.
    fn energy(&self, s: f64, [m, n]: [i32; 2]) -> Vec<f64> {
        match *self {
            Self::Lattice { fill, amplitude: [cell, ground], depth_um, .. } => {
                let step = Complex::from_polar(cell, -TAU * depth_um * s) - ground;
                let sinc = |k: i32, share: f64| {
                    let x = PI * f64::from(k) * share;
                    if k == 0 { share } else { share * x.sin() / x }
                };
                let at = |j: i32, i: i32| {
                    let whole = if (i, j) == (0, 0) { Complex::from(ground) } else { Complex::from(0.0) };
                    (whole + step * sinc(i, fill[0]) * sinc(j, fill[1])).norm_sqr()
                };
                (-n..=n).flat_map(|j| (-m..=m).map(move |i| at(j, i))).collect()
            }
            Self::Grating { profile, depth_um, .. } => line(profile, depth_um * s, m),
            Self::Paper { depth_um, .. } => line(Profile::Sinusoid, depth_um * s, m),
        }
    }
}

/// Energies of the orders `-m..=m` of a profile; `turns` is its depth times w/λ.
fn line(profile: Profile, turns: f64, m: i32) -> Vec<f64> {
    let height = |x: f64| match profile {
        Profile::Sinusoid => 0.5 * (TAU * x).cos(),
        Profile::Blazed => x,
        Profile::Rectangular => f64::from(u8::from(x < 0.5)),
    };
    let at = |i: usize| (i as f64 + 0.5) / SAMPLES as f64;
    let field: Vec<Complex<f64>> =
        (0..SAMPLES).map(|i| Complex::from_polar(1.0, TAU * turns * height(at(i)))).collect();
    let order = |k: i32| {
        let wave = |i: usize| Complex::from_polar(1.0, -TAU * f64::from(k) * at(i));
        (field.iter().enumerate().map(|(i, f)| f * wave(i)).sum::<Complex<f64>>() / SAMPLES as f64).norm_sqr()
    };
    (-m..=m).map(order).collect()
}

impl Orders {
    /// Energy of an order at this w/λ; 0 for orders that are not computed.
    pub(super) fn at(&self, order: [i32; 2], s: f64) -> f64 {
        let [m, n] = self.count;
        if order[0].abs() > m || order[1].abs() > n {
            return 0.0;
        }
        let span = (self.range[1] - self.range[0]).max(f64::MIN_POSITIVE);
        let place = ((s - self.range[0]) / span * (NODES - 1) as f64).clamp(0.0, (NODES - 1) as f64);
        let (low, share) = ((place as usize).min(NODES - 2), place - (place as usize).min(NODES - 2) as f64);
        let (across, all) = ((2 * m + 1) as usize, ((2 * m + 1) * (2 * n + 1)) as usize);
        let index = (order[1] + n) as usize * across + (order[0] + m) as usize;
        self.energy[low * all + index] * (1.0 - share) + self.energy[(low + 1) * all + index] * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bessel function J of integer order from its integral.
    fn bessel(m: i32, x: f64) -> f64 {
        let n = 2000;
        let at = |k: i32| {
            let t = PI * (f64::from(k) + 0.5) / f64::from(n);
            (f64::from(m) * t - x * t.sin()).cos()
        };
        (0..n).map(at).sum::<f64>() / f64::from(n)
    }

    #[test]
    fn sinusoids_have_bessel_energies_and_nothing_is_lost() {
        for turns in [0.05, 0.2, 0.45] {
            let found = line(Profile::Sinusoid, turns, 12);
            for (k, energy) in (-12..=12).zip(&found) {
                assert!((energy - bessel(k, PI * turns).powi(2)).abs() < 1e-9, "{turns} {k}");
            }
            assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        }
        // A blaze of one wavelength diffracts everything into the first order.
        let blazed = line(Profile::Blazed, 1.0, 3);
        assert!((blazed[4] - 1.0).abs() < 1e-4, "{blazed:?}");
        // A phase step of half a wave between equal halves cancels the zero order.
        let pits = line(Profile::Rectangular, 0.5, 1);
        assert!(pits[1] < 1e-9 && (pits[2] - 4.0 / (PI * PI)).abs() < 1e-4, "{pits:?}");
    }

    #[test]
    fn a_lattice_conserves_energy() {
        let surface =
            Surface::Lattice { pitch_um: [20.0, 20.0], fill: [0.5, 0.5], amplitude: [1.0, 1.0], depth_um: 0.1 };
        let energy: f64 = surface.energy(2.0 / 0.55, [200, 200]).iter().sum();
        // The remaining energy is in orders beyond 200.
        assert!((0.99..=1.0).contains(&energy), "{energy}");
    }
}
