use super::*;
use nacre_maps::Kind;
use std::f64::consts::PI;

/// Periods that grow with orientation, with some scatter; the highest line densities are unknown.
fn spiral() -> Distribution {
    let (orientations, periods) = (60, 40);
    let mut found = Distribution {
        orientations,
        periods,
        lines_per_um: [0.5, 1.3],
        share: vec![0.0; orientations * periods],
        sigma: vec![0.001; orientations * periods],
        coverage: vec![1.0; orientations * periods],
        relative: false,
    };
    for at in 0..orientations * periods {
        let theta = PI * ((at % orientations) as f64 + 0.5) / orientations as f64;
        let um = 2.0 / (found.edge(at / orientations) + found.edge(at / orientations + 1));
        found.share[at] = (-0.5 * ((um - 0.9 - 0.7 * theta / PI) / 0.06).powi(2)).exp();
    }
    let sum: f64 = found.share.iter().sum();
    found.share.iter_mut().for_each(|s| *s /= sum);
    found
}

#[test]
fn a_distribution_comes_back_from_its_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("histogram.exr");
    let found = spiral();
    found.write(&path).unwrap();
    let back = Distribution::read(&path).unwrap();
    assert_eq!(back.lines_per_um, found.lines_per_um);
    assert!(total_variation(&back.share, &found.share) < 1e-6);
    assert_eq!(back.coverage, found.coverage);
    let relative = Distribution { relative: true, ..found };
    relative.write(&path).unwrap();
    assert!(Distribution::read(&path).unwrap().relative);
    std::fs::write(&path, b"no map").unwrap();
    assert!(Distribution::read(&path).is_err());
}

#[test]
fn bins_are_where_they_say() {
    let found = spiral();
    assert_eq!(found.bin(0.0, 2.0), Some(0));
    assert_eq!(found.bin(-1e-9, 2.0), Some(59));
    assert_eq!(found.bin(PI / 2.0 + 1e-9, 1.0 / (0.5 + 0.8 * 0.51)), Some(20 * 60 + 30));
    assert_eq!((found.bin(0.0, 2.01), found.bin(0.0, 0.7)), (None, None));
}

#[test]
fn maps_show_the_distribution_for_every_shape() {
    let from = spiral();
    // An L of 5 × 7 pixels.
    let letter = Shape::Mask(5, (0..35).map(|i| i % 5 < 2 || i / 5 > 4).collect());
    for shape in [Shape::Square(4), Shape::Disc(7.0), letter] {
        let dots = Dots { size: [600, 500], pixel_um: 10.0, shape: shape.clone(), seed: 5 };
        let made = synthesize(&from, &dots).unwrap();
        let (maps, report) = (&made.maps, &made.report);
        let bits = |made: &Synthesis| -> Vec<u32> {
            made.maps.maps.values().flat_map(|m| m.value.iter().map(|v| v.to_bits())).collect()
        };
        assert!(bits(&made) == bits(&synthesize(&from, &dots).unwrap()));
        assert!(bits(&made) != bits(&synthesize(&from, &Dots { seed: 6, ..dots.clone() }).unwrap()));
        // The histogram of the maps is recomputed from the maps alone.
        let (theta, um) = (&maps.maps[&Kind::Orientation], &maps.maps[&Kind::Period]);
        let (mut share, known) = (vec![0.0; 60], theta.known() as f64);
        for i in (0..600 * 500).filter(|i| theta.mask[*i] > 0.0) {
            share[(f64::from(theta.value[i]) / PI * 60.0) as usize] += 1.0 / known;
            // The spiral: periods follow orientations.
            assert!((f64::from(um.value[i]) - 0.9 - 0.7 * f64::from(theta.value[i]) / PI).abs() < 0.4);
        }
        let off = total_variation(&share, &from.of_orientations());
        assert!((off - report.total_variation[0]).abs() < 1e-3, "{off} {report:?}");
        assert!(off < 0.05, "{shape:?} {off}");
        // Total variation at most 1.6 times that of independent draws, which allows for unequal dot areas.
        assert!(off < 1.6 * report.expected[0], "{shape:?} {report:?}");
        assert!(report.bare < 0.03, "{shape:?} {}", report.bare);
        assert_eq!(theta.mask, um.mask);
    }
    // Each square has a single orientation.
    let dots = Dots { size: [64, 64], pixel_um: 1.0, shape: Shape::Square(8), seed: 1 };
    let made = synthesize(&from, &dots).unwrap();
    let theta = &made.maps.maps[&Kind::Orientation].value;
    assert!((0..64).all(|i| theta[8 * 64 + 16] == theta[(8 + i / 8) * 64 + 16 + i % 8]));
    assert!(made.report.warnings.iter().any(|w| w.contains("too few")), "{:?}", made.report);
}

#[test]
fn invalid_input_is_refused() {
    let good = Dots { size: [32, 32], pixel_um: 1.0, shape: Shape::Square(8), seed: 1 };
    for dots in [
        Dots { size: [0, 4], ..good.clone() },
        Dots { size: [1 << 40, 1 << 40], ..good.clone() },
        Dots { pixel_um: f64::NAN, ..good.clone() },
        Dots { shape: Shape::Square(0), ..good.clone() },
        Dots { shape: Shape::Disc(f64::INFINITY), ..good.clone() },
        Dots { shape: Shape::Mask(3, vec![false; 9]), ..good.clone() },
        Dots { shape: Shape::Mask(0, vec![]), ..good },
    ] {
        assert!(synthesize(&spiral(), &dots).is_err(), "{dots:?}");
    }
    for settings in [
        Settings { period_um: Some([2.0, 1.0]), ..Settings::default() },
        Settings { bins: Some([3, 1 << 30]), ..Settings::default() },
        Settings { depth_um: Some(f64::NAN), ..Settings::default() },
    ] {
        assert!(settings.check().is_err(), "{settings:?}");
    }
}

#[test]
fn marginals_are_about_the_zero_order() {
    // All light in one pixel, 10 right of and 10 above the centre.
    let mut light = vec![0.0_f32; 101 * 101];
    light[40 * 101 + 60] = 3.0;
    light[0] = f32::NAN;
    let found = Marginals::of(&light, 101, [50.0, 50.0], [5.0, 25.0], [8, 10]);
    assert_eq!(found.angular[1], 1.0);
    assert_eq!(found.radial[4], 1.0);
    assert_eq!(total_variation(&found.radial, &found.radial), 0.0);
}
