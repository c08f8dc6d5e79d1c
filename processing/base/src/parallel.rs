//! Parallel sums independent of the number of threads.

use rayon::prelude::*;

/// Sum of the items of a parallel iterator, added in their order.
///
/// Rayon's `sum` and `reduce` add partial sums according to the splitting of work, so that the last digits vary between
/// runs. This function stores one number per item until the end: with many cheap items, pass sums of fixed blocks.
///
/// ```
/// use nacre_base::parallel::sum_in_order;
/// use rayon::prelude::*;
///
/// let values: Vec<f32> = (0..10_000).map(|i| i as f32).collect();
/// let block = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>();
/// assert_eq!(sum_in_order(values.par_chunks(1024).map(block)), 49_995_000.0);
/// ```
pub fn sum_in_order(terms: impl IndexedParallelIterator<Item = f64>) -> f64 {
    terms.collect::<Vec<f64>>().iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_is_the_same_for_any_number_of_threads() {
        // Terms of very different magnitude: any other order of additions changes the last digits.
        let term = |i: usize| (i as f64 * 0.618).fract().powi(9) * if i.is_multiple_of(3) { -1e6 } else { 1.0 };
        let one_by_one: f64 = (0..5000).map(term).sum();
        let backwards: f64 = (0..5000).rev().map(term).sum();
        assert_ne!(one_by_one.to_bits(), backwards.to_bits());
        for threads in 1..=4 {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = pool.install(|| sum_in_order((0..5000).into_par_iter().map(term)));
            assert_eq!(found.to_bits(), one_by_one.to_bits(), "{threads} threads");
        }
    }
}
