//! One pixel, or a row of them, from all photographs.

/// Standard deviation over the median absolute deviation of a normal distribution.
const OF_MAD: f32 = 1.4826;

/// Least standard deviation in steps of the code: that of rounded values of which half are equal.
const LEAST_STEPS: f32 = 0.75;

/// Least standard deviation of a pixel, over the median one of its row: few values can agree by chance.
const LEAST_OF_ROW: f32 = 0.5;

/// Fewer values show no outlier.
const LEAST_VALUES: usize = 4;

/// Rounds of clipping; each uses the values that the last one kept.
const ROUNDS: usize = 5;

/// A pixel of the stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Mean of the values that were kept; NaN without any.
    pub mean: f32,
    /// Their median.
    pub median: f32,
    /// Their standard deviation, that of one photograph; NaN where one was kept.
    pub sigma: f32,
    /// Number of values that were kept.
    pub kept: usize,
    /// Number of finite values.
    pub given: usize,
}

/// A row: `photographs[k][x]` becomes `row[x]`. Values further than `clip` standard deviations from the median are rejected; `step` is the
/// distance of two codes, 0 for floating-point files.
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
        let mut scatter: Vec<f32> = values.iter().filter(|v| v.len() >= LEAST_VALUES).map(|v| robust(v)).collect();
        scatter.sort_unstable_by(f32::total_cmp);
        let of_row = scatter.get(scatter.len() / 2).copied().unwrap_or(0.0);
        let least = (LEAST_OF_ROW * of_row).max(LEAST_STEPS * step);
        values.iter_mut().for_each(|v| *v = clipped(v, clip as f32, least).to_vec());
    }
    values.iter().zip(given).map(|(v, given)| pixel(v, given)).collect()
}

/// Values without outliers; they are sorted, so that outliers are at the ends.
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

/// Standard deviation of sorted values, of which up to half may be outliers.
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
    Pixel { mean: mean as f32, median: median(sorted), sigma: sigma as f32, kept: n, given }
}
