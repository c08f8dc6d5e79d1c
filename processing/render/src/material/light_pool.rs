//! Resampled importance sampling (Talbot et al. 2005): many directions of light are sampled, few of them are traced
//! through the scene.

use crate::vector::V3;

/// Maximum number of directions in a pool.
pub(crate) const MOST: usize = 16;

/// Number of traced directions.
const CHOSEN: usize = 2;

/// Steps of Roberts' low-discrepancy sequences in three and in two dimensions.
const STEPS: [[f64; 3]; 2] = [[0.819_172_513, 0.671_043_607, 0.549_700_478], [0.754_877_666, 0.569_840_291, 0.0]];

/// A direction of light.
#[derive(Clone, Copy, Default)]
pub(crate) struct Candidate {
    /// Direction in the frame of the point, or of its patch.
    pub local: [f64; 3],
    /// Direction in the scene.
    pub towards: V3,
    /// Its colour contribution to the estimate.
    pub part: [f64; 3],
    /// Selection weight: an estimate of the light of its contribution.
    pub weight: f64,
}

/// Candidates for selection.
pub(crate) struct Pool {
    candidates: [Candidate; MOST],
    count: usize,
    sum: f64,
}

impl Pool {
    pub(crate) fn new() -> Self {
        Self { candidates: [Candidate::default(); MOST], count: 0, sum: 0.0 }
    }

    /// Adds a direction; it is dropped if the pool is full or its weight is zero.
    pub(crate) fn add(&mut self, candidate: Candidate) {
        if candidate.weight > 0.0 && self.count < MOST {
            self.candidates[self.count] = candidate;
            self.count += 1;
            self.sum += candidate.weight;
        }
    }

    /// Selects [`CHOSEN`] directions by systematic sampling in proportion to their weights, with a random number from 0
    /// to 1. Calls `each` with the factor that makes the sum of contributions unbiased.
    pub(crate) fn chosen(&self, number: f64, mut each: impl FnMut(&Candidate, f64)) {
        let step = self.sum / CHOSEN as f64;
        let (mut running, mut next) = (0.0, number * step);
        for candidate in &self.candidates[..self.count] {
            running += candidate.weight;
            let mut times = 0;
            while next < running {
                next += step;
                times += 1;
            }
            if times > 0 {
                each(candidate, f64::from(times) * step / candidate.weight);
            }
        }
    }
}

/// Low-discrepancy numbers of the k-th direction of a pool, from those of the first.
pub(crate) fn even<const N: usize>(first: [f64; N], k: usize) -> [f64; N] {
    let steps = STEPS[usize::from(N < 3)];
    std::array::from_fn(|i| (first[i] + k as f64 * steps[i]).fract())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_base::random::Stream;

    /// The expected value over all selections is the sum of all contributions, for any weights.
    #[test]
    fn chosen_directions_stand_for_all() {
        let mut pool = Pool::new();
        let mut truth = 0.0;
        let mut random = Stream::of(3);
        for _ in 0..9 {
            let [weight, part] = random.numbers();
            pool.add(Candidate { part: [part; 3], weight, ..Candidate::default() });
            truth += part;
        }
        pool.add(Candidate { part: [1.0; 3], ..Candidate::default() });
        let (mut sum, n) = (0.0, 10_000);
        for k in 0..n {
            pool.chosen((f64::from(k) + 0.5) / f64::from(n), |one, factor| sum += one.part[0] * factor / f64::from(n));
        }
        assert!((sum / truth - 1.0).abs() < 1e-3, "{sum} {truth}");
    }
}
