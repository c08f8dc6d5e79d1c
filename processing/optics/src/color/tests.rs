//! Colours compared with published values.

use super::*;

/// Chromaticity (x, y) of an illuminant.
fn chromaticity(light: &Illuminant, observer: Observer) -> [f64; 2] {
    let mut sum = [0.0; 3];
    for nm in (360..=830).map(f64::from) {
        let (power, seen) = (light.spectrum.at(nm), observer.at(nm));
        sum.iter_mut().zip(seen).for_each(|(s, c)| *s += power * c);
    }
    let all: f64 = sum.iter().sum();
    [sum[0] / all, sum[1] / all]
}

#[test]
fn lights_have_the_chromaticities_that_the_cie_publishes() {
    // CIE 15: chromaticities for 2° and 10°.
    for (name, two, ten) in [
        ("A", [0.447_58, 0.407_45], [0.451_17, 0.405_94]),
        ("D65", [0.312_72, 0.329_03], [0.313_81, 0.330_98]),
        ("E", [0.333_33, 0.333_33], [0.333_33, 0.333_33]),
        ("FL2", [0.372_08, 0.375_29], [0.379_25, 0.367_33]),
        ("FL11", [0.380_52, 0.377_13], [0.385_41, 0.371_23]),
    ] {
        let light = Illuminant::named(name).unwrap();
        for (observer, published) in [(Observer::Cie1931, two), (Observer::Cie1964, ten)] {
            let [x, y] = chromaticity(&light, observer);
            // The lines of fluorescent lamps depend on the interpolation within steps of 5 nm.
            let limit = if name.starts_with("FL") { 2e-3 } else { 3e-4 };
            assert!(
                (x - published[0]).abs() < limit && (y - published[1]).abs() < limit,
                "{name} {observer:?}: {x} {y}"
            );
        }
    }
}

#[test]
fn every_name_is_a_light_and_nothing_else_is() {
    for name in NAMES {
        let light = Illuminant::named(name).unwrap();
        assert!(light.spectrum.at(560.0) > 0.0, "{name}");
    }
    let inverse = Illuminant::named("A-inverse").unwrap().spectrum;
    let a = Illuminant::named("A").unwrap().spectrum;
    assert!((inverse.at(560.0) - 1.0).abs() < 1e-12 && (inverse.at(450.0) * a.at(450.0) - a.at(560.0)).abs() < 1e-9);
    assert!(Illuminant::named("D651").is_none());
    let problem = Illuminant::of("no-such-light").unwrap_err().to_string();
    assert!(problem.contains("no-such-light") && problem.contains("CSV"), "{problem}");
}

#[test]
fn spectra_that_make_no_sense_are_refused() {
    for (text, word) in [
        ("", "rows"),
        ("wavelength,power\n500,1", "rows"),
        ("500,1\n400,1", "rise"),
        ("500,1\n600,-1", "power"),
        ("500,1\n600,nan", "power"),
        ("500,0\n600,0", "dark"),
        ("500,1\nhello", "line 2"),
        ("0,1\n600,1", "wavelength"),
    ] {
        let problem = Spectrum::parse(text).unwrap_err();
        assert!(problem.contains(word), "{text:?}: {problem}");
    }
    let s = Spectrum::parse("nm;W\n400;1\n500;3\n").unwrap();
    assert_eq!([s.at(399.0), s.at(400.0), s.at(450.0), s.at(500.0), s.at(501.0)], [0.0, 1.0, 2.0, 3.0, 0.0]);
}

#[test]
fn white_is_white() {
    // D65 with Y = 1.
    let white = linear_srgb([0.950_47, 1.0, 1.088_83]);
    assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-4), "{white:?}");
}

#[test]
fn codes_are_those_of_the_curve() {
    // Every 97th float from 0 to 1, then values outside of that range.
    for bits in (0..=1.0_f32.to_bits()).step_by(97) {
        let light = f32::from_bits(bits);
        assert_eq!(srgb_code(light), (255.0 * srgb_encode(light)).round() as u8, "{light}");
    }
    let outside = [-1.0, -0.0, 1.0, 1.5, f32::INFINITY, f32::NEG_INFINITY, f32::NAN].map(srgb_code);
    assert_eq!(outside, [0, 0, 255, 255, 255, 0, 0]);
}
