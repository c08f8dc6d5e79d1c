//! Differences between pixels: DSNU, PRNU and bad pixels, after EMVA Standard 1288, release 4.0 Linear, section 8.

use crate::series::{Group, values};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use rayon::prelude::*;

/// Side of the square whose mean is removed from each pixel: shading of lens and light is no property of pixels.
const SQUARE: usize = 11;

/// Share of a pixel's variance that its difference from the mean of the square keeps.
const KEPT: f64 = 1.0 - 1.0 / (SQUARE * SQUARE) as f64;

/// Robust standard deviations beyond which a pixel is bad.
const BAD: f64 = 8.0;

/// Smallest deviation of the response of a bad pixel, as a share of its neighbours.
const BAD_RESPONSE: f32 = 0.1;

/// Means of a group, pixel by pixel, in DN.
///
/// # Errors
/// `Input` for files that cannot be read; `Cancelled`.
pub fn mean(group: &Group, channel: usize, progress: &dyn Progress) -> Result<Vec<f32>> {
    let mut sum: Vec<f64> = vec![];
    for file in &group.files {
        let values = values(file, channel, progress)?;
        sum.resize(values.len(), 0.0);
        sum.iter_mut().zip(&values).for_each(|(s, v)| *s += f64::from(*v));
        progress.step();
    }
    Ok(sum.into_iter().map(|s| (s / group.files.len() as f64) as f32).collect())
}

/// Difference of each pixel from the mean of the square around it.
pub fn local(values: &[f32], width: usize) -> Vec<f32> {
    let height = values.len() / width.max(1);
    // Sums of all values above and to the left.
    let mut sums = vec![0.0_f64; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += f64::from(values[y * width + x]);
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
        }
    }
    let half = SQUARE / 2;
    let difference = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (left, right) = (x.saturating_sub(half), (x + half + 1).min(width));
        let (top, bottom) = (y.saturating_sub(half), (y + half + 1).min(height));
        let at = |x: usize, y: usize| sums[y * (width + 1) + x];
        let sum = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
        values[i] - (sum / ((right - left) * (bottom - top)) as f64) as f32
    };
    (0..values.len()).into_par_iter().map(difference).collect()
}

/// Standard deviation between good pixels of local differences in DN, without the temporal noise of their mean.
pub fn scatter(local: &[f32], bad: &[bool], temporal_dn2: f64) -> f64 {
    let good = || local.iter().zip(bad).filter(|(_, bad)| !**bad).map(|(v, _)| f64::from(*v).powi(2));
    let variance = good().sum::<f64>() / good().count().max(1) as f64 / KEPT;
    (variance - temporal_dn2).max(0.0).sqrt()
}

/// Pixels that differ from their neighbours far more than pixels do: in darkness, or in their response to light.
///
/// `dark` and `light` are local differences; `signal` is the mean signal of `light` in DN.
pub fn bad(dark: &[f32], light: &[f32], signal: f32) -> Vec<bool> {
    let spread = |values: &[f32]| {
        let all: Vec<f32> = values.iter().map(|v| v.abs()).collect();
        // The median of the magnitude of a normal distribution is 0.6745 standard deviations.
        f64::from(median(all).unwrap_or(0.0)) / 0.6745
    };
    // A difference below one step of the file is no fault.
    let hot = (BAD * spread(dark)).max(1.0) as f32;
    let weak = ((BAD * spread(light)) as f32).max(BAD_RESPONSE * signal);
    dark.iter().zip(light).map(|(d, l)| d.abs() > hot || l.abs() > weak).collect()
}
