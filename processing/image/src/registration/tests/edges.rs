//! Effect of registration on orientations at the edges of tiles.

use super::super::Resampler;
use super::{TILES, angles, registrar, told, wedge};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

const SIZE: [usize; 2] = [320, 288];

/// S0, S1 and S2 of every pixel; NaN without a value in some frame.
type Stokes = Vec<[f32; 3]>;

/// Least-squares fit of frames with `shifts`, each corrected by its entry in `undone` (Malus: I = (S0 + S1 cos 2ψ + S2
/// sin 2ψ) / 2).
fn fitted(psi: &[f64], shifts: &[[f64; 2]], undone: Option<&[[f64; 2]]>) -> Stokes {
    let [width, height] = SIZE;
    let rows: Vec<Vector3<f64>> =
        psi.iter().map(|psi| 0.5 * Vector3::new(1.0, (2.0 * psi).cos(), (2.0 * psi).sin())).collect();
    let inverse = rows.iter().map(|r| r * r.transpose()).sum::<Matrix3<f64>>().try_inverse().unwrap();
    let mut sums = vec![Vector3::<f64>::zeros(); width * height];
    for (k, angle) in psi.iter().enumerate() {
        let frame = TILES.frame(SIZE, *angle, shifts[k], 1.0, k as u64);
        let row = |y: usize, values: &mut [f32], _: &mut [u8]| values.copy_from_slice(&frame[y * width..][..width]);
        let resampler = undone.map(|undone| Resampler::new(undone[k], width, height));
        for (y, sums) in sums.chunks_mut(width).enumerate() {
            let (mut values, mut bad) = (vec![0.0; width], vec![0; width]);
            match &resampler {
                Some(resampler) => resampler.row(y, row, &mut values, &mut bad),
                None => row(y, &mut values, &mut bad),
            }
            for ((sum, value), bad) in sums.iter_mut().zip(values).zip(bad) {
                *sum += rows[k] * if bad == 0 { f64::from(value) } else { f64::NAN };
            }
        }
    }
    sums.iter().map(|sum| (inverse * sum).map(|v| v as f32).into()).collect()
}

/// Mean orientation errors in degrees, at edges and elsewhere, of a map of the scene shifted by `at`.
fn orientation_errors(maps: &Stokes, at: [f64; 2]) -> [f64; 2] {
    let (mut sum, mut count) = ([0.0; 2], [0.0; 2]);
    for i in (0..maps.len()).filter(|i| maps[*i][0].is_finite()) {
        let (x, y) = ((i % SIZE[0]) as f64 - at[0], (i / SIZE[0]) as f64 - at[1]);
        let ([a, c, s], around) = (TILES.at(x, y), [[2.0, 0.0], [-2.0, 0.0], [0.0, 2.0], [0.0, -2.0]]);
        let edge = around.iter().any(|[dx, dy]| {
            let [b, d, t] = TILES.at(x + dx, y + dy);
            (b - a).abs() + (d - c).abs() + (t - s).abs() > 1e-3
        });
        // Opposite orientations of neighbours cancel.
        if c.hypot(s) < 0.2 * TILES.modulation * a {
            continue;
        }
        let (truth, found) = (0.5 * s.atan2(c), 0.5 * f64::from(maps[i][2]).atan2(maps[i][1].into()));
        sum[usize::from(!edge)] += ((found - truth + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2).abs().to_degrees();
        count[usize::from(!edge)] += 1.0;
    }
    [0, 1].map(|k| sum[k] / count[k])
}

#[test]
fn orientations_at_edges_are_restored() {
    let psi = angles(12);
    let still = [[0.0; 2]; 12];
    let [unshifted, _] = orientation_errors(&fitted(&psi, &still, None), [0.0; 2]);
    for px in [0.3, 1.0, 3.0] {
        let truth = wedge(&psi, px);
        let mean = [0, 1].map(|i| truth.iter().map(|t| t[i]).sum::<f64>() / 12.0);
        let found = told(registrar(&TILES, SIZE, &psi, &truth, 1.0).polarized(&psi));
        let undone: Vec<[f64; 2]> = found.iter().map(|s| [s.dx, s.dy]).collect();
        let [spoiled, inside] = orientation_errors(&fitted(&psi, &truth, None), mean);
        let [restored, quiet] = orientation_errors(&fitted(&psi, &truth, Some(&undone)), mean);
        // A tenth of the error due to shifts may remain; inside the tiles, resampling only averages noise.
        let stays = (restored - unshifted) / (spoiled - unshifted);
        assert!(stays < 0.1, "{px} px: {unshifted}°, spoiled {spoiled}°, restored {restored}°");
        assert!(quiet < inside, "{px} px: {quiet}° {inside}°");
    }
}
