//! One pixel, or a row of them, from all photographs.

/// Standard deviation over the median absolute deviation of a normal distribution.
const OF_MAD: f32 = 1.4826;

/// Least standard deviation in steps of the code: that of rounded values of which half are equal.
const LEAST_STEPS: f32 = 0.75;

/// Pixels on either side in the order of brightness whose median standard deviation is the least one of a pixel: few values can agree by
/// chance, and noise depends on brightness.
const ALIKE: usize = 16;

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
    pub kept: u32,
    /// Number of finite values.
    pub given: u32,
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
        let least = of_alike_pixels(&values);
        for (v, least) in values.iter_mut().zip(least) {
            *v = clipped(v, clip as f32, least.max(LEAST_STEPS * step)).to_vec();
        }
    }
    values.iter().zip(given).map(|(v, given)| pixel(v, given)).collect()
}

/// For each pixel the median standard deviation of those that are about as bright.
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
    Pixel { mean: mean as f32, median: median(sorted), sigma: sigma as f32, kept: n as u32, given: given as u32 }
}
