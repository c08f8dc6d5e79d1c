//! Tables under environments by two passes, against plain sums over light and against samples.

use super::flat::sky;
use super::*;
use crate::material::diffraction::Diffraction;
use crate::prepared_scene::two_pass::{Fineness, Plan, Seen};
use nacre_optics::color::xyz_of_linear_srgb;
use std::f64::consts::PI;

/// A scene with one shape of a table under a sky that is not seen itself.
fn scene(shape: &str, side: usize, more: &str) -> String {
    format!(
        "[camera]\nposition = [-60, 90, 600]\ntarget = [0, 0, 0]\nfov_deg = 10\nwidth = {side}\nheight = {side}\n[[shape]]\n{shape}\n\
         material = \"a\"\n[material.a.diffraction]\ntype = \"table\"\nfile = \"lut.exr\"\n{more}[[light]]\ntype = \"environment\"\n\
         file = \"sky.exr\"\nturn_deg = 25\nvisible = false\n"
    )
}

const PLANE: &str = "type = \"plane\"\nsize = [100, 100]\nup = [0.3, 1, 0]";
const SPHERE: &str = "type = \"sphere\"\ncenter = [0, 0, 0]\nradius = 45\naxis = [0.4, 1, 0.2]";
const CYLINDER: &str =
    "type = \"cylinder\"\ncenter = [0, 0, -300]\naxis = [0, 1, 0]\nstart = [0, 0, 1]\nradius = 300\nlength = 90\narc_deg = [-10, 10]";
const MESH: &str = "type = \"mesh\"\nfile = \"bowl.obj\"";

/// A shallow bowl of triangles, bent along both sides, with texture coordinates.
fn bowl(folder: &Path) {
    let n = 24;
    let mut text = String::new();
    for i in 0..=n * n + 2 * n {
        let [u, v] = [i % (n + 1), i / (n + 1)].map(|k| k as f64 / n as f64);
        let [x, y] = [u, v].map(|w| 100.0 * (w - 0.5));
        let z = -0.0009 * x * x - 0.0014 * y * y - 0.0004 * x * y;
        let normal = V::new(0.0018 * x + 0.0004 * y, 0.0028 * y + 0.0004 * x, 1.0).normalize();
        text += &format!("v {x} {y} {z}\nvt {u} {v}\nvn {} {} {}\n", normal.x, normal.y, normal.z);
    }
    for i in 0..n * n {
        let a = i / n * (n + 1) + i % n + 1;
        let corner = |k: usize| format!("{k}/{k}/{k}");
        let [a, b, c, d] = [a, a + 1, a + n + 2, a + n + 1].map(corner);
        text += &format!("f {a} {b} {c} {d}\n");
    }
    std::fs::write(folder.join("bowl.obj"), text).unwrap();
}
type V = nalgebra::Vector3<f64>;

fn files() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    table(dir.path());
    sky(dir.path());
    bowl(dir.path());
    dir
}

fn prepared(text: &str, folder: &Path) -> PreparedScene {
    PreparedScene::new(&Scene::parse(text).unwrap(), folder, Accuracy::new(1e-3, None), &Silent).unwrap()
}

/// Luminance that a place reflects of the sky by a plain sum over all directions: `f cos θ` is `S (1 + ωi·ωo)²/cos θo`, scaled as the table is.
fn plainly(ready: &PreparedScene, (frame, towards): &Seen) -> f64 {
    let Some(Diffraction::Table(table)) = &ready.materials[0].diffraction else { panic!("no table") };
    let view = frame.map(|f| f.dot(towards));
    let (width, height) = (768, 384);
    let mut sum = [0.0; 3];
    for i in 0..width * height {
        let (polar, azimuth) = (PI * ((i / width) as f64 + 0.5) / 384.0, TAU * ((i % width) as f64 + 0.5) / 768.0);
        let (sin, cos) = polar.sin_cos();
        let towards = V::new(sin * azimuth.cos(), sin * azimuth.sin(), cos);
        let light = frame.map(|f| f.dot(&towards));
        if light[2] > 0.0 {
            let solid = sin * PI / 384.0 * TAU / 768.0;
            let s = table.raw([light[0] + view[0], light[1] + view[1]]);
            let gain = (1.0 + (0..3).map(|k| light[k] * view[k]).sum::<f64>()).powi(2) * solid;
            let radiance = ready.skies[0].radiance(towards);
            (0..3).for_each(|c| sum[c] += s[c] * gain * radiance[c]);
        }
    }
    let whole = table.whole(view);
    let rgb = [0, 1, 2].map(|c| (sum[c] * table.scale / whole[c]) as f32);
    f64::from(xyz_of_linear_srgb(rgb)[1])
}

/// Mean and root mean square of the differences between two passes and the plain sum over some places of a shape, over their mean, at views
/// up to an angle.
fn off(ready: &PreparedScene, fineness: Fineness, up_to_deg: f64) -> (f64, usize) {
    let Some(Diffraction::Table(table)) = &ready.materials[0].diffraction else { panic!("no table") };
    let factors = table.factored(None, 0.002).unwrap();
    let all: Vec<Seen> = ready.places_of(0, 96).iter().map(|(_, hit)| ready.seen(hit, 0)).collect();
    let plan = Plan::new(&factors.parts, &all, fineness);
    let poles = plan.count();
    let filtered = plan.filter(&ready.skies, &Silent).unwrap();
    let (mut square, mut mean, mut count) = (0.0, 0.0, 0.0_f64);
    for (_, hit) in ready.places_of(0, 9) {
        let seen = ready.seen(&hit, 0);
        if seen.0[2].dot(&seen.1) < up_to_deg.to_radians().cos() {
            continue;
        }
        let found = ready.under_skies((&hit, 0), &seen, Some(&filtered), &mut Stream::of(0)).unwrap();
        let truth = plainly(ready, &seen);
        square += (found - truth).powi(2);
        mean += truth;
        count += 1.0;
    }
    if count < 3.0 { return (f64::NAN, poles) }
    ((square * count).sqrt() / mean, poles)
}

#[test]
fn explore() {
    let dir = files();
    for (name, shape) in [("plane", PLANE), ("sphere", SPHERE), ("cylinder", CYLINDER), ("mesh", MESH)] {
        for turn in [0.0, 37.0] {
            let text = scene(shape, 32, "") + &format!("[turn]\nsample_deg = {turn}\n");
            let ready = prepared(&text, dir.path());
            for fineness in [Fineness { width: 128, poles: 48 }, Fineness { width: 256, poles: 96 }] {
                for up in [12.0, 20.0, 40.0, 60.0] {
                    if shape != SPHERE && up > 20.0 { continue }
                    println!("{name} {turn} {fineness:?} {up}: {:?}", off(&ready, fineness, up));
                }
            }
            let begun = std::time::Instant::now();
            let parsed = Scene::parse(&text).unwrap();
            for (method, e) in [(Method::TwoPass, 0.02), (Method::Auto, 0.02), (Method::Auto, 0.1), (Method::Samples, 0.02)] {
                let (_, report) = render(&parsed, dir.path(), &Settings { method, max_error: e, samples: 1 << 14, ..Settings::default() }, &Silent).unwrap();
                println!("{:?} {} noise {} model {} samples {} {:?} {:?}", method, begun.elapsed().as_secs_f64(), report.noise, report.predicted_model_error, report.samples, report.environments, report.warnings);
            }
        }
    }
}
