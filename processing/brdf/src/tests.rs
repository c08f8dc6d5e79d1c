//! Power densities compared with closed forms and direct sums.

use super::bank::{Bank, Relief, Scratch};
use super::expansion::{Expansion, Kind};
use super::height::{HeightField, Profile, Shape, Synthetic};
use super::pq::{Pq, interpolation_error, repeats};
use super::reference::Reference;
use super::*;
use nacre_base::progress::Silent;
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

fn grating(profile: Profile, depth_um: f64, angle_deg: f64) -> HeightField {
    let shape = Shape::Grating(profile);
    Synthetic { shape, pixels: 100, pixel_um: 0.1, period_um: 2.5, depth_um, angle: angle_deg.to_radians() }
        .field()
        .unwrap()
}

fn fingers() -> HeightField {
    Synthetic { shape: Shape::Fingers, pixels: 60, pixel_um: 0.1, period_um: 1.2, depth_um: 0.5, angle: 0.4 }
        .field()
        .unwrap()
}

#[test]
fn the_reference_is_the_mean_over_all_places_of_a_coherence_window() {
    // Brute force: the patch repeated, the window's amplitude at a grid of positions, the squared transform, the mean.
    let field = HeightField { pixel_um: 0.25, ..fingers() };
    let field = HeightField { width: 12, height: 10, um: field.um[..120].to_vec(), ..field };
    let window = Window::new(8.0).unwrap();
    let sigma_s = 2.0;
    for (place, q) in [([0.1, -0.2], 20.0), ([0.6, 0.35], 31.0)] {
        let mut mean = 0.0;
        let places = 12 * 10;
        for k in 0..places {
            let spot = [(k % 12) as f64, (k / 12) as f64];
            let mut sum = Complex64::new(0.0, 0.0);
            for dy in -60_i64..=60 {
                for dx in -60_i64..=60 {
                    let (x, y) = (spot[0] as i64 + dx, spot[1] as i64 + dy);
                    let h = field.um[(y.rem_euclid(10) * 12 + x.rem_euclid(12)) as usize];
                    let r = (dx as f64 * 0.25).powi(2) + (dy as f64 * 0.25).powi(2);
                    let amplitude = (-0.5 * r / (sigma_s * sigma_s)).exp() / (PI.sqrt() * sigma_s);
                    let phase = -q * h - TAU * 0.25 * (place[0] * x as f64 - place[1] * y as f64);
                    sum += Complex64::from_polar(amplitude * 0.25 * 0.25, phase);
                }
            }
            mean += sum.norm_sqr() / f64::from(places);
        }
        let found = Reference::new(&field).density(place, q, window);
        assert!((found / mean - 1.0).abs() < 1e-6 && mean > 1e-3, "{found} {mean}");
    }
}

#[test]
fn banks_agree_with_direct_sums() {
    let window = Window::new(20.0).unwrap();
    for field in [fingers(), grating(Profile::Blazed, 0.5, 0.0), grating(Profile::Sinusoid, 0.3, 90.0)] {
        let relief = Relief::new(&field);
        let [low, high] = [8.0, 33.0].map(|q| q * relief.half_um);
        for kind in [Kind::Taylor, Kind::Chebyshev, Kind::Nodes] {
            let expansion = Expansion::new(kind, low, high, 1e-7, f64::EPSILON).unwrap();
            let bank = Bank::<f64>::new(&relief, expansion, [3.0; 2], 1e-12, || {});
            let (mut scratch, reference) = (Scratch::default(), Reference::new(&field));
            let mut most = 0.0_f64;
            for k in 0..60 {
                let angle = 0.37 * f64::from(k);
                let place =
                    if k == 0 { [0.4, 0.0] } else { [angle.cos(), angle.sin()].map(|c| c * 0.045 * f64::from(k)) };
                let q = 8.0 + 25.0 * (0.618 * f64::from(k)).fract();
                let truth = reference.density(place, q, window);
                let found = bank.density(place, q, window, window.radius(1e-9), &mut scratch);
                assert!((found - truth).abs() < 1e-6 * window.peak(), "{kind:?} {k}: {found} {truth}");
                most = most.max(truth);
            }
            assert!(most > 1e-3 * window.peak(), "{kind:?}: {most}");
        }
    }
}

#[test]
fn deep_surfaces_are_exact_to_4_um_and_in_single_precision_to_a_thousandth() {
    for depth in [0.5, 2.0, 4.0] {
        // One period of 2.5 µm, fine enough for all orders of such a deep surface.
        let um = (0..250).map(|k| 0.5 * depth * (TAU * f64::from(k) / 250.0).cos()).collect();
        let field = HeightField::new("sinusoid", 250, 1, 0.01, um).unwrap();
        let relief = Relief::new(&field);
        let [low, high] = [8.0, 33.0].map(|q| q * relief.half_um);
        for kind in [Kind::Chebyshev, Kind::Nodes] {
            let of = |error: f64| Expansion::new(kind, low, high, error, f64::EPSILON).unwrap();
            let double = Bank::<f64>::new(&relief, of(1e-6), [49.0, 0.0], 1e-16, || {});
            let single = Bank::<f32>::new(&relief, of(1e-4), [49.0, 0.0], 1e-12, || {});
            let (mut a, mut b) = (Scratch::default(), Scratch::default());
            for q in [8.5, 16.0, 25.0, 32.5] {
                for m in -12..=12_i32 {
                    // Jacobi-Anger expansion: |c_m| = |J_m(q d/2)|.
                    let truth = libm::jn(m.abs(), 0.5 * q * depth).powi(2);
                    let power = |[re, im]: [f64; 2]| re * re + im * im;
                    let f64s = power(double.amplitude_at([m as isize, 0], q, &mut a));
                    let f32s = power(single.amplitude_at([m as isize, 0], q, &mut b));
                    assert!((f64s - truth).abs() < 4e-6, "{kind:?} {depth} {q} {m}: {f64s} {truth}");
                    assert!((f32s - f64s).abs() < 1e-3, "{kind:?} {depth} {q} {m}: {f32s} {f64s}");
                }
                // All frequencies of the patch together hold all the light.
                assert!((double.total(q) - 1.0).abs() < 1e-5, "{kind:?} {depth} {q}: {}", double.total(q));
            }
        }
    }
}

#[test]
fn a_tilted_mirror_reflects_where_mirrors_do() {
    // A rise to the right faces left: light from above leaves to the left.
    let um = (0..100 * 4).map(|k| 0.5 * (f64::from(k % 100) / 100.0)).collect();
    let field = HeightField::new("ramp", 100, 4, 0.05, um).unwrap();
    let window = Window::new(30.0).unwrap();
    let q = TAU / 0.5 * 2.0;
    let at = |f: f64| Reference::new(&field).density([f, 0.0], q, window);
    // 5 µm wide, 0.5 µm high: two wavelengths of path per patch, order -2.
    assert!(at(-2.0 / 5.0) > 0.9 * window.peak() && at(2.0 / 5.0) < 1e-3 * window.peak(), "{} {}", at(-0.4), at(0.4));
    // Along y, a rise upwards faces down.
    let um = (0..100 * 4).map(|k| 0.5 * (f64::from(99 - k / 4) / 100.0)).collect();
    let field = HeightField::new("ramp", 4, 100, 0.05, um).unwrap();
    let at = |f: f64| Reference::new(&field).density([0.0, f], q, window);
    assert!(at(-2.0 / 5.0) > 0.9 * window.peak() && at(2.0 / 5.0) < 1e-3 * window.peak());
    let bank = Bank::<f64>::new(
        &Relief::new(&field),
        Expansion::new(Kind::Chebyshev, 1.0, q * 0.25, 1e-6, 0.0).unwrap(),
        [9.0; 2],
        0.0,
        || {},
    );
    let found = bank.density([0.0, -0.4], q, window, window.radius(1e-9), &mut Scratch::default());
    assert!((found / at(-0.4) - 1.0).abs() < 1e-5);
}

#[test]
fn the_window_holds_the_whole_light_and_its_radius_what_it_says() {
    let window = Window::new(65.0).unwrap();
    assert!((window.sigma - 1.0 / (TAU * 16.25) / 2_f64.sqrt()).abs() < 1e-12);
    let (step, mut sum, mut inside) = (window.sigma / 7.0, 0.0, 0.0);
    let radius = window.radius(0.01);
    for y in -80..=80 {
        for x in -80..=80 {
            let r = f64::from(x).hypot(f64::from(y)) * step;
            let w = window.peak() * (-0.5 * (r / window.sigma).powi(2)).exp() * step * step;
            sum += w;
            inside += if r < radius { w } else { 0.0 };
        }
    }
    assert!((sum - 1.0).abs() < 1e-9 && (inside - 0.99).abs() < 1e-3, "{sum} {inside}");
}

#[test]
fn geometry_knows_mirrors() {
    for theta in [0.0, 0.4, 1.3] {
        let light = Direction::new(theta, 0.7);
        let mirror = Direction::new(theta, 0.7 + PI);
        let pair = Pair::new(light, mirror);
        assert!((pair.gain - 1.0).abs() < 1e-12 && pair.tangent[0].hypot(pair.tangent[1]) < 1e-12);
        assert!((pair.half_cos - theta.cos()).abs() < 1e-12);
        assert!((Pair::v_grooves(light, mirror) - 1.0).abs() < 1e-12);
    }
    assert!(Pair::v_grooves(Direction::new(1.4, 0.0), Direction::new(1.4, 0.1)) < 1.0);
    assert!(Direction::light(90.0, 0.0).is_err() && Direction::light(f64::NAN, 0.0).is_err());
}

fn blazed() -> HeightField {
    // Ten periods of 40 pixels, fine enough for 380 nm at 75 degrees.
    Synthetic {
        shape: Shape::Grating(Profile::Blazed),
        pixels: 400,
        pixel_um: 0.0625,
        period_um: 2.5,
        depth_um: 0.3,
        angle: 0.0,
    }
    .field()
    .unwrap()
}

const METHODS: [Method; 8] = [
    Method::Auto,
    Method::Taylor,
    Method::Chebyshev,
    Method::Fft,
    Method::Nmm,
    Method::Pq,
    Method::PqLinear,
    Method::Reference,
];

#[test]
fn every_method_keeps_the_grating_equation() {
    let field = blazed();
    let quality = height::Quality::of(&field, 65.0);
    let all: Vec<f64> = (380..=780).step_by(5).map(f64::from).collect();
    for method in METHODS.into_iter().filter(|m| *m != Method::Reference) {
        let settings = Settings { light_deg: [75.0, 0.0], method, ..Settings::default() };
        let found = check(&field, &quality, &settings, &all, [Some(2.5), Some(0.0)], &Silent).unwrap();
        assert_eq!(found.peaks.len(), all.len());
        assert!((found.mean_nm - 2500.0).abs() < 1.0, "{method:?} {}", found.mean_nm);
        assert!(found.variance_nm2 < 0.4, "{method:?} {}", found.variance_nm2);
    }
}

#[test]
fn methods_agree_with_direct_sums_within_what_they_predict() {
    let one = Synthetic {
        shape: Shape::Grating(Profile::Sinusoid),
        pixels: 128,
        pixel_um: 0.09,
        period_um: 0.09 * 32.0,
        depth_um: 0.4,
        angle: 0.0,
    };
    let samples = [
        one,
        Synthetic { shape: Shape::Grating(Profile::Blazed), angle: std::f64::consts::FRAC_PI_2, ..one },
        Synthetic { shape: Shape::Grating(Profile::Rectangular { duty: 0.5 }), depth_um: 1.0, ..one },
        Synthetic { shape: Shape::Cd, period_um: 1.6, depth_um: 0.12, ..one },
        Synthetic { shape: Shape::TwoRegions, period_um: 1.3, ..one },
        Synthetic { shape: Shape::Fingers, period_um: 1.2, depth_um: 2.0, ..one },
    ];
    let views: Vec<f64> = (-80..=80).map(|k| f64::from(k) * 0.55).collect();
    for sample in samples {
        let field = sample.field().unwrap();
        let quality = height::Quality::of(&field, 12.0);
        let run = |method, max_error| {
            let settings =
                Settings { light_deg: [20.0, 30.0], method, max_error, coherence_um: 12.0, ..Settings::default() };
            slice(&field, &quality, &settings, [&[420.0, 610.0], &views], Some(10.0), &Silent)
        };
        let truth = run(Method::Reference, 0.01).unwrap();
        let window = Window::new(12.0).unwrap();
        for max_error in [0.05, 0.01, 1e-4] {
            for method in [Method::Auto, Method::Taylor, Method::Chebyshev, Method::Fft, Method::Nmm] {
                let found = match run(method, max_error) {
                    Ok(found) => found,
                    // Two-dimensional or too deep for powers: refused rather than wrong.
                    Err(e) => {
                        assert!(matches!(method, Method::Taylor | Method::Nmm), "{method:?} {e}");
                        continue;
                    }
                };
                assert!(found.error_estimate <= max_error, "{method:?} {sample:?}: {}", found.error_estimate);
                let mut worst = 0.0_f64;
                for (k, (a, b)) in found.values.iter().zip(&truth.values).enumerate() {
                    let nm = [420.0, 610.0][k / views.len()];
                    let light = Direction::light(20.0, 30.0).unwrap();
                    let pair =
                        Pair::new(light, Direction::new(views[k % views.len()].to_radians(), 10_f64.to_radians()));
                    let lobe = 1e-3 * window.peak() * pair.gain * 1e6 / (nm * nm);
                    worst = worst.max((a - b).abs() / b.max(lobe));
                }
                assert!(worst <= max_error && worst.is_finite(), "{method:?} {max_error} {sample:?}: {worst}");
            }
        }
    }
}

#[test]
fn methods_refuse_what_they_cannot_do() {
    let fingers = fingers();
    let quality = height::Quality::of(&fingers, 65.0);
    let of = |field: &HeightField, method| {
        let settings = Settings { method, ..Settings::default() };
        let quality = height::Quality::of(field, 65.0);
        slice(field, &quality, &settings, [&[500.0], &[0.0, 10.0]], None, &Silent)
    };
    assert!(!quality.is_periodic());
    assert!(of(&fingers, Method::Pq).err().unwrap().to_string().contains("edges"));
    assert!(of(&fingers, Method::Nmm).err().unwrap().to_string().contains("several"));
    let deep = HeightField { um: blazed().um.iter().map(|h| h * 20.0).collect(), ..blazed() };
    assert!(of(&deep, Method::Taylor).err().unwrap().to_string().contains("cancel"));
    let coarse = HeightField { pixel_um: 0.5, ..blazed() };
    let settings = Settings::default();
    let problem = map(&coarse, &quality, &settings, Views::all(16), &Silent).err().unwrap().to_string();
    assert!(problem.contains("pixels of at most 0.1900"), "{problem}");
    assert!(map(&fingers, &quality, &settings, Views::all(1), &Silent).is_err());
    assert!(
        map(&fingers, &quality, &Settings { max_error: f64::NAN, ..Settings::default() }, Views::all(16), &Silent)
            .is_err()
    );
}

/// Coarse steps split an order into separate colours, and the measured error shows it. Fine steps are as accurate as
/// the default.
#[test]
fn steps_of_wavelengths_are_as_far_off_as_they_say() {
    let field = fingers();
    let quality = height::Quality::of(&field, 65.0);
    let of = |wavelength_step_nm| {
        let settings = Settings { wavelength_step_nm, coherence_um: 20.0, ..Settings::default() };
        map(&field, &quality, &settings, Views::all(64), &Silent).unwrap()
    };
    let exact = of(None);
    let off = |found: &Map| {
        let pairs = found.xyz.iter().zip(&exact.xyz).filter(|(a, _)| a[1].is_finite());
        let squares = pairs.fold([0.0_f64; 2], |[d, s], (a, b)| {
            let each = a.iter().zip(b).map(|(a, b)| [f64::from(a - b).powi(2), f64::from(*b).powi(2)]);
            each.fold([d, s], |[d, s], [e, t]| [d + e, s + t])
        });
        (squares[0] / squares[1]).sqrt()
    };
    let (fine, coarse) = (of(Some(1.0)), of(Some(80.0)));
    assert!(off(&fine) < 0.01 && fine.error_estimate < 0.03, "{} {}", off(&fine), fine.error_estimate);
    assert!(off(&coarse) > 0.1, "{}", off(&coarse));
    let said = coarse.error_estimate - exact.error_estimate;
    assert!((said / off(&coarse) - 1.0).abs() < 0.1, "{said} {}", off(&coarse));
    assert!(coarse.choice.why.contains("80 nm"), "{}", coarse.choice.why);
}

#[test]
fn a_mirror_reflects_all_light_into_its_lobe() {
    let field = HeightField::new("flat", 32, 32, 0.1, vec![0.3; 1024]).unwrap();
    let quality = height::Quality::of(&field, 65.0);
    for light_deg in [[0.0, 0.0], [40.0, 70.0]] {
        // A coherence of 8 µm gives a lobe that a map resolves.
        let settings = Settings { light_deg, coherence_um: 8.0, ..Settings::default() };
        let found = map(&field, &quality, &settings, Views::all(400), &Silent).unwrap();
        // ∫ f cos θ dω = ∫ f dx dy.
        let sum: f64 = found.xyz.iter().filter(|v| v[1].is_finite()).map(|v| f64::from(v[1])).sum();
        let flux = sum * (2.0 / 400.0_f64).powi(2);
        // The gain is 1 only at the centre of the lobe.
        assert!((flux - 1.0).abs() < 0.003, "{light_deg:?}: {flux}");
        let relative = Settings { normalisation: Normalisation::Relative, ..settings };
        let peak = map(&field, &quality, &relative, Views::all(401), &Silent)
            .unwrap()
            .xyz
            .iter()
            .map(|v| v[1])
            .fold(0.0, f32::max);
        // Half a map pixel beside the centre of the lobe.
        assert!((peak - 1.0).abs() < 5e-4, "{peak}");
    }
}

#[test]
fn nmm_finds_the_light_of_a_map_at_few_wavelengths() {
    let field = Synthetic {
        shape: Shape::Grating(Profile::Sinusoid),
        pixels: 75,
        pixel_um: 0.1,
        period_um: 2.5,
        depth_um: 0.2,
        angle: 0.0,
    }
    .field()
    .unwrap();
    let quality = height::Quality::of(&field, 65.0);
    let run =
        |method| map(&field, &quality, &Settings { method, ..Settings::default() }, Views::all(63), &Silent).unwrap();
    let (all, few, truth) = (run(Method::Chebyshev), run(Method::Nmm), run(Method::Reference));
    let most = truth.xyz.iter().map(|v| v[1]).fold(0.0, f32::max);
    for found in [&all, &few] {
        let (mut off, mut sum) = (0.0, 0.0);
        for (a, t) in found.xyz.iter().zip(&truth.xyz) {
            for c in 0..3 {
                assert_eq!(a[c].is_nan(), t[c].is_nan());
                if t[c].is_finite() {
                    assert!((a[c] - t[c]).abs() <= 0.01 * t[c] + 1e-5 * most, "{a:?} {t:?}");
                    off += f64::from(a[c] - t[c]).powi(2);
                    sum += f64::from(t[c]).powi(2);
                }
            }
        }
        assert!((off / sum).sqrt() < found.error_estimate && found.error_estimate <= 0.01, "{off} {sum}");
    }
    // The picture of a sinusoid is symmetric.
    let at = |x: usize, y: usize| truth.xyz[y * 63 + x][1];
    assert!((0..31).all(|x| {
        let (a, b) = (at(x, 31), at(62 - x, 31));
        (a - b).abs() <= 1e-3 * a.max(b).max(1e-6) || a.is_nan()
    }));
}

#[test]
fn every_expansion_conserves_energy_on_a_surface_of_two_dimensions() {
    let field = fingers();
    let relief = Relief::new(&field);
    let [low, high] = [8.0, 33.0].map(|q| q * relief.half_um);
    for kind in [Kind::Taylor, Kind::Chebyshev, Kind::Nodes] {
        let of = |error: f64| Expansion::new(kind, low, high, error, f64::EPSILON).unwrap();
        // All frequencies except those at half a cycle per pixel, which only an even number of pixels has.
        let odd = HeightField { width: 59, height: 59, um: crop(&field, 59), ..field.clone() };
        let relief = Relief::new(&odd);
        let double = Bank::<f64>::new(&relief, of(1e-5), [99.0; 2], 1e-12, || {});
        for q in [8.0, 12.3, 20.0, 33.0] {
            assert!((double.total(q) - 1.0).abs() < 1e-3, "{kind:?} {q}: {}", double.total(q));
        }
    }
}

fn crop(field: &HeightField, side: usize) -> Vec<f64> {
    field.um.chunks(field.width).take(side).flat_map(|row| row[..side].to_vec()).collect()
}

#[test]
fn pq_is_the_sum_over_all_repetitions() {
    // 25 pixels per period, two periods per patch, eight patches; along y a sixteenth of the coherence is one patch.
    let field = Synthetic {
        shape: Shape::Grating(Profile::Blazed),
        pixels: 50,
        pixel_um: 0.1,
        period_um: 2.5,
        depth_um: 0.3,
        angle: 0.0,
    }
    .field()
    .unwrap();
    let relief = Relief::new(&field);
    let expansion = Expansion::new(Kind::Chebyshev, 5.0 * relief.half_um, 33.0 * relief.half_um, 1e-9, 0.0).unwrap();
    for linear in [false, true] {
        let bank = Bank::<f64>::new(&relief, expansion.clone(), [9.0; 2], 0.0, || {});
        let pq = Pq { bank, pixels: [50, 50], size_um: relief.size_um, repeats: repeats(relief.size_um, 40.0), linear };
        let n = pq.repeats[0];
        assert_eq!(pq.repeats, [8, 8]);
        let limit = interpolation_error(pq.repeats, linear);
        let mut scratch = Scratch::default();
        for q in [12.0, 23.0] {
            for k in -60..=60 {
                let f = f64::from(k) * 0.4 / 20.0 + 0.003;
                // Pixels of all repetitions along x; along y the sum is that of a mirror.
                let sum: Complex64 = (0..50 * n)
                    .map(|x| Complex64::from_polar(0.1, -q * field.um[x % 50] - TAU * f * 0.1 * x as f64))
                    .sum();
                let along = 5.0 * n as f64;
                let truth = sum.norm_sqr() / along * along;
                let found = pq.density([f, 0.0], q, &mut scratch);
                // Amplitude error relative to the strongest lobe.
                let area = pq.area_um2();
                let most = limit * (truth * area).sqrt() + 0.25 * limit * limit * area;
                assert!((found - truth).abs() <= most, "{linear} {q} {f}: {found} {truth}");
            }
        }
    }
}
