//! Registration against exact truth: errors, their σ, refusals, and the effect on orientations.

mod edges;
mod resampling;
mod scene;

use super::*;
use scene::{BANDS, TILES, Tiled, angles, errors, normal, registrar, rows, wedge};

const SIZE: [usize; 2] = [384, 320];

fn told(registration: Registration) -> Vec<Shift> {
    match registration {
        Registration::Told(shifts) => shifts,
        Registration::CannotTell(doubt) => panic!("{doubt:?}"),
    }
}

fn doubt(registration: Registration) -> Doubt {
    match registration {
        Registration::Told(shifts) => panic!("{shifts:?}"),
        Registration::CannotTell(doubt) => doubt,
    }
}

/// The bound is 0.05 px; the error is 0.01, and 0.002 for strong modulation.
#[test]
fn shifts_of_a_wedge_are_found() {
    let faint = Tiled { modulation: 0.05, ..TILES };
    for (name, scene, most) in [("tiles", TILES, 0.005), ("bands", BANDS, 0.01), ("faint", faint, 0.02)] {
        for (n, px) in [(4, 1.0), (6, 0.3), (13, 3.0)] {
            let psi = angles(n);
            let truth = wedge(&psi, px);
            let found = told(registrar(&scene, SIZE, &psi, &truth, 1.0).polarized(&psi));
            let (error, sigma) = errors(&found, &truth);
            assert!(error < most && sigma < 0.03, "{name}, {n} frames, {px} px: {error} σ {sigma}");
        }
    }
}

/// Camera displacement beyond the range of the pyramid, on a sample without repetition.
#[test]
fn large_jumps_are_found() {
    let scene = Tiled { modulation: 0.1, pitch: [37.0, 29.0], variation: 0.8, ..TILES };
    let psi = angles(6);
    let mut truth = wedge(&psi, 0.5);
    truth[2] = [17.3, -24.6];
    truth[5] = [-3.2, 9.9];
    let (error, _) = errors(&told(registrar(&scene, SIZE, &psi, &truth, 1.0).polarized(&psi)), &truth);
    assert!(error < 0.02, "{error}");
}

/// Errors agree with σ at ten times the usual noise, where noise alone causes them.
#[test]
fn sigma_is_honest() {
    let psi = angles(6);
    let truth = wedge(&psi, 0.8);
    let (mut square, mut count) = (0.0_f64, 0.0);
    for seed in 0..6 {
        let mut registrar = Registrar::new(SIZE[0], SIZE[1]);
        for k in 0..6 {
            registrar.add(rows(TILES.frame(SIZE, psi[k], truth[k], 10.0, (100 * seed + k) as u64), SIZE[0]));
        }
        let found = told(registrar.polarized(&psi));
        for (f, t) in found.iter().zip(&truth) {
            let mean = [0, 1].map(|i| truth.iter().map(|t| t[i]).sum::<f64>() / 6.0);
            square += (((f.dx - t[0] + mean[0]).powi(2) + (f.dy - t[1] + mean[1]).powi(2)) / f.sigma.powi(2)) / 2.0;
            count += 1.0;
        }
    }
    // σ is that of the worse direction, so the ratio is below 1; 36 pairs determine it to about 10 %.
    let ratio = (square / count).sqrt();
    assert!((0.4..1.2).contains(&ratio), "{ratio}");
}

/// A source drift of 2 % violates Malus' law slightly everywhere, but hardly affects shifts.
#[test]
fn drifting_light_is_borne() {
    let psi = angles(8);
    let truth = wedge(&psi, 1.2);
    let mut registrar = Registrar::new(SIZE[0], SIZE[1]);
    for k in 0..8 {
        let gain = 1.0 + 0.02 * (k as f32 * 1.7).sin();
        let mut frame = TILES.frame(SIZE, psi[k], truth[k], 1.0, k as u64);
        frame.iter_mut().for_each(|v| *v *= gain);
        registrar.add(rows(frame, SIZE[0]));
    }
    let (error, _) = errors(&told(registrar.polarized(&psi)), &truth);
    assert!(error < 0.03, "{error}");
}

/// Two photographs of an unchanging scene, and three behind an analyser with little modulation.
#[test]
fn few_photographs_are_registered_too() {
    let still = Tiled { modulation: 0.0, ..TILES };
    let truth = [[0.0, 0.0], [2.3, -1.1]];
    let (error, _) = errors(&told(registrar(&still, SIZE, &[0.0; 2], &truth, 1.0).still()), &truth);
    assert!(error < 0.005, "{error}");
    let (psi, faint) = (angles(3), Tiled { modulation: 0.01, variation: 0.6, ..TILES });
    let truth = wedge(&psi, 1.0);
    let (error, sigma) = errors(&told(registrar(&faint, SIZE, &psi, &truth, 1.0).polarized(&psi)), &truth);
    assert!(error < 0.05, "{error} {sigma}");
}

/// Three frames of a strongly modulating sample fit Malus' law under any shifts and are refused.
#[test]
fn three_strongly_modulated_frames_are_not_trusted() {
    let psi = angles(3);
    let truth = wedge(&psi, 1.0);
    match registrar(&TILES, SIZE, &psi, &truth, 1.0).polarized(&psi) {
        Registration::CannotTell(_) => {}
        Registration::Told(found) => {
            let (error, sigma) = errors(&found, &truth);
            assert!(error < 2.0 * sigma, "{error} {sigma}");
        }
    }
}

#[test]
fn noise_has_no_shift() {
    // One tile, far from its edges.
    let flat = Tiled { modulation: 0.3, pitch: [1e6, 1e6], ..TILES };
    for n in [3, 4, 12] {
        let psi = angles(n);
        let shifts = vec![[-5e5, -5e5]; n];
        let registrar = registrar(&flat, SIZE, &psi, &shifts, 1.0);
        let lost: Vec<usize> = (1..n).collect();
        assert_eq!(doubt(registrar.polarized(&psi)), Doubt::NothingInCommon(lost));
        assert!(matches!(doubt(registrar.still()), Doubt::NothingInCommon(_)));
    }
}

/// A frame of another scene is named.
#[test]
fn a_frame_without_the_scene_is_named() {
    let psi = angles(6);
    let mut registrar = Registrar::new(SIZE[0], SIZE[1]);
    for (k, psi) in psi.iter().enumerate() {
        let away = if k == 4 { [5e5, -3e5] } else { [0.0; 2] };
        let scene = if k == 4 { Tiled { pitch: [1e6, 1e6], ..TILES } } else { TILES };
        registrar.add(rows(scene.frame(SIZE, *psi, away, 1.0, k as u64), SIZE[0]));
    }
    assert_eq!(doubt(registrar.polarized(&psi)), Doubt::NothingInCommon(vec![4]));
}

/// Texture of 0.1 % under noise of 0.5 %.
#[test]
fn too_little_texture_is_not_told() {
    let psi = angles(6);
    let scene = Tiled { modulation: 0.001, variation: 0.001, ..TILES };
    doubt(registrar(&scene, SIZE, &psi, &wedge(&psi, 1.0), 1.0).polarized(&psi));
}

/// Without variation along one direction, that component is unknown, however sharp the edges are.
#[test]
fn endless_bands_are_not_told() {
    let psi = angles(6);
    let scene = Tiled { pitch: [40.0, f64::INFINITY], ..BANDS };
    doubt(registrar(&scene, SIZE, &psi, &wedge(&psi, 0.0), 1.0).polarized(&psi));
    doubt(registrar(&scene, SIZE, &psi, &wedge(&psi, 2.0), 1.0).polarized(&psi));
}

/// Uniform reflectance and four angles: two perpendicular frames give `A ± C`, the other two `A ± S`. As A has no
/// edges, nothing relates the pairs. Six angles do.
#[test]
fn pairs_of_crossed_frames_need_edges_in_common() {
    let scene = Tiled { variation: 0.0, ..TILES };
    for (n, known) in [(4, false), (6, true)] {
        let psi = angles(n);
        let truth = wedge(&psi, 1.0);
        match registrar(&scene, SIZE, &psi, &truth, 1.0).polarized(&psi) {
            Registration::Told(found) => assert!(known && errors(&found, &truth).0 < 0.01, "{n}: {found:?}"),
            Registration::CannotTell(doubt) => assert!(!known, "{n}: {doubt:?}"),
        }
    }
}

/// Saturated values are no texture: alone they give no result, and beside good tiles no error.
#[test]
fn saturation_is_not_followed() {
    let psi = angles(6);
    let truth = wedge(&psi, 1.5);
    let run = |clipped: fn(usize) -> bool, flat: bool| {
        let mut registrar = Registrar::new(SIZE[0], SIZE[1]);
        for k in 0..6 {
            let frame = TILES.frame(SIZE, psi[k], truth[k], 1.0, k as u64);
            registrar.add(|y: usize, left: usize, values: &mut [f32], bad: &mut [u8]| {
                for i in 0..values.len() {
                    let x = left + i;
                    let v = frame[y * SIZE[0] + x];
                    let saturated = clipped(x) && v > 0.42;
                    // Unsaturated parts are uniform grey where the scene is flat.
                    let grey = 0.3 + 1e-3 * normal((k << 40 | y << 20 | x) as u64) as f32;
                    values[i] = if saturated {
                        0.0
                    } else if flat {
                        grey
                    } else {
                        v
                    };
                    bad[i] |= u8::from(saturated);
                }
            });
        }
        registrar.polarized(&psi)
    };
    doubt(run(|_| true, true));
    let (error, _) = errors(&told(run(|x| x < 150, false)), &truth);
    assert!(error < 0.02, "{error}");
    // All values are saturated.
    let mut blind = Registrar::new(SIZE[0], SIZE[1]);
    (0..6).for_each(|_| blind.add(|_: usize, _: usize, _: &mut [f32], bad: &mut [u8]| bad.fill(1)));
    doubt(blind.polarized(&psi));
}

#[test]
fn tiny_images_and_empty_sets_are_refused() {
    let psi = angles(4);
    let tiny = registrar(&TILES, [31, 400], &psi, &[[0.0; 2]; 4], 1.0);
    assert_eq!(doubt(tiny.polarized(&psi)), Doubt::TooSmall);
    assert_eq!(doubt(Registrar::new(100, 100).polarized(&[])), Doubt::TooSmall);
    assert_eq!(doubt(Registrar::new(0, 0).polarized(&[])), Doubt::TooSmall);
}

/// Small photographs have one window. (In 64 pixels too few edges overlap, and the result is unknown.)
#[test]
fn small_images_are_registered() {
    let psi = angles(8);
    let truth = wedge(&psi, 0.7);
    let found = told(registrar(&TILES, [160, 128], &psi, &truth, 1.0).polarized(&psi));
    let (error, sigma) = errors(&found, &truth);
    assert!(error < 0.02, "{error} {sigma}");
}
