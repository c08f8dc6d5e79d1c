//! A mesh and an environment for example scenes.

use nacre_base::Result;
use nacre_image::{OutputFolder, write_exr};
use std::f64::consts::{PI, TAU};
use std::fmt::Write;

/// A coiled snake as OBJ: a tube around a spiral, with u along and v around it.
pub(crate) fn snake() -> String {
    const ALONG: usize = 480;
    const AROUND: usize = 48;
    let middle = |t: f64| -> [f64; 3] {
        let (angle, radius) = (TAU * 1.6 * t + 0.6, 50.0 - 30.0 * t);
        [radius * angle.cos(), radius * angle.sin() * 0.9, 14.0 * t - 6.0 + 2.0 * (5.0 * angle).sin()]
    };
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let unit = |a: [f64; 3]| {
        let n = (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt();
        a.map(|v| v / n)
    };
    let mut text = String::from("# A snake: a tube around a spiral, u along it and v around it\n");
    for i in 0..=ALONG {
        let t = i as f64 / ALONG as f64;
        let along = unit(sub(middle(t + 1e-4), middle(t - 1e-4)));
        let right = unit(cross(along, [0.0, 0.0, 1.0]));
        let up = cross(right, along);
        // Thin at the tail, with a head at the other end.
        let tail = (t * 4.0).min(1.0).powf(0.7);
        let head = if t > 0.93 { 1.0 + 0.35 * (PI * (t - 0.93) / 0.07).sin() } else { 1.0 };
        let nose = ((1.0 - t) * 60.0).clamp(0.02, 1.0).sqrt();
        let radius = 7.5 * tail.max(0.05) * head * nose;
        for j in 0..=AROUND {
            let v = j as f64 / AROUND as f64;
            let (sin, cos) = (TAU * v).sin_cos();
            let m = middle(t);
            let p = [0, 1, 2].map(|c| m[c] + radius * (cos * right[c] + 0.8 * sin * up[c]));
            let _ = writeln!(text, "v {:.5} {:.5} {:.5}\nvt {:.6} {:.6}", p[0], p[1], p[2], t, v);
        }
    }
    for i in 0..ALONG {
        for j in 0..AROUND {
            let a = i * (AROUND + 1) + j + 1;
            let [b, c, d] = [a + AROUND + 1, a + AROUND + 2, a + 1];
            let _ = writeln!(text, "f {a}/{a} {d}/{d} {c}/{c}\nf {a}/{a} {c}/{c} {b}/{b}");
        }
    }
    text
}

/// Environment of a room: dim walls, a window, a strip of lamps at the ceiling and a lamp in the corner.
pub(crate) fn room(folder: &OutputFolder) -> Result<()> {
    const WIDTH: usize = 512;
    const HEIGHT: usize = 256;
    let radiance = |x: usize, y: usize| -> [f32; 3] {
        let azimuth = (0.5 - (x as f64 + 0.5) / WIDTH as f64) * 360.0;
        let height = 90.0 - (y as f64 + 0.5) / HEIGHT as f64 * 180.0;
        // Membership of a box of angles, with edges softened over a degree.
        let within = |a: f64, half: f64, b: f64, tall: f64| {
            let d = (azimuth - a + 540.0).rem_euclid(360.0) - 180.0;
            let edge = |v: f64| (0.5 + v).clamp(0.0, 1.0);
            edge(half - d.abs()) * edge(tall - (height - b).abs())
        };
        let wall = 0.05 + 0.04 * (height / 90.0).max(0.0);
        let window = 3.0 * within(40.0, 16.0, 30.0, 18.0) * (1.0 - 0.9 * within(40.0, 1.0, 30.0, 18.0));
        let strip = 8.0 * within(180.0, 40.0, 62.0, 2.5);
        let lamp = 60.0 * within(-60.0, 2.0, 42.0, 2.0);
        let part = |warm: f64, cold: f64| (wall + window * cold + strip + lamp * warm) as f32;
        [part(1.3, 0.9), part(1.0, 1.0), part(0.55, 1.15)]
    };
    write_exr(&folder.path("room.exr"), WIDTH, HEIGHT, &["R", "G", "B"], &[], &|c, y, row| {
        row.iter_mut().enumerate().for_each(|(x, out)| *out = radiance(x, y)[c]);
    })
}
