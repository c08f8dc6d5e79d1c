//! Pixels with responses computed term by term, compared with their solutions.

use super::optics::carrier;
use super::optics::tests::facing;
use super::*;
use std::f64::consts::{PI, TAU};

/// Panel position of light leaving a point of the sample in order `m` of a grating, computed with angles rather than
/// sines.
fn spot(point: [f64; 2], orientation: f64, period_um: f64, m: f64) -> Option<[f64; 2]> {
    let [x, y] = point;
    let to = [-50.0 - x, -y, 250.0];
    let distance = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt();
    let sines = [
        -to[0] / distance + m * 0.56 / period_um * orientation.cos(),
        -to[1] / distance + m * 0.56 / period_um * orientation.sin(),
    ];
    let polar = sines[0].hypot(sines[1]);
    if polar >= 0.99 {
        return None;
    }
    let (reach, azimuth) = (250.0 * polar.asin().tan(), sines[1].atan2(sines[0]));
    let place = [x + reach * azimuth.cos() - 50.0, y + reach * azimuth.sin()];
    (place[0].abs() < 260.0 && place[1].abs() < 160.0).then_some(place)
}

/// Response of a pixel to fringes.
fn answers(fringes: &[[f64; 2]], spots: &[([f64; 2], f64)]) -> Vec<f32> {
    let of = |f: &[f64; 2]| {
        let angle = |at: [f64; 2]| TAU * (f[0] * at[0] + f[1] * at[1]);
        let sum = |part: fn(f64) -> f64| spots.iter().map(|(at, w)| w * part(angle(*at))).sum::<f64>() as f32;
        [sum(f64::cos), sum(f64::sin)]
    };
    fringes.iter().flat_map(of).collect()
}

struct Bench {
    optics: Optics,
    fringes: Vec<[f64; 2]>,
    carriers: Vec<[f64; 2]>,
    search: Search,
}

impl Bench {
    fn new(count: usize) -> Self {
        let optics = Optics { aperture_mm: 0.01, ..facing() };
        let fringes = frequencies(count, 28.0);
        let carriers: Vec<_> = fringes.iter().map(|f| carrier(*f)).collect();
        let search = Search::new(&optics, &carriers);
        Self { optics, fringes, carriers, search }
    }

    fn solve(&self, point: [f64; 2], spots: &[([f64; 2], f64)], demands: Demands) -> Solution {
        let solver = Solver { optics: &self.optics, carriers: &self.carriers, search: &self.search, demands };
        let place = self.optics.place([point[0], point[1], 0.0]);
        let components = answers(&self.fringes, spots);
        let mean = 0.5 * spots.iter().map(|s| s.1).sum::<f64>();
        let rest: Vec<[f32; 1]> = solver.without_mirror(&place, &components).into_iter().map(|v| [v]).collect();
        let mut response = Vec::new();
        self.search.correlate(&rest, &mut response);
        let response: Vec<f32> = response.into_iter().map(|[v]| v).collect();
        solver.solve(&place, &Answer { components: &components, sigma: 0.002, mean }, &response)
    }

    fn orders(&self, point: [f64; 2], orientation: f64, period_um: f64) -> Vec<([f64; 2], f64)> {
        let weights = [(0.0, 0.19), (1.0, 0.33), (-1.0, 0.33), (2.0, 0.06), (-2.0, 0.06)];
        let seen = |(m, w): (f64, f64)| spot(point, orientation, period_um, m).map(|at| (at, w));
        weights.into_iter().filter_map(seen).collect()
    }
}

/// Gratings of all directions and periods are recovered to 0.1 % at any pixel; those out of reach are not recovered at
/// all.
#[test]
fn gratings_come_back() {
    let bench = Bench::new(12);
    let (mut found, mut all) = (0, 0);
    for step in 0..60 {
        let orientation = PI * (f64::from(step) * 0.618).fract();
        let period = 1.25 + 1.75 * (f64::from(step) * 0.414).fract();
        let point = [0.31, 0.73].map(|a| 18.0 * ((f64::from(step) * a).fract() - 0.5));
        let spots = bench.orders(point, orientation, period);
        let (verdict, grating, _) = bench.solve(point, &spots, Demands::default());
        all += 1;
        if verdict != Verdict::Resolved {
            continue;
        }
        let grating = grating.unwrap();
        found += 1;
        assert!((grating.period_um / period - 1.0).abs() < 1e-3, "{period} {grating:?}");
        let turned = (grating.orientation - orientation + 0.5 * PI).rem_euclid(PI) - 0.5 * PI;
        assert!(turned.abs() < 1e-3, "{orientation} {grating:?}");
    }
    assert!(found * 10 >= all * 9, "{found} of {all}");
    // Mirrored light alone, and no light.
    let mirror = [(spot([0.0; 2], 0.0, 1.0, 0.0).unwrap(), 0.5)];
    let (verdict, grating, _) = bench.solve([0.0; 2], &mirror, Demands::default());
    assert!(verdict == Verdict::NoOrder && grating.is_none(), "{verdict:?}");
    assert_eq!(bench.solve([0.0; 2], &[], Demands::default()).0, Verdict::Dark);
}

/// Two gratings in one pixel are not taken for a third one: the pixel is masked, unless one outshines the other.
#[test]
fn two_gratings_are_not_one() {
    let bench = Bench::new(12);
    for step in 0..40 {
        let turn = |k: f64| PI * (f64::from(step) * 0.618 + k).fract();
        let period = |k: f64| 1.25 + 1.75 * (f64::from(step) * 0.414 + k).fract();
        let truths = [(turn(0.0), period(0.0)), (turn(0.37), period(0.53))];
        let point = [3.0, -4.0];
        let mut spots = bench.orders(point, truths[0].0, truths[0].1);
        spots.extend(bench.orders(point, truths[1].0, truths[1].1));
        let (verdict, grating, _) = bench.solve(point, &spots, Demands::default());
        if verdict == Verdict::Resolved {
            let g = grating.unwrap();
            assert!(truths.iter().any(|(_, p)| (g.period_um / p - 1.0).abs() < 0.02), "{truths:?} {g:?}");
        }
    }
}

/// A deviating mirror direction is fitted with the grating, because zero and first orders determine it.
#[test]
fn tilted_surfaces_are_distinguished_from_periods() {
    let bench = Bench::new(12);
    let (orientation, period) = (0.6, 2.0);
    // A displaced sample: all orders are those of a position 0.8 mm to the right.
    let spots = bench.orders([0.8, 0.0], orientation, period);
    let demands = Demands { mirror_sigma: 0.01, ..Demands::default() };
    let (verdict, grating, _) = bench.solve([0.0; 2], &spots, demands);
    let grating = grating.unwrap();
    assert_eq!(verdict, Verdict::Resolved);
    assert!((grating.period_um / period - 1.0).abs() < 3e-3, "{grating:?}");
    assert!(grating.mirror_offset[0].hypot(grating.mirror_offset[1]) > 1e-3, "{grating:?}");
}
