//! Alias tables, from which shaders draw an index in proportion to its share.

/// Alias table for shares of mean 1: per index, the probability to keep it, and the alternative index (Walker 1977;
/// Vose 1991).
pub(super) fn draws(mut shares: Vec<f64>) -> Vec<(f64, usize)> {
    let mut found: Vec<(f64, usize)> = (0..shares.len()).map(|k| (1.0, k)).collect();
    let (mut poor, mut rich): (Vec<usize>, Vec<usize>) = (0..shares.len()).partition(|k| shares[*k] < 1.0);
    while let (Some(k), Some(from)) = (poor.pop(), rich.last().copied()) {
        found[k] = (shares[k], from);
        shares[from] -= 1.0 - shares[k];
        if shares[from] < 1.0 {
            rich.pop();
            poor.push(from);
        }
    }
    found
}
