//! Whether a photograph's pixels are fine enough for what they show.

use super::photograph::Photograph;
use super::plane::Plane;

/// Most pixels that are looked at.
const PIXELS: usize = 40_000;

/// Nearer to the zero order than this part of the shorter side nothing is looked at: it is brighter than all else.
const INSIDE: f64 = 0.15;

/// Root mean square error of the photograph between its pixels, over its own light there. None where nothing can be told.
///
/// Every second pixel of every second row alone leaves pixels in between, where the error of interpolation is seen. With all pixels it is
/// smaller; by how much was found for Gaussian orders of 0.6 to 4 pixels (0.17 to 3·10⁻⁵, to a factor of 1.7). A table's entries,
/// which are sums along a line, are about twice as good. Noise counts as well.
pub(super) fn between_pixels(p: &Photograph, center: [f64; 2]) -> Option<f64> {
    let (width, height) = (p.width.div_ceil(2), p.height.div_ceil(2));
    let half: Vec<f32> = (0..width * height).map(|i| p.light[i / width * 2 * p.width + i % width * 2]).collect();
    let plane = Plane::new(&half, width, height);
    let every = (width * height / PIXELS).max(1);
    let inside = INSIDE * p.width.min(p.height) as f64;
    let (mut square, mut all) = (0.0, 0.0);
    for i in (0..width * height).step_by(every) {
        let (x, y) = (2 * (i % width) + 1, 2 * (i / width) + 1);
        let Some(light) = p.light.get(y * p.width + x).copied().filter(|_| x < p.width).map(f64::from) else {
            continue;
        };
        let [found, known] = plane.at(0.5 * x as f32, 0.5 * y as f32);
        let far = (x as f64 - center[0]).hypot(y as f64 - center[1]) > inside;
        if far && known == 1.0 && light.is_finite() {
            square += (f64::from(found) - light).powi(2);
            all += light * light;
        }
    }
    let halved = (all > 0.0).then(|| (square / all).sqrt())?;
    Some(halved * (0.024 + 0.18 * halved * halved))
}
