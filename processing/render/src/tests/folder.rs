//! Tests of rendering jobs: referenced files, previews, scenes of maps.

use crate::{GALLERY, Options, Picture, Pixel, Scene, SoFar, gallery_scene, scene_of_maps};
use nacre_base::operation::{Operation, perform};
use nacre_base::progress::{Progress, Silent};
use nacre_image::{OutputFolder, write_exr};
use std::path::Path;
use std::sync::Mutex;

const SCENE: &str = "
[camera]
position = [0, 0, 300]
target = [0, 0, 0]
fov_deg = 20
width = 12
height = 8
[[shape]]
type = \"plane\"
size = [80, 80]
material = \"paper\"
[[light]]
type = \"point\"
position = [0, 100, 280]
[material.paper.base]
albedo = [0.5, 0.5, 0.5]
";

/// Stores the previews.
#[derive(Default)]
struct Watched(Mutex<Vec<(SoFar, Vec<u8>)>>);

impl Progress for Watched {
    fn stage(&self, _: &str, _: u64) {}

    fn step(&self) {}

    fn is_watched(&self) -> bool {
        true
    }

    fn show(&self, so_far: serde_json::Value, png: Vec<u8>) {
        self.0.lock().unwrap().push((serde_json::from_value(so_far).unwrap(), png));
    }

    fn cancelled(&self) -> bool {
        false
    }
}

fn written(text: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("scene.toml"), text).unwrap();
    dir
}

#[test]
fn files_stay_beside_their_scene() {
    let albedo = |file: &str| SCENE.replace("[0.5, 0.5, 0.5]", &format!("{file:?}"));
    let refusal = |text: &str| {
        let dir = written(text);
        Options::default().check(dir.path()).unwrap_err().to_string()
    };
    for file in ["/etc/passwd", "../a.png", "a/../../b.png", ".."] {
        let said = refusal(&albedo(file));
        assert!(said.contains("material.paper.base.albedo") && said.contains("outside"), "{said}");
    }
    assert!(refusal(&albedo("./a.png")).contains("not there"));
    assert!(refusal(&SCENE.replace("width = 12", "width = 70000")).contains("70000"));
    let dir = written(SCENE);
    Options::default().check(dir.path()).unwrap();
    std::fs::copy(dir.path().join("scene.toml"), dir.path().join("other.TOML")).unwrap();
    assert!(Options::default().check(dir.path()).unwrap_err().to_string().contains("more than once"));
}

#[test]
fn a_job_shows_its_passes_and_leaves_nothing_when_it_fails() {
    let dir = written(SCENE);
    let out = dir.path().join("out");
    let options = Options { samples: 64, max_error: 1e-5, ..Options::default() };
    let watched = Watched::default();
    perform(&options, dir.path(), &out, false, &watched).unwrap();
    let seen = watched.0.into_inner().unwrap();
    // Previews are at least a second apart, so a short job shows only its first pass.
    assert!(seen[0].0.passes == 1 && seen[0].0.noise.is_nan() && seen.len() < 16, "{}", seen.len());
    assert!(seen.iter().all(|(so_far, png)| so_far.of >= so_far.passes && png.starts_with(b"\x89PNG")));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert!(
        report["warnings"].to_string().contains("allow more samples") && report["exposure"].is_number(),
        "{report}"
    );
    let failed = dir.path().join("failed");
    let none = Options { samples: 0, ..Options::default() };
    perform(&none, dir.path(), &failed, false, &Silent).unwrap_err();
    assert!(!failed.exists());
}

#[test]
fn a_smaller_picture_holds_the_same_light() {
    let pixel = |k: usize| Pixel { rgb: [k as f64, 1.0, 0.0], luminance: k as f64, ..Pixel::default() };
    let picture = Picture {
        width: 5,
        height: 3,
        pass_samples: 4,
        passes: 2,
        pixels: (0..15).map(pixel).collect(),
        bands: vec![],
    };
    assert_eq!(picture.shrunk(5), picture);
    let small = picture.shrunk(3);
    assert_eq!((small.width, small.height), (3, 2));
    assert_eq!(small.pixels[0].luminance, (0.0 + 1.0 + 5.0 + 6.0) / 4.0);
    assert_eq!(small.pixels[5].rgb, [14.0, 1.0, 0.0]);
    assert_eq!((picture.shrunk(0).width, picture.shrunk(1).height), (1, 1));
}

#[test]
fn scenes_to_start_from_name_files_that_are_there() {
    for name in GALLERY.into_iter().flat_map(|n| [n.to_owned(), format!("{n}-room")]) {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::begin(dir.path(), true).unwrap();
        gallery_scene(&folder, &name).unwrap();
        folder.commit().unwrap();
        Options::default().check(dir.path()).unwrap();
    }
    let dir = tempfile::tempdir().unwrap();
    let folder = OutputFolder::begin(dir.path(), true).unwrap();
    assert!(gallery_scene(&folder, "scales").unwrap_err().to_string().contains("star-paper"));
}

#[test]
fn maps_become_a_sheet_of_their_proportions() {
    let dir = tempfile::tempdir().unwrap();
    let write = |path: &Path, names: &[&str]| write_exr(path, 8, 4, names, &[], &|_, _, row| row.fill(1.0)).unwrap();
    assert_eq!(scene_of_maps(dir.path()).unwrap(), None);
    write(&dir.path().join("lut.exr"), &["X", "Y", "Z"]);
    assert!(scene_of_maps(dir.path()).unwrap().unwrap().contains("\"table\""));
    write(&dir.path().join("orientation.exr"), &["orientation", "mask"]);
    let text = scene_of_maps(dir.path()).unwrap().unwrap();
    assert!(text.contains("size = [110.0, 55.0]") && text.contains("period_um"), "{text}");
    Scene::parse(&text).unwrap().check_files(dir.path()).unwrap();
}
