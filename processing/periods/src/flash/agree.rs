//! Neighbours that agree: what a polygon's pixels say together.
//!
//! At an edge copies see more or less of a polygon, by where their pixels lie, so that its outermost pixels are known less well than those
//! beside them, which have the same grooves. Each pixel becomes the mean of its neighbours that agree with it, weighted by their variance;
//! its σ is not smaller for it, since neighbours share much of their error. A pixel that few neighbours agree with is masked: copies
//! that lie beside each other make such pixels, print seldom does.

use super::fit::{Found, Grating, Why};
use std::f64::consts::{FRAC_PI_2, PI};

/// Neighbours agree within so many standard deviations.
const AGREE: f64 = 4.0;

/// Neighbours that must agree with a pixel for it to be believed: where two polygons meet, a few pixels see both, and what explains them is
/// neither; they come in pairs that agree with each other.
const VOUCHING: usize = 3;

/// At an edge each copy sees a part of its own of the polygon beside, so that its light scatters more than the fit knows: σ is so
/// many times as large. Measured on simulated sheets.
const AT_EDGE: f64 = 3.0;

/// How far that reaches, in pixels.
const REACH: usize = 2;

/// Share of the places with light that must have one grating for any of them to be believed.
const BELIEVED: f64 = 0.2;

/// Masks all where few places with light have one grating: the others are then found by chance, as where periods lie outside of the range
/// that is looked at.
pub(super) fn believed(found: Vec<Found>) -> Vec<Found> {
    let count = |wanted: &dyn Fn(&Found) -> bool| found.iter().filter(|f| wanted(f)).count() as f64;
    let gratings = count(&|f| matches!(f, Found::Grating(_)));
    let others = count(&|f| matches!(f, Found::Masked(Why::Several | Why::Unexplained | Why::Ambiguous)));
    if gratings >= BELIEVED * (gratings + others) {
        return found;
    }
    let none = |f| if let Found::Grating(_) = f { Found::Masked(Why::Unexplained) } else { f };
    found.into_iter().map(none).collect()
}

/// Means over neighbours that agree.
pub(super) fn agreed(found: &[Found], width: usize) -> Vec<Found> {
    let height = found.len() / width.max(1);
    let at = |i: usize| {
        let Found::Grating(own) = &found[i] else { return found[i] };
        let (x, y) = (i % width, i / width);
        let around = (y.saturating_sub(1)..(y + 2).min(height))
            .flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| v * width + u))
            .filter(|k| *k != i);
        let known = around.filter_map(|k| if let Found::Grating(g) = &found[k] { Some(g) } else { None });
        let alike: Vec<&Grating> = known.filter(|g| agree(own, g)).collect();
        if alike.len() < VOUCHING {
            return Found::Masked(Why::Ambiguous);
        }
        let mean = mean(own, &alike);
        if !at_edge(found, width, i, own) {
            return Found::Grating(mean);
        }
        let [orientation_sigma, length_sigma] = [mean.orientation_sigma, mean.length_sigma].map(|s| AT_EDGE * s);
        Found::Grating(Grating { orientation_sigma, length_sigma, ..mean })
    };
    (0..found.len()).map(at).collect()
}

/// Whether something else, or the tile's end, is near.
fn at_edge(found: &[Found], width: usize, i: usize, own: &Grating) -> bool {
    let (x, y, height) = (i % width, i / width, found.len() / width);
    let ends = x < REACH || y < REACH || x + REACH >= width || y + REACH >= height;
    let same = |k: usize| matches!(&found[k], Found::Grating(g) if agree(own, g));
    ends || !(y - REACH..=y + REACH).all(|v| (x - REACH..=x + REACH).all(|u| same(v * width + u)))
}

/// Pixels whose neighbours all have the same grating.
pub(super) fn firm(found: &[Found], width: usize) -> Vec<bool> {
    let of = |i: usize| matches!(&found[i], Found::Grating(own) if !at_edge(found, width, i, own));
    (0..found.len()).map(of).collect()
}

/// `to - from`, the short way around.
fn turn(from: f64, to: f64) -> f64 {
    (to - from + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2
}

fn agree(a: &Grating, b: &Grating) -> bool {
    let within = |off: f64, s: f64, t: f64| off.abs() <= AGREE * s.hypot(t);
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
    fn polygons_keep_their_own_and_lonely_pixels_are_masked() {
        // Two polygons, either side of the seam at 180°, an uncertain pixel at the edge, and one that is like neither.
        let mut map: Vec<Found> = (0..36).map(|i| grating(if i % 6 < 3 { 0.01 } else { 3.0 }, 0.001)).collect();
        map[14] = grating(0.01 - 0.02 + PI, 0.01);
        map[22] = grating(1.5, 0.001);
        let found = agreed(&map, 6);
        let at = |k: usize| if let Found::Grating(g) = found[k] { Some(g.orientation) } else { None };
        assert!((at(14).unwrap() - 0.01).abs() < 2e-3, "{:?}", at(14));
        assert_eq!(at(22), None);
        assert!((0..36).filter(|k| ![14, 22].contains(k)).all(|k| {
            let wanted = if k % 6 < 3 { 0.01 } else { 3.0 };
            turn(wanted, at(k).unwrap()).abs() < 1e-3
        }));
    }
}
