//! Quantiles of samples and of distributions.

use std::cmp::Ordering;

/// Floating-point numbers, ordered as by `total_cmp`.
pub trait Real: Copy {
    /// Total order of two numbers.
    fn order(&self, other: &Self) -> Ordering;
}

impl Real for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Real for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// Median, the upper one of an even number of values; `None` without values. Reorders the values; linear time.
pub fn median<T: Real>(mut values: impl AsMut<[T]>) -> Option<T> {
    let values = values.as_mut();
    nth(values, values.len() / 2)
}

/// Quantile for a fraction of 0 to 1: the value of rank ⌊share · (n - 1)⌋. `None` without values. Reorders the values.
pub fn quantile<T: Real>(values: &mut [T], share: f64) -> Option<T> {
    nth(values, (share * values.len().saturating_sub(1) as f64) as usize)
}

fn nth<T: Real>(values: &mut [T], rank: usize) -> Option<T> {
    (rank < values.len()).then(|| *values.select_nth_unstable_by(rank, T::order).1)
}

/// Median of χ² (Wilson-Hilferty approximation).
pub fn median_chi_square(freedom: usize) -> f64 {
    chi_square_quantile(freedom, 0.0)
}

/// Quantile of χ² at `z` standard deviations of a normal variable (Wilson and Hilferty 1931), accurate to 1 % from two
/// degrees of freedom on. The median for one is 5 % high, which lowers the noise estimate by as much.
pub fn chi_square_quantile(freedom: usize, z: f64) -> f64 {
    let n = freedom as f64;
    let k = 2.0 / (9.0 * n);
    n * (1.0 - k + z * k.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_of_samples() {
        assert_eq!(median([3.0, 1.0, 2.0_f64]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0, 3.0, 2.0_f32]), Some(3.0));
        assert_eq!(quantile(&mut [4.0, 1.0, 3.0, 2.0_f32], 0.5), Some(2.0));
        assert_eq!(quantile(&mut [4.0, 1.0, 3.0, 2.0_f64], 1.0), Some(4.0));
        assert_eq!(median(Vec::<f64>::new()), None);
        assert_eq!(quantile::<f32>(&mut [], 0.5), None);
    }

    #[test]
    fn chi_square_quantiles_match_tables() {
        for (freedom, z, table) in
            [(1, 0.0, 0.455), (5, 0.0, 4.351), (9, 0.0, 8.343), (9, 3.0902, 27.877), (2, 3.0902, 13.816)]
        {
            let got = chi_square_quantile(freedom, z);
            // 5 % is the known error of the formula at one degree of freedom, the worst case.
            assert!((got / table - 1.0).abs() < 0.06, "{freedom} {z}: {got} {table}");
        }
    }
}
