//! Regularisation over neighbouring pixels of the same grating.
//!
//! Near an edge, copies cover different fractions of a polygon, depending on their pixel grids. The outermost pixels
//! are therefore less accurate than their inner neighbours with the same grating. Each pixel becomes the
//! inverse-variance weighted mean of the neighbours that agree with it. Its σ is not reduced, because neighbours share
//! much of their error. A pixel that few neighbours agree with is masked: such pixels result from overlapping copies,
//! but rarely from print.

use super::fit::{Found, Grating, MaskReason};
use std::f64::consts::{FRAC_PI_2, PI};

/// Maximum difference, in standard deviations, of neighbours that agree.
const MAX_SIGMAS: f64 = 4.0;

/// Minimum number of agreeing neighbours of an unmasked pixel. At an edge between polygons a few pixels see both, and
/// the fitted grating is neither; they occur in pairs that agree.
const MIN_AGREEING: usize = 3;

/// Factor on σ near an edge: each copy covers a different fraction of the adjacent polygon, which increases scatter
/// beyond the fit's estimate. Measured on simulated sheets.
const EDGE_SIGMA_FACTOR: f64 = 3.0;

/// Width of that border in pixels.
const EDGE_WIDTH: usize = 2;

/// Minimum fraction of lit positions with a single grating; below, all are masked.
const MIN_GRATING_SHARE: f64 = 0.2;

/// Masks all pixels if few lit positions have a single grating. The remaining ones are then accidental, for instance
/// because true periods lie outside of the searched range.
pub(super) fn mask_accidental(found: Vec<Found>) -> Vec<Found> {
    let count = |wanted: &dyn Fn(&Found) -> bool| found.iter().filter(|f| wanted(f)).count() as f64;
    let gratings = count(&|f| matches!(f, Found::Grating(_)));
    let others =
        count(&|f| matches!(f, Found::Masked(MaskReason::Several | MaskReason::Unexplained | MaskReason::Ambiguous)));
    if gratings >= MIN_GRATING_SHARE * (gratings + others) {
        return found;
    }
    let none = |f| if let Found::Grating(_) = f { Found::Masked(MaskReason::Unexplained) } else { f };
    found.into_iter().map(none).collect()
}

/// Weighted means over neighbours that agree.
pub(super) fn regularised(found: &[Found], width: usize) -> Vec<Found> {
    let height = found.len() / width.max(1);
    let at = |i: usize| {
        let Found::Grating(own) = &found[i] else { return found[i] };
        let (x, y) = (i % width, i / width);
        let around = (y.saturating_sub(1)..(y + 2).min(height))
            .flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| v * width + u))
            .filter(|k| *k != i);
        let known = around.filter_map(|k| if let Found::Grating(g) = &found[k] { Some(g) } else { None });
        let alike: Vec<&Grating> = known.filter(|g| agree(own, g)).collect();
        if alike.len() < MIN_AGREEING {
            return Found::Masked(MaskReason::Ambiguous);
        }
        let mean = mean(own, &alike);
        if !at_edge(found, width, i, own) {
            return Found::Grating(mean);
        }
        let [orientation_sigma, length_sigma] =
            [mean.orientation_sigma, mean.length_sigma].map(|s| EDGE_SIGMA_FACTOR * s);
        Found::Grating(Grating { orientation_sigma, length_sigma, ..mean })
    };
    (0..found.len()).map(at).collect()
}

/// True if another grating, or the tile's border, is nearby.
fn at_edge(found: &[Found], width: usize, i: usize, own: &Grating) -> bool {
    let (x, y, height) = (i % width, i / width, found.len() / width);
    let ends = x < EDGE_WIDTH || y < EDGE_WIDTH || x + EDGE_WIDTH >= width || y + EDGE_WIDTH >= height;
    let same = |k: usize| matches!(&found[k], Found::Grating(g) if agree(own, g));
    ends || !(y - EDGE_WIDTH..=y + EDGE_WIDTH).all(|v| (x - EDGE_WIDTH..=x + EDGE_WIDTH).all(|u| same(v * width + u)))
}

/// Pixels with the same grating in their whole neighbourhood.
pub(super) fn interior(found: &[Found], width: usize) -> Vec<bool> {
    let of = |i: usize| matches!(&found[i], Found::Grating(own) if !at_edge(found, width, i, own));
    (0..found.len()).map(of).collect()
}

/// Angle from `from` to `to`, by the shorter way.
fn turn(from: f64, to: f64) -> f64 {
    (to - from + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2
}

fn agree(a: &Grating, b: &Grating) -> bool {
    let within = |off: f64, s: f64, t: f64| off.abs() <= MAX_SIGMAS * s.hypot(t);
    within(turn(a.orientation, b.orientation), a.orientation_sigma, b.orientation_sigma)
        && within(a.length - b.length, a.length_sigma, b.length_sigma)
}

fn mean(own: &Grating, alike: &[&Grating]) -> Grating {
    let (mut turned, mut longer) = ([0.0; 2], [0.0; 2]);
    for g in alike.iter().copied().chain([own]) {
        let [a, b] = [g.orientation_sigma, g.length_sigma].map(|s| 1.0 / (s * s).max(1e-18));
        turned = [turned[0] + a * turn(own.orientation, g.orientation), turned[1] + a];
        longer = [longer[0] + b * g.length, longer[1] + b];
    }
    let count = (alike.len() + 1) as f64;
    Grating {
        orientation: (own.orientation + turned[0] / turned[1]).rem_euclid(PI),
        length: longer[0] / longer[1],
        orientation_sigma: (count / turned[1]).sqrt(),
        length_sigma: (count / longer[1]).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grating(orientation: f64, sigma: f64) -> Found {
        Found::Grating(Grating { orientation, length: 0.3, orientation_sigma: sigma, length_sigma: 0.01 })
    }

    #[test]
    fn polygons_keep_their_gratings_and_isolated_pixels_are_masked() {
        // Two polygons on both sides of the wrap at 180°, an uncertain pixel at the edge, and an outlier.
        let mut map: Vec<Found> = (0..36).map(|i| grating(if i % 6 < 3 { 0.01 } else { 3.0 }, 0.001)).collect();
        map[14] = grating(0.01 - 0.02 + PI, 0.01);
        map[22] = grating(1.5, 0.001);
        let found = regularised(&map, 6);
        let at = |k: usize| if let Found::Grating(g) = found[k] { Some(g.orientation) } else { None };
        assert!((at(14).unwrap() - 0.01).abs() < 2e-3, "{:?}", at(14));
        assert_eq!(at(22), None);
        assert!((0..36).filter(|k| ![14, 22].contains(k)).all(|k| {
            let wanted = if k % 6 < 3 { 0.01 } else { 3.0 };
            turn(wanted, at(k).unwrap()).abs() < 1e-3
        }));
    }
}
