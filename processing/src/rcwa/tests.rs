//! Against truths that share no code with either method: Fresnel, Bessel, energy, reciprocity, point matching.

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

/// The two methods at settings that are ample for dielectrics.
fn both(grating: &Grating, light: &Light, polarization: Polarization) -> [Orders; 2] {
    [
        coordinates(grating, light, polarization, 10).unwrap(),
        slices(grating, light, polarization, 10, 24).unwrap(),
    ]
}

#[test]
fn dielectrics_conserve_energy() {
    for (depth_um, angle) in [(0.05, 0.0), (0.3, 0.4), (0.6, -0.9)] {
        let glass = Grating { below: Complex::from(1.5), ..foil(0.9, depth_um) };
        for polarization in BOTH {
            let [smooth, stairs] = both(&glass, &green(angle), polarization);
            assert!(stairs.transmitted.len() >= 2);
            // The staircase conserves energy exactly for any number of waves, the smooth profile as far as it converged.
            assert!((stairs.total() - 1.0).abs() < 1e-10, "{polarization:?} {depth_um}: {}", stairs.total() - 1.0);
            let smooth_enough = if depth_um < 0.5 { 1e-8 } else { 1e-4 };
            assert!((smooth.total() - 1.0).abs() < smooth_enough, "{polarization:?} {depth_um}: {}", smooth.total() - 1.0);
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

/// Slopes of 1:100 under a metal that reflects all: the scalar theory's Jm² (physics of the 2018 paper's Eq. 2).
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

/// Light sent back along order m returns along the old incidence with the same efficiency.
#[test]
fn orders_are_reciprocal() {
    let (grating, light) = (foil(1.0, 0.2), green(0.3));
    for polarization in BOTH {
        for m in [-2, -1] {
            let forth = both(&grating, &light, polarization);
            let sine = light.angle.sin() + f64::from(m) * 0.56;
            let back = both(&grating, &green((-sine).asin()), polarization);
            for (k, bound) in [(0, 1e-9), (1, 1e-9)] {
                let (a, b) = (forth[k].reflected(m).efficiency, back[k].reflected(m).efficiency);
                assert!((a - b).abs() < bound && a > 1e-3, "{polarization:?} {m} {k}: {a} {b}");
            }
        }
    }
}

/// Plane waves above and below, matched in least squares at points of the surface: Rayleigh's hypothesis, which holds
/// rigorously while the steepest slope πd/Λ is under 0.448.
fn point_matching(grating: &Grating, light: &Light, polarization: Polarization, harmonics: usize) -> Vec<Order> {
    let waves = Waves::new(grating, light, polarization, harmonics).unwrap();
    let (n, points) = (waves.count(), 4 * waves.count());
    let wave = |medium: usize, j: usize, q: Complex<f64>, at: usize| {
        let phase = TAU * at as f64 / points as f64;
        let (height, slope) = (0.5 * waves.depth * phase.cos(), -0.5 * waves.depth * waves.grating * phase.sin());
        // Evanescent waves are scaled to 1 where they are largest.
        let field = (I * waves.alpha[j] * (phase / waves.grating) + I * q * height - q.im.abs() * waves.depth / 2.0).exp();
        [field, field * (q - slope * waves.alpha[j]) * waves.weight(medium)]
    };
    let column = |k: usize| if k < n { (0, k, waves.above[k], 1.0) } else { (1, k - n, -waves.below[k - n], -1.0) };
    let system = DMatrix::from_fn(2 * points, 2 * n, |i, k| {
        let (medium, j, q, sign) = column(k);
        wave(medium, j, q, i % points)[i / points] * sign
    });
    let incident = DVector::from_fn(2 * points, |i, _| {
        -wave(0, harmonics, -waves.above[harmonics], i % points)[i / points]
    });
    let found = system.svd(true, true).solve(&incident, 1e-14).unwrap();
    waves.orders(0, &found.as_slice()[..n])
}

#[test]
fn coordinates_agree_with_point_matching() {
    for (grating, angle) in [(foil(1.0, 0.1), 0.0), (foil(2.0, 0.1), 0.2), (foil(1.0, 0.12), -FRAC_PI_4)] {
        for polarization in BOTH {
            let wanted = point_matching(&grating, &green(angle), polarization, 10);
            let found = coordinates(&grating, &green(angle), polarization, 8).unwrap();
            assert_eq!(wanted.len(), found.reflected.len());
            for (a, b) in wanted.iter().zip(&found.reflected) {
                assert!((a.amplitude - b.amplitude).norm() < 1e-5, "{polarization:?} {grating:?} {a:?} {b:?}");
            }
        }
    }
}
