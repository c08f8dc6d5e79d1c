//! One grating under an environment: a sum over orders and wavelengths, without a lookup table.
//!
//! Order m of wavelength λ diffracts light from `ωi` to `ωo` where `ωi + ωo` is m λ/a along the grating vector, in the
//! tangential plane. Both sides have the same area of direction cosines. The radiance is therefore multiplied by the
//! order's efficiency, without a Jacobian.

use super::{Environment, Frame};
use nacre_base::{Error, Result};
use nacre_optics::color::{Observer, linear_srgb};
use std::sync::LazyLock;

/// Visible range in nm.
const SEEN_NM: [f64; 2] = [390.0, 720.0];

/// Wavelength step of the tabulated efficiencies in nm; values between are interpolated.
const TABLED_NM: f64 = 5.0;

/// Efficiency below which an order is neglected at all wavelengths.
const LEAST: f64 = 1e-5;

/// Smallest and largest adaptive step in nm.
const STEP_NM: [f64; 2] = [0.25, 20.0];

/// Cumulative response of each channel to an equal-energy spectrum, in steps of 1 nm; 1 at the end.
static SEEN: LazyLock<Vec<[f64; 3]>> = LazyLock::new(|| {
    let mut sum = [0.0; 3];
    let mut all = vec![sum];
    for k in 0..(SEEN_NM[1] - SEEN_NM[0]) as usize {
        let xyz = Observer::Cie1931.at(SEEN_NM[0] + k as f64 + 0.5);
        let weight = linear_srgb(xyz.map(|v| v as f32));
        (0..3).for_each(|c| sum[c] += f64::from(weight[c]));
        all.push(sum);
    }
    all.iter().map(|s| std::array::from_fn(|c| s[c] / sum[c])).collect()
});

/// Maximum number of orders per side.
const ORDERS: usize = 40;

/// A lossless sinusoidal grating.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grating {
    /// Period in µm.
    pub period_um: f64,
    /// Peak-to-peak depth in µm.
    pub depth_um: f64,
    /// Direction of the grating vector, anticlockwise from the frame's tangent, radians.
    pub azimuth: f64,
}

/// Sampling of the wavelengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Steps {
    /// Fixed step in nm (5 in the papers).
    Even(f64),
    /// Steps in which an order moves by this many pixels of the environment.
    Adaptive(f64),
}

impl Grating {
    /// Checks the parameters.
    ///
    /// # Errors
    /// `Input`, which names the parameter.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, value: f64, remedy: &str| Err(Error::input(what, format!("is {value}"), remedy));
        if !(0.3..=1000.0).contains(&self.period_um) {
            return bad("period-um", self.period_um, "give 0.3 to 1000 µm");
        }
        if !(0.0..=2.0).contains(&self.depth_um) {
            return bad("depth-um", self.depth_um, "give 0 to 2 µm");
        }
        if !self.azimuth.is_finite() {
            return bad("azimuth", self.azimuth, "give a number");
        }
        Ok(())
    }

    /// Radiance reflected towards `view`, and number of evaluated environment directions. Each channel of the
    /// environment is assumed to have an equal-energy spectrum. Efficiencies are `J_m²` of the phase amplitude in the
    /// mirror direction, and add up to 1; the power of evanescent orders is lost.
    ///
    /// # Errors
    /// `Input` as [`Self::check`].
    pub fn reflected(
        &self,
        environment: &Environment,
        frame: &Frame,
        view: [f64; 3],
        steps: Steps,
    ) -> Result<([f64; 3], usize)> {
        self.check()?;
        let local = frame.local(view);
        let mut sum = [0.0; 3];
        if local[2] <= 0.0 {
            return Ok((sum, 0));
        }
        let tabled = self.efficiencies(local[2]);
        let (sin, cos) = self.azimuth.sin_cos();
        let pixel = std::f64::consts::PI / environment.height as f64;
        let mut looked_up = 0;
        for (m, efficiencies) in tabled.iter().enumerate() {
            if efficiencies.iter().all(|e| *e < LEAST) {
                continue;
            }
            for order in if m == 0 { vec![0.0] } else { vec![m as f64, -(m as f64)] } {
                let per_nm = order * 1e-3 / self.period_um;
                let step = match steps {
                    Steps::Even(nm) => nm.max(STEP_NM[0]),
                    Steps::Adaptive(pixels) => (pixels * pixel / per_nm.abs()).clamp(STEP_NM[0], STEP_NM[1]),
                };
                let count = ((SEEN_NM[1] - SEEN_NM[0]) / step).ceil() as usize;
                let step = (SEEN_NM[1] - SEEN_NM[0]) / count as f64;
                for k in 0..count {
                    let nm = SEEN_NM[0] + (k as f64 + 0.5) * step;
                    let [before, after] = [nm - 0.5 * step, nm + 0.5 * step].map(seen);
                    let [x, y] = [per_nm * nm * cos - local[0], per_nm * nm * sin - local[1]];
                    let square = x * x + y * y;
                    if square >= 1.0 {
                        continue;
                    }
                    let from = frame.world([x, y, (1.0 - square).sqrt()]);
                    let radiance = environment.radiance(from);
                    let efficiency = at(efficiencies, nm);
                    (0..3).for_each(|c| sum[c] += (after[c] - before[c]) * efficiency * f64::from(radiance[c]));
                    looked_up += 1;
                }
            }
        }
        Ok((sum, looked_up))
    }

    /// Efficiency of orders 0, 1, … at wavelengths [`TABLED_NM`] apart.
    fn efficiencies(&self, cos: f64) -> Vec<Vec<f64>> {
        let count = ((SEEN_NM[1] - SEEN_NM[0]) / TABLED_NM) as usize + 1;
        let phase = |k: usize| std::f64::consts::TAU * cos * self.depth_um * 1e3 / (SEEN_NM[0] + k as f64 * TABLED_NM);
        let most = (phase(0) + 6.0).ceil() as usize;
        (0..=most.min(ORDERS)).map(|m| (0..count).map(|k| libm::jn(m as i32, phase(k)).powi(2)).collect()).collect()
    }
}

/// Cumulative response of each channel up to a wavelength.
fn seen(nm: f64) -> [f64; 3] {
    let place = (nm - SEEN_NM[0]).clamp(0.0, (SEEN.len() - 1) as f64);
    let k = (place as usize).min(SEEN.len() - 2);
    std::array::from_fn(|c| SEEN[k][c] + (place - k as f64) * (SEEN[k + 1][c] - SEEN[k][c]))
}

fn at(tabled: &[f64], nm: f64) -> f64 {
    let place = ((nm - SEEN_NM[0]) / TABLED_NM).clamp(0.0, (tabled.len() - 1) as f64);
    let k = (place as usize).min(tabled.len() - 2);
    tabled[k] + (place - k as f64) * (tabled[k + 1] - tabled[k])
}
