//! Directions of light against the grating equation, energies, and output files.

use super::*;
use std::f64::consts::PI;

/// One polygon in one tile.
pub(super) fn plain() -> TilesPhotograph {
    TilesPhotograph {
        tiles: [1, 1],
        tile_mm: [240.0, 180.0],
        pattern: Pattern { polygons: 1, directions: 1, first_deg: 30.0, gap_mm: 0.0, ..Pattern::default() },
        lights_mm: vec![[12.0, -7.0, 220.0]],
        light_sigma_mm: 2.0,
        band_nm: 0.0,
        blur_px: 0.0,
        width: 320,
        height: 240,
        ..TilesPhotograph::default()
    }
}

/// Brightest pixel within a few pixels of another one.
fn peak(light: &[f64], width: usize, near: [f64; 2]) -> ([f64; 2], f64) {
    let mut best = ([0.0; 2], 0.0);
    for (i, v) in light.iter().enumerate() {
        let at = [(i % width) as f64, (i / width) as f64];
        if (at[0] - near[0]).hypot(at[1] - near[1]) < 12.0 && *v > best.1 {
            best = (at, *v);
        }
    }
    best
}

#[test]
fn orders_lie_where_the_grating_equation_has_them() {
    let scene = plain();
    let light = scene.radiance(scene.lights_mm[0]);
    let geometry = scene.geometry();
    // Newton iteration to the point with half vector n λ/a along the grating vector, with the shared geometry, which
    // the renderer does not use.
    for n in [-2.0, -1.0, 0.0, 1.0, 2.0] {
        let wanted = [(PI / 6.0).cos(), (PI / 6.0).sin()].map(|c| n * 0.56 / 1.66 * c);
        let mut at = [0.0; 3];
        for _ in 0..50 {
            let found = geometry.half(at, scene.lights_mm[0]);
            // Half vectors decrease to the right, by about 1/500 + 1/220 per mm.
            at = [0, 1, 2].map(|k| if k == 2 { 0.0 } else { at[k] + 100.0 * (found[k] - wanted[k]) });
        }
        let pixel = geometry.pixel(at).unwrap();
        let (found, value) = peak(&light, scene.width, pixel);
        assert!(value > 0.0 && (found[0] - pixel[0]).hypot(found[1] - pixel[1]) < 2.5, "{n}: {found:?} {pixel:?}");
    }
}

#[test]
fn a_tilted_sheet_moves_orders_and_a_flat_one_does_not() {
    let scene = plain();
    let tilted = TilesPhotograph { tilt_deg: [0.0, 2.0], ..scene.clone() };
    let bowed = TilesPhotograph { bow_mm: 1.0, ..scene.clone() };
    let brightest = |s: &TilesPhotograph| {
        let light = s.radiance(s.lights_mm[0]);
        light.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map(|(i, _)| i % s.width).unwrap() as f64
    };
    // The zero order moves by twice the tilt, divided by the change of half vectors per mm. A sheet that descends to
    // the right faces right, so the mirror image moves left. It descends by tan 2°.
    let moved = (brightest(&tilted) - brightest(&scene)) * scene.pixel_mm();
    let predicted = -2.0 * 2.0_f64.to_radians().sin() / (1.0 / 500.0 + 1.0 / 220.0);
    assert!((moved - predicted).abs() < 0.1 * predicted.abs(), "{moved} {predicted}");
    assert!((brightest(&bowed) - brightest(&scene)).abs() < 4.0);
}

#[test]
fn tiles_repeat_and_misaligned_ones_are_off_by_what_is_said() {
    let scene = TilesPhotograph { misaligned_px: 3.0, ..TilesPhotograph::default() };
    let worst = (0..80).flat_map(|k| scene.offset_mm([k % 10, k / 10])).map(f64::abs).fold(0.0, f64::max);
    assert!(worst <= 3.0 * scene.pixel_mm() && worst > 2.5 * scene.pixel_mm(), "{worst}");
    let grooves = scene.grooves();
    let all: Vec<Grooves> =
        (0..10_000).filter_map(|k| grooves([0.297 * (k % 100) as f64, 0.2625 * (k / 100) as f64])).collect();
    let mut polygons: Vec<usize> = all.iter().map(|g| g.polygon).collect();
    polygons.sort_unstable();
    polygons.dedup();
    assert_eq!(polygons.len(), 24);
    assert!(all.iter().all(|g| g.edge_mm > 0.0 && g.period_um == 1.66 && (0.0..PI).contains(&g.orientation)));
    // Gaps cover part of the area.
    assert!((7000..9500).contains(&all.len()), "{}", all.len());
}

#[test]
fn scenes_out_of_range_are_refused() {
    let refused = |scene: TilesPhotograph, word: &str| {
        let error = scene.check().unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    };
    refused(TilesPhotograph { tiles: [0, 8], ..TilesPhotograph::default() }, "tiles");
    refused(TilesPhotograph { lights_mm: vec![], ..TilesPhotograph::default() }, "lights_mm");
    refused(TilesPhotograph { light_sigma_mm: f64::NAN, ..TilesPhotograph::default() }, "light_sigma_mm");
    refused(TilesPhotograph { width: 1 << 20, ..TilesPhotograph::default() }, "width");
    let pattern = Pattern { periods: Periods::Mixed(vec![]), ..Pattern::default() };
    refused(TilesPhotograph { pattern, ..TilesPhotograph::default() }, "periods");
}
