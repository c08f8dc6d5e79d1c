//! Tests of the selected model against the truth, on series for which the paper's method fails.

use crate::film::choose::{Choice, choose};
use crate::film::cloud::{CloudPoint, cloud};
use crate::film::curve::Source;
use crate::film::models::{Candidate, Model, orientation};
use crate::film::projection::CurveSamples;
use crate::film::search::Begin;
use crate::film::solve_options::SolveOptions;
use crate::solve::{orient_with, solve_model};
use crate::synthetic::{Series, Spread, Synthetic, even_angles, uniform};
use crate::{MASK_SNR, OrientationMaps, angle_difference};
use num_complex::Complex;
use std::f64::consts::{PI, TAU};

/// Mean absolute error in degrees under a candidate, after the best common offset.
fn error(candidate: &Candidate, pairs: &[(CloudPoint, f32)]) -> f64 {
    let errors = errors(candidate, pairs);
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// Absolute error of each point in degrees.
fn errors(candidate: &Candidate, pairs: &[(CloudPoint, f32)]) -> Vec<f64> {
    let curve_samples = CurveSamples::new(candidate.curve);
    let off: Vec<f64> =
        pairs.iter().map(|(p, t)| orientation(candidate, &curve_samples, p).0 - f64::from(*t)).collect();
    let (sin, cos) = off.iter().fold((0.0, 0.0), |(s, c), d| (s + (2.0 * d).sin(), c + (2.0 * d).cos()));
    let offset = 0.5 * f64::atan2(sin, cos);
    off.iter().map(|d| angle_difference(*d, offset).abs().to_degrees()).collect()
}

/// The choice of `auto`, and the error of every candidate.
fn compared(scene: &Synthetic, pixels: usize, seed: u64) -> (Choice, Vec<f64>) {
    compared_for(Model::Auto, scene, pixels, seed)
}

/// The choice for a wanted model, and the error of every candidate.
fn compared_for(wanted: Model, scene: &Synthetic, pixels: usize, seed: u64) -> (Choice, Vec<f64>) {
    let (choice, pairs) = chosen(wanted, scene, pixels, seed);
    let errors = choice.candidates.iter().map(|c| error(c, &pairs)).collect();
    (choice, errors)
}

/// The choice, with its points and their true orientations.
fn chosen(wanted: Model, scene: &Synthetic, pixels: usize, seed: u64) -> (Choice, Vec<(CloudPoint, f32)>) {
    let Series { maps, design, noise, truth } = scene.photograph(pixels, seed).unwrap();
    let points = cloud(&maps, &design, &noise, pixels);
    assert_eq!(points.len(), truth.len());
    let pairs: Vec<_> = points.into_iter().zip(truth).filter(|(p, _)| p.snr >= f64::from(MASK_SNR)).collect();
    let points: Vec<_> = pairs.iter().map(|(p, _)| *p).collect();
    (choose(&points, wanted, Begin::Anywhere, 0.0, Source::IDEAL).unwrap(), pairs)
}

fn listed(choice: &Choice, errors: &[f64]) -> String {
    let line = |k: usize| {
        let c = &choice.candidates[k];
        let film = c.film.map(|f| f.canonical().to_array().map(|v| (v * 1e3).round() / 1e3));
        let (uncertain, difference) = (c.uncertain.to_degrees(), choice.differences[k].to_degrees());
        format!(
            "  {} error {:.3}° differs {difference:.3}° uncertain {uncertain:.3}° behind {:.1} ± {:.1} {film:?}\n",
            c.name(),
            errors[k],
            choice.behind[k],
            choice.difference_sigma[k]
        )
    };
    (0..errors.len()).map(line).collect()
}

/// Scenes on which the paper's pre-normalization fails: films of any axis, and reflectance that varies by ±40 %.
#[test]
fn hard_scenes_are_right() {
    let scenes = [
        // The points hardly distinguish the two explanations of such a small shift of the circle: typical errors are
        // 0.13 to 0.27°.
        (1.1, 45.0, 0.5, 12, 0.5),
        (1.05, 175.0, 10.0, 12, 1.0),
        (1.2, 20.0, 10.0, 12, 0.45),
        (1.2, 150.0, 2.0, 4, 0.4),
        (1.02, 178.0, 1.0, 12, 2.5),
    ];
    let seed = 7;
    for (k, (r, zeta, retardance, angles, most)) in scenes.into_iter().enumerate() {
        // Both distributions of orientations if `NACRE_DRAWS` requests more than a sample, otherwise alternating.
        let both = [Spread::Even, Spread::Bands(5)];
        let taken = if std::env::var_os("NACRE_DRAWS").is_some() { &both[..] } else { &both[k % 2..=k % 2] };
        for spread in taken.iter().copied() {
            let scene = Synthetic {
                ratio: Complex::from_polar(r, f64::to_radians(zeta)),
                retardance: f64::to_radians(retardance),
                axis: PI * uniform(seed, k as u64),
                spread,
                reflectance: 0.4,
                angles: even_angles(angles),
                ..Synthetic::default()
            };
            let (choice, errors) = compared(&scene, 40_000, seed);
            let found = errors[choice.chosen];
            println!(
                "r {r} ζ {zeta}° Δn {retardance}° {spread:?}: {found:.3}° by {}",
                choice.candidates[choice.chosen].name()
            );
            assert!(
                found <= most,
                "seed {seed} {scene:?}
{}",
                listed(&choice, &errors)
            );
        }
    }
}

/// Stray light reduces every point's polarization, and a film fit must not attribute this to other parameters.
#[test]
fn stray_light_is_part_of_the_model() {
    let scene = |stray| Synthetic {
        ratio: Complex::from_polar(1.2, 150f64.to_radians()),
        retardance: 10f64.to_radians(),
        axis: 0.35,
        stray,
        ..Synthetic::default()
    };
    let (choice, errors) = compared(&scene(0.0), 40_000, 7);
    let none = errors[choice.chosen];
    let (choice, errors) = compared(&scene(0.02), 40_000, 7);
    let (found, chosen) = (errors[choice.chosen], &choice.candidates[choice.chosen]);
    assert!(found < 1.25 * none + 0.05, "{none}\n{}", listed(&choice, &errors));
    // S0 is 1 + r² for light of intensity 2 without a film; a film changes it by a few per cent.
    let share = 0.04 / (1.0 + 1.44 + 0.04);
    let stray = chosen.film.map_or(0.0, |f| f.stray);
    assert!((stray / share - 1.0).abs() < 0.1, "{stray} {share}\n{}", listed(&choice, &errors));
}

/// A small map far off every circle also gets its film; the required error is that of the large map.
#[test]
fn a_film_is_found_in_a_small_map() {
    let scene = Synthetic {
        ratio: Complex::from_polar(1.2, 20f64.to_radians()),
        retardance: 10f64.to_radians(),
        axis: 0.7,
        ..Synthetic::default()
    };
    let (choice, errors) = compared(&scene, 4000, 7);
    assert!(errors[choice.chosen] < 0.45, "{}", listed(&choice, &errors));
}

/// Five orientations and a front reflection do not determine the film: a choice with a large error must report it.
#[test]
fn few_orientations_leave_other_films_possible() {
    let (choice, errors) = compared(&drawn(77_001), 30_000, 77_001);
    let (found, claimed) = (errors[choice.chosen], choice.error.map(f64::to_degrees));
    assert!(
        found < 1.0 || claimed.is_none_or(|c| c > 0.5 * found),
        "{found} {claimed:?}\n{}",
        listed(&choice, &errors)
    );
}

/// Films that are easily mistaken for others. Evidence without held-out points was 44° off, distances to curves that
/// bend within the noise 23°, and a search that starts only from samples 35°. Measured errors: 0.65, 1.66 and 9.9°;
/// five orientations allow no better.
#[test]
fn curves_within_their_noise_are_distinguished() {
    for (seed, most) in [(5005, 1.0), (5021, 2.5), (5030, 12.0)] {
        let (choice, errors) = compared(&drawn(seed), 30_000, seed);
        assert!(errors[choice.chosen] < most, "{seed}\n{}", listed(&choice, &errors));
    }
}

/// A random film and grating: r 0.7 to 1.5, ζ 0 to 180°, Δn 0 to 12°, any axis. Half of them have a front reflection of
/// amplitude up to 0.25 and any phase. Orientations are evenly distributed, or five.
fn drawn(seed: u64) -> Synthetic {
    let draw = |i: u64, low: f64, high: f64| low + (high - low) * uniform(seed, 1000 + i);
    let front = Complex::from_polar(draw(5, 0.0, 0.25), draw(6, 0.0, TAU));
    Synthetic {
        ratio: Complex::from_polar(draw(1, 0.7f64.ln(), 1.5f64.ln()).exp(), draw(2, 0.0, PI)),
        retardance: draw(3, 0.0, 12.0).to_radians(),
        axis: draw(4, 0.0, PI),
        front: if draw(7, 0.0, 1.0) < 0.5 { front } else { 0.0.into() },
        spread: if draw(0, 0.0, 1.0) < 0.5 { Spread::Even } else { Spread::Bands(5) },
        reflectance: 0.4,
        ..Synthetic::default()
    }
}

/// For random films and gratings, few errors exceed 1.25 x + 0.05° of the best model's x, and even fewer are
/// unreported. `NACRE_DRAWS=200` sets the number of draws, `NACRE_FIRST` skips the ones before.
#[test]
fn auto_is_nearly_the_best_of_its_models() {
    let number = |name: &str| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
    let count = number("NACRE_DRAWS").unwrap_or(4);
    let seed = number("NACRE_SEED").unwrap_or(1);
    println!("seed {seed}");
    let (mut bad, mut lies) = (0, 0);
    let first = number("NACRE_FIRST").unwrap_or(0);
    for k in first..first + count {
        let seed = seed.wrapping_mul(1000) + k;
        let scene = drawn(seed);
        let (choice, errors) = compared(&scene, 30_000, seed);
        let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
        let found = errors[choice.chosen];
        if found <= 1.25 * best + 0.05 {
            continue;
        }
        bad += 1;
        let (ratio, dn) = (scene.ratio, scene.retardance.to_degrees());
        let (r, zeta, claimed) = (ratio.norm(), ratio.arg().to_degrees(), choice.error.map(f64::to_degrees));
        let listed = format!(
            "{seed}: r {r:.3} ζ {zeta:.0}° Δn {dn:.1}° front {:.2} {:?}: {found:.3}° instead of {best:.3}°, claimed {claimed:.2?}\n{}",
            scene.front.norm(),
            scene.spread,
            listed(&choice, &errors)
        );
        println!("{listed}");
        lies += usize::from(claimed.is_some_and(|c| found > 3.0 * c));
    }
    println!(
        "{bad} of {count} farther from the best than 1.25 x + 0.05°, {lies} of them by more than three times what was claimed"
    );
    // In 208 draws (seeds 5, 9 and 77) ten exceeded the limit, since their points do not distinguish the true film from
    // the choice. One of these reported less than a third of its error, noise beside a second branch. At these rates,
    // five or three of twelve occur by chance once in 5000 runs; the four draws of the default seed are fixed.
    assert!(3 * bad <= count && 6 * lies as u64 <= count, "seed {seed}: {bad} of {count}, {lies} not told");
}

/// A given model reports its error correctly, although many other models are more likely and most of these are wrong,
/// too. 68 % of the points have an error below the reported one including noise, with a tolerance of a tenth.
#[test]
fn a_given_model_states_its_error() {
    for (front, spread) in [(0.0, Spread::Even), (0.1, Spread::Even), (0.0, Spread::Bands(5))] {
        let front = Complex::from_polar(front, 1.0);
        let film = Synthetic { retardance: 10f64.to_radians(), axis: 20f64.to_radians(), ..Synthetic::default() };
        let scene = Synthetic { front, spread, ..film };
        let (choice, pairs) = chosen(Model::Sinusoid, &scene, 30_000, 7);
        let mut off = errors(&choice.candidates[choice.chosen], &pairs);
        let found = nacre_base::statistics::quantile(&mut off, 0.683).unwrap();
        let claimed = choice.error.map_or(f64::INFINITY, f64::to_degrees);
        assert!((claimed / found - 1.0).abs() < 0.1, "{front} {spread:?}: {found} {claimed}");
    }
}

/// With a weak front reflection and a weak film, the two films of an off-centre circle differ by more than the noise,
/// and photographs hardly distinguish them. The more likely one is selected, and σ includes the difference.
#[test]
fn ambiguous_films_claim_the_difference_of_their_rivals() {
    let (mut means, mut ratios) = (vec![], vec![]);
    for seed in 0..6 {
        let scene = Synthetic {
            ratio: Complex::from_polar(1.1, 45f64.to_radians()),
            front: Complex::from_polar(0.05, TAU * uniform(seed, 5)),
            retardance: 0.5f64.to_radians(),
            axis: PI * uniform(seed, 77),
            spread: [Spread::Even, Spread::Bands(5)][seed as usize % 2],
            reflectance: 0.2,
            ..Synthetic::default()
        };
        let Series { mut maps, design, noise, truth } = scene.photograph(40_000, seed).unwrap();
        let map = orient_with(&mut maps, &design, &noise, &SolveOptions::of(Model::Auto));
        let found = crate::compare(&map.orientation, &map.sigma, &truth, |_| true).unwrap();
        let off = |i: usize| f64::from(map.orientation[i]) - found.offset_deg.to_radians();
        ratios.extend(
            (0..truth.len())
                .filter(|i| map.orientation[*i].is_finite())
                .map(|i| angle_difference(off(i), f64::from(truth[i])).abs() / f64::from(map.sigma[i])),
        );
        means.push(found.mean_deg);
    }
    let within = |limit: f64| ratios.iter().filter(|r| **r < limit).count() as f64 / ratios.len() as f64;
    println!(
        "{means:.3?}: {:.3} within 1σ, {:.4} within 3σ, {:.5} beyond 5σ",
        within(1.0),
        within(3.0),
        1.0 - within(5.0)
    );
    assert!(within(1.0) > 0.63 && within(3.0) > 0.99 && 1.0 - within(5.0) < 1e-3);
    // Noise alone causes 0.11°, the wrong film 0.34 to 0.46°.
    means.sort_by(f64::total_cmp);
    assert!(means[2] < 0.2, "{means:?}");
}

/// Hardly any pixel deviates by more than 5σ where models fail. The cases are films with a larger retardance than any
/// packaging, a wrong given model, and too few points for the correct one.
#[test]
fn no_model_is_wrong_and_confident() {
    let film = |retardance: f64| Synthetic {
        ratio: Complex::from_polar(1.2, 150f64.to_radians()),
        retardance: retardance.to_radians(),
        axis: 20f64.to_radians(),
        reflectance: 0.2,
        ..Synthetic::default()
    };
    let of_ratio = |r: f64| Synthetic { ratio: Complex::from_polar(r, 150f64.to_radians()), ..film(5.0) };
    let near_mirror = Synthetic { ratio: Complex::from_polar(1.2, 176f64.to_radians()), ..film(3.0) };
    let scenes = [
        ("film of 60°", film(60.0), Model::Auto, 4000),
        ("film of 75°", film(75.0), Model::Auto, 4000),
        ("film of 90°", film(90.0), Model::Auto, 4000),
        ("film of 5° in a small map", film(5.0), Model::Auto, 1200),
        ("sinusoid, film of 2°", film(2.0), Model::Sinusoid, 4000),
        ("sinusoid, film of 10°", film(10.0), Model::Sinusoid, 4000),
        ("sinusoid, film of 75°", film(75.0), Model::Sinusoid, 4000),
        ("sinusoid, ζ 176°", near_mirror.clone(), Model::Sinusoid, 4000),
        // Its circle is off by twice the noise, and explains the points to 6 % of their variance.
        ("circle, film of 3°", film(3.0), Model::Circle, 4000),
        ("circle, film of 10°", film(10.0), Model::Circle, 4000),
        ("auto, ζ 176°", near_mirror, Model::Auto, 4000),
        // A reflector of a single polarization, or nearly so: films up to r 1.3 explain the points.
        ("r 0.0001", of_ratio(1e-4), Model::Auto, 4000),
        ("r 0.01", of_ratio(0.01), Model::Auto, 4000),
        ("r 1000", of_ratio(1e3), Model::Auto, 4000),
        // A weaker reflection with a stronger film also explains the points.
        ("front 0.4", Synthetic { front: 0.4.into(), ..film(5.0) }, Model::Auto, 4000),
        // For gratings of ζ 90° the circle stays about the origin. All of them, with any r and film, lie on the same
        // ellipse as a polarizer.
        ("ζ 90°, film of 3°", Synthetic { ratio: Complex::new(0.0, 1.2), ..film(3.0) }, Model::Auto, 4000),
        ("ζ 90°, film of 1.5°", Synthetic { ratio: Complex::new(0.0, 1.2), ..film(1.5) }, Model::Auto, 30_000),
    ];
    for (name, scene, model, pixels) in scenes {
        let Series { mut maps, design, noise, truth } = scene.photograph(pixels, 5).unwrap();
        let map = orient_with(&mut maps, &design, &noise, &SolveOptions { pixels, ..SolveOptions::of(model) });
        assert_hardly_wrong(name, &map, &truth);
    }
    // Fifty points for four thousand pixels.
    let Series { mut maps, design, noise, truth } = film(10.0).photograph(4000, 5).unwrap();
    let map = orient_with(&mut maps, &design, &noise, &SolveOptions { pixels: 50, ..SolveOptions::of(Model::Auto) });
    assert_hardly_wrong("fifty points", &map, &truth);
}

fn assert_hardly_wrong(name: &str, map: &OrientationMaps, truth: &[f32]) {
    let found = crate::compare(&map.orientation, &map.sigma, truth, |_| true).unwrap();
    let error = |i: usize| {
        let off = f64::from(map.orientation[i]) - found.offset_deg.to_radians();
        angle_difference(off, f64::from(truth[i])).abs()
    };
    let is_wrong = |i: &usize| map.orientation[*i].is_finite() && error(*i) > 5.0 * f64::from(map.sigma[*i]);
    let wrong = (0..truth.len()).filter(is_wrong).count() as f64 / truth.len() as f64;
    let mut sigma = map.sigma.clone();
    sigma.sort_by(f32::total_cmp);
    println!(
        "{name}: {:.2}° off, median σ {:.2}°, {wrong:.4} wrong",
        found.mean_deg,
        sigma[sigma.len() / 2].to_degrees()
    );
    assert!(wrong <= 1e-3, "{name}: {wrong} {found:?}");
}

/// σ matches the scatter, with and without a film. In every decile of σ and every 20° of orientation, 68 % of the
/// pixels are within 1σ, 99 % within 3σ, and hardly any beyond 5σ. Few pixels with sufficient signal are masked.
#[test]
fn sigma_is_the_scatter_everywhere() {
    const PIXELS: usize = 200_000;
    for (r, zeta, retardance, reflectance) in
        [(1.1, 45.0_f64, 0.0_f64, 0.9), (1.2, 20.0, 10.0, 0.9), (1.05, 175.0, 4.0, 0.5)]
    {
        let scene = Synthetic {
            ratio: Complex::from_polar(r, zeta.to_radians()),
            retardance: retardance.to_radians(),
            axis: 0.7,
            reflectance,
            ..Synthetic::default()
        };
        let Series { mut maps, design, noise, truth } = scene.photograph(PIXELS, 11).unwrap();
        let points = cloud(&maps, &design, &noise, PIXELS);
        let solved = solve_model(&mut maps, &design, &noise, &SolveOptions::of(Model::Auto));
        let choice = solved.choice.unwrap();
        let found = crate::compare(&solved.map.orientation, &solved.map.sigma, &truth, |_| true).unwrap();
        let rows: Vec<[f64; 4]> = (0..PIXELS)
            .filter(|i| solved.map.orientation[*i].is_finite() && points[*i].snr >= 5.0)
            .map(|i| {
                let (at, truth) = (f64::from(solved.map.orientation[i]), f64::from(truth[i]));
                let error = angle_difference(at - found.offset_deg.to_radians(), truth);
                let sigma = f64::from(solved.map.sigma[i]);
                [error.abs() / sigma, sigma, truth, f64::from(u8::from(error.abs() > 5.0 * sigma))]
            })
            .collect();
        println!("{} σ {:.2}°: {found:?}", choice.candidates[choice.chosen].name(), rows[0][1].to_degrees());
        let within = |of: &[&[f64; 4]], limit: f64| {
            of.iter().filter(|row| row[0] < limit).count() as f64 / of.len().max(1) as f64
        };
        let wrong = rows.iter().map(|row| row[3]).sum::<f64>() / rows.len() as f64;
        assert!(wrong <= 1e-3, "{wrong} beyond 5σ");
        let mut sorted: Vec<&[f64; 4]> = rows.iter().collect();
        sorted.sort_by(|a, b| a[1].total_cmp(&b[1]));
        let mut groups: Vec<(String, Vec<&[f64; 4]>)> = sorted
            .chunks(sorted.len().div_ceil(10))
            .enumerate()
            .map(|(k, g)| (format!("decile {k}"), g.to_vec()))
            .collect();
        for k in 0..9 {
            let inside = |row: &&[f64; 4]| (row[2].to_degrees() / 20.0) as usize == k;
            groups.push((format!("{}°", 20 * k), rows.iter().filter(inside).collect()));
        }
        for (name, group) in groups.iter().filter(|g| g.1.len() > 2000) {
            let (one, three) = (within(group, 1.0), within(group, 3.0));
            assert!((one - 0.683).abs() < 0.03 && three > 0.99, "{name}: {one:.3} within 1σ, {three:.4} within 3σ");
        }
        // Of the pixels with a noise-limited error below 3°, 5 % may be masked.
        let knowable = |i: &usize| solved.map.sigma[*i] < 3f32.to_radians() || 0.5 / points[*i].snr < 3f64.to_radians();
        let known: Vec<usize> = (0..PIXELS).filter(knowable).collect();
        let masked = known.iter().filter(|i| solved.map.orientation[**i].is_nan()).count() as f64 / known.len() as f64;
        println!("{masked:.4} of {} masked", known.len());
        assert!(masked < 0.05, "{masked}");
    }
}
