//! Adaptive sampling. Half of the passes are distributed in proportion to the pixels' standard deviation, which
//! minimises the error for a number of samples (Neyman 1934), the other half evenly.
//!
//! A rim, a lobe's flank or a glint concentrates most of a picture's noise in few pixels. The noise estimate of a
//! pixel's own samples is correlated with their mean. A choice based on it biases pixels towards dark, because those
//! without a bright sample so far receive no more. The estimate therefore uses the neighbouring pixels, and every pixel
//! keeps a positive share.

use crate::picture::pixel::Pixel;
use nacre_base::random::Stream;
use rayon::prelude::*;

/// Evenly distributed passes per noise-weighted pass. The noise of calm and dark pixels, which counts little in a mean
/// but is visible, thus rises by at most √2.
const EVEN: f64 = 1.0;

/// Share of the even passes for pixels without any light.
const UNLIT: f64 = 0.1;

/// Radius in pixels of the neighbourhood for the noise estimate: a larger one reduces the feedback of a pixel's
/// estimate through its neighbours.
const AROUND: usize = 2;

/// Maximum number of passes of a pixel at once.
const MOST: f64 = 255.0;

/// Noise estimate from the neighbours of a pixel.
#[derive(Clone, Copy, Default)]
pub(crate) struct Others {
    /// Standard deviation of passes.
    pub deviation: f64,
    /// Whether any neighbour has light.
    pub lit: bool,
}

impl Others {
    pub(crate) fn of<'a>(pixels: impl Iterator<Item = &'a Pixel>) -> Self {
        let (mut sum, mut count, mut lit) = (0.0, 0.0_f64, false);
        for p in pixels {
            sum += p.squares.max(0.0) / f64::from(p.passes.max(2) - 1);
            count += 1.0;
            lit |= p.luminance > 0.0;
        }
        Self { deviation: (sum / count.max(1.0)).sqrt(), lit }
    }
}

/// Weights of pixels.
pub(crate) fn weights(others: &[Others]) -> Vec<f64> {
    let lit = others.iter().filter(|o| o.lit).count().max(1);
    let even = EVEN * others.iter().map(|o| o.deviation).sum::<f64>() / lit as f64;
    others.iter().map(|o| o.deviation + even * if o.lit { 1.0 } else { UNLIT }).collect()
}

/// Weights of a picture's pixels, from their neighbours.
pub(crate) fn picture_weights(pixels: &[Pixel], width: usize) -> Vec<f64> {
    let rows = pixels.len() / width.max(1);
    let near = |at: usize, n: usize| at.saturating_sub(AROUND)..(at + AROUND + 1).min(n);
    let around = |k: usize| {
        let (x, y) = (k % width, k / width);
        let places = near(y, rows).flat_map(|j| near(x, width).map(move |i| j * width + i));
        Others::of(places.filter(|other| *other != k).map(|other| &pixels[other]))
    };
    let others: Vec<Others> = (0..pixels.len()).into_par_iter().map(around).collect();
    weights(&others)
}

/// Number of further passes of each pixel, in total as many as there are lit pixels, after `rounds` rounds.
pub(crate) fn adaptive_passes(pixels: &[Pixel], width: usize, rounds: usize) -> Vec<u8> {
    let weights = picture_weights(pixels, width);
    let all: f64 = weights.iter().sum();
    if all <= 0.0 {
        return vec![1; pixels.len()];
    }
    let lit = pixels.iter().filter(|p| p.luminance > 0.0).count().max(1) as f64;
    let done: f64 = pixels.iter().map(|p| f64::from(p.passes)).sum();
    let share = (done + lit) / all;
    let wanted: Vec<f64> =
        weights.iter().zip(pixels).map(|(w, p)| (w * share - f64::from(p.passes)).clamp(0.0, MOST)).collect();
    let scale = lit / wanted.iter().sum::<f64>().max(1e-300);
    let round = |(k, wanted): (usize, f64)| {
        // Fractions of a pass are rounded at random.
        (wanted * scale.min(1.0) + Stream::new(k, usize::MAX - 1 - rounds).next()).min(MOST) as u8
    };
    wanted.into_iter().enumerate().map(round).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noisy_places_get_most_and_none_gets_nothing() {
        let pixel = |k: usize| {
            let (x, y) = (k % 32, k / 32);
            let noisy = (10..14).contains(&x) && (10..14).contains(&y);
            Pixel { luminance: 1.0, squares: if noisy { 300.0 } else { 0.03 }, passes: 4, ..Pixel::default() }
        };
        let mut pixels: Vec<Pixel> = (0..32 * 32).map(pixel).collect();
        let mut total = vec![0_usize; pixels.len()];
        for round in 0..40 {
            let found = adaptive_passes(&pixels, 32, round);
            let sum: usize = found.iter().map(|n| usize::from(*n)).sum();
            assert!((900..1150).contains(&sum), "{sum}");
            for ((pixel, total), n) in pixels.iter_mut().zip(&mut total).zip(found) {
                *total += usize::from(n);
                // The variance stays the same.
                pixel.squares *= f64::from(pixel.passes + u32::from(n) - 1) / f64::from(pixel.passes - 1);
                pixel.passes += u32::from(n);
            }
        }
        let (inside, outside) = (total[12 * 32 + 12], total[25 * 32 + 25]);
        assert!(inside > 15 * outside && outside >= 10, "{inside} {outside}");
        let dark = vec![Pixel { passes: 4, ..Pixel::default() }; 64];
        assert!(adaptive_passes(&dark, 8, 4).iter().all(|n| *n == 1));
    }

    /// Where bright samples are rare, a pixel without one appears calm and dark.
    #[test]
    fn rare_bright_samples_are_not_lost() {
        let glints = |k: usize| (6..18).contains(&(k % 24)) && (6..18).contains(&(k / 24));
        let (mut sum, mut count, trials) = (0.0, 0.0, 40);
        for trial in 0..trials {
            let mut pixels = vec![Pixel::default(); 24 * 24];
            for round in 0..24 {
                let counts = if round < 4 { vec![1; 24 * 24] } else { adaptive_passes(&pixels, 24, round) };
                for (k, (pixel, n)) in pixels.iter_mut().zip(counts).enumerate() {
                    for _ in 0..n {
                        let chance = Stream::new(trial * 1000 + k, pixel.passes as usize).next();
                        let light = if glints(k) { f64::from(chance < 0.02) / 0.02 } else { 1.0 + 0.1 * chance };
                        pixel.add(([light; 3], light));
                    }
                }
            }
            let inside = pixels.iter().enumerate().filter(|(k, _)| glints(*k));
            inside.for_each(|(_, p)| (sum, count) = (sum + p.luminance, count + 1.0));
        }
        // Each glint pixel has about 90 passes of mean 1 and variance 49.
        let (bias, sigma) = (sum / count - 1.0, (49.0_f64 / 90.0 / count).sqrt());
        println!("{bias:.4}, chance {sigma:.4}");
        assert!(bias.abs() < 0.05, "{bias} {sigma}");
    }
}
