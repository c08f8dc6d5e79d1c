//! Lens blur.

use rayon::prelude::*;

/// Separable Gaussian of `sigma` pixels in place; edges repeat. Nothing happens below 0.01 pixels.
pub fn gaussian(plane: &mut Vec<f32>, width: usize, sigma: f64) {
    if sigma < 0.01 || plane.is_empty() {
        return;
    }
    let radius = (4.0 * sigma).ceil() as i64;
    let weights: Vec<f64> = (-radius..=radius).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let weights: Vec<f32> = weights.iter().map(|w| (w / sum) as f32).collect();
    let height = plane.len() / width;
    let source = std::mem::take(plane);
    let at = |i: i64, limit: usize| i.clamp(0, limit as i64 - 1) as usize;
    let mut rows = vec![0.0_f32; source.len()];
    rows.par_chunks_mut(width).zip(source.par_chunks(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            *out = weights.iter().zip(-radius..).map(|(w, i)| w * row[at(x as i64 + i, width)]).sum();
        }
    });
    let mut result = source;
    result.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        out.fill(0.0);
        for (w, i) in weights.iter().zip(-radius..) {
            let row = &rows[at(y as i64 + i, height) * width..][..width];
            out.iter_mut().zip(row).for_each(|(o, v)| *o += w * v);
        }
    });
    *plane = result;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_keeps_light_and_has_the_asked_width() {
        let (width, sigma) = (65, 2.0);
        let mut plane = vec![0.0; width * width];
        plane[32 * width + 32] = 1.0;
        gaussian(&mut plane, width, sigma);
        let sum: f32 = plane.iter().sum();
        let variance: f32 = plane.iter().enumerate().map(|(i, v)| v * ((i % width) as f32 - 32.0).powi(2)).sum();
        assert!((sum - 1.0).abs() < 1e-5 && (variance - 4.0).abs() < 0.02, "{sum} {variance}");
    }
}
