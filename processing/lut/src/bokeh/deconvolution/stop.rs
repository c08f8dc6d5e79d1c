//! When to stop: iterations first find structure and then fit the noise.
//!
//! The discrepancy principle stops where the misfit equals the noise. But an estimate that has followed the noise with part of
//! its freedom must lie closer to the data than the noise alone, and how much closer is known: were the light even, an iteration
//! would leave of each frequency of the misfit the share `1 - κ |H|²`, whatever is in it, with `H` the transfer of the point spread
//! function. The sum of what is left is the number of degrees of freedom that were not spent. The estimate is then expected to
//! predict another photograph best where `Σ misfit² - 2 · Σ variance · left` is least (Mallows 1973). Iterations go on for a while after
//! that, since it may fall again, and the best one is taken. It depends on differences of the misfit, so that noise known to a
//! few per cent is enough. Pixels near to the edges do not count: what lies beyond can be anything and takes up their misfit.

use super::steps::Weights;

/// Frequencies along each axis.
const FREQUENCIES: usize = 32;

/// Noise that does not grow with light slows an iteration down in the dark, to these shares of its speed.
const SPEEDS: [f64; 6] = [0.02, 0.1, 0.3, 0.6, 0.9, 1.0];

/// What an iteration leaves of the misfit at each frequency.
type Left = Vec<f64>;

/// Degrees of freedom that were not spent yet.
pub(super) struct Freedom {
    power: Vec<f64>,
    /// How much of the photograph, and of its variance, has each speed.
    shares: [[f64; 6]; 2],
    /// Mean variance.
    variance: f64,
    /// Of the estimate, of the one before, and of the point the next one starts from.
    now: [Left; 6],
    before: [Left; 6],
    start: [Left; 6],
}

impl Freedom {
    /// `power` of the point spread function, see [`Psf::power`](super::Psf), and the light of the pixels with the shift.
    pub(super) fn new(power: Vec<f64>, shifted: impl Iterator<Item = f32>, weights: &Weights) -> Self {
        let mut shares = [[0.0; 6]; 2];
        let Weights { shift, slope, rest } = *weights;
        for light in shifted {
            let speed = f64::from((1.0 - shift / light.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0));
            let nearest = SPEEDS.windows(2).take_while(|pair| speed > 0.5 * (pair[0] + pair[1])).count();
            shares[0][nearest] += 1.0;
            shares[1][nearest] += f64::from(slope * light.max(0.0) + rest);
        }
        let sums = shares.map(|s| s.iter().sum::<f64>().max(f64::MIN_POSITIVE));
        let all: [Left; 6] = std::array::from_fn(|_| vec![1.0; power.len()]);
        Self {
            power,
            variance: sums[1] / sums[0],
            shares: [0, 1].map(|of| shares[of].map(|s| s / sums[of])),
            now: all.clone(),
            before: all.clone(),
            start: all,
        }
    }

    /// Frequencies to ask the point spread function for.
    pub(super) fn frequencies() -> usize {
        FREQUENCIES
    }

    /// Mean variance of the photograph.
    pub(super) fn variance(&self) -> f64 {
        self.variance
    }

    /// Share that the next iteration starts with, of pixels and of variance.
    pub(super) fn left(&self) -> [f64; 2] {
        let mean = |left: &Left| left.iter().sum::<f64>() / left.len().max(1) as f64;
        let means = self.start.each_ref().map(mean);
        self.shares.map(|shares| shares.iter().zip(means).map(|(share, left)| share * left).sum())
    }

    /// An iteration, followed by an extrapolation so many times as far as the estimate went.
    pub(super) fn spend(&mut self, extrapolation: f64) {
        for (k, speed) in SPEEDS.iter().enumerate() {
            let next =
                self.start[k].iter().zip(&self.power).map(|(left, power)| left * (1.0 - speed * power)).collect();
            self.before[k] = std::mem::replace(&mut self.now[k], next);
            let pairs = self.now[k].iter().zip(&self.before[k]);
            self.start[k] = pairs.map(|(now, before)| now + extrapolation * (now - before)).collect();
        }
    }
}
