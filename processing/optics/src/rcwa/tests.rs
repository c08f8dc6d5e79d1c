//! Comparison with references that share no code with either method: Fresnel, Bessel, energy, reciprocity, point
//! matching.

use super::*;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::FRAC_PI_4;

const BOTH: [Polarization; 2] = [Polarization::Te, Polarization::Tm];

fn foil(period_um: f64, depth_um: f64) -> Grating {
    Grating { period_um, depth_um, above: 1.0, below: ALUMINIUM }
}

fn green(angle: f64) -> Light {
    Light { wavelength_nm: 560.0, angle }
}

/// Solutions of both methods at settings that are ample for dielectrics.
fn both(grating: &Grating, light: &Light, polarization: Polarization) -> [Orders; 2] {
    [coordinates(grating, light, polarization, 10).unwrap(), slices(grating, light, polarization, 10, 24).unwrap()]
}

#[test]
fn dielectrics_conserve_energy() {
    for (depth_um, angle) in [(0.05, 0.0), (0.3, 0.4), (0.6, -0.9)] {
        let glass = Grating { below: Complex::from(1.5), ..foil(0.9, depth_um) };
        for polarization in BOTH {
            let [smooth, stairs] = both(&glass, &green(angle), polarization);
            assert!(stairs.transmitted.len() >= 2);
            // The staircase conserves energy exactly for any number of waves, the smooth profile within its
            // convergence.
            assert!((stairs.total() - 1.0).abs() < 1e-10, "{polarization:?} {depth_um}: {}", stairs.total() - 1.0);
            let smooth_enough = if depth_um < 0.5 { 1e-8 } else { 1e-4 };
            assert!(
                (smooth.total() - 1.0).abs() < smooth_enough,
                "{polarization:?} {depth_um}: {}",
                smooth.total() - 1.0
            );
        }
    }
}

#[test]
fn flat_surfaces_reflect_as_fresnel_says() {
    for (below, angle) in [(ALUMINIUM, 0.0_f64), (ALUMINIUM, 1.0), (Complex::from(1.5), 0.6)] {
        let flat = Grating { below, above: 1.2, ..foil(0.8, 0.0) };
        let (n1, n2) = (1.2_f64, below);
        let cos2 = (1.0 - (n1 * angle.sin() / n2).powi(2)).sqrt();
        let s = (n1 * angle.cos() - n2 * cos2) / (n1 * angle.cos() + n2 * cos2);
        let p = (n2 * angle.cos() - n1 * cos2) / (n2 * angle.cos() + n1 * cos2);
        for (polarization, wanted) in [(Polarization::Te, s), (Polarization::Tm, p)] {
            for orders in both(&flat, &green(angle), polarization) {
                assert!((orders.reflected(0).amplitude - wanted).norm() < 1e-12, "{polarization:?} {angle}");
                assert!(orders.reflected(1).efficiency < 1e-24);
            }
        }
    }
}

/// Slopes of 1:100 in a perfect reflector: efficiencies Jm² of scalar theory (from the 2018 paper's Eq. 2).
#[test]
fn wide_periods_give_the_scalar_bessel_efficiencies() {
    let silver = Complex::new(0.001, 100.0);
    let wide = Grating { below: silver, ..foil(20.0, 0.1) };
    for polarization in BOTH {
        let found = coordinates(&wide, &green(0.0), polarization, 42).unwrap();
        for m in -3..=3 {
            let wanted = libm::jn(m, TAU / 0.56 * 0.1).powi(2);
            let got = found.reflected(m).efficiency;
            assert!((got - wanted).abs() < 3e-3 * wanted.max(0.01), "{polarization:?} {m}: {got} {wanted}");
        }
    }
}

/// Light sent back along order m returns along the incident direction with the same efficiency.
#[test]
fn orders_are_reciprocal() {
    let (metal, light) = (foil(1.0, 0.2), green(0.3));
    let glass = Grating { below: Complex::from(1.5), ..metal };
    for polarization in BOTH {
        for m in [-2, -1] {
            let back = green(-(light.angle.sin() + f64::from(m) * 0.56).asin());
            let smooth = |light| coordinates(&metal, light, polarization, 12).unwrap().reflected(m).efficiency;
            let (a, b) = (smooth(&light), smooth(&back));
            assert!((a - b).abs() < 1e-8 && a > 1e-3, "{polarization:?} {m}: {a} {b}");
            // The two problems are truncated differently, so the staircase is reciprocal within its convergence only.
            let stairs = |light| slices(&glass, light, polarization, 16, 16).unwrap().reflected(m).efficiency;
            let (a, b) = (stairs(&light), stairs(&back));
            assert!((a - b).abs() < 1e-2 * a && a > 1e-4, "{polarization:?} {m}: {a} {b}");
        }
    }
}

/// On glass both methods converge to the same result.
#[test]
fn the_staircase_converges_to_the_smooth_profile() {
    let glass = Grating { below: Complex::from(1.5), ..foil(1.0, 0.1) };
    for polarization in BOTH {
        let wanted = coordinates(&glass, &green(0.2), polarization, 8).unwrap().reflected(0).efficiency;
        let error = |count| {
            slices(&glass, &green(0.2), polarization, 16, count).unwrap().reflected(0).efficiency / wanted - 1.0
        };
        let (coarse, fine) = (error(6), error(24));
        assert!(fine.abs() < 1e-3 && fine.abs() < 0.25 * coarse.abs(), "{polarization:?}: {coarse} {fine}");
    }
}

/// Staircase codes give Rs 0.513 and Rp 0.374 for this foil. Rs is right; Rp has the error of the stairs. Our staircase
/// agrees at the same number of slices. The smooth profile has 0.3801 by point matching and by the coordinate method.
#[test]
fn aluminium_foil_of_1_micrometre() {
    let (foil, light) = (foil(1.0, 0.1), green(0.0));
    let near = |got: f64, wanted: f64, relative: f64| assert!((got / wanted - 1.0).abs() < relative, "{got} {wanted}");
    near(slices(&foil, &light, Polarization::Te, 20, 16).unwrap().reflected(0).efficiency, 0.513, 5e-3);
    near(slices(&foil, &light, Polarization::Tm, 20, 16).unwrap().reflected(0).efficiency, 0.374, 1.5e-2);
    near(solve(&foil, &light, Polarization::Te, 1e-6).unwrap().reflected(0).efficiency, 0.513, 5e-3);
    let matched = |polarization| {
        let orders = point_matching(&foil, &light, polarization, 12);
        orders.iter().find(|o| o.m == 0).unwrap().efficiency
    };
    for polarization in BOTH {
        let found = solve(&foil, &light, polarization, 1e-6).unwrap();
        near(found.reflected(0).efficiency, matched(polarization), 1e-5);
    }
}

/// Predicted errors hold against a much finer setting.
#[test]
fn predicted_errors_hold() {
    for (period, depth, wanted) in [(1.0, 0.1, 1e-3), (0.7, 0.3, 1e-4), (2.0, 0.6, 1e-2)] {
        for polarization in BOTH {
            let found = solve(&foil(period, depth), &green(0.3), polarization, wanted).unwrap();
            let truth = coordinates(&foil(period, depth), &green(0.3), polarization, 16).unwrap();
            for order in &truth.reflected {
                let off = (order.amplitude - found.reflected(order.m).amplitude).norm();
                assert!(off <= found.predicted_error && found.predicted_error <= wanted, "{found:?} {order:?} {off}");
            }
        }
    }
}

#[test]
fn impossible_requests_are_refused() {
    let deep = foil(0.4, 5.0);
    assert!(solve(&deep, &green(0.0), Polarization::Tm, 1e-6).is_err());
    for bad in [foil(-1.0, 0.1), foil(1.0, f64::NAN), Grating { below: Complex::new(1.0, -6.0), ..foil(1.0, 0.1) }] {
        assert!(solve(&bad, &green(0.0), Polarization::Te, 1e-3).is_err(), "{bad:?}");
    }
    assert!(RatioTable::new(&foil(1.0, 0.1), [2.0, 1.0], 560.0, 0.01).is_err());
}

#[test]
fn a_mirror_has_the_ratio_minus_one() {
    let mirror = ratio(&foil(1.0, 0.0), 560.0, 1e-9).unwrap();
    assert!((mirror + ONE).norm() < 1e-9 && contrast(mirror).abs() < 1e-9, "{mirror}");
}

/// The offset equals that of the Jones calculus and depends on the period.
#[test]
fn the_offset_is_what_the_jones_calculus_shows() {
    use crate::polarization::{Jones, JonesVector, angle_difference};
    let of = |period| ratio(&foil(period, 0.1), 560.0, 1e-6).unwrap();
    for period in [0.7, 1.0, 2.0] {
        let light = Jones::grating(0.0, of(period)).apply(JonesVector::circular()).stokes();
        assert!(angle_difference(light.aolp(), phase_offset(of(period))).abs() < 1e-12);
    }
    let apart = angle_difference(phase_offset(of(2.0)), phase_offset(of(1.0))).to_degrees();
    assert!((apart - 7.6).abs() < 0.1, "{apart}");
}

/// Between nodes, anomalies included, the error of the table is within its prediction.
#[test]
fn tables_are_as_good_as_they_say() {
    let film = Grating { above: 1.468, ..foil(1.0, 0.1) };
    let table = RatioTable::new(&film, [0.7, 1.3], 560.0, 0.01).unwrap();
    assert!(table.error() <= 0.0101, "{}", table.error());
    for k in 0..150 {
        let period_um = 0.7 + 0.6 * (f64::from(k) + 0.37) / 150.0;
        let wanted = ratio(&Grating { period_um, ..film }, 560.0, 1e-4).unwrap();
        let off = (table.at(period_um).unwrap() - wanted).norm();
        assert!(off <= table.error(), "{period_um}: {off}");
    }
    assert!(table.at(0.69).is_none() && table.at(1.31).is_none() && table.at(1.3).is_some());
}

/// Plane waves above and below, matched by least squares at surface points. This relies on Rayleigh's hypothesis, which
/// holds rigorously for steepest slopes πd/Λ below 0.448.
fn point_matching(grating: &Grating, light: &Light, polarization: Polarization, harmonics: usize) -> Vec<Order> {
    let waves = Waves::new(grating, light, polarization, harmonics).unwrap();
    let (n, points) = (waves.count(), 4 * waves.count());
    let wave = |medium: usize, j: usize, q: Complex<f64>, at: usize| {
        let phase = TAU * at as f64 / points as f64;
        let (height, slope) = (0.5 * waves.depth * phase.cos(), -0.5 * waves.depth * waves.grating * phase.sin());
        // Evanescent waves are scaled to 1 at their maximum.
        let field =
            (I * waves.alpha[j] * (phase / waves.grating) + I * q * height - q.im.abs() * waves.depth / 2.0).exp();
        [field, field * (q - slope * waves.alpha[j]) * waves.weight(medium)]
    };
    let column = |k: usize| if k < n { (0, k, waves.above[k], 1.0) } else { (1, k - n, -waves.below[k - n], -1.0) };
    let system = DMatrix::from_fn(2 * points, 2 * n, |i, k| {
        let (medium, j, q, sign) = column(k);
        wave(medium, j, q, i % points)[i / points] * sign
    });
    let incident =
        DVector::from_fn(2 * points, |i, _| -wave(0, harmonics, -waves.above[harmonics], i % points)[i / points]);
    let found = system.svd(true, true).solve(&incident, 1e-14).unwrap();
    waves.orders(0, &found.as_slice()[..n])
}

#[test]
fn coordinates_agree_with_point_matching() {
    for (grating, angle) in [(foil(1.0, 0.1), 0.0), (foil(2.0, 0.1), 0.2), (foil(1.0, 0.12), -FRAC_PI_4)] {
        for polarization in BOTH {
            let wanted = point_matching(&grating, &green(angle), polarization, 14);
            let found = coordinates(&grating, &green(angle), polarization, 8).unwrap();
            assert_eq!(wanted.len(), found.reflected.len());
            for (a, b) in wanted.iter().zip(&found.reflected) {
                assert!((a.amplitude - b.amplitude).norm() < 1e-5, "{polarization:?} {grating:?} {a:?} {b:?}");
            }
        }
    }
}

/// Comparison with Chandezon's method for a perfect reflector; energy conservation for a cross-section beyond its
/// scope.
#[test]
fn perfect_conductors_lose_nothing_and_agree_with_coordinates() {
    let silver = Complex::new(0.0, 400.0);
    for (period, depth, angle) in [(1.0, 0.1, 0.0), (1.6, 0.2, -0.5), (2.5, 0.2, 0.9)] {
        for polarization in BOTH {
            let found = conductor(&[[depth / 2.0, 0.0]], period, &green(angle), polarization, 16).unwrap();
            let metal = Grating { below: silver, ..foil(period, depth) };
            let wanted = coordinates(&metal, &green(angle), polarization, 16).unwrap();
            assert!((found.total() - 1.0).abs() < 1e-9, "{polarization:?} {period}: {}", found.total() - 1.0);
            for (a, b) in found.reflected.iter().zip(&wanted.reflected) {
                // The difference is due to the metal's impedance of 1/400.
                assert!((a.efficiency - b.efficiency).abs() < 0.01, "{polarization:?} {period} {depth}: {a:?} {b:?}");
            }
        }
    }
    let teeth = [[0.0, -0.06], [0.01, -0.025], [0.0, -0.01]];
    for polarization in BOTH {
        let there = conductor(&teeth, 1.6, &green(0.4), polarization, 20).unwrap();
        // Asymmetric teeth converge too, more slowly than sinusoids.
        let coarse = conductor(&teeth, 1.6, &green(0.4), polarization, 10).unwrap();
        let lost = [coarse.total() - 1.0, there.total() - 1.0];
        assert!(lost[1].abs() < 1e-5 && lost[1].abs() < 0.1 * lost[0].abs(), "{polarization:?}: {lost:?}");
        let back = conductor(&teeth, 1.6, &green(-(0.4_f64.sin() - 0.35).asin()), polarization, 20).unwrap();
        let [a, b] = [there.reflected(-1).efficiency, back.reflected(-1).efficiency];
        assert!((a - b).abs() < 1e-5 && a > 0.01, "{polarization:?}: {a} {b}");
    }
    assert!(conductor(&[[f64::NAN, 0.0]], 1.0, &green(0.0), Polarization::Te, 5).is_err());
}
