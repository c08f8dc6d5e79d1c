//! Patches of few periods, whole and cut, compared with closed forms and rigorous theory.

use super::*;
use crate::height::{Profile, Shape, Synthetic};
use nacre_base::progress::Silent;
use nacre_optics::rcwa::{self, ALUMINIUM, Polarization};
use std::f64::consts::PI;

/// Patch with this number of periods along its side.
fn patch(profile: Profile, periods: f64, angle_deg: f64) -> HeightField {
    let (pixels, period_um) = (120, 2.5);
    let pixel_um = periods * period_um / pixels as f64;
    let (shape, angle) = (Shape::Grating(profile), angle_deg.to_radians());
    Synthetic { shape, pixels, pixel_um, period_um, depth_um: 0.2, angle }.field().unwrap()
}

fn checked(field: &HeightField, nm: &[f64]) -> GratingCheck {
    lit(field, nm, None)
}

/// Check with the light at 40° in an azimuth.
fn lit(field: &HeightField, nm: &[f64], azimuth_deg: Option<f64>) -> GratingCheck {
    let quality = Quality::of(field, 65.0);
    let settings = Settings { light_deg: [40.0, 0.0], ..Settings::default() };
    check(field, &quality, &settings, nm, [None, azimuth_deg], &Silent).unwrap_or_else(|e| panic!("{e:?} {quality:?}"))
}

/// Bessel function J1 by its power series.
fn bessel_1(x: f64) -> f64 {
    let mut term = 0.5 * x;
    let mut sum = term;
    for k in 1..40 {
        term *= -0.25 * x * x / (f64::from(k) * f64::from(k + 1));
        sum += term;
    }
    sum
}

#[test]
fn few_periods_whole_or_cut_tell_period_and_direction() {
    for profile in [Profile::Sinusoid, Profile::Blazed, Profile::Rectangular { duty: 0.4 }] {
        for periods in [1.3, 1.5, 1.85, 2.0, 2.5, 3.3, 4.5, 5.2, 7.85] {
            for angle_deg in [0.0, 30.0, 90.0, 117.0] {
                let quality = Quality::of(&patch(profile, periods, angle_deg), 65.0);
                let at = format!("{profile:?} {periods} periods at {angle_deg}°: {:?}", quality.periods.first());
                let first = quality.periods[0];
                let turned = (first.direction_deg - angle_deg).abs();
                assert!((first.period_um / 2.5 - 1.0).abs() < 0.01, "{at}");
                assert!(turned.min(180.0 - turned) < 0.6, "{at}");
            }
        }
    }
}

#[test]
fn one_period_along_a_side_is_that_of_the_repeated_patch() {
    for profile in [Profile::Sinusoid, Profile::Blazed] {
        for angle_deg in [0.0, 90.0] {
            let field = patch(profile, 1.0, angle_deg);
            let found = checked(&field, &[450.0, 550.0, 650.0]);
            assert!(found.cut_periods.is_none() && (found.azimuth_deg - angle_deg).abs() < 1e-9, "{found:?}");
            assert!((found.mean_nm - 2500.0).abs() < 2.0 && found.variance_nm2 < 0.4, "{profile:?} {found:?}");
            assert!(found.warnings.is_empty(), "{:?}", found.warnings);
        }
    }
    // Less than one oblique period, and surfaces without a grating, give no grating.
    assert!(Quality::of(&patch(Profile::Sinusoid, 0.6, 30.0), 65.0).grating.is_none());
    let shape = Shape::Fingers;
    let fingers = Synthetic { shape, pixels: 96, pixel_um: 0.09, period_um: 1.2, depth_um: 0.3, angle: 0.4 };
    assert!(Quality::of(&fingers.field().unwrap(), 65.0).grating.is_none());
}

#[test]
fn a_check_of_a_cut_patch_is_that_of_its_grating() {
    for (periods, angle_deg) in [(1.5, 0.0), (2.3, 90.0), (2.5, 30.0), (3.7, 117.0), (7.85, 0.0)] {
        for profile in [Profile::Sinusoid, Profile::Blazed] {
            let found = checked(&patch(profile, periods, angle_deg), &[450.0, 500.0, 550.0, 600.0]);
            assert!(found.cut_periods.is_some(), "{periods} at {angle_deg}°");
            let at = format!("{profile:?} {periods} at {angle_deg}°: {} {}", found.mean_nm, found.variance_nm2);
            assert!((found.mean_nm - 2500.0).abs() < 12.0 && found.variance_nm2 < 1.0, "{at}");
            assert!(found.warnings.iter().all(|w| !w.contains("repeated")), "{:?}", found.warnings);
        }
    }
}

#[test]
fn orders_of_a_cut_patch_hold_the_light_of_closed_forms() {
    // x is half of the phase depth. The first order of a ramp is sinc² of the distance from a full turn. The observed
    // order is on the light's side of the mirror direction. A ramp that rises towards the light diffracts to the other
    // side.
    let of = |profile: Profile, x: f64, azimuth_deg: f64| match profile {
        Profile::Sinusoid => bessel_1(x).powi(2),
        _ => {
            let off = if azimuth_deg == 0.0 { x + PI } else { x - PI };
            (off.sin() / off).powi(2)
        }
    };
    for profile in [Profile::Sinusoid, Profile::Blazed] {
        for azimuth_deg in [0.0, 180.0] {
            let found = lit(&patch(profile, 2.6, 0.0), &[450.0, 550.0, 650.0], Some(azimuth_deg));
            assert!(found.cut_periods.is_some() && found.peaks.len() == 3, "{found:?}");
            for p in &found.peaks {
                let w = 40_f64.to_radians().cos() + p.theta_r_deg.to_radians().cos();
                let x = PI * 0.2 * w * 1e3 / p.wavelength_nm;
                let truth = of(profile, x, azimuth_deg);
                // A ramp with 46 pixels per period is a staircase.
                assert!((p.relative / truth - 1.0).abs() < 0.06, "{profile:?} {azimuth_deg} {p:?} {truth}");
            }
        }
    }
}

#[test]
fn rigorous_theory_has_the_same_order_as_a_cut_patch() {
    // A long, shallow aluminium grating: its first order relative to the reflectance of the metal.
    let (period_um, depth_um) = (8.0, 0.12);
    let shape = Shape::Grating(Profile::Sinusoid);
    let field = Synthetic { shape, pixels: 128, pixel_um: 0.15, period_um, depth_um, angle: 0.0 }.field().unwrap();
    let quality = Quality::of(&field, 65.0);
    let settings = Settings { light_deg: [5.0, 0.0], ..Settings::default() };
    let found = check(&field, &quality, &settings, &[560.0], [None, None], &Silent).unwrap();
    assert!(found.cut_periods.is_some(), "{found:?}");
    let grating = rcwa::Grating { period_um, depth_um, above: 1.0, below: ALUMINIUM };
    let flat = rcwa::Grating { depth_um: 1e-6, ..grating };
    let light = rcwa::Light { wavelength_nm: 560.0, angle: 5_f64.to_radians() };
    let of = |g: &rcwa::Grating, order: i32| {
        [Polarization::Te, Polarization::Tm]
            .map(|p| rcwa::solve(g, &light, p, 1e-3).unwrap().reflected(order).efficiency)
            .iter()
            .sum::<f64>()
    };
    let [low, high] = [-1, 1].map(|order| of(&grating, order) / of(&flat, 0));
    let peak = found.peaks[0].relative;
    assert!((peak / low - 1.0).abs().min((peak / high - 1.0).abs()) < 0.04, "{peak} {low} {high}");
}
