//! Picture of the histogram.

use super::distribution::Distribution;
use nacre_image::{Canvas, scalar_picture};

/// Approximate side of the drawn histogram in pixels.
const SIDE: usize = 540;

/// Draws orientation from 0° (left) to 180° (right) and period from the longest (top). Colours show shares relative to
/// a uniform distribution over the bins.
pub fn picture(found: &Distribution, relative: bool) -> Canvas {
    let (w, h) = (found.orientations, found.periods);
    let zoom = [w, h].map(|n| (SIDE / n).max(1));
    let even = (w * h) as f64;
    let top = found.share.iter().copied().fold(0.0, f64::max) * even;
    let value = |x: usize, y: usize| {
        let at = y / zoom[1] * w + x / zoom[0];
        (found.coverage[at] > 0.0).then(|| (found.share[at] * even) as f32)
    };
    let [low, high] = found.lines_per_um;
    let word = if relative { " (relative)" } else { "" };
    let title = format!(
        "Orientations and periods of the dots\n0° to 180° from left to right, periods{word} from {:.3} µm on top to {:.3} µm",
        1.0 / low,
        1.0 / high
    );
    scalar_picture([w * zoom[0], h * zoom[1]], &value, [0.0, top as f32], "share, 1 is even", &title, None)
}
