//! Stopping rule: iterations first recover structure and then fit noise.
//!
//! The discrepancy principle stops where the misfit equals the noise. An estimate that has fitted part of the noise
//! must be closer to the data than that, by a known amount. For uniform light, an iteration scales each frequency of
//! the residual by `1 - κ |H|²`, with transfer function `H` of the point spread function. The product of these factors
//! over all iterations, summed over frequencies, is the number of unused degrees of freedom.
//!
//! The estimate predicts another photograph best at the minimum of `Σ residual² - 2 · Σ variance · unused` (Mallows
//! 1973). Iterations continue for a while beyond the minimum, which may be local, and the best estimate is kept. The
//! rule depends on differences of the misfit, so that a noise model accurate to a few per cent suffices. Pixels near
//! the edges are excluded: unknown light beyond the edges absorbs their residuals.

use super::steps::Weights;

/// Number of frequencies along each axis.
const FREQUENCIES: usize = 32;

/// Relative convergence speeds κ: signal-independent noise slows convergence in dark pixels.
const SPEEDS: [f64; 6] = [0.02, 0.1, 0.3, 0.6, 0.9, 1.0];

/// Remaining fraction of the residual at each frequency.
type Remaining = Vec<f64>;

/// Unused degrees of freedom.
pub(super) struct Freedom {
    power: Vec<f64>,
    /// Fraction of the pixels, and of the summed variance, in each class of speed.
    shares: [[f64; 6]; 2],
    /// Mean variance.
    variance: f64,
    /// For the estimate, the previous estimate, and the extrapolated start of the next iteration.
    now: [Remaining; 6],
    before: [Remaining; 6],
    start: [Remaining; 6],
}

impl Freedom {
    /// `power` is [`Psf::power`](super::Psf) of the point spread function; `shifted` is the light of the pixels
    /// including the shift.
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
        let all: [Remaining; 6] = std::array::from_fn(|_| vec![1.0; power.len()]);
        Self {
            power,
            variance: sums[1] / sums[0],
            shares: [0, 1].map(|of| shares[of].map(|s| s / sums[of])),
            now: all.clone(),
            before: all.clone(),
            start: all,
        }
    }

    /// Number of frequencies per axis to request from the point spread function.
    pub(super) fn frequencies() -> usize {
        FREQUENCIES
    }

    /// Mean variance of the photograph.
    pub(super) fn variance(&self) -> f64 {
        self.variance
    }

    /// Unused fraction of degrees of freedom at the start of the next iteration, weighted by pixels and by variance.
    pub(super) fn unused(&self) -> [f64; 2] {
        let mean = |left: &Remaining| left.iter().sum::<f64>() / left.len().max(1) as f64;
        let means = self.start.each_ref().map(mean);
        self.shares.map(|shares| shares.iter().zip(means).map(|(share, left)| share * left).sum())
    }

    /// Accounts for one iteration, followed by an extrapolation by `extrapolation` times the last step.
    pub(super) fn account(&mut self, extrapolation: f64) {
        for (k, speed) in SPEEDS.iter().enumerate() {
            let next =
                self.start[k].iter().zip(&self.power).map(|(left, power)| left * (1.0 - speed * power)).collect();
            self.before[k] = std::mem::replace(&mut self.now[k], next);
            let pairs = self.now[k].iter().zip(&self.before[k]);
            self.start[k] = pairs.map(|(now, before)| now + extrapolation * (now - before)).collect();
        }
    }
}
