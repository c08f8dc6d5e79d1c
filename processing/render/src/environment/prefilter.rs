//! Prefiltered environments, evaluated in the mirror direction (2017 TOG, section 6.2).

use super::reference::dot;
use super::{Environment, Frame};

/// Radiance reflected towards `view`, from an environment prefiltered for surfaces that face its directions
/// ([`two_pass`](super::two_pass) or [`facing`](super::facing)). It is exact for `view` along the normal. `corrected`
/// multiplies by cos³ θ, the decrease of `(1 + ωi·ωo)² / cos θo` in the mirror direction towards grazing angles; the
/// paper omits it.
pub fn prefiltered(filtered: &Environment, frame: &Frame, view: [f64; 3], corrected: bool) -> [f32; 3] {
    let cos = dot(frame.normal, view);
    if cos <= 0.0 {
        return [0.0; 3];
    }
    let mirror: [f64; 3] = std::array::from_fn(|k| 2.0 * cos * frame.normal[k] - view[k]);
    let factor = if corrected { cos.powi(3) as f32 } else { 1.0 };
    filtered.radiance(mirror).map(|v| v * factor)
}
