use super::*;

const ANGLES: [f64; 17] = [0.0, 0.9, 1.7, 2.4, 0.3, 1.1, 2.9, 2.0, 0.5, 1.4, 2.6, 0.1, 3.0, 1.9, 0.7, 2.2, 1.2];

/// Frames of a few tiles, the last of which is incomplete.
fn frames(count: usize) -> Vec<Vec<f32>> {
    let value = |k: usize, i: usize| {
        let phase = i as f64 * 0.01;
        (3.0 + (2.0 * (ANGLES[k] - phase)).cos() + 0.01 * ((7 * i + 13 * k) % 11) as f64) as f32
    };
    (0..count).map(|k| (0..2 * TILE + 300).map(|i| value(k, i)).collect()).collect()
}

fn planes(maps: &StokesMaps) -> [&[f32]; 5] {
    [&maps.s0, &maps.s1, &maps.s2, &maps.residual, &maps.correlation]
}

/// For every grouping and number of frames the maps are bit-identical.
#[test]
fn one_by_one_in_groups_and_all_at_once_are_the_same() {
    for count in 3..=ANGLES.len() {
        let (frames, angles) = (frames(count), &ANGLES[..count]);
        let (design, width) = (Design::new(angles).unwrap(), 4);
        let folded = |group: usize| {
            let mut fit = Fit::new(width, frames[0].len() / width);
            for (psi, frames) in angles.chunks(group).zip(frames.chunks(group)) {
                fit.add_several(psi, |k, y, row, _| row.copy_from_slice(&frames[k][y * width..][..width]));
            }
            fit.solve(&design)
        };
        let slices: Vec<&[f32]> = frames.iter().map(Vec::as_slice).collect();
        let mut stack = StokesMaps::default();
        fit_stack(&slices, width, &design, &mut stack);
        assert_eq!((stack.width, stack.height), (width, frames[0].len() / width));
        for group in [1, 2, 3, 5, 17] {
            assert_eq!(planes(&folded(group)), planes(&stack), "{count} frames in groups of {group}");
        }
    }
}

/// Compared with least squares in double precision.
#[test]
fn the_maps_are_those_of_least_squares() {
    let (frames, angles) = (frames(13), &ANGLES[..13]);
    let design = Design::new(angles).unwrap();
    let slices: Vec<&[f32]> = frames.iter().map(Vec::as_slice).collect();
    let mut maps = StokesMaps::default();
    fit_stack(&slices, 4, &design, &mut maps);
    for i in (0..frames[0].len()).step_by(37) {
        let values = || design.rows.iter().zip(&frames).map(|(x, frame)| (x, f64::from(frame[i])));
        let beta = design.inverse * values().map(|(x, v)| x * v).sum::<nalgebra::Vector3<f64>>();
        let left: f64 = values().map(|(x, v)| (v - x.dot(&beta)).powi(2)).sum();
        let wanted = [2.0 * beta[0], 2.0 * beta[1], 2.0 * beta[2], left];
        for (got, wanted) in planes(&maps).into_iter().zip(wanted) {
            assert!((f64::from(got[i]) - wanted).abs() < 1e-5, "pixel {i}: {} {wanted}", got[i]);
        }
    }
}

#[test]
fn maps_contain_only_finite_values() {
    let mut frames = frames(5);
    (frames[0][3], frames[2][TILE], frames[4][7]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
    let slices: Vec<&[f32]> = frames.iter().map(Vec::as_slice).collect();
    let mut maps = StokesMaps::default();
    fit_stack(&slices, 4, &Design::new(&ANGLES[..5]).unwrap(), &mut maps);
    for plane in planes(&maps) {
        assert!([3, 7, TILE].iter().all(|i| plane[*i].is_nan()));
        assert_eq!(plane.iter().filter(|v| v.is_nan()).count(), 3);
    }
}
