//! The chosen model against the truth, on series that the paper's method cannot do.

use crate::film::asked::Asked;
use crate::film::choose::{Choice, choose};
use crate::film::cloud::{CloudPoint, cloud};
use crate::film::foot::Path;
use crate::film::models::{Candidate, Model, orientation};
use crate::film::search::Begin;
use crate::solve::{orient_with, solve_model};
use crate::synthetic::{Series, Spread, Synthetic, even_angles, uniform};
use crate::{MASK_SNR, OrientationMaps, angle_difference};
use num_complex::Complex;
use std::f64::consts::{PI, TAU};

/// Mean absolute error in degrees under a candidate, the best common offset removed.
fn error(candidate: &Candidate, pairs: &[(CloudPoint, f32)]) -> f64 {
    let errors = errors(candidate, pairs);
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// Absolute error of each point in degrees.
fn errors(candidate: &Candidate, pairs: &[(CloudPoint, f32)]) -> Vec<f64> {
    let path = Path::new(candidate.curve);
    let off: Vec<f64> = pairs.iter().map(|(p, t)| orientation(candidate, &path, p).0 - f64::from(*t)).collect();
    let (sin, cos) = off.iter().fold((0.0, 0.0), |(s, c), d| (s + (2.0 * d).sin(), c + (2.0 * d).cos()));
    let offset = 0.5 * f64::atan2(sin, cos);
    off.iter().map(|d| angle_difference(*d, offset).abs().to_degrees()).collect()
}

/// What `auto` chooses, and the error of every candidate.
fn compared(scene: &Synthetic, pixels: usize, seed: u64) -> (Choice, Vec<f64>) {
    compared_for(Model::Auto, scene, pixels, seed)
}

/// What is chosen where a model is wanted, and the error of every candidate.
fn compared_for(wanted: Model, scene: &Synthetic, pixels: usize, seed: u64) -> (Choice, Vec<f64>) {
    let (choice, pairs) = chosen(wanted, scene, pixels, seed);
    let errors = choice.candidates.iter().map(|c| error(c, &pairs)).collect();
    (choice, errors)
}

/// What is chosen, on which points, with the truth.
fn chosen(wanted: Model, scene: &Synthetic, pixels: usize, seed: u64) -> (Choice, Vec<(CloudPoint, f32)>) {
    let Series { maps, design, noise, truth } = scene.photograph(pixels, seed).unwrap();
    let points = cloud(&maps, &design, &noise, pixels);
    assert_eq!(points.len(), truth.len());
    let pairs: Vec<_> = points.into_iter().zip(truth).filter(|(p, _)| p.snr >= f64::from(MASK_SNR)).collect();
    let points: Vec<_> = pairs.iter().map(|(p, _)| *p).collect();
    (choose(&points, wanted, Begin::Anywhere, 0.0).unwrap(), pairs)
}

fn told(choice: &Choice, errors: &[f64]) -> String {
    let line = |k: usize| {
        let c = &choice.candidates[k];
        let film = c.film.map(|f| f.canonical().to_array().map(|v| (v * 1e3).round() / 1e3));
        let (uncertain, difference) = (c.uncertain.to_degrees(), choice.differences[k].to_degrees());
        format!(
            "  {} error {:.3}° differs {difference:.3}° uncertain {uncertain:.3}° behind {:.1} ± {:.1} {film:?}\n",
            c.name(),
            errors[k],
            choice.behind[k],
            choice.chance[k]
        )
    };
    (0..errors.len()).map(line).collect()
}

/// The scenes that the paper's pre-normalization fails on: films of any axis, reflectance that varies by ±40 %.
#[test]
fn hard_scenes_are_right() {
    let scenes = [
        // The points hardly tell the two explanations of so small a shift of the circle apart: typically 0.13 to 0.27°.
        (1.1, 45.0, 0.5, 12, 0.5),
        (1.05, 175.0, 10.0, 12, 1.0),
        (1.2, 20.0, 10.0, 12, 0.45),
        (1.2, 150.0, 2.0, 4, 0.4),
        (1.02, 178.0, 1.0, 12, 2.5),
    ];
    let seed = 7;
    for (k, (r, zeta, retardance, angles, most)) in scenes.into_iter().enumerate() {
        // Both distributions of orientations where `NACRE_DRAWS` asks for more than a sample, else each in turn.
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
                told(&choice, &errors)
            );
        }
    }
}

/// Light from around the bench makes every point's polarization less, which a film's fit must not take for something else.
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
    assert!(found < 1.25 * none + 0.05, "{none}\n{}", told(&choice, &errors));
    // S0 is 1 + r² of light of intensity 2 without a film; one changes it by a few per cent.
    let share = 0.04 / (1.0 + 1.44 + 0.04);
    let stray = chosen.film.map_or(0.0, |f| f.stray);
    assert!((stray / share - 1.0).abs() < 0.1, "{stray} {share}\n{}", told(&choice, &errors));
}

/// A map of few pixels far off every circle gets its film all the same; the error is that wanted of the large one.
#[test]
fn a_film_is_found_in_a_small_map() {
    let scene = Synthetic {
        ratio: Complex::from_polar(1.2, 20f64.to_radians()),
        retardance: 10f64.to_radians(),
        axis: 0.7,
        ..Synthetic::default()
    };
    let (choice, errors) = compared(&scene, 4000, 7);
    assert!(errors[choice.chosen] < 0.45, "{}", told(&choice, &errors));
}

/// Five orientations and a front reflection do not determine the film: a choice that is far off must not claim to know.
#[test]
fn few_orientations_leave_other_films_possible() {
    let (choice, errors) = compared(&drawn(77_001), 30_000, 77_001);
    let (found, claimed) = (errors[choice.chosen], choice.error.map(f64::to_degrees));
    assert!(found < 1.0 || claimed.is_none_or(|c| c > 0.5 * found), "{found} {claimed:?}\n{}", told(&choice, &errors));
}

/// Films that are easily taken for others: by evidence that does not hold points out (44° off), by distances to curves that bend within the noise
/// (23°), and by a search that begins from samples alone (35°). Measured were 0.65, 1.66 and 9.9°, which five orientations do not tell better.
#[test]
fn curves_within_their_noise_are_told_apart() {
    for (seed, most) in [(5005, 1.0), (5021, 2.5), (5030, 12.0)] {
        let (choice, errors) = compared(&drawn(seed), 30_000, seed);
        assert!(errors[choice.chosen] < most, "{seed}\n{}", told(&choice, &errors));
    }
}

/// A film and a grating: r 0.7 to 1.5, ζ 0 to 180°, Δn 0 to 12°, any axis, half of them with a front reflection of amplitude up to
/// 0.25 and any phase, orientations evenly spread or five.
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

/// Films and gratings drawn by a seed: few are farther from the best than 1.25 x + 0.05°, and fewer do not say so. `NACRE_DRAWS=200`
/// takes all that there is time for, `NACRE_FIRST` leaves out those before.
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
        let told = format!(
            "{seed}: r {r:.3} ζ {zeta:.0}° Δn {dn:.1}° front {:.2} {:?}: {found:.3}° instead of {best:.3}°, claimed {claimed:.2?}\n{}",
            scene.front.norm(),
            scene.spread,
            told(&choice, &errors)
        );
        println!("{told}");
        lies += usize::from(claimed.is_some_and(|c| found > 3.0 * c));
    }
    println!(
        "{bad} of {count} farther from the best than 1.25 x + 0.05°, {lies} of them by more than three times what was claimed"
    );
    // Ten of 208 were measured (seeds 5, 9 and 77), whose points do not tell the true film from what is chosen; one of these claimed less than a third of
    // its error, which is noise beside a second branch. At these rates, five or three of twelve are chance once in 5000 runs; the four
    // draws of the default seed are always the same ones.
    assert!(3 * bad <= count && 6 * lies as u64 <= count, "seed {seed}: {bad} of {count}, {lies} not told");
}

/// A model that was asked for claims what it is off by and no more, though many are likelier than it and most of these wrong as well: 68 % of the points
/// have a smaller error than claimed with noise, to a tenth of it.
#[test]
fn what_was_asked_for_claims_what_it_is_off_by() {
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

/// A weak front reflection beside a weak film: the two films that a circle off the origin can mean differ by more than the noise, and photographs hardly
/// decide between them. The likelier is taken, and σ includes what the other differs by.
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
        let map = orient_with(&mut maps, &design, &noise, &Asked::of(Model::Auto));
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
    // Noise alone makes 0.11°, the wrong film 0.34 to 0.46°.
    means.sort_by(f64::total_cmp);
    assert!(means[2] < 0.2, "{means:?}");
}

/// Hardly any pixel is more than 5σ off where models fail: films that delay by more than any packaging does, a model that was
/// asked for and is wrong, and too few points for the right one.
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
        // Reflects one polarization only, or nearly so: films from there to r 1.3 explain the points.
        ("r 0.0001", of_ratio(1e-4), Model::Auto, 4000),
        ("r 0.01", of_ratio(0.01), Model::Auto, 4000),
        ("r 1000", of_ratio(1e3), Model::Auto, 4000),
        // A weaker reflection of a stronger film explains the points as well.
        ("front 0.4", Synthetic { front: 0.4.into(), ..film(5.0) }, Model::Auto, 4000),
        // Of gratings of ζ 90° the circle stays about the origin, and all of them lie on the same ellipse as a polarizer does, whatever r and film.
        ("ζ 90°, film of 3°", Synthetic { ratio: Complex::new(0.0, 1.2), ..film(3.0) }, Model::Auto, 4000),
        ("ζ 90°, film of 1.5°", Synthetic { ratio: Complex::new(0.0, 1.2), ..film(1.5) }, Model::Auto, 30_000),
    ];
    for (name, scene, model, pixels) in scenes {
        let Series { mut maps, design, noise, truth } = scene.photograph(pixels, 5).unwrap();
        let map = orient_with(&mut maps, &design, &noise, &Asked { pixels, ..Asked::of(model) });
        assert_hardly_wrong(name, &map, &truth);
    }
    // Fifty points for four thousand pixels.
    let Series { mut maps, design, noise, truth } = film(10.0).photograph(4000, 5).unwrap();
    let map = orient_with(&mut maps, &design, &noise, &Asked { pixels: 50, ..Asked::of(Model::Auto) });
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

/// σ is the scatter: in every decile of σ and every 20° of orientation 68 % of the pixels are within 1σ and 99 % within 3σ,
/// hardly any beyond 5σ, and few of those that noise allows to know are masked; with and without a film.
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
        let solved = solve_model(&mut maps, &design, &noise, &Asked::of(Model::Auto));
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
        // Of the pixels that noise lets one know to 3°, 5 % may be masked.
        let knowable = |i: &usize| solved.map.sigma[*i] < 3f32.to_radians() || 0.5 / points[*i].snr < 3f64.to_radians();
        let known: Vec<usize> = (0..PIXELS).filter(knowable).collect();
        let masked = known.iter().filter(|i| solved.map.orientation[**i].is_nan()).count() as f64 / known.len() as f64;
        println!("{masked:.4} of {} masked", known.len());
        assert!(masked < 0.05, "{masked}");
    }
}
