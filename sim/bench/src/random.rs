//! Stateless random numbers: each is a hash of its inputs. Frames are reproducible to the bit, and pixels can be
//! computed in any order.

/// Hash of 64 bits (the finaliser of SplitMix64, Steele et al. 2014).
pub fn hash(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Combines several values into one key.
pub fn key(parts: &[u64]) -> u64 {
    parts.iter().fold(0, |k, part| hash(k ^ part))
}

/// Uniform deviate in (0, 1).
pub fn uniform(bits: u64) -> f64 {
    ((bits >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

/// Two independent standard normal deviates of a key (Box and Muller 1958).
pub fn normals(key: u64) -> [f64; 2] {
    let (a, b) = (uniform(hash(key)), uniform(hash(key ^ 0x5851_f42d_4c95_7f2d)));
    let (sin, cos) = (std::f64::consts::TAU * b).sin_cos();
    let radius = (-2.0 * a.ln()).sqrt();
    [radius * cos, radius * sin]
}

/// Number of electrons with the given mean, plus Gaussian read noise.
///
/// Poisson deviate by inversion below 40 electrons, its normal limit above (skewness below 0.16).
pub fn electrons(key: u64, mean: f64, read_noise: f64) -> f64 {
    let [shot, read] = normals(key);
    let arrived = if mean < 40.0 {
        poisson(uniform(hash(key ^ 0x1405_7b7e_f767_814f)), mean)
    } else {
        (mean + mean.sqrt() * shot).round()
    };
    arrived + read_noise * read
}

fn poisson(uniform: f64, mean: f64) -> f64 {
    let mut count = 0.0;
    let mut probability = (-mean).exp();
    let mut sum = probability;
    while uniform > sum && count < 200.0 {
        count += 1.0;
        probability *= mean / count;
        sum += probability;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn electrons_have_poisson_and_read_variance() {
        for (mean, read) in [(0.5, 0.0), (5.0, 2.0), (39.0, 0.0), (41.0, 8.0), (20_000.0, 8.0)] {
            let n = 100_000;
            let values: Vec<f64> = (0..n).map(|i| electrons(key(&[3, i]), mean, read)).collect();
            let average = values.iter().sum::<f64>() / n as f64;
            let variance = values.iter().map(|v| (v - average).powi(2)).sum::<f64>() / n as f64;
            let wanted = mean + read * read;
            // Five standard errors of mean and variance.
            assert!((average - mean).abs() < 5.0 * (wanted / n as f64).sqrt(), "{mean}: {average}");
            assert!(
                (variance / wanted - 1.0).abs() < 5.0 * ((2.0 + 1.0 / mean) / n as f64).sqrt(),
                "{mean}: {variance}"
            );
        }
    }
}
