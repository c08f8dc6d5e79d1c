use super::{lattice, random, room};
use crate::environment::factor::{Factors, Kind, Settings};
use crate::environment::{
    Environment, Frame, Lights, Table, clamped, normalized_error, turned_back, turned_to, two_pass,
};
use nacre_base::progress::Silent;
use std::f64::consts::{FRAC_PI_2, PI};

fn factors(table: &Table, settings: Settings) -> Factors {
    Factors::of(table, &settings).unwrap()
}

/// Error against the full integral, at directions all over the sphere.
fn error(environment: &Environment, table: &Table, meridian: f64, found: &[[f32; 3]]) -> f64 {
    let lights = Lights::new(environment, 2);
    let (mut some, mut truth) = (vec![], vec![]);
    for k in 0..60 {
        let i = (random(k) * found.len() as f64) as usize;
        let direction =
            environment.direction((i % environment.width) as f64 + 0.5, (i / environment.width) as f64 + 0.5);
        truth.push(lights.by_table(table, &Frame::facing(direction, meridian), direction).map(|v| v as f32));
        some.push(found[i]);
    }
    normalized_error(&some, &truth)
}

#[test]
fn two_passes_are_the_full_integral() {
    let environment = room(256);
    // Perpendicular and oblique directions, both without mirror symmetry.
    for directions in [[0.0, FRAC_PI_2], [0.3, 0.3 + 1.2], [1.9, 0.5]] {
        let spots = lattice(128, 0.7, directions, 0.17, 0.035);
        let table =
            Table::from_fn(128, 0.7, |h| spots.at(h).map(|v| f64::from(v) * (1.0 + 0.5 * h[0] + 0.3 * h[1]))).unwrap();
        let f = factors(&table, Settings { directions: Some(directions), max_error: 0.01, ..Settings::default() });
        let mut found = f.reflected(&environment, &Silent).unwrap();
        clamped(&mut found);
        let off = error(&environment, &table, directions[1], &found);
        println!("{directions:?}: rank {:?}, table {:.4}, picture {off:.4}", f.rank, f.error());
        assert!(off < 0.02, "{directions:?} {off}");
    }
}

#[test]
fn a_white_furnace_is_white() {
    let table = lattice(128, 0.7, [0.2, 1.7], 0.17, 0.035);
    let white = Environment::of(64, 32, vec![[1.0; 3]; 2048]).unwrap();
    let truth = Lights::new(&white, 16).by_table(&table, &Frame::facing([0.6, 0.0, 0.8], 1.7), [0.6, 0.0, 0.8]);
    for kind in [Kind::Singular, Kind::Nonnegative, Kind::Line] {
        let f = factors(&table, Settings { rank: Some(24), kind, directions: Some([0.2, 1.7]), ..Settings::default() });
        let found = two_pass(&white, &f.parts[0], &Silent).unwrap();
        for c in 0..3 {
            let (least, most) = found.iter().fold((f32::MAX, 0.0_f32), |(l, m), p| (l.min(p[c]), m.max(p[c])));
            let off = |v: f32| (f64::from(v) / truth[c] - 1.0).abs();
            println!("{kind:?} {c}: {least} {most} {}", truth[c]);
            assert!(off(least) < 0.005 && off(most) < 0.005, "{kind:?}: {least} to {most} for {}", truth[c]);
        }
    }
}

#[test]
fn printed_passes_have_no_rank() {
    let environment = room(128);
    let table = lattice(96, 0.7, [0.0, FRAC_PI_2], 0.2, 0.04);
    let f = factors(&table, Settings { rank: Some(10), directions: Some([0.0, FRAC_PI_2]), ..Settings::default() });
    let right = error(&environment, &table, FRAC_PI_2, &two_pass(&environment, &f.parts[0], &Silent).unwrap());
    let printed = two_pass(&environment, &f.parts[0].as_printed(), &Silent).unwrap();
    let printed = error(&environment, &table, FRAC_PI_2, &printed);
    println!("right {right}, printed {printed}");
    assert!(printed > 10.0 * right);
}

#[test]
fn rotations_put_the_poles_where_they_do_no_harm() {
    let environment = room(256);
    let frame = Frame::facing([0.3, 0.4, 0.75_f64.sqrt()], 0.0);
    let there = turned_to(&environment, &frame).unwrap();
    // The direction of the normal is at the centre of the picture.
    let middle = there.radiance([1.0, 0.0, 0.0]);
    let normal = environment.radiance(frame.normal);
    assert!((middle[0] - normal[0]).abs() < 0.05 * normal[0].max(0.1));
    let back = turned_back(&there, &frame).unwrap();
    // Two interpolations blur lamps of two pixels strongly, so this checks only their positions; the smooth sky below
    // checks the values.
    let off = normalized_error(&back.rgb, &environment.rgb);
    assert!(off < 0.8, "{off}");
    let smooth = Environment::of(
        256,
        128,
        (0..256 * 128)
            .map(|i| {
                let d = environment.direction((i % 256) as f64 + 0.5, (i / 256) as f64 + 0.5);
                [d[0] + 2.0, d[1] + 2.0, d[2] + 2.0].map(|v| v as f32)
            })
            .collect(),
    )
    .unwrap();
    let back = turned_back(&turned_to(&smooth, &frame).unwrap(), &frame).unwrap();
    assert!(normalized_error(&back.rgb, &smooth.rgb) < 1e-3);
}

#[test]
fn patterns_are_recognised() {
    let spots = lattice(128, 0.7, [0.3, 1.6], 0.17, 0.03);
    let found = factors(&spots, Settings::default());
    let angles = [found.parts[0].grid.across(), found.parts[0].grid.meridian].map(|a| a.rem_euclid(PI));
    for wanted in [0.3, 1.6] {
        assert!(angles.iter().any(|a| (a - wanted).sin().abs() < 0.01), "{angles:?}");
    }
    let streaks = |angles: &'static [f64]| {
        Table::from_fn(128, 0.7, move |h| {
            let line =
                |a: &f64| (-((h[1] * a.cos() - h[0] * a.sin()) / 0.02).powi(2)).exp() * (-h[0].hypot(h[1]) / 0.3).exp();
            [angles.iter().map(line).sum(); 3]
        })
        .unwrap()
    };
    let radial =
        Table::from_fn(128, 0.7, |h| [(1.0 + (60.0 * h[0].hypot(h[1])).cos()) * (-h[0].hypot(h[1]) / 0.2).exp(); 3])
            .unwrap();
    let report = |table: &Table, parts| {
        let settings = Settings { parts, ..Settings::default() };
        factors(table, settings).report(table, Kind::Singular)
    };
    let r = report(&radial, 1);
    assert_eq!(r.pattern, "radial");
    let three = report(&streaks(&[0.2, 1.25, 2.3]), 1);
    assert_eq!(three.pattern, "three directions or more");
    let apart = report(&streaks(&[0.2, 1.25, 2.3]), 3);
    let terms = |r: &crate::environment::factor::Report| r.parts.iter().map(|p| p.rank).sum::<usize>();
    println!(
        "radial {} {}, three {} {}, in parts {} {}",
        terms(&r),
        r.error,
        terms(&three),
        three.error,
        terms(&apart),
        apart.error
    );
    assert_eq!(apart.parts.len(), 3);
    assert!(terms(&apart) < terms(&three));
    assert_eq!(report(&streaks(&[0.7]), 1).pattern, "one direction");
}

#[test]
fn lattices_that_are_brightest_along_their_diagonals_lie_along_their_sides() {
    // Separable except for the included geometric factor; spots on the axes have a fifth of the light of the others.
    let side = |v: f64| -> f64 {
        let spot = |k: i32| (-((v - 0.1 * f64::from(k)) / 0.012).powi(2)).exp() * if k == 0 { 0.2 } else { 1.0 };
        (-6..=6).map(spot).sum::<f64>() * (-v.abs() / 0.4).exp()
    };
    let table = Table::from_fn(128, 0.7, |h| [side(h[0]) * side(h[1]); 3]).unwrap();
    let found = factors(&table, Settings { max_error: 0.05, ..Settings::default() });
    let angles = [found.parts[0].grid.across(), found.parts[0].grid.meridian];
    assert!(angles.iter().all(|a| (2.0 * a).sin().abs() < 0.05), "{angles:?}");
    let of =
        |directions| factors(&table, Settings { max_error: 0.05, directions: Some(directions), ..Settings::default() });
    let (sides, diagonals) = (of([0.0, FRAC_PI_2]), of([0.5 * FRAC_PI_2, 1.5 * FRAC_PI_2]));
    assert!(found.rank[0] <= sides.rank[0] && found.rank[0] < diagonals.rank[0], "{:?}", [found.rank, diagonals.rank]);
}

#[test]
fn settings_that_make_no_sense_are_refused_by_name() {
    let table = lattice(32, 0.7, [0.0, FRAC_PI_2], 0.2, 0.05);
    for (settings, word) in [
        (Settings { rank: Some(0), ..Settings::default() }, "rank"),
        (Settings { max_error: f64::NAN, ..Settings::default() }, "max-error"),
        (Settings { directions: Some([0.1, 0.1]), ..Settings::default() }, "directions-deg"),
        (Settings { directions: Some([f64::NAN, 0.1]), ..Settings::default() }, "directions-deg"),
        (Settings { parts: 9, ..Settings::default() }, "parts"),
    ] {
        let words = Factors::of(&table, &settings).unwrap_err().to_string();
        assert!(words.starts_with(word), "{words}");
    }
    let dark = Table::from_fn(32, 0.7, |_| [0.0; 3]).unwrap();
    assert!(Factors::of(&dark, &Settings::default()).is_err());
    let odd = Environment::of(5, 2, vec![[1.0; 3]; 10]).unwrap();
    let f = factors(&table, Settings::default());
    assert!(two_pass(&odd, &f.parts[0], &Silent).is_err());
}

/// Three non-separable streaks. The expected numbers are those of numpy's `linalg.svd` of the same kernel, derived
/// independently from the formulas; the program `tests/factor/compare.py` does so for more tables.
#[test]
fn truncation_errors_are_those_of_numpy() {
    let table = Table::from_fn(96, 0.62, |h| {
        let line = |a: f64| (-0.5 * ((h[1] * a.cos() - h[0] * a.sin()) / 0.035).powi(2)).exp();
        [[0.3, 1.5, 2.4].into_iter().map(line).sum::<f64>() * (-h[0].hypot(h[1]) / 0.2).exp(); 3]
    })
    .unwrap();
    for (rank, truth) in [(1, 0.289_856), (3, 0.172_291), (10, 0.051_030), (21, 0.013_447_5)] {
        let settings = Settings { rank: Some(rank), directions: Some([0.3, 1.5]), ..Settings::default() };
        let found = factors(&table, settings).error();
        assert!((found / truth - 1.0_f64).abs() < 0.01, "{rank}: {found} {truth}");
    }
}
