use super::*;
use crate::angle_difference;
use nacre_base::progress::Silent;

/// Normal deviates by Box and Muller on a hash.
fn normal(seed: u64) -> f64 {
    let hash = |mut z: u64| {
        z = z.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x632b_e59b_d9b4_e019);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    let (u, v) = (hash(2 * seed).max(1e-300), hash(2 * seed + 1));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

const SIDE: usize = 64;

/// A map of the orientations `truth(x, y)` (NaN masks) with noise of `sigma(x, y)`.
fn noisy(truth: impl Fn(usize, usize) -> f32, sigma: impl Fn(usize, usize) -> f32, seed: u64) -> OrientationMaps {
    let at = |i: usize| (i % SIDE, i / SIDE);
    let sigmas: Vec<f32> = (0..SIDE * SIDE).map(|i| sigma(at(i).0, at(i).1)).collect();
    let deviate = |i: usize| sigmas[i] * normal(seed << 32 | i as u64) as f32;
    let orientation = (0..SIDE * SIDE).map(|i| fold(truth(at(i).0, at(i).1) + deviate(i))).collect();
    OrientationMaps { width: SIDE, height: SIDE, orientation, sigma: sigmas }
}

fn rounds(n: u32) -> Smoothing {
    n.to_string().parse().unwrap()
}

/// Root mean square over pixels and repeats, where `counts` holds: scatter about the truth, and the predicted σ.
fn scatter_and_sigma(
    truth: impl Fn(usize, usize) -> f32 + Copy,
    sigma: impl Fn(usize, usize) -> f32 + Copy,
    smoothing: Smoothing,
    repeats: u64,
    counts: impl Fn(usize, usize) -> bool,
) -> (f64, f64) {
    let (mut scatter, mut stated, mut n) = (0.0, 0.0, 0.0);
    // Changes of the noise-free map by the filter are not noise.
    let mut clean = noisy(truth, |_, _| 0.0, 0);
    clean.sigma = noisy(truth, sigma, 0).sigma;
    let clean = smooth(&clean, smoothing, 1.0, &Silent).unwrap();
    for repeat in 0..repeats {
        let map = smooth(&noisy(truth, sigma, repeat + 1), smoothing, 1.0, &Silent).unwrap();
        for i in (0..SIDE * SIDE).filter(|i| counts(i % SIDE, i / SIDE) && clean.orientation[*i].is_finite()) {
            scatter += angle_difference(map.orientation[i].into(), clean.orientation[i].into()).powi(2);
            stated += f64::from(map.sigma[i]).powi(2);
            n += 1.0;
        }
    }
    ((scatter / n).sqrt(), (stated / n).sqrt())
}

/// The predicted σ matches the scatter of repeated noise, within 10 % in a uniform region with its borders and 20 %
/// beside an edge.
#[test]
fn sigma_is_the_scatter_of_repeats() {
    for (n, repeats) in [(1, 20), (10, 60), (50, 60)] {
        let (scatter, sigma) = scatter_and_sigma(|_, _| 3.13, |_, _| 0.03, rounds(n), repeats, |_, _| true);
        assert!((sigma / scatter - 1.0).abs() < 0.1, "{n} rounds: σ {sigma} scatter {scatter}");
        // A uniform Gaussian of n iterations, each of 4.5 px² (biweight of radius 6): 0.133, 0.042, 0.019; borders have
        // more.
        let least = 1.0 / (4.0 * std::f64::consts::PI * 4.5 * f64::from(n)).sqrt();
        assert!((1.0..1.6).contains(&(scatter / 0.03 / least)), "{n} rounds: {scatter}");
    }
    let truth = |x: usize, _: usize| if x < 32 { 0.2 } else { 1.5 };
    let beside = |x: usize, _: usize| x.abs_diff(32) < 3;
    let (scatter, sigma) = scatter_and_sigma(truth, |_, _| 0.03, Smoothing::LIGHT, 40, beside);
    assert!((sigma / scatter - 1.0).abs() < 0.2, "at an edge: σ {sigma} scatter {scatter}");
}

/// Where regions mix in ways that few moments cannot describe, σ is too small, within the documented limit.
#[test]
fn sigma_is_a_third_too_small_at_worst() {
    let sparse = |x: usize, y: usize| if normal((x * 91 + y) as u64) > 0.0 { 3.13 } else { f32::NAN };
    let strips = |x: usize, _: usize| if (x / 5).is_multiple_of(2) { 0.2 } else { 1.5 };
    let checks = |x: usize, y: usize| if (x / 8 + y / 8).is_multiple_of(2) { 0.02 } else { 0.06 };
    let cases = [
        scatter_and_sigma(sparse, |_, _| 0.03, Smoothing::STRONG, 40, |_, _| true),
        scatter_and_sigma(strips, |_, _| 0.03, Smoothing::STRONG, 40, |_, _| true),
        scatter_and_sigma(|_, _| 3.13, checks, Smoothing::STRONG, 40, |_, _| true),
        scatter_and_sigma(|x, _| 0.05 * x as f32, |_, _| 0.03, rounds(1), 10, |_, _| true),
        scatter_and_sigma(|x, _| 0.05 * x as f32, |_, _| 0.03, Smoothing::LIGHT, 10, |_, _| true),
        scatter_and_sigma(|x, _| 0.02 * x as f32, |_, _| 0.03, Smoothing::LIGHT, 10, |_, _| true),
        scatter_and_sigma(|x, _| 0.03 * x as f32, |_, _| 0.002, Smoothing::LIGHT, 10, |_, _| true),
        scatter_and_sigma(|_, _| 3.13, |_, _| 0.12, rounds(1), 10, |_, _| true),
    ];
    for (i, (scatter, sigma)) in cases.into_iter().enumerate() {
        assert!((0.67..1.1).contains(&(sigma / scatter)), "case {i}: σ {sigma} scatter {scatter}");
    }
}

/// Resampled photographs have noise that is correlated between neighbours, which σ includes once many pixels are
/// averaged.
#[test]
fn noise_that_neighbours_share_counts() {
    let map = noisy(|_, _| 1.0, |_, _| 0.03, 1);
    let [alone, shared] =
        [1.0, 2.0].map(|c| smooth(&map, Smoothing::LIGHT, c, &Silent).unwrap().sigma[SIDE * SIDE / 2]);
    assert!((shared / alone - 2f32.sqrt()).abs() < 1e-3);
}

fn errors(map: &[f32], truth: impl Fn(usize, usize) -> f32) -> Vec<f64> {
    let error = |i: usize| angle_difference(map[i].into(), truth(i % SIDE, i / SIDE).into()).abs();
    (0..SIDE * SIDE).map(error).collect()
}

/// A tile on another one, 11° to 90° apart: its edges are preserved to the pixel; only its corners may change.
#[test]
fn edges_stay() {
    for (apart, sigma) in [(0.2_f32, 0.005), (0.5, 0.03), (0.8, 0.03), (1.57, 0.03), (1.57, 0.1)] {
        let inside = |x: usize, y: usize| (16..48).contains(&x) && (16..48).contains(&y);
        let truth = |x: usize, y: usize| if inside(x, y) { 0.1 + apart } else { 0.1 };
        let map = noisy(truth, |_, _| sigma, 5);
        let raw: f64 = errors(&map.orientation, truth).iter().sum();
        for smoothing in [Smoothing::LIGHT, Smoothing::STRONG] {
            let smoothed = smoothed_orientation(&map, smoothing, &Silent).unwrap();
            let errors = errors(&smoothed, truth);
            let wrong: Vec<_> = (0..errors.len())
                .filter(|i| errors[*i] > 0.4 * f64::from(apart))
                .map(|i| (i % SIDE, i / SIDE))
                .collect();
            let corner = |(x, y): &(usize, usize)| [16, 47].contains(x) && [16, 47].contains(y);
            assert!(wrong.iter().all(corner), "{apart} {smoothing}: {wrong:?}");
            let rest: f64 = errors.iter().filter(|e| **e <= 0.4 * f64::from(apart)).sum();
            assert!(rest < 0.5 * raw, "{apart} {smoothing}: {rest} {raw}");
        }
    }
}

/// Outliers, alone or in pairs, are replaced by their surroundings.
#[test]
fn salt_is_removed() {
    let truth = |x: usize, y: usize| 0.01 * (x + y) as f32;
    let mut map = noisy(truth, |_, _| 0.02, 3);
    let clean = smoothed_orientation(&map, Smoothing::LIGHT, &Silent).unwrap();
    for k in 0..80_usize {
        let i = k * 2_654_435_761 % (SIDE * SIDE);
        map.orientation[i] = fold(map.orientation[i] + 1.2);
    }
    let off = |map: &[f32]| errors(map, |x, y| clean[y * SIDE + x]).into_iter().fold(0.0, f64::max);
    assert!(off(&map.orientation) > 1.1);
    let worst = off(&smoothed_orientation(&map, Smoothing::LIGHT, &Silent).unwrap());
    assert!(worst < 0.03, "{worst}");
}

/// Masked pixels stay masked, keep their σ and do not affect their neighbours.
#[test]
fn the_mask_is_respected() {
    let masked = |x: usize, y: usize| (x / 7 + y / 5).is_multiple_of(3);
    let truth = |x: usize, y: usize| if masked(x, y) { f32::NAN } else { 1.0 };
    let a = noisy(truth, |_, _| 0.02, 9);
    let b = noisy(truth, |x, y| if masked(x, y) { 1.5 } else { 0.02 }, 9);
    let [a, b] = [a, b].map(|m| smooth(&m, Smoothing::LIGHT, 1.0, &Silent).unwrap());
    for i in 0..SIDE * SIDE {
        let hidden = masked(i % SIDE, i / SIDE);
        assert_eq!(a.orientation[i].is_finite(), !hidden);
        assert_eq!(a.orientation[i].to_bits(), b.orientation[i].to_bits());
        assert_eq!(b.sigma[i] == 1.5, hidden);
    }
}

/// Orientations about 0° are averaged across 180°; an image narrower than the window is permitted.
#[test]
fn orientations_wrap() {
    let map = noisy(|_, _| 0.0, |_, _| 0.05, 4);
    assert!(map.orientation.iter().any(|t| *t > 3.0) && map.orientation.iter().any(|t| *t < 0.1));
    let smoothed = smoothed_orientation(&map, Smoothing::LIGHT, &Silent).unwrap();
    assert!(errors(&smoothed, |_, _| 0.0).iter().all(|e| *e < 0.015));
    let small = OrientationMaps { width: 2, height: 1, orientation: vec![0.05, 3.1], sigma: vec![0.1, 0.1] };
    let found = smooth(&small, rounds(1), 1.0, &Silent).unwrap();
    assert!(
        found.orientation.iter().all(|t| angle_difference((*t).into(), 0.0).abs() < 0.03),
        "{:?}",
        found.orientation
    );
    assert!(found.sigma.iter().all(|s| (s / 0.0707 - 1.0).abs() < 0.05), "{:?}", found.sigma);
}

/// Reliable pixels have larger weights.
#[test]
fn reliable_pixels_lead() {
    let odd = |x: usize| x % 2 == 1;
    let map = noisy(|x, _| if odd(x) { 1.2 } else { 1.0 }, |x, _| if odd(x) { 0.1 } else { 1e-4 }, 2);
    let smoothed = smoothed_orientation(&map, rounds(1), &Silent).unwrap();
    let mean = smoothed.iter().sum::<f32>() / smoothed.len() as f32;
    assert!(mean < 1.05, "{mean}");
}

#[test]
fn it_can_be_cancelled() {
    struct Stopped;
    impl Progress for Stopped {
        fn stage(&self, _: &str, _: u64) {}
        fn step(&self) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let map = noisy(|_, _| 1.0, |_, _| 0.05, 4);
    assert!(matches!(smoothed_orientation(&map, Smoothing::LIGHT, &Stopped), Err(nacre_base::Error::Cancelled)));
}

#[test]
fn names_and_numbers_are_read() {
    for text in ["none", "light", "strong", "3", "1000"] {
        assert_eq!(text.parse::<Smoothing>().unwrap().to_string(), text);
    }
    assert_eq!("10".parse::<Smoothing>().unwrap(), Smoothing::LIGHT);
    assert!(["", "heavy", "-1", "1001", "1.5"].iter().all(|t| t.parse::<Smoothing>().is_err()));
}
