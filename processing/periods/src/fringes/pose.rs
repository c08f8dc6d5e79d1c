//! Common errors of periods and orientations from an uncertain geometry, which residuals do not reveal.

use super::optics::Optics;
use nacre_optics::geometry::{Pose, Uncertainty};
use std::f64::consts::PI;

/// Number of directions of grating vectors in the average.
const DIRECTIONS: usize = 12;

/// Relative standard deviation of periods, and standard deviation of orientations in rad, due to the geometry. Root
/// mean square over reachable directions of the grating vector, for gratings of this period in the sample's centre.
/// `None` if the uncertainty of the geometry is unknown.
///
/// First-order propagation of each parameter separately. If both first orders are on the panel, their difference
/// counts, as in the fit, so that errors of the mirror direction alone cancel.
pub fn of_geometry(optics: &Optics, sigma: &Uncertainty, period_um: f64) -> Option<[f64; 2]> {
    let moved = perturbed(optics, sigma);
    if moved.is_empty() {
        return None;
    }
    let q = optics.wavelength_um / period_um;
    let mut squares = [0.0; 2];
    let mut count = 0.0;
    for step in 0..DIRECTIONS {
        let (sin, cos) = (PI * step as f64 / DIRECTIONS as f64).sin_cos();
        let Some(seen) = orders(optics, [q * cos, q * sin]) else { continue };
        count += 1.0;
        for other in &moved {
            let Some([u, v]) = vector(other, &seen) else { continue };
            let along = (u * cos + v * sin) / q - 1.0;
            let across = (v * cos - u * sin) / q;
            squares = [squares[0] + along * along, squares[1] + across * across];
        }
    }
    (count > 0.0).then(|| squares.map(|s| (s / count).sqrt()))
}

/// Panel positions of the first orders; that of the opposite grating vector comes second.
fn orders(optics: &Optics, [u, v]: [f64; 2]) -> Option<[Option<[f64; 2]>; 2]> {
    let place = optics.place([0.0; 3]);
    let lands = |sign: f64| {
        let landing = optics.land(place.point, [place.mirror[0] + sign * u, place.mirror[1] + sign * v])?;
        optics.is_on(landing.at, 0.0).then_some(landing.at)
    };
    let both = [lands(1.0), lands(-1.0)];
    both.iter().any(Option::is_some).then_some(both)
}

/// Grating vector that another geometry derives from these orders.
fn vector(optics: &Optics, seen: &[Option<[f64; 2]>; 2]) -> Option<[f64; 2]> {
    let place = optics.place([0.0; 3]);
    let sines = |at: [f64; 2]| optics.towards(place.point, at);
    let difference = |a: [f64; 2], b: [f64; 2], part: f64| [0, 1].map(|k| part * (a[k] - b[k]));
    match seen {
        [Some(a), Some(b)] => Some(difference(sines(*a), sines(*b), 0.5)),
        [Some(a), None] => Some(difference(sines(*a), place.mirror, 1.0)),
        [None, Some(b)] => Some(difference(place.mirror, sines(*b), 1.0)),
        [None, None] => None,
    }
}

/// Geometries with one parameter at a time displaced by its σ.
fn perturbed(optics: &Optics, sigma: &Uncertainty) -> Vec<Optics> {
    let unit = |k: usize, by: f64| std::array::from_fn::<f64, 3, _>(|i| if i == k { by } else { 0.0 });
    let added = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + b[i]);
    let turned = |k: usize, deg: f64| Pose::from_rotation_vector(unit(k, deg.to_radians()), [0.0; 3]);
    let mut all = vec![];
    for k in 0..3 {
        if let Some(mm) = sigma.panel_mm {
            all.push(Optics { panel_mm: added(optics.panel_mm, unit(k, mm[k])), ..optics.clone() });
        }
        if let Some(deg) = sigma.panel_turn_deg {
            let pose = turned(k, deg[k]);
            all.push(Optics { panel_axes: optics.panel_axes.map(|axis| pose.turn(axis)), ..optics.clone() });
        }
        // The camera defines position and rotation of the sample; in sample coordinates, the camera moves.
        if let Some(mm) = sigma.sample_mm {
            all.push(Optics { viewer_mm: added(optics.viewer_mm, unit(k, mm[k])), ..optics.clone() });
        }
        if let Some(deg) = sigma.sample_turn_deg {
            all.push(Optics { viewer_mm: turned(k, deg[k]).turn(optics.viewer_mm), ..optics.clone() });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::super::optics::tests::facing;
    use super::*;

    #[test]
    fn a_panel_that_is_farther_away_makes_periods_shorter() {
        // Camera above the sample, panel around it: the sine of an order at x is x/√(x² + 250²).
        let optics = Optics { viewer_mm: [0.0, 0.0, 250.0], panel_mm: [0.0, 0.0, 250.0], ..facing() };
        let sigma = Uncertainty { panel_mm: Some([0.0, 0.0, 2.5]), ..Uncertainty::default() };
        let [period, turn] = of_geometry(&optics, &sigma, 3.0).unwrap();
        // 1 % of distance changes the sine by the squared cosine times 1 %.
        let sine = optics.wavelength_um / 3.0;
        let wanted = 0.01 * (1.0 - sine * sine);
        assert!((period / wanted - 1.0).abs() < 0.02 && turn < 1e-9, "{period} {wanted} {turn}");
        // Rotation of the panel about its normal rotates orientations by the same angle.
        let sigma = Uncertainty { panel_turn_deg: Some([0.0, 0.0, 0.3]), ..Uncertainty::default() };
        let [period, turn] = of_geometry(&optics, &sigma, 3.0).unwrap();
        assert!((turn.to_degrees() - 0.3).abs() < 1e-3 && period < 1e-4, "{period} {turn}");
        // A lateral displacement moves both orders equally; the remaining effect is of second order.
        let sigma = Uncertainty { panel_mm: Some([1.0, 0.0, 0.0]), ..Uncertainty::default() };
        let [period, turn] = of_geometry(&optics, &sigma, 3.0).unwrap();
        assert!(period < 1e-4 && turn < 1e-4, "{period} {turn}");
        assert!(of_geometry(&optics, &Uncertainty::default(), 3.0).is_none());
        // No order is within reach.
        assert!(of_geometry(&optics, &sigma, 0.3).is_none());
    }
}
