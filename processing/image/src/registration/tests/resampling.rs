//! Tests of the resampler.

use super::super::Resampler;
use super::normal;

const WIDTH: usize = 40;
const HEIGHT: usize = 30;

fn moved(
    shift: [f64; 2],
    value: impl Fn(usize, usize) -> f32,
    flag: impl Fn(usize, usize) -> bool,
) -> (Vec<f32>, Vec<u8>) {
    let resampler = Resampler::new(shift, WIDTH, HEIGHT);
    let (mut values, mut bad) = (vec![0.0; WIDTH * HEIGHT], vec![0; WIDTH * HEIGHT]);
    for y in 0..HEIGHT {
        let source = |y: usize, row: &mut [f32], bad: &mut [u8]| {
            for x in 0..WIDTH {
                row[x] = value(x, y);
                bad[x] |= u8::from(flag(x, y));
            }
        };
        let at = y * WIDTH;
        resampler.row(y, source, &mut values[at..at + WIDTH], &mut bad[at..at + WIDTH]);
    }
    (values, bad)
}

#[test]
fn whole_pixels_are_copied_and_the_border_is_bad() {
    let value = |x: usize, y: usize| (x * 31 + y * 7) as f32;
    for (dx, dy) in [(0_i32, 0_i32), (3, -2), (-5, 1), (100, 0), (0, -100), (-40, 30)] {
        let (values, bad) = moved([dx.into(), dy.into()], value, |_, _| false);
        for i in 0..WIDTH * HEIGHT {
            let (x, y) = ((i % WIDTH) as i32 + dx, (i / WIDTH) as i32 + dy);
            let inside = (0..WIDTH as i32).contains(&x) && (0..HEIGHT as i32).contains(&y);
            assert_eq!(bad[i] == 0, inside, "{dx} {dy} at {i}");
            assert!(!inside || values[i] == value(x as usize, y as usize));
        }
    }
}

/// Six taps preserve polynomials up to the fifth degree; a windowed sinc would move even a ramp by 0.01 px.
#[test]
fn polynomials_are_kept() {
    let polynomial = |x: f64, y: f64| {
        let (x, y) = (0.05 * x - 1.0, 0.07 * y - 1.0);
        1.0 + 0.5 * x - 0.3 * y + x * y + 0.2 * x.powi(3) - 0.4 * x.powi(5) + 0.1 * y.powi(4)
    };
    for shift in [[0.5, 0.5], [-0.3, 1.7], [2.01, -0.99]] {
        let (values, bad) = moved(shift, |x, y| polynomial(x as f64, y as f64) as f32, |_, _| false);
        let good: Vec<usize> = (0..WIDTH * HEIGHT).filter(|i| bad[*i] == 0).collect();
        // Lost are three rows or columns on one side, two on the other, and the whole pixels of the shift.
        assert!(good.len() > (WIDTH - 8) * (HEIGHT - 8), "{}", good.len());
        for i in good {
            let wanted = polynomial((i % WIDTH) as f64 + shift[0], (i / WIDTH) as f64 + shift[1]);
            assert!((f64::from(values[i]) - wanted).abs() < 2e-6, "{shift:?} at {i}");
        }
    }
}

#[test]
fn a_bad_value_spoils_what_it_touches_and_no_more() {
    let spoiled = |shift| {
        let (_, bad) = moved(shift, |_, _| 1.0, |x, y| (x, y) == (20, 15));
        let (_, border) = moved(shift, |_, _| 1.0, |_, _| false);
        bad.iter().zip(border).filter(|(bad, border)| **bad != *border).count()
    };
    assert_eq!([spoiled([0.4, 0.4]), spoiled([0.4, 2.0]), spoiled([1.0, 2.0])], [36, 6, 1]);
}

/// The factor equals the variance of resampled noise; 1,000 pixels of correlated noise determine it to about 6 %.
#[test]
fn the_noise_factor_is_that_of_noise() {
    for shift in [[0.0, 0.0], [0.5, 0.5], [0.25, 0.1], [3.5, -1.0]] {
        let (mut square, mut count) = (0.0, 0.0);
        for seed in 0..20 {
            let (values, bad) = moved(shift, |x, y| normal((seed << 32 | y << 16 | x) as u64) as f32, |_, _| false);
            for v in values.iter().zip(bad).filter(|(_, bad)| *bad == 0).map(|(v, _)| f64::from(*v)) {
                square += v * v;
                count += 1.0;
            }
        }
        let factor = Resampler::new(shift, WIDTH, HEIGHT).noise_factor();
        assert!((square / count / factor - 1.0_f64).abs() < 0.06, "{shift:?}: {} {factor}", square / count);
    }
}
