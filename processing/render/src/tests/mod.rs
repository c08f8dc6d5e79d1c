//! Tests of pictures against closed forms, energy conservation, symmetry, and invalid input.

mod adaptive_sampling;
mod bad_input;
mod energy;
mod flat;
mod folder;
mod held;
mod lamps;
mod radial;
mod relief;
mod spectral;
mod two_pass;

use super::*;
use crate::material::diffraction::grating::{Grating, Groove, Scratch};
use crate::material::shading::Accuracy;
use crate::prepared_scene::PreparedScene;
use nacre_base::progress::Silent;
use nacre_base::random::Stream;
use nacre_brdf::height::Profile;
use nacre_brdf::{Reflectance, Section};
use nacre_image::{Attribute, write_exr};
use std::f64::consts::TAU;
use std::path::Path;

const SKY: &str = "\n[[light]]\ntype = \"environment\"\ncolor = [1, 1, 1]\n";

/// A plane seen at an angle from its normal, from an azimuth.
fn plane(angle: f64, azimuth: f64, more: &str) -> String {
    let ((sin, cos), (s, c)) = (angle.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
    let position = [1e4 * sin * c, 1e4 * sin * s, 1e4 * cos];
    format!(
        "[camera]\nposition = {position:?}\ntarget = [0, 0, 0]\nup = [{:?}, {:?}, 0]\nfov_deg = 0.01\nwidth = 4\nheight = 4\n\
         [[shape]]\ntype = \"plane\"\nsize = [1e4, 1e4]\nmaterial = \"a\"\n{more}",
        -s - 1e-3,
        c
    )
}

fn picture(text: &str, folder: &Path, settings: &Settings) -> Picture {
    let scene = Scene::parse(text).unwrap();
    render(&scene, folder, settings, &Silent).unwrap().0
}

fn settings(samples: usize, max_error: f64) -> Settings {
    Settings { samples, max_error, ..Settings::default() }
}

fn mean(picture: &Picture) -> [f64; 3] {
    [0, 1, 2].map(|c| picture.pixels.iter().map(|p| p.rgb[c]).sum::<f64>() / picture.pixels.len() as f64)
}

/// Writes a lookup table of a lattice of spots.
fn table(folder: &Path) {
    let n = 96;
    write_exr(
        &folder.join("lut.exr"),
        n,
        n,
        &["X", "Y", "Z"],
        &[
            ("extent", Attribute::Text("1".into())),
            ("warp", Attribute::Text("1".into())),
            ("illuminant", Attribute::Text("E".into())),
        ],
        &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let [u, v] = [x, y].map(|k| (k as f64 + 0.5) / 48.0 - 1.0);
                let spot = (-(u * u + v * v) / 0.02).exp() + 0.3 * (-((u.abs() - 0.4).powi(2) + v * v) / 0.03).exp();
                *out = (0.05 + spot * [1.0, 0.9, 0.7][c]) as f32;
            }
        },
    )
    .unwrap();
}

/// Writes heights of a bumpy surface.
fn heights(folder: &Path) {
    let n = 64;
    let attributes = [("units", Attribute::Text("µm".into())), ("pixel_um", Attribute::Number(0.09))];
    write_exr(&folder.join("heights.exr"), n, n, &["height"], &attributes, &|_, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let [u, v] = [x, y].map(|k| TAU * k as f64 / n as f64);
            *out = (0.08 * (4.0 * u).cos() + 0.05 * (3.0 * v + u).sin()) as f32;
        }
    })
    .unwrap();
}

/// Linear sRGB of a grating by a sum over 40000 wave numbers and all orders, directly from the formulas.
fn brute(period: f64, [view, light]: [[f64; 3]; 2], sigma: f64, grating: &Grating) -> [f64; 3] {
    let groove = Groove { across: [1.0, 0.0], period_um: period };
    let (low, high) = (1.0 / 0.78, 1.0 / 0.38);
    let n = 40_000;
    let spectrum = nacre_optics::color::Illuminant::named("E").unwrap().spectrum;
    let observer = nacre_optics::color::Observer::Cie1931;
    let (mut sum, mut white) = ([0.0; 3], 0.0);
    let mut scratch = Scratch::default();
    let mut powers = vec![];
    for k in 0..n {
        let number: f64 = low + (high - low) * (f64::from(k) + 0.5) / f64::from(n);
        let nm = 1e3 / number;
        let xyz = observer.at(nm).map(|c| c * spectrum.at(nm) / (number * number));
        white += xyz[1];
        if k % 40 == 0 {
            powers.clear();
            grating.orders(view, groove, number, &mut scratch, |o| powers.push((o.order, o.power)));
        }
        for (order, power) in &powers {
            let x = number * (view[0] + light[0]) - f64::from(*order) / period;
            let y = number * (view[1] + light[1]);
            let lobe = (-0.5 * (x * x + y * y) / (sigma * sigma)).exp() / (TAU * sigma * sigma);
            (0..3).for_each(|c| sum[c] += xyz[c] * power * lobe * number * number);
        }
    }
    nacre_optics::color::linear_srgb(sum.map(|v| (v / white) as f32)).map(f64::from)
}

#[test]
fn a_point_lights_picture_is_the_brdf_pixel_by_pixel() {
    let period = 1.6;
    let more = "[material.a.diffraction]\ntype = \"grating\"\nperiod_um = 1.6\norientation_deg = 0\nrelief = { depth_um = 0.2 }\ncoherence_um = 20\n\
                [[light]]\ntype = \"directional\"\ndirection = [0.3, 0.02, 0.9]\nspectrum = \"E\"\n";
    let text = "[camera]\nposition = [0, 0, 100]\ntarget = [0, 0, 0]\nfov_deg = 70\nwidth = 24\nheight = 24\n[[shape]]\ntype = \"plane\"\nsize = [1e4, 1e4]\nmaterial = \"a\"\n".to_owned() + more;
    let scene = Scene::parse(&text).unwrap();
    let prepared = PreparedScene::new(&scene, Path::new(""), Accuracy::new(1e-5, None), &Silent).unwrap();
    let section = Section::Formula { profile: Profile::Sinusoid, depth_um: 0.2 };
    let window = nacre_brdf::Window::new(20.0).unwrap();
    let grating = Grating::new(&section, period, window.sigma, Reflectance::Perfect, 1e-6);
    let light = nalgebra::Vector3::new(0.3, 0.02, 0.9).normalize();
    let half = 35.0_f64.to_radians().tan();
    let (mut brightest, mut worst) = (0.0_f64, 0.0_f64);
    for k in 0..24 * 24 {
        let (x, y) = ((k % 24) as f64 + 0.5, (k / 24) as f64 + 0.5);
        let mut memory = Default::default();
        let found = prepared.at([x, y], &mut Stream::new(k, 0), &mut memory);
        let found = nacre_optics::color::linear_srgb(found.map(|v| v as f32)).map(f64::from);
        // From the point on the plane to the camera.
        let place = nalgebra::Vector3::new((x / 12.0 - 1.0) * half * 100.0, (1.0 - y / 12.0) * half * 100.0, 0.0);
        let view = (nalgebra::Vector3::new(0.0, 0.0, 100.0) - place).normalize();
        let pair = [[view.x, view.y, view.z], [light.x, light.y, light.z]];
        let truth = brute(period, pair, window.sigma, &grating).map(|v| v * light.z);
        for c in 0..3 {
            brightest = brightest.max(truth[c]);
            worst = worst.max((found[c] - truth[c]).abs());
        }
    }
    // Where an order becomes evanescent the others jump; linear interpolation between 65 wave numbers smears the jump.
    // Measured: 0.24 % of the brightest.
    assert!(worst < 4e-3 * brightest && brightest > 0.1, "{worst} of {brightest}");
}

#[test]
fn a_height_fields_picture_is_its_brdf() {
    use nacre_brdf::height::{Quality, Scale, read};
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    let field = read(&dir.path().join("heights.exr"), &Scale::default()).unwrap();
    let options = nacre_brdf::Settings { light_deg: [20.0, 30.0], coherence_um: 20.0, ..Default::default() };
    let views = nacre_brdf::Views { size: 16, center: [0.0; 2], half: 0.6 };
    let map = nacre_brdf::map(&field, &Quality::of(&field, 20.0), &options, views, &Silent).unwrap();
    let (s, c) = 30_f64.to_radians().sin_cos();
    let (a, b) = 20_f64.to_radians().sin_cos();
    let light = format!("[{:?}, {:?}, {b:?}]", a * c, a * s);
    let material = "[material.a.diffraction]\ntype = \"heightfield\"\nfile = \"heights.exr\"\ncoherence_um = 20\n";
    let brightest = map.xyz.iter().map(|v| v[1]).fold(0.0, f32::max);
    let mut seen = 0;
    for (k, truth) in map.xyz.iter().enumerate() {
        let at = |k: usize| ((2 * k + 1) as f64 / 16.0 - 1.0) * 0.6;
        let [x, y] = [at(k % 16), -at(k / 16)];
        let view = [1e4 * x, 1e4 * y, 1e4 * (1.0 - x * x - y * y).sqrt()];
        let text = format!(
            "[camera]\nposition = {view:?}\ntarget = [0, 0, 0]\nfov_deg = 0.01\nwidth = 1\nheight = 1\n[[shape]]\ntype = \"plane\"\n\
             size = [1e4, 1e4]\nmaterial = \"a\"\n{material}[[light]]\ntype = \"directional\"\ndirection = {light}\nspectrum = \"E\"\n"
        );
        if truth[1] < 0.02 * brightest || k % 3 != 0 {
            continue;
        }
        seen += 1;
        let scene = Scene::parse(&text).unwrap();
        let prepared = PreparedScene::new(&scene, dir.path(), Accuracy::new(1e-3, None), &Silent).unwrap();
        let found = prepared.at([0.5, 0.5], &mut Stream::new(0, 0), &mut Default::default());
        for c in 0..3 {
            let truth = f64::from(truth[c]) * b;
            // Each is accurate to 1 %.
            assert!(
                (found[c] - truth).abs() < 0.02 * truth + 1e-3 * f64::from(brightest),
                "{k} {c}: {} {truth}",
                found[c]
            );
        }
    }
    assert!(seen > 3, "{seen}");
}

const FOIL: &str = "[material.a.base]\nalbedo = [0.1, 0.2, 0.3]\n[material.a.diffraction]\ntype = \"grating\"\nperiod_um = 1.6\norientation_deg = 25\n\
     relief = { depth_um = 0.15 }\ncoherence_um = 15\n[material.a]\ncoverage = 0.5\n";

const STAGE: &str = "[camera]\nposition = [20, -30, 200]\ntarget = [0, 0, 0]\nfov_deg = 30\nwidth = 32\nheight = 32\n\
     [[light]]\ntype = \"point\"\nposition = [60, 90, 150]\nsigma_mm = 4\n";

fn largest(a: &Picture, b: &Picture) -> f64 {
    let most = a.pixels.iter().map(|p| p.luminance).fold(0.0, f64::max);
    let each = a.pixels.iter().zip(&b.pixels).flat_map(|(p, q)| (0..3).map(move |c| (p.rgb[c] - q.rgb[c]).abs()));
    each.fold(0.0, f64::max) / most
}

#[test]
fn turning_all_together_changes_nothing() {
    let shape = "[[shape]]\ntype = \"plane\"\nsize = [90, 70]\nmaterial = \"a\"\n";
    let dir = Path::new("");
    let of = |sample: f64, light: f64, view: f64| {
        let turn = format!("[turn]\nsample_deg = {sample:?}\nlight_deg = {light:?}\nview_deg = {view:?}\n");
        picture(&format!("{turn}{STAGE}{shape}{FOIL}"), dir, &settings(4, 1e-3))
    };
    let still = of(0.0, 0.0, 0.0);
    assert!(largest(&still, &of(77.0, 77.0, 77.0)) < 1e-6);
    // Rotating the sample alone exchanges light and view, and gives another picture.
    let turned = of(40.0, 0.0, 0.0);
    assert!(largest(&turned, &of(0.0, -40.0, -40.0)) < 1e-6);
    assert!(largest(&still, &turned) > 0.05);
    // The same under an environment.
    let sky = "[[light]]\ntype = \"environment\"\ncolor = [1, 0.5, 0.2]\n";
    let of = |angle: f64| {
        let turn = format!("[turn]\nsample_deg = {angle:?}\nlight_deg = {angle:?}\nview_deg = {angle:?}\n");
        picture(&format!("{turn}{STAGE}{shape}{FOIL}{sky}"), dir, &settings(4, 1e-3))
    };
    assert!(largest(&of(0.0), &of(33.0)) < 1e-5);
}

/// Two triangles of a rectangle, with texture coordinates.
const OBJ: &str =
    "v -45 -35 0\nv 45 -35 0\nv 45 35 0\nv -45 35 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";

#[test]
fn a_mesh_of_a_rectangle_is_the_plane() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.obj"), OBJ).unwrap();
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float tx\n\
               property float ty\nproperty float tz\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
               -45 -35 0 1 0 0\n45 -35 0 1 0 0\n45 35 0 1 0 0\n-45 35 0 1 0 0\n4 0 1 2 3\n";
    std::fs::write(dir.path().join("a.ply"), ply).unwrap();
    std::fs::write(dir.path().join("a.gltf"), gltf()).unwrap();
    let of = |shape: &str| {
        let text = format!("{STAGE}[[shape]]\n{shape}\nmaterial = \"a\"\n{FOIL}");
        picture(&text, dir.path(), &settings(4, 1e-3))
    };
    let truth = of("type = \"plane\"\nsize = [90, 70]");
    for file in ["a.obj", "a.ply", "a.gltf"] {
        // Rounding of f32 moves an edge by 1e-5 of a pixel.
        let found = of(&format!("type = \"mesh\"\nfile = \"{file}\""));
        assert!(largest(&truth, &found) < 1e-5, "{file}: {}", largest(&truth, &found));
    }
}

/// The rectangle as glTF, where v points down.
fn gltf() -> String {
    use base64::Engine;
    let floats: [f32; 20] = [
        -45.0, -35.0, 0.0, 45.0, -35.0, 0.0, 45.0, 35.0, 0.0, -45.0, 35.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0,
    ];
    let mut bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|v| v.to_le_bytes()));
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2}}]}}],
        "buffers":[{{"byteLength":92,"uri":"data:application/octet-stream;base64,{data}"}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":32}},{{"buffer":0,"byteOffset":80,"byteLength":12}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-45,-35,0],"max":[45,35,0]}},
        {{"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"}},{{"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}}]}}"#
    )
}

#[test]
fn noise_and_sums_are_as_predicted() {
    let shape = "[[shape]]\ntype = \"sphere\"\nradius = 40\nmaterial = \"a\"\n";
    let room = "[[light]]\ntype = \"rectangle\"\ncenter = [0, 150, 100]\nnormal = [0, -1, -0.6]\nup = [0, 0, 1]\nsize = [60, 60]\nluminance = 5\n";
    for more in [shape.to_owned(), format!("{shape}{room}"), format!("{shape}{SKY}")] {
        let text = format!("{STAGE}{more}{FOIL}").replace("width = 32\nheight = 32", "width = 64\nheight = 64");
        let scene = Scene::parse(&text).unwrap();
        let (_, report) =
            render(&scene, Path::new(""), &Settings { check: true, ..settings(64, 0.02) }, &Silent).unwrap();
        let ratio = report.noise / report.predicted.noise;
        assert!((1.0 / 1.5..1.5).contains(&ratio), "{ratio}: {report:?}");
        as_predicted(&report);
    }
}

/// The error of sums matches its prediction within a factor of two, and stays below the permitted error.
fn as_predicted(report: &Report) {
    let (predicted, measured) = (report.predicted_model_error, report.measured_model_error.unwrap());
    println!("sums off by {predicted:.2e} predicted, {measured:.2e} measured");
    assert!(measured < 2.0 * predicted + 1e-7 && predicted < 2.0 * measured + 1e-7, "{report:?}");
}

#[test]
fn errors_of_sums_are_as_reported() {
    let shape = "[[shape]]\ntype = \"sphere\"\nradius = 40\nmaterial = \"a\"\n";
    for (foil, light) in
        [(FOIL.to_owned(), ""), (FOIL.replace("depth_um = 0.15", "depth_um = 1.2"), ""), (FOIL.to_owned(), SKY)]
    {
        for error in [0.2, 0.05, 0.01] {
            let scene = Scene::parse(&format!("{STAGE}{shape}{light}{foil}")).unwrap();
            let wanted = Settings { check: true, ..settings(4, error) };
            let (_, report) = render(&scene, Path::new(""), &wanted, &Silent).unwrap();
            as_predicted(&report);
            assert!(report.measured_model_error.unwrap() < 0.5 * error, "{report:?}");
        }
    }
}

/// Where only the far flank of a lobe is visible, sums must be accurate relative to the flank.
#[test]
fn flanks_of_lobes_are_as_exact_as_lobes() {
    // The centres of lobes have values of about 100.
    for (beside, faint) in [(0.05, 1.0), (0.08, 1e-3)] {
        let light = nalgebra::Vector3::new(0.4, beside, 0.9).normalize();
        let more = format!(
            "[material.a.diffraction]\ntype = \"grating\"\nperiod_um = 1.6\norientation_deg = 0\nrelief = {{ depth_um = 0.2 }}\ncoherence_um = 20\n\
             [[light]]\ntype = \"directional\"\ndirection = [0.4, {beside}, 0.9]\nspectrum = \"E\"\n"
        );
        let scene = Scene::parse(&plane(0.0, 0.0, &more)).unwrap();
        let (picture, report) = render(&scene, Path::new(""), &settings(4, 0.01), &Silent).unwrap();
        let section = Section::Formula { profile: Profile::Sinusoid, depth_um: 0.2 };
        let sigma = nacre_brdf::Window::new(20.0).unwrap().sigma;
        let grating = Grating::new(&section, 1.6, sigma, Reflectance::Perfect, 1e-9);
        let truth = brute(1.6, [[0.0, 0.0, 1.0], [light.x, light.y, light.z]], sigma, &grating).map(|v| v * light.z);
        let found = mean(&picture);
        let most = truth.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        assert!(most < faint && most > 1e-3 * faint, "{truth:?}");
        assert!(truth.iter().zip(&found).all(|(t, f)| (t - f).abs() < 0.01 * most), "{truth:?} {found:?} {report:?}");
    }
}

#[test]
fn kept_pictures_are_resumed() {
    let dir = tempfile::tempdir().unwrap();
    let text = format!("{STAGE}[[shape]]\ntype = \"sphere\"\nradius = 40\nmaterial = \"a\"\n{FOIL}");
    let whole = picture(&text, dir.path(), &settings(32, 1e-5));
    let keep = Some(dir.path().join("state.exr"));
    let part = Settings { keep: keep.clone(), ..settings(12, 1e-5) };
    picture(&text, dir.path(), &part);
    let rest = picture(&text, dir.path(), &Settings { keep: keep.clone(), resume: true, ..settings(32, 1e-5) });
    assert_eq!((whole.passes, rest.passes), (8, 8));
    // The saved state has single precision.
    assert!(largest(&whole, &rest) < 1e-6);
    let other = Scene::parse(&text.replace("radius = 40", "radius = 41")).unwrap();
    let refused = render(&other, dir.path(), &Settings { keep, resume: true, ..settings(32, 1e-5) }, &Silent);
    assert!(refused.unwrap_err().to_string().contains("state.exr"));
}

#[test]
fn a_lens_is_sharp_at_its_focus_only() {
    // The edge of a lit square at the centre of the picture.
    let of = |focus: f64| {
        let text = format!(
            "[camera]\nposition = [0, 0, 100]\ntarget = [0, 0, 0]\nfov_deg = 0.3133\nwidth = 32\nheight = 1\naperture_mm = 10\nfocus_mm = {focus:?}\n\
             [[shape]]\ntype = \"plane\"\ncenter = [50, 0, 0]\nsize = [100, 100]\nmaterial = \"a\"\n[material.a.base]\n\
             [[light]]\ntype = \"directional\"\ndirection = [0, 0, 1]\n"
        );
        let picture = picture(&text, Path::new(""), &settings(2048, 1e-4));
        let full = picture.pixels[31].luminance;
        picture.pixels.iter().filter(|p| p.luminance > 0.02 * full && p.luminance < 0.98 * full).count()
    };
    assert!(of(100.0) <= 1, "{}", of(100.0));
    // A point is imaged as a disc of aperture · |1 - 100/200| = 5 mm; 17.5 mm are 32 pixels, so it has 9 pixels.
    let blurred = of(200.0);
    assert!((6..=11).contains(&blurred), "{blurred}");
}
