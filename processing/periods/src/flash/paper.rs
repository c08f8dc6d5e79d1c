//! The paper's way (2018, sections 4.3 and 4.4), to be charted against: a place is said to diffract where it is brightest, which is what
//! lowering a threshold until it appears comes to; its orientation is the direction of the highlight in the image.

use super::fit::{Grating, Observed, SPECULAR};
use super::lobe::Lobe;

/// The grating of the brightest copy; `towards` is the direction from each copy's place to the highlight. None without light.
pub(super) fn brightest(observed: &[Observed], towards: &[[f64; 2]], lobe: &Lobe) -> Option<Grating> {
    let lit = observed.iter().zip(towards).filter(|(o, _)| {
        let [light, variance] = o.light;
        light.is_finite() && light > 6.0 * variance.sqrt() && lobe.at(&o.seen).square(o.seen.half) > SPECULAR * SPECULAR
    });
    let (best, [x, y]) = lit.max_by(|a, b| a.0.light[0].total_cmp(&b.0.light[0]))?;
    let orientation = y.atan2(*x).rem_euclid(std::f64::consts::PI);
    let length = (best.seen.half[0] * orientation.cos() + best.seen.half[1] * orientation.sin()).abs();
    // A bright copy lies within a lobe: nothing more is known of it.
    let width = lobe.at(&best.seen).width();
    (length > 0.0).then(|| Grating { orientation, length, orientation_sigma: width / length, length_sigma: width })
}
