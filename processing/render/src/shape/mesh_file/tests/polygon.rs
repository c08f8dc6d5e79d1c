//! Tests of faces with many corners.

use super::*;
use std::f64::consts::TAU;
use std::fmt::Write;

/// An OBJ file of one face through these points.
fn face(places: &[[f64; 3]]) -> String {
    let mut text = String::new();
    for [x, y, z] in places {
        writeln!(text, "v {x} {y} {z}").unwrap();
    }
    let numbers: Vec<String> = (1..=places.len()).map(|k| k.to_string()).collect();
    writeln!(text, "f {}", numbers.join(" ")).unwrap();
    text
}

fn flat(places: &[[f64; 2]]) -> Vec<[f64; 3]> {
    places.iter().map(|[x, y]| [*x, *y, 0.0]).collect()
}

/// Area of a simple polygon.
fn shoelace(places: &[[f64; 2]]) -> f64 {
    let next = places.iter().cycle().skip(1);
    0.5 * places.iter().zip(next).map(|(p, q)| p[0] * q[1] - p[1] * q[0]).sum::<f64>().abs()
}

/// For every first corner, both orientations, and a tilted plane: the total area is that of the polygon, without
/// warnings.
fn check(places: &[[f64; 2]]) {
    let expected = shoelace(places);
    let turn = nalgebra::Rotation3::from_euler_angles(0.7, -0.4, 1.9);
    for reversed in [false, true] {
        for first in 0..places.len() {
            let mut places = places.to_vec();
            places.rotate_left(first);
            if reversed {
                places.reverse();
            }
            let tilted: Vec<[f64; 3]> =
                flat(&places).into_iter().map(|p| (turn * V3::from(p) + V3::new(3.0, 1.0, -9.0)).into()).collect();
            for places in [flat(&places), tilted] {
                let mesh = mesh("a.obj", face(&places)).unwrap();
                assert!((area(&mesh) / expected - 1.0).abs() < 1e-9, "{} for {expected}: {places:?}", area(&mesh));
                assert_eq!(warnings(mesh), [""; 0], "{places:?}");
            }
        }
    }
}

#[test]
fn concave_faces_have_their_area() {
    // An L, an arrow, a comb, and a letter E with corners on straight edges.
    check(&[[0.0, 0.0], [5.0, 0.0], [5.0, 2.0], [2.0, 2.0], [2.0, 7.0], [0.0, 7.0]]);
    check(&[[0.0, 0.0], [4.0, 1.0], [0.0, 2.0], [1.0, 1.0]]);
    let comb: Vec<[f64; 2]> = (0..9)
        .flat_map(|k| {
            let x = f64::from(k);
            [[x, 3.0], [x + 0.4, 0.5]]
        })
        .chain([[9.0, 0.0], [0.0, 0.0]])
        .collect();
    check(&comb);
    check(&[
        [0.0, 0.0],
        [2.0, 0.0],
        [4.0, 0.0],
        [4.0, 1.0],
        [1.0, 1.0],
        [1.0, 2.0],
        [3.0, 2.0],
        [3.0, 3.0],
        [1.0, 3.0],
        [1.0, 4.0],
        [4.0, 4.0],
        [4.0, 5.0],
        [0.0, 5.0],
        [0.0, 2.5],
    ]);
}

#[test]
fn spirals_and_stars_have_their_area() {
    let star = |n: usize| -> Vec<[f64; 2]> {
        let at = |k: usize| {
            let r = if k.is_multiple_of(2) { 5.0 } else { 2.0 };
            let a = TAU * k as f64 / (2 * n) as f64;
            [r * a.cos(), r * a.sin()]
        };
        (0..2 * n).map(at).collect()
    };
    check(&star(5));
    check(&star(20));
    let turn = |k: usize, r: f64| {
        let a = k as f64 * 0.2;
        [(r + 0.1 * a) * a.cos(), (r + 0.1 * a) * a.sin()]
    };
    let spiral: Vec<[f64; 2]> = (0..60).map(|k| turn(k, 1.0)).chain((0..60).rev().map(|k| turn(k, 1.3))).collect();
    check(&spiral);
}

/// A square with square holes, each connected by a cut with coincident corners.
#[test]
fn holes_behind_cuts_stay_open() {
    let one = [
        [0.0, 0.0],
        [6.0, 0.0],
        [6.0, 6.0],
        [0.0, 6.0],
        [0.0, 0.0],
        [2.0, 2.0],
        [2.0, 4.0],
        [4.0, 4.0],
        [4.0, 2.0],
        [2.0, 2.0],
    ];
    check(&one);
    let mesh = mesh("a.obj", face(&flat(&one))).unwrap();
    assert!(!covers(&mesh, 3.1, 3.2) && covers(&mesh, 1.1, 3.2) && covers(&mesh, 5.1, 0.3));
    // Two holes from one corner.
    check(&[
        [0.0, 0.0],
        [9.0, 0.0],
        [9.0, 4.0],
        [0.0, 4.0],
        [0.0, 0.0],
        [1.0, 1.0],
        [1.0, 3.0],
        [3.0, 3.0],
        [3.0, 1.0],
        [1.0, 1.0],
        [0.0, 0.0],
        [5.0, 1.0],
        [5.0, 3.0],
        [7.0, 3.0],
        [7.0, 1.0],
        [5.0, 1.0],
    ]);
}

#[test]
fn corners_may_be_repeated_and_straight() {
    check(&[[0.0, 0.0], [2.0, 0.0], [2.0, 0.0], [4.0, 0.0], [4.0, 4.0], [1.0, 1.0]]);
    // A spike has no area.
    check(&[[0.0, 0.0], [4.0, 0.0], [7.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
}

#[test]
fn convex_faces_stay_fans() {
    let hexagon: Vec<[f64; 2]> =
        (0..6).map(|k| TAU * f64::from(k) / 6.0).map(|a| [a.cos() * 3.0, a.sin() * 3.0]).collect();
    check(&hexagon);
    let mesh = mesh("a.obj", face(&flat(&hexagon))).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
}

#[test]
fn self_intersecting_and_flat_faces_are_reported() {
    let eight = [[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 3.0]];
    let of = |places: &[[f64; 2]]| warnings(mesh("a.obj", face(&flat(places))).unwrap()).join("; ");
    assert!(of(&eight).contains("1 face crosses itself"), "{}", of(&eight));
    assert!(of(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]]).contains("1 face crosses itself"));
    let line = "v 0 0 0\nv 1 1 1\nv 2 2 2\nv 3 3 3\nv 0 4 0\nf 1 2 3 4\nf 1 2 3\nf 1 2 5\n";
    let said = warnings(mesh("a.obj", line).unwrap()).join("; ");
    assert!(said.contains("1 face without an area") && said.contains("1 triangle without an area"), "{said}");
}

/// Two thousand teeth take a moment; a file that would take hours is refused.
#[test]
fn long_outlines_end() {
    let teeth = |n: usize| -> Vec<[f64; 2]> {
        (0..n).flat_map(|k| [[k as f64, 1.0], [k as f64 + 0.5, 0.1]]).chain([[n as f64, 0.0], [0.0, 0.0]]).collect()
    };
    let places = teeth(2000);
    let found = area(&mesh("a.obj", face(&flat(&places))).unwrap());
    assert!((found / shoelace(&places) - 1.0).abs() < 1e-9);
    let mut text = face(&flat(&teeth(20_000)));
    let line = text.lines().last().unwrap().to_owned();
    for _ in 0..3 {
        text.push_str(&line);
        text.push('\n');
    }
    match mesh("a.obj", text) {
        Ok(mesh) => assert!((area(&mesh) / (4.0 * shoelace(&teeth(20_000))) - 1.0).abs() < 1e-9),
        Err(refusal) => assert!(refusal.to_string().contains("take too long"), "{refusal}"),
    }
}
