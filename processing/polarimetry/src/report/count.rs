//! Counts and quantiles over all pixels.

use crate::report::json::Pixels;
use crate::{OrientationMaps, StokesMaps};
use rayon::prelude::*;

/// Pixels per block.
const BLOCK: usize = 1 << 20;

/// Counts of one block.
#[derive(Clone, Default)]
struct Count {
    valid: usize,
    saturated: usize,
    correlation: f64,
    /// Histogram of σ over valid pixels, by its upper 16 bits.
    coarse: Vec<u32>,
}

impl Count {
    fn plus(mut self, other: &Self) -> Self {
        self.valid += other.valid;
        self.saturated += other.saturated;
        self.correlation += other.correlation;
        add(&mut self.coarse, &other.coarse);
        self
    }
}

fn add(sum: &mut Vec<u32>, other: &[u32]) {
    sum.resize(other.len(), 0);
    sum.iter_mut().zip(other).for_each(|(a, b)| *a += b);
}

impl Pixels {
    /// Counts of a map.
    pub(crate) fn count(maps: &StokesMaps, map: &OrientationMaps, without_grating: usize) -> Self {
        let pairs = map.orientation.par_chunks(BLOCK).zip(map.sigma.par_chunks(BLOCK));
        let counted = pairs.clone().zip(maps.correlation.par_chunks(BLOCK)).map(|((theta, sigma), correlation)| {
            let mut count = Count { coarse: vec![0; 1 << 16], ..Count::default() };
            for ((theta, sigma), correlation) in theta.iter().zip(sigma).zip(correlation) {
                count.saturated += usize::from(correlation.is_nan());
                if theta.is_finite() {
                    count.valid += 1;
                    count.correlation += f64::from(*correlation);
                    count.coarse[(sigma.to_bits() >> 16) as usize] += 1;
                }
            }
            count
        });
        let counted: Vec<Count> = counted.collect();
        let Count { valid, saturated, correlation, coarse } =
            counted.iter().fold(Count::default(), |all, block| all.plus(block));
        // Positive floats sort as their bits do: the upper half of the quantile is found first, then the lower one.
        let quantile = |q: f64| -> Option<f64> {
            let rank = (q * (valid.checked_sub(1)?) as f64) as usize;
            let (upper, rank) = place(&coarse, rank)?;
            let lower = pairs.clone().map(|(theta, sigma)| {
                let mut fine = vec![0; 1 << 16];
                for (_, sigma) in theta.iter().zip(sigma).filter(|(t, s)| s.to_bits() >> 16 == upper && t.is_finite()) {
                    fine[(sigma.to_bits() & 0xffff) as usize] += 1;
                }
                fine
            });
            let mut fine = vec![];
            lower.collect::<Vec<Vec<u32>>>().iter().for_each(|block| add(&mut fine, block));
            let (lower, _) = place(&fine, rank)?;
            Some(f64::from(f32::from_bits(upper << 16 | lower)).to_degrees())
        };
        let all = map.orientation.len();
        Self {
            all,
            valid,
            saturated,
            without_grating,
            too_little_modulation: (all - valid - saturated).saturating_sub(without_grating),
            sigma_median_deg: quantile(0.5),
            sigma_p90_deg: quantile(0.9),
            correlation_mean: (valid > 0).then_some(correlation / valid.max(1) as f64),
        }
    }
}

/// The bin that contains the `rank`-th number, and its rank there.
fn place(counts: &[u32], mut rank: usize) -> Option<(u32, usize)> {
    for (bin, count) in counts.iter().map(|c| *c as usize).enumerate() {
        if rank < count {
            return Some((bin as u32, rank));
        }
        rank -= count;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::uniform;

    /// Quantiles match those of sorted numbers, over several blocks, with masked pixels excluded.
    #[test]
    fn quantiles_are_those_of_sorted_numbers() {
        for pixels in [0, 1, 2, 1000, BLOCK + 12_345] {
            let sigma: Vec<f32> = (0..pixels).map(|i| (0.2 * uniform(1, i as u64).powi(3)) as f32).collect();
            let carries = |i: &usize| i % 7 != 3;
            let orientation = (0..pixels).map(|i| if carries(&i) { 1.0 } else { f32::NAN }).collect();
            let correlation = (0..pixels).map(|i| if i % 14 == 3 { f32::NAN } else { 0.5 }).collect();
            let maps = StokesMaps { correlation, ..StokesMaps::default() };
            let map = OrientationMaps { width: pixels, height: 1, orientation, sigma };
            let found = Pixels::count(&maps, &map, 0);
            let mut sorted: Vec<f32> = (0..pixels).filter(carries).map(|i| map.sigma[i]).collect();
            sorted.sort_by(f32::total_cmp);
            let wanted = |q: f64| {
                sorted.get((q * sorted.len().saturating_sub(1) as f64) as usize).map(|s| f64::from(*s).to_degrees())
            };
            assert_eq!((found.all, found.valid), (pixels, sorted.len()));
            assert_eq!(found.saturated, (0..pixels).filter(|i| i % 14 == 3).count());
            assert_eq!((found.sigma_median_deg, found.sigma_p90_deg), (wanted(0.5), wanted(0.9)));
            assert_eq!(found.correlation_mean, (!sorted.is_empty()).then_some(0.5));
        }
    }
}
