//! Rendering of scenes from a user's point of view.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::read_exr;
use nacre_tests::nacre;
use std::path::Path;

const SCENE: &str = "
[camera]
position = [0, 0, 300]
target = [0, 0, 0]
fov_deg = 20
width = 48
height = 40
[[shape]]
type = \"plane\"
size = [80, 80]
material = \"foil\"
[[light]]
type = \"point\"
position = [0, 100, 280]
sigma_mm = 3
[material.foil.base]
albedo = [0.05, 0.05, 0.05]
[material.foil.diffraction]
type = \"grating\"
period_um = 1.6
orientation_deg = 90
relief = { depth_um = 0.1 }
coherence_um = 20
";

fn path(dir: &Path, name: &str) -> String {
    dir.join(name).to_str().unwrap().to_owned()
}

#[test]
fn a_scene_becomes_a_picture_whose_error_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("a.toml"), SCENE).unwrap();
    let [scene, out] = [path(dir, "a.toml"), path(dir, "a.exr")];
    let report = nacre(["--json", "render", &scene, "--out", &out, "--samples", "64", "--check"]).expect(0).json();
    assert!(report["noise"].as_f64().unwrap() > 0.0, "{report}");
    assert!(report["measured_model_error"].as_f64().unwrap() < 0.02, "{report}");
    let map = read_exr(&dir.join("a.exr")).unwrap();
    assert_eq!([map.width, map.height], [48, 40]);
    for name in ["R", "G", "B", "error"] {
        assert!(map.channels[name].iter().all(|v| v.is_finite()), "{name}");
    }
    assert!(dir.join("a.png").is_file());
    // Existing files are not replaced; an error bound that the samples cannot meet sets the exit code.
    nacre(["render", &scene, "--out", &out]).expect(2);
    nacre(["render", &scene, "--out", &out, "--force", "--samples", "8", "--max-error", "0.00001"]).expect(1);
    // A kept state is resumed.
    let keep = path(dir, "state.exr");
    nacre(["render", &scene, "--out", &path(dir, "b.exr"), "--samples", "16", "--keep", &keep]).expect(0);
    let rest = path(dir, "c.exr");
    nacre(["render", &scene, "--out", &rest, "--samples", "32", "--keep", &keep, "--resume"]).expect(0);
    // An animation is a folder.
    let folder = path(dir, "turning");
    nacre(["render", &scene, "--out", &folder, "--samples", "4", "--frames", "3", "--turn", "light"]).expect(0);
    assert!(dir.join("turning/frame_0002.png").is_file());
}

#[test]
fn scenes_that_make_no_sense_are_refused_whole() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let out = path(dir, "a.exr");
    for (from, to, word) in [
        ("fov_deg", "fov", "fov"),
        ("fov_deg = 20", "fov_deg = nan", "camera.fov_deg"),
        ("\"plane\"\nsize = [80, 80]", "\"mesh\"\nfile = \"none.obj\"", "none.obj"),
        ("period_um = 1.6\n", "", "period_um"),
        ("period_um = 1.6\n", "maps = \"none.exr\"\n", "none.exr"),
        ("albedo = [0.05, 0.05, 0.05]", "albedo = \"none.png\"", "none.png"),
        ("material = \"foil\"", "material = \"gold\"", "gold"),
    ] {
        std::fs::write(dir.join("a.toml"), SCENE.replace(from, to)).unwrap();
        let run = nacre(["render", &path(dir, "a.toml"), "--out", &out]).expect(2);
        assert!(run.stderr().contains(word), "{word}: {}", run.stderr());
    }
    assert_eq!(std::fs::read_dir(dir).unwrap().count(), 1);
    let schema = nacre(["schema", "scene"]).expect(0).json();
    assert!(schema["properties"]["camera"].is_object(), "{schema}");
}

#[test]
fn the_gallery_is_made_by_one_command() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("gallery");
    let skin = dir.path().join("skin.exr").to_str().unwrap().to_owned();
    let fingers = ["--period-um", "1.1", "--depth-um", "0.3", "--pixels", "64", "--pixel-um", "0.08"];
    nacre(["brdf", "surface", "fingers", "--out", &skin].into_iter().chain(fingers)).expect(0);
    nacre(["render", "--gallery", out.to_str().unwrap(), "--samples", "1"]).expect(0);
    let measured = dir.path().join("measured");
    let gallery = ["render", "--gallery", measured.to_str().unwrap(), "--samples", "1", "--skin", &skin];
    let wrong = nacre(gallery.into_iter().chain(["--scenes", "snail"])).expect(2);
    assert!(wrong.stderr().contains("snail") && !measured.exists(), "{}", wrong.stderr());
    nacre(gallery.into_iter().chain(["--scenes", "snake-measured,snake-measured-room"])).expect(0);
    let names =
        ["cd", "phone", "tv", "star-paper", "kinematic-tile", "logo", "emblem", "spiral-foil", "rolled", "snake"];
    for (out, name) in names.map(|name| (&out, name)).into_iter().chain([(&measured, "snake-measured")]) {
        for suffix in ["", "-room"] {
            for ending in ["toml", "exr", "png"] {
                assert!(out.join(format!("{name}{suffix}.{ending}")).is_file(), "{name}{suffix}.{ending}");
            }
        }
    }
    assert!(!measured.join("cd.toml").exists());
}
