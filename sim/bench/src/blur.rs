//! Lens blur.

use rayon::prelude::*;

/// Radius in pixels that the blur reaches; 0 for σ below 0.01 pixels.
pub fn reach(sigma: f64) -> usize {
    if sigma < 0.01 { 0 } else { (4.0 * sigma).ceil() as usize }
}

/// Convolves a picture with a separable Gaussian of `sigma` pixels.
///
/// The picture has a margin of [`reach`] on all sides, as the lens also brings in light from beyond the edges; the
/// result has none. `width` includes the margins.
pub fn gaussian(plane: &[f32], width: usize, sigma: f64) -> Vec<f32> {
    let reach = reach(sigma);
    let weights: Vec<f64> =
        (0..=2 * reach).map(|i| (-0.5 * ((i as f64 - reach as f64) / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let weights: Vec<f32> = if reach == 0 { vec![1.0] } else { weights.iter().map(|w| (w / sum) as f32).collect() };
    let inner = width - 2 * reach;
    let mut rows = vec![0.0_f32; plane.len() / width * inner];
    rows.par_chunks_mut(inner).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        for (out, around) in out.iter_mut().zip(row.windows(weights.len())) {
            *out = weights.iter().zip(around).map(|(w, v)| w * v).sum();
        }
    });
    let mut result = vec![0.0; rows.len() - 2 * reach * inner];
    result.par_chunks_mut(inner).enumerate().for_each(|(y, out)| {
        for (w, row) in weights.iter().zip(rows[y * inner..].chunks(inner)) {
            out.iter_mut().zip(row).for_each(|(o, v)| *o += w * v);
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_keeps_light_and_has_the_asked_width() {
        let (width, sigma) = (65, 2.0);
        let with_margins = width + 2 * reach(sigma);
        let mut plane = vec![0.0; with_margins * with_margins];
        plane[with_margins * with_margins / 2] = 1.0;
        let plane = gaussian(&plane, with_margins, sigma);
        assert_eq!(plane.len(), width * width);
        let sum: f32 = plane.iter().sum();
        let variance: f32 = plane.iter().enumerate().map(|(i, v)| v * ((i % width) as f32 - 32.0).powi(2)).sum();
        assert!((sum - 1.0).abs() < 1e-5 && (variance - 4.0).abs() < 0.02, "{sum} {variance}");
    }

    /// The blur of a crop with margin equals the crop of the blur, and a uniform picture stays uniform up to its
    /// edges.
    #[test]
    fn edges_see_what_is_beyond_them() {
        let sigma = 0.5;
        let value = |x: usize, y: usize| if x < 8 { 1.0 } else { 2.0 + (y % 3) as f32 };
        let picture = |left: usize, width: usize| {
            let margin = reach(sigma);
            let with_margins = width + 2 * margin;
            let plane: Vec<f32> =
                (0..with_margins * 20).map(|i| value(left + i % with_margins, i / with_margins)).collect();
            gaussian(&plane, with_margins, sigma)
        };
        let (whole, part) = (picture(0, 16), picture(5, 6));
        for (whole, part) in whole.chunks(16).zip(part.chunks(6)) {
            assert_eq!(whole[5..11], *part);
            assert!((whole[0] - 1.0).abs() < 1e-6, "{whole:?}");
        }
        assert_eq!(gaussian(&[1.0, 2.0, 3.0, 4.0], 2, 0.0), [1.0, 2.0, 3.0, 4.0]);
    }
}
