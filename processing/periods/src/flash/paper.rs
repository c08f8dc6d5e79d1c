//! The paper's method (2018, sections 4.3 and 4.4), for comparison. A position diffracts where it is brightest, which
//! is the limit of a decreasing threshold. Its orientation is the direction of the highlight in the image.

use super::fit::{Grating, Observed, SPECULAR};
use super::lobe::Lobe;

/// Grating of the brightest copy; `None` without light. `towards` holds the direction from each copy to the highlight.
pub(super) fn brightest(observed: &[Observed], towards: &[[f64; 2]], lobe: &Lobe) -> Option<Grating> {
    let lit = observed.iter().zip(towards).filter(|(o, _)| {
        let [light, variance] = o.light;
        light.is_finite() && light > 6.0 * variance.sqrt() && lobe.at(&o.seen).square(o.seen.half) > SPECULAR * SPECULAR
    });
    let (best, [x, y]) = lit.max_by(|a, b| a.0.light[0].total_cmp(&b.0.light[0]))?;
    let orientation = y.atan2(*x).rem_euclid(std::f64::consts::PI);
    let length = (best.seen.half[0] * orientation.cos() + best.seen.half[1] * orientation.sin()).abs();
    // The lobe's width is the only information about the distance of a bright copy from the peak.
    let width = lobe.at(&best.seen).width();
    (length > 0.0).then(|| Grating { orientation, length, orientation_sigma: width / length, length_sigma: width })
}
