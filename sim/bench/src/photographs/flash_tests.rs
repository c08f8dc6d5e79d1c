//! Diffraction orders against the grating equation and closed forms.

use super::*;
use crate::photographs::orders::Profile;
use std::f64::consts::PI;

/// A grating far from camera and flash, so that pixels correspond to directions.
fn far(surface: Surface) -> FlashPhotograph {
    FlashPhotograph {
        surface,
        width: 241,
        height: 241,
        camera_mm: 1e5,
        flash_mm: 1e5,
        // u = 2 x / distance.
        pixel_um: 0.5 * 1e5 * 0.0005 * 1000.0,
        flash_diameter_mm: 0.0,
        band_nm: 0.0,
        blur_px: 0.0,
        ..FlashPhotograph::default()
    }
}

#[test]
fn orders_lie_where_the_grating_equation_says_with_their_energy() {
    let surface = Surface::Grating { profile: Profile::Sinusoid, period_um: 20.0, depth_um: 0.1, angle_deg: 0.0 };
    let scene = far(surface.clone());
    let light = scene.radiance().unwrap();
    // λ/Λ = 0.034 is 68 pixels of 0.0005.
    let around = |x: usize| {
        let all = (0..241_usize * 241).filter(|i| (i % 241).abs_diff(x) < 25 && (i / 241).abs_diff(120) < 25);
        let sum = all.clone().map(|i| light[i]).sum::<f64>();
        (all.map(|i| light[i] * (i % 241) as f64).sum::<f64>() / sum, sum)
    };
    let [(left, one), (middle, zero), (right, other)] = [52, 120, 188].map(around);
    assert!((left - 52.0).abs() < 0.02 && (middle - 120.0).abs() < 0.01 && (right - 188.0).abs() < 0.02);
    assert!((one / other - 1.0).abs() < 1e-3);
    // Energy: J1²/J0² of half the phase depth, 2π·0.1·2/0.68 peak to peak; obliquity is below 1e-3 here.
    let x: f64 = PI * 0.1 * 2.0 / 0.68;
    let series = |m: i32| {
        let n = 2000;
        (0..n)
            .map(|k| PI * (f64::from(k) + 0.5) / f64::from(n))
            .map(|t| (f64::from(m) * t - x * t.sin()).cos())
            .sum::<f64>()
    };
    let wanted = (series(1) / series(0)).powi(2);
    assert!((one / zero / wanted - 1.0).abs() < 5e-3, "{} {wanted}", one / zero);
    // The zero order's radiance, integrated over directions, is its efficiency times the irradiance.
    let irradiance = 1.0 / (1e5 * 1e5);
    let energy = (series(0) / 2000.0).powi(2);
    assert!((zero * 0.0005 * 0.0005 / irradiance / energy - 1.0).abs() < 5e-3);
}

#[test]
fn a_wide_flash_and_a_wide_band_smear_orders_as_they_should() {
    let surface = Surface::Grating { profile: Profile::Sinusoid, period_um: 20.0, depth_um: 0.1, angle_deg: 0.0 };
    let spread = |scene: &FlashPhotograph, x: usize| {
        let light = scene.radiance().unwrap();
        let all = (0..241_usize * 241).filter(|i| (i % 241).abs_diff(x) < 28 && (i / 241).abs_diff(120) < 28);
        let (sum, first, second) = all.fold((0.0, 0.0, 0.0), |(s, a, b), i| {
            let at = (i % 241) as f64 - x as f64;
            (s + light[i], a + light[i] * at, b + light[i] * at * at)
        });
        second / sum - (first / sum).powi(2)
    };
    let sharp = far(surface);
    let wide = FlashPhotograph { flash_diameter_mm: 1000.0, ..sharp.clone() };
    // A disc of 0.01 rad is 20 pixels wide: variance of a disc along one axis is (diameter/4)².
    let grown = spread(&wide, 120) - spread(&sharp, 120);
    assert!((grown / 25.0 - 1.0).abs() < 1e-3, "{grown}");
    let band = FlashPhotograph { band_nm: 40.0, ..sharp.clone() };
    assert!((spread(&band, 120) - spread(&sharp, 120)).abs() < 0.05);
    // The first order moves by 0.1 pixel per nm: σ of the band is 40/2.355 nm.
    let grown = spread(&band, 188) - spread(&sharp, 188);
    assert!((grown.sqrt() / (40.0 / 2.355 * 0.1) - 1.0).abs() < 5e-3, "{grown}");
}

#[test]
fn scenes_that_make_no_sense_are_refused() {
    for change in [
        |s: &mut FlashPhotograph| s.pixel_um = f64::NAN,
        |s: &mut FlashPhotograph| s.width = 4,
        |s: &mut FlashPhotograph| s.exposures.clear(),
        |s: &mut FlashPhotograph| s.band_nm = 1e9,
        |s: &mut FlashPhotograph| s.surface = Surface::Paper { period_um: 0.0, depth_um: 0.1, directions: 3 },
    ] {
        let mut scene = FlashPhotograph::default();
        change(&mut scene);
        assert!(scene.check().is_err());
    }
}
