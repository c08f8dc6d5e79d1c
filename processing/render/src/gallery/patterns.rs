//! Grating patterns from formulas, for example scenes: orientation (rad) and period (µm) at a position (u, v); `None`
//! where nothing diffracts.

use nacre_base::random::Stream;
use std::f64::consts::{PI, TAU};

/// A pseudo-random number from 0 to 1 for a cell.
fn chance(x: i64, y: i64, what: usize) -> f64 {
    Stream::new((x as usize).wrapping_mul(0x1_0001).wrapping_add(y as usize), what).next()
}

/// Cell of the nearest of random points, one per cell of a grid (Voronoi).
fn nearest(u: f64, v: f64, cells: f64) -> [i64; 2] {
    let (x, y) = (u * cells, v * cells);
    let mut best = (f64::INFINITY, [0; 2]);
    for j in -1..=1 {
        for i in -1..=1 {
            let (cx, cy) = (x.floor() as i64 + i, y.floor() as i64 + j);
            let wrap = |k: i64| k.rem_euclid(cells as i64);
            let place = [cx as f64 + chance(wrap(cx), wrap(cy), 1), cy as f64 + chance(wrap(cx), wrap(cy), 2)];
            let distance = (place[0] - x).powi(2) + (place[1] - y).powi(2);
            if distance < best.0 {
                best = (distance, [wrap(cx), wrap(cy)]);
            }
        }
    }
    best.1
}

/// Holographic paper: polygons of twelve orientations, with four-pointed stars between them.
pub(crate) fn star_paper(u: f64, v: f64) -> Option<[f64; 2]> {
    let [x, y] = nearest(u, v, 12.0);
    let angle = (chance(x, y, 3) * 12.0).floor() * PI / 12.0;
    let (p, q) = ((u * 4.0).fract() - 0.5, (v * 4.0).fract() - 0.5);
    // An astroid.
    if p.abs().sqrt() + q.abs().sqrt() < 0.55 {
        return Some([q.atan2(p), 1.2]);
    }
    Some([angle, 1.6])
}

/// A kinematic tile: rings of sectors with increasing orientation, so that reflections rotate when it is tilted.
pub(crate) fn kinematic(u: f64, v: f64) -> Option<[f64; 2]> {
    let (x, y) = ((u * 3.0).fract() - 0.5, (v * 3.0).fract() - 0.5);
    let (radius, angle) = (x.hypot(y), y.atan2(x));
    if radius > 0.47 {
        return Some([PI / 4.0, 1.9]);
    }
    let ring = (radius / 0.47 * 4.0).floor();
    let sector = ((angle + PI) / TAU * (6.0 + 4.0 * ring)).floor();
    Some([sector * PI / (3.0 + 2.0 * ring) + ring * PI / 8.0, 1.2 + 0.12 * ring])
}

/// The letters of a name, each of a few orientations, on a background of another orientation.
pub(crate) fn logo(u: f64, v: f64) -> Option<[f64; 2]> {
    // Five by seven pixels each.
    const LETTERS: [[u8; 7]; 5] = [
        [0b10001, 0b11001, 0b10101, 0b10011, 0b10001, 0b10001, 0b10001],
        [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        [0b01111, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b01111],
        [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
        [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111],
    ];
    let (x, y) = ((u - 0.05) / 0.9 * 29.0, (0.62 - v) / 0.24 * 7.0);
    if (0.0..29.0).contains(&x) && (0.0..7.0).contains(&y) {
        let (letter, column) = ((x / 6.0) as usize, (x % 6.0) as usize);
        if letter < 5 && column < 5 && LETTERS[letter][y as usize] >> (4 - column) & 1 == 1 {
            return Some([PI / 2.0, 1.25 + 0.1 * letter as f64]);
        }
    }
    let ray = ((v - 0.5).atan2(u - 0.5) / TAU * 24.0).floor();
    Some([ray * PI / 12.0, 1.7])
}

/// An emblem: a shield of concentric outlines with a star, on plain foil.
pub(crate) fn emblem(u: f64, v: f64) -> Option<[f64; 2]> {
    let (x, y) = ((u - 0.5) * 2.2, (v - 0.52) * 2.2);
    let shield = if y > 0.0 { x.abs().max(y) } else { (x.abs() + 0.35 * y * y).hypot(0.75 * y) };
    let (radius, angle) = (x.hypot(y), y.atan2(x));
    let point = ((angle - PI / 2.0) / TAU * 5.0).rem_euclid(1.0);
    let star = 0.26 + 0.34 * (2.0 * point - 1.0).abs().powf(1.6);
    if radius < star {
        return Some([((angle - PI / 2.0) / TAU * 10.0).floor() * PI / 10.0 + PI / 20.0, 1.3]);
    }
    if shield < 0.85 {
        return Some([y.atan2(x), 1.45]);
    }
    if shield < 0.97 {
        return Some([PI / 2.0, 1.25]);
    }
    None
}

/// Random dots whose orientation rotates with the distance from the centre: a spiral of light.
pub(crate) fn spiral_foil(u: f64, v: f64) -> Option<[f64; 2]> {
    let [x, y] = nearest(u, v, 120.0);
    let (p, q) = (x as f64 / 120.0 - 0.5, y as f64 / 120.0 - 0.5);
    let spread = 0.35 * (chance(x, y, 5) + chance(x, y, 6) - 1.0);
    Some([q.atan2(p) + 7.0 * p.hypot(q) + spread, 1.3 + 0.5 * chance(x, y, 7)])
}

/// Ridges on a snake's scale: curved rows across it, 1 µm apart; the skin between scales does not diffract.
pub(crate) fn scales(u: f64, v: f64) -> Option<[f64; 2]> {
    // Rhombs: two lattices of scales, one shifted by half a period.
    let (mut x, mut y) = (u - 0.5, v - 0.5);
    if x.abs() + y.abs() > 0.5 {
        x -= 0.5_f64.copysign(x);
        y -= 0.5_f64.copysign(y);
    }
    if x.abs() + y.abs() > 0.46 {
        return None;
    }
    Some([0.25 * (TAU * y).sin() + 0.15 * x, 1.1 + 0.12 * y])
}
