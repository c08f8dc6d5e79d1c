//! Checks the stated layout of a polarization sensor against its photographs. Intensities behind two crossed polarizers
//! add up to the total light, so `I(0°) + I(90°) = I(45°) + I(135°)` in every block. A layout that violates this while
//! another one satisfies it is wrong.

use super::sample::Sample;
use crate::fit::views::View;
use nacre_base::statistics::median;
use nacre_frames::LoadedFrames;

/// The three ways to pair the four pixels of a block (row by row), and a layout for each in which the pairs are
/// crossed.
const PAIRINGS: [([usize; 4], &str); 3] =
    [([0, 3, 1, 2], "90,45,135,0"), ([0, 1, 2, 3], "0,90,45,135"), ([0, 2, 1, 3], "0,45,90,135")];

/// A pairing is preferred to the stated one if its typical mismatch is smaller by this factor.
const CLEARLY_BETTER: f64 = 3.0;

/// Largest deviation of crossed angles from 90°, in degrees.
const CROSSED_DEG: f64 = 1.0;

/// Warning if another layout fits clearly better than the stated one.
pub(crate) fn contradiction(frames: &LoadedFrames, views: &[View], sample: &Sample) -> Option<String> {
    let layout = frames.set.filters()?.angles;
    let crossed = |a: usize, b: usize| ((layout[a] - layout[b]).rem_euclid(180.0) - 90.0).abs() < CROSSED_DEG;
    let stated = PAIRINGS.iter().position(|([a, b, c, d], _)| crossed(*a, *b) && crossed(*c, *d))?;
    let mismatch: Vec<f64> =
        PAIRINGS.iter().map(|(pairing, _)| typical_mismatch(pairing, views, sample)).collect::<Option<_>>()?;
    let best = (0..PAIRINGS.len()).min_by(|a, b| mismatch[*a].total_cmp(&mismatch[*b]))?;
    if mismatch[best] * CLEARLY_BETTER >= mismatch[stated] {
        return None;
    }
    let listed = layout.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let name = PAIRINGS[best].1;
    Some(format!(
        "the layout {listed} contradicts the photographs: I(0°) + I(90°) and I(45°) + I(135°) differ by {:.1} % of their sum in a typical block; {name} or one of its turns fits ({:.1} %): correct the layout (nacre import --layout {name})",
        100.0 * mismatch[stated],
        100.0 * mismatch[best]
    ))
}

/// Median of `|Ia + Ib - Ic - Id| / (Ia + Ib + Ic + Id)`.
fn typical_mismatch([a, b, c, d]: &[usize; 4], views: &[View], sample: &Sample) -> Option<f64> {
    let kept = &views[..sample.views().min(views.len())];
    // The four pixels of a block are consecutive views.
    let blocks = (0..kept.len() / 4).filter(|k| kept[4 * k..4 * k + 4].iter().all(|v| v.block > 1));
    let values = blocks.flat_map(|k| {
        let [a, b, c, d] = [a, b, c, d].map(|i| sample.view(4 * k + i));
        (0..a.len()).map(move |i| [a[i], b[i], c[i], d[i]].map(f64::from))
    });
    let relative = |[a, b, c, d]: [f64; 4]| ((a + b - c - d) / (a + b + c + d)).abs();
    median(values.map(relative).filter(|m| m.is_finite()).collect::<Vec<_>>())
}
