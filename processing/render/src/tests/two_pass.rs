//! Tests of two passes for lookup tables under environments, against direct sums over light and against samples.

use super::flat::sky;
use super::*;
use crate::environment::factor;
use crate::material::diffraction::Diffraction;
use crate::prepared_scene::two_pass::{Curves, Fineness, Plan, Seen};
use nacre_base::operation::perform;
use nacre_optics::color::xyz_of_linear_srgb;
use std::f64::consts::PI;

/// A scene with one shape with a table under an invisible sky.
fn scene(shape: &str, side: usize, more: &str) -> String {
    format!(
        "[camera]\nposition = [-60, 90, 600]\ntarget = [0, 0, 0]\nfov_deg = 10\nwidth = {side}\nheight = {side}\n[[shape]]\n{shape}\n\
         material = \"a\"\n[material.a.diffraction]\ntype = \"table\"\nfile = \"lut.exr\"\n{more}[[light]]\ntype = \"environment\"\n\
         file = \"sky.exr\"\nturn_deg = 25\nvisible = false\n"
    )
}

type V = nalgebra::Vector3<f64>;

const PLANE: &str = "type = \"plane\"\nsize = [100, 100]\nup = [0.3, 1, 0]";
const SPHERE: &str = "type = \"sphere\"\ncenter = [0, 0, 0]\nradius = 45\naxis = [0.4, 1, 0.2]";
const CYLINDER: &str = "type = \"cylinder\"\ncenter = [0, 0, -300]\naxis = [0, 1, 0]\nstart = [0, 0, 1]\nradius = 300\nlength = 90\narc_deg = [-10, 10]";
const BOWL: &str = "type = \"mesh\"\nfile = \"bowl.obj\"";

/// A shallow bowl of triangles, curved in both directions, with texture coordinates.
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

/// Luminance of the sky reflected by a point, by a direct sum over all directions: `f cos θ` is
/// `S (1 + ωi·ωo)²/cos θo`, scaled as the table is.
fn plainly(prepared: &PreparedScene, (frame, towards): &Seen) -> f64 {
    let Some(Diffraction::Table(table)) = &prepared.materials[0].diffraction else { panic!("no table") };
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
            let radiance = prepared.skies[0].radiance(towards);
            (0..3).for_each(|c| sum[c] += s[c] * gain * radiance[c]);
        }
    }
    let whole = table.whole(view);
    let rgb = [0, 1, 2].map(|c| (sum[c] * table.scale / whole[c]) as f32);
    f64::from(xyz_of_linear_srgb(rgb)[1])
}

/// Root mean square difference between two passes and the direct sum at some points of a shape, relative to their mean,
/// and the number of filtered environments.
fn off(prepared: &PreparedScene, fineness: Fineness) -> (f64, usize) {
    let Some(Diffraction::Table(table)) = &prepared.materials[0].diffraction else { panic!("no table") };
    let curves = Curves::of(table, None, 0.005).unwrap();
    let all: Vec<Seen> = prepared.places_of(0, 96).iter().map(|(_, hit)| prepared.seen(hit, 0)).collect();
    let plan = Plan::new(&curves, &all, fineness);
    let count = plan.count();
    let filtered = plan.filter(&prepared.skies, &Silent).unwrap();
    let (mut square, mut mean, mut places) = (0.0, 0.0, 0.0_f64);
    for (_, hit) in prepared.places_of(0, 7) {
        let seen = prepared.seen(&hit, 0);
        let truth = plainly(prepared, &seen);
        let Some(found) = prepared.under_skies((&hit, 0), &seen, Some(&filtered), &mut Stream::of(0)) else { continue };
        square += (found - truth).powi(2);
        mean += truth;
        places += 1.0;
    }
    assert!(places > 12.0, "{places} places");
    ((square * places).sqrt() / mean, count)
}

/// From the front, from behind (where frames are left-handed), and rotated about z.
#[test]
fn filtered_skies_approach_plain_sums_on_every_shape() {
    let dir = files();
    let coarse = Fineness { width: 96, poles: 16, tilts: 0.4 };
    let fine = Fineness { width: 128, poles: 32, tilts: 0.2 };
    for (name, shape) in [("plane", PLANE), ("cylinder", CYLINDER), ("bowl", BOWL), ("sphere", SPHERE)] {
        for (turn, behind) in [(0.0, false), (37.0, true)] {
            let front = scene(shape, 32, "") + &format!("[turn]\nsample_deg = {turn}\n");
            let text = if behind { front.replace("90, 600]", "90, -600]") } else { front };
            let prepared = prepared(&text, dir.path());
            let (rough, few) = off(&prepared, coarse);
            if name == "sphere" {
                // All views up to the horizon: even the coarsest tilts need a thousand environments.
                println!("{name} {turn}: {rough} by {few}");
                assert!(rough < 0.1, "{name} {turn}: {rough}");
                continue;
            }
            let (close, many) = off(&prepared, fine);
            println!("{name} {turn}: {rough} by {few}, {close} by {many}");
            assert!(close < 0.05 && close < 0.8 * rough, "{name} {turn}: {rough} {close}");
        }
    }
}

fn difference(a: &Picture, b: &Picture) -> f64 {
    let square: f64 = a.pixels.iter().zip(&b.pixels).map(|(a, b)| (a.luminance - b.luminance).powi(2)).sum();
    let mean: f64 = b.pixels.iter().map(|p| p.luminance).sum();
    (square * b.pixels.len() as f64).sqrt() / mean
}

/// The measured error matches that of the picture, at ranks with large, small and negligible residuals.
#[test]
fn two_passes_are_as_far_off_as_they_say() {
    let dir = files();
    let parsed = Scene::parse(&scene(BOWL, 24, "")).unwrap();
    let asked = Settings { samples: 1 << 16, max_error: 0.02, ..Settings::default() };
    let exact = Settings { method: Method::Samples, max_error: 0.01, ..asked.clone() };
    let (truth, other) = render(&parsed, dir.path(), &exact, &Silent).unwrap();
    let mut before = f64::INFINITY;
    for rank in [1, 3, 10] {
        let settings = Settings { method: Method::TwoPass, rank: Some(rank), ..asked.clone() };
        let (picture, report) = render(&parsed, dir.path(), &settings, &Silent).unwrap();
        let [about] = &report.environments[..] else { panic!("{report:?}") };
        let (found, noise) = (difference(&picture, &truth), report.noise.hypot(other.noise));
        println!("rank {rank}: {found}, noise {noise}, {about:?}");
        assert_eq!((about.method, &about.rank[..]), ("two-pass", &[rank][..]));
        // The measured error includes two standard deviations of the measurement, from 256 points.
        assert!(found < 1.1 * about.measured_error.hypot(noise), "{rank}: {found} {about:?}");
        assert!(found > 0.5 * about.measured_error, "{rank}: {found} {about:?}");
        assert!(report.predicted_model_error == about.measured_error && about.measured_error <= 1.3 * before);
        // Curves of lower rank are cheaper, so their environments are filtered at a higher resolution.
        let missed = report.warnings.iter().any(|w| w.starts_with("two passes are off"));
        assert_eq!(missed, about.measured_error > 0.02, "{report:?}");
        before = about.measured_error;
    }
}

/// A curved sheet has no correlation method: two passes are selected, meet the target error, and need a small fraction
/// of the samples.
#[test]
fn two_passes_are_chosen_where_they_are_cheaper() {
    let dir = files();
    let parsed = Scene::parse(&scene(CYLINDER, 160, "")).unwrap();
    let asked = Settings { samples: 1 << 16, max_error: 0.03, ..Settings::default() };
    let (picture, report) = render(&parsed, dir.path(), &asked, &Silent).unwrap();
    let [about] = &report.environments[..] else { panic!("{report:?}") };
    let samples = Settings { method: Method::Samples, max_error: 0.02, ..asked };
    let (truth, other) = render(&parsed, dir.path(), &samples, &Silent).unwrap();
    let found = difference(&picture, &truth);
    println!("{found}, {} samples against {}, {about:?}", report.samples, other.samples);
    assert_eq!(about.method, "two-pass");
    assert!(about.measured_error < 0.03 && report.noise.hypot(about.measured_error) <= 0.03 * 1.01, "{report:?}");
    assert!(found < 0.03_f64.hypot(other.noise), "{found}");
    // Where samples are as cheap, they are selected.
    let few = Settings { max_error: 1.0, samples: 16, ..Settings::default() };
    let small = Scene::parse(&scene(CYLINDER, 16, "")).unwrap();
    let (_, report) = render(&small, dir.path(), &few, &Silent).unwrap();
    assert!(report.environments.iter().all(|e| e.method == "samples"), "{:?}", report.environments);
}

/// Curves from a folder give the same picture as internally computed ones. Other folders are refused, with the file's
/// name.
#[test]
fn curves_of_a_folder_are_those_of_the_table() {
    let dir = files();
    let (lut, out) = (dir.path().join("lut.exr"), dir.path().join("curves"));
    let options = factor::Options { rank: Some(6), ..factor::Options::default() };
    perform(&options, &lut, &out, true, &Silent).unwrap();
    let asked = Settings { method: Method::TwoPass, rank: Some(6), max_error: 0.05, ..Settings::default() };
    let shape = PLANE.replace("[0.3, 1, 0]", "[0.3, 1, 0.1]\nnormal = [0, 0.1, 1]");
    let picture = |more: &str, asked: &Settings| {
        render(&Scene::parse(&scene(&shape, 16, more)).unwrap(), dir.path(), asked, &Silent)
    };
    let named = "factors = \"curves\"\n";
    let [(own, first), (read, second)] = ["", named].map(|more| picture(more, &asked).unwrap());
    let found = difference(&read, &own);
    println!("{found}: {:?} {:?}", first.environments, second.environments);
    // Curves contain half vectors up to a length of 1, the table also longer ones: both errors are measured.
    let measured = [&first, &second].map(|report| report.environments[0].measured_error);
    assert!(found < 1.1 * measured[0].hypot(measured[1]), "{found} {measured:?}");
    assert!((first.environments[0].table_error - second.environments[0].table_error).abs() < 1e-3);
    // Fewer terms have a larger error.
    let (_, fewer) = picture(named, &Settings { rank: Some(1), ..asked.clone() }).unwrap();
    assert!(
        fewer.environments[0].rank == [1] && fewer.environments[0].table_error > second.environments[0].table_error
    );

    let refused = |words: &str| {
        let said = picture(named, &asked).unwrap_err().to_string();
        assert!(said.contains(words), "{words}: {said}");
    };
    let along = out.join("part-1-along.exr");
    let whole = nacre_image::read_exr(&along).unwrap();
    let write = |name: &str, size: [usize; 2], shift: f64, value: f32| {
        let number = |key: &str, shift: f64| {
            (key.to_owned(), Attribute::Text((whole.attributes[key].parse::<f64>().unwrap() + shift).to_string()))
        };
        let attributes = [
            number("meridian_deg", 0.0),
            number("shear_deg", shift),
            number("reach_x", 0.0),
            number("reach_beta", 0.0),
        ];
        let attributes: Vec<(&str, Attribute)> = attributes.iter().map(|(k, v)| (k.as_str(), v.clone())).collect();
        write_exr(&out.join(name), size[0], size[1], &["R", "G", "B"], &attributes, &|_, _, row| row.fill(value))
            .unwrap();
    };
    let size = [whole.width, whole.height];
    write("part-1-along.exr", size, 0.0, f32::NAN);
    refused("part-1-along.exr");
    write("part-1-along.exr", size, 0.0, f32::INFINITY);
    refused("no finite number");
    write("part-1-along.exr", [size[0], 3], 0.0, 1.0);
    refused("has 3 curves");
    write("part-1-along.exr", [size[0], 200], 0.0, 1.0);
    refused("1 to 96");
    write("part-1-along.exr", size, 1.0, 1.0);
    refused("another shear_deg");
    write("part-1-along.exr", size, 200.0, 1.0);
    refused("a number from");
    // Light where the table has none.
    write("part-1-along.exr", size, 0.0, 1e4);
    refused("of another table");
    std::fs::remove_file(&along).unwrap();
    refused("part-1-along.exr");
    std::fs::remove_file(out.join("part-1-across.exr")).unwrap();
    refused("part-1-across.exr");
}

#[test]
fn two_passes_are_refused_where_they_cannot_be() {
    let dir = files();
    let two = Settings { method: Method::TwoPass, ..settings(16, 0.1) };
    let grating = "[material.a.diffraction]\ntype = \"grating\"\nperiod_um = 2\norientation_deg = 0\nrelief = { depth_um = 0.1 }\n";
    let refused = |text: &str, settings: &Settings, words: &str| {
        let said = render(&Scene::parse(text).unwrap(), dir.path(), settings, &Silent).unwrap_err().to_string();
        assert!(said.contains(words), "{words}: {said}");
    };
    refused(&plane(10.0, 0.0, &format!("{grating}{SKY}")), &two, "tables under environments");
    let table = scene(PLANE, 8, "");
    refused(&table, &Settings { gpu: true, ..two.clone() }, "gpu");
    refused(&table, &Settings { rank: Some(0), ..two.clone() }, "rank");
    refused(&table, &Settings { rank: Some(3), method: Method::Samples, ..two }, "rank");
}
