//! Combination of single pixels and rows over all photographs.

/// Ratio of standard deviation to median absolute deviation of a normal distribution.
const OF_MAD: f32 = 1.4826;

/// Minimum standard deviation in quantisation steps: that of rounded values of which half are equal.
const LEAST_STEPS: f32 = 0.75;

/// Number of neighbours on either side in order of brightness. Their median standard deviation is the lower bound for a
/// pixel, because few values can agree by chance and noise depends on brightness.
const ALIKE: usize = 16;

/// Minimum number of values for outlier detection.
const LEAST_VALUES: usize = 4;

/// Number of clipping iterations; each uses the values kept by the previous one.
const ROUNDS: usize = 5;

/// A pixel of the stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Mean of the kept values; NaN without any.
    pub mean: f32,
    /// Median of the kept values.
    pub median: f32,
    /// Standard deviation of the kept values, thus of one photograph; NaN for a single value.
    pub sigma: f32,
    /// Number of kept values.
    pub kept: u32,
    /// Number of finite values.
    pub given: u32,
}

/// Combines a row: `photographs[k][x]` becomes `row[x]`. Values more than `clip` standard deviations from the median
/// are rejected; `step` is the quantisation step, 0 for floating-point files.
pub fn row(photographs: &[Vec<f32>], clip: Option<f64>, step: f32) -> Vec<Pixel> {
    let columns = photographs.first().map_or(0, Vec::len);
    let mut values: Vec<Vec<f32>> = (0..columns)
        .map(|x| {
            let mut all: Vec<f32> = photographs.iter().map(|p| p[x]).filter(|v| v.is_finite()).collect();
            all.sort_unstable_by(f32::total_cmp);
            all
        })
        .collect();
    let given: Vec<usize> = values.iter().map(Vec::len).collect();
    if let Some(clip) = clip.filter(|_| photographs.len() >= LEAST_VALUES) {
        let least = of_alike_pixels(&values);
        for (v, least) in values.iter_mut().zip(least) {
            *v = clipped(v, clip as f32, least.max(LEAST_STEPS * step)).to_vec();
        }
    }
    values.iter().zip(given).map(|(v, given)| pixel(v, given)).collect()
}

/// For each pixel, the median standard deviation of pixels of similar brightness.
fn of_alike_pixels(values: &[Vec<f32>]) -> Vec<f32> {
    let mut order: Vec<usize> = (0..values.len()).filter(|x| values[*x].len() >= LEAST_VALUES).collect();
    let middles: Vec<f32> = values.iter().map(|v| median(v)).collect();
    order.sort_by(|a, b| middles[*a].total_cmp(&middles[*b]));
    let scatter: Vec<f32> = order.iter().map(|x| robust(&values[*x])).collect();
    let mut least = vec![0.0; values.len()];
    for (place, x) in order.iter().enumerate() {
        let mut alike = scatter[place.saturating_sub(ALIKE)..(place + ALIKE + 1).min(scatter.len())].to_vec();
        alike.sort_unstable_by(f32::total_cmp);
        least[*x] = median(&alike);
    }
    least
}

/// Values without outliers; the input is sorted, so outliers are at its ends.
fn clipped(values: &[f32], clip: f32, least: f32) -> &[f32] {
    let mut kept = values;
    for _ in 0..ROUNDS {
        if kept.len() < LEAST_VALUES {
            break;
        }
        let (middle, reach) = (median(kept), clip * robust(kept).max(least));
        let first = kept.partition_point(|v| *v < middle - reach);
        let end = kept.partition_point(|v| *v <= middle + reach);
        if end - first == kept.len() {
            break;
        }
        kept = &kept[first..end];
    }
    kept
}

/// Median of sorted values.
fn median(sorted: &[f32]) -> f32 {
    let n = sorted.len();
    match n {
        0 => f32::NAN,
        _ if n % 2 == 1 => sorted[n / 2],
        _ => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

/// Standard deviation of sorted values; robust for up to half outliers.
fn robust(sorted: &[f32]) -> f32 {
    let middle = median(sorted);
    let mut away: Vec<f32> = sorted.iter().map(|v| (v - middle).abs()).collect();
    away.sort_unstable_by(f32::total_cmp);
    OF_MAD * median(&away)
}

fn pixel(sorted: &[f32], given: usize) -> Pixel {
    let n = sorted.len();
    let mean = sorted.iter().map(|v| f64::from(*v)).sum::<f64>() / n as f64;
    let squares: f64 = sorted.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum();
    let sigma = if n > 1 { (squares / (n - 1) as f64).sqrt() } else { f64::NAN };
    Pixel { mean: mean as f32, median: median(sorted), sigma: sigma as f32, kept: n as u32, given: given as u32 }
}
