use super::*;
use crate::Map;
use nacre_image::{OutputFolder, Palette, write_png16_gray};
use std::f64::consts::PI;

/// Pseudo-random number from 0 to 1 for a cell.
pub(super) fn chance(a: usize, b: usize, seed: u64) -> f64 {
    let mixed = (a as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (b as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f) ^ seed;
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((mixed ^ (mixed >> 32)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Index of the nearest of 14 random points in a periodic tile.
pub(super) fn polygon([x, y]: [f64; 2], [w, h]: [f64; 2], seed: u64) -> usize {
    let far = |k: usize| {
        let at = [chance(k, 0, seed) * w, chance(k, 1, seed) * h];
        let d = |a: f64, b: f64, n: f64| {
            let off = (a - b).rem_euclid(n);
            off.min(n - off)
        };
        d(x, at[0], w).hypot(d(y, at[1], h))
    };
    (0..14).min_by(|a, b| far(*a).total_cmp(&far(*b))).unwrap()
}

/// A noisy, unevenly lit photograph.
pub(super) fn photograph(size: [usize; 2], grey: &dyn Fn(f64, f64) -> f64) -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    let codes: Vec<u16> = (0..size[0] * size[1])
        .map(|i| {
            let (x, y) = ((i % size[0]) as f64, (i / size[0]) as f64);
            let light = 0.5 + 0.4 * x / size[0] as f64;
            let noise = 0.01 * (chance(i, 5, 9) + chance(i, 6, 9) + chance(i, 7, 9) - 1.5);
            (40_000.0 * (light * grey(x, y) + noise).clamp(0.0, 1.0)) as u16
        })
        .collect();
    write_png16_gray(&home.path().join("a.png"), size[0], size[1], &codes).unwrap();
    home
}

#[test]
fn tiles_of_polygons_are_for_the_flash() {
    for (seed, [w, h]) in [(1, [64.0, 48.0]), (2, [55.5, 61.25]), (3, [90.0, 70.0])] {
        let tile = |x: f64, y: f64| 0.2 + 0.6 * chance(polygon([x, y], [w, h], seed), 3, seed);
        let home = photograph([600, 440], &tile);
        let (report, picture) = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap();
        assert_eq!(report.advice, Advice::Flash, "{seed}: {report:?}");
        let found = report.repeats.unwrap();
        assert!((found.copies - 600.0 * 440.0 / (w * h)).abs() < 0.02 * found.copies, "{found:?}");
        let sides = found.sides_px;
        let off = [sides[0][0] - w, sides[0][1], sides[1][0], sides[1][1] - h];
        assert!(off.iter().all(|d| d.abs() < 0.3), "{seed}: {found:?}");
        assert_eq!([picture.width, picture.height], [600, 440]);
    }
}

#[test]
fn gradual_changes_and_single_motifs_are_for_fringes() {
    let wave =
        |x: f64, y: f64| 0.5 + 0.2 * (2.0 * PI * x / 60.0).sin() + 0.2 * (2.0 * PI * (y / 45.0 + x / 60.0)).sin();
    let home = photograph([600, 440], &wave);
    let (report, _) = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap();
    assert!(report.advice == Advice::Spots && report.repeats.is_some() && !report.discrete, "{report:?}");
    assert!(report.why.contains("gradually"), "{report:?}");
    // Polygons without repetition.
    let once = |x: f64, y: f64| 0.2 + 0.6 * chance(polygon([x, y], [600.0, 440.0], 4), 3, 4);
    let home = photograph([600, 440], &once);
    let (report, _) = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap();
    assert!(report.advice == Advice::Spots && report.repeats.is_none() && report.discrete, "{report:?}");
    let (report, _) = recommend(&home.path().join("a.png"), Need::Orientation, Palette::Cyclic).unwrap();
    assert_eq!(report.advice, Advice::Polarization);
    // A tile with six copies.
    let few = |x: f64, y: f64| 0.2 + 0.6 * chance(polygon([x, y], [200.0, 220.0], 5), 3, 5);
    let home = photograph([600, 440], &few);
    let (report, _) = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap();
    assert!(report.advice == Advice::Spots && report.repeats.is_some_and(|r| r.copies < 7.0), "{report:?}");
}

#[test]
fn orientation_maps_are_treated_as_lines() {
    // 0° and 180° are the same orientation: a tile with polygons on both sides of the wrap.
    let (w, h) = (320, 240);
    let angle = |i: usize| {
        let cell = polygon([(i % w) as f64, (i / w) as f64], [40.0, 40.0], 8);
        (0.2 * (chance(cell, 1, 8) - 0.5)).rem_euclid(PI) as f32
    };
    let known = |i: usize| i % 17 != 4;
    let map = Map {
        value: (0..w * h).map(|i| if known(i) { angle(i) } else { f32::NAN }).collect(),
        sigma: vec![0.01; w * h],
        mask: (0..w * h).map(|i| f32::from(u8::from(known(i)))).collect(),
        more: Default::default(),
        attributes: Default::default(),
    };
    let maps = Maps { width: w, height: h, maps: [(Kind::Orientation, map)].into() };
    let home = tempfile::tempdir().unwrap();
    let folder = OutputFolder::begin(&home.path().join("out"), false).unwrap();
    maps.write(&folder).unwrap();
    folder.commit().unwrap();
    let (report, _) = recommend(&home.path().join("out"), Need::Period, Palette::Cyclic).unwrap();
    assert!((report.repeats.unwrap().copies - 45.0).abs() < 1.0, "{report:?}");
    assert_eq!(report.advice, Advice::Flash, "{report:?}");
}

#[test]
fn files_that_are_no_pictures_are_refused() {
    let home = tempfile::tempdir().unwrap();
    assert!(recommend(home.path(), Need::Period, Palette::Cyclic).is_err());
    assert!(recommend(&home.path().join("none.png"), Need::Period, Palette::Cyclic).is_err());
    write_png16_gray(&home.path().join("a.png"), 8, 8, &[1; 64]).unwrap();
    let problem = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap_err().to_string();
    assert!(problem.contains("32 pixels"), "{problem}");
    // Uniform grey.
    write_png16_gray(&home.path().join("a.png"), 64, 64, &[500; 4096]).unwrap();
    let (report, _) = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap();
    assert!(report.repeats.is_none() && !report.discrete, "{report:?}");
}
