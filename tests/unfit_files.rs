//! Special or oversized inputs are rejected at once, by name. Outputs that would overwrite an input, or that are
//! special files, are rejected, and the input is unchanged.

#![allow(clippy::unwrap_used, clippy::panic)]

use nacre_tests::{BENCH, NEVER, Place, command, nacre};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// Kinds of unsuitable inputs. `folder` comes last, because some commands accept one.
const KINDS: [&str; 4] = ["pipe", "zeros", "sparse", "folder"];

/// Creates an unsuitable input at a path.
fn make(kind: &str, at: &Path) {
    match kind {
        "pipe" => assert!(Command::new("mkfifo").arg(at).status().unwrap().success()),
        "zeros" => symlink("/dev/zero", at).unwrap(),
        "sparse" => fs::File::create(at).unwrap().set_len(5 << 30).unwrap(),
        _ => fs::create_dir(at).unwrap(),
    }
}

fn remove(at: &Path) {
    fs::remove_file(at).or_else(|_| fs::remove_dir_all(at)).unwrap();
}

/// Runs the program in a folder with little memory; a hanging one is killed, and fails the test. Returns exit code and
/// all output.
fn run(folder: &Path, args: &str) -> (Option<i32>, String) {
    let program = command().0.get_program().to_owned();
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -v 8000000; exec \"$@\"", "sh"]).arg(program).args(args.split_whitespace());
    limited.current_dir(folder).stdin(Stdio::null());
    let told = folder.join("told");
    let both = fs::File::create(&told).unwrap();
    let mut child = limited.stdout(both.try_clone().unwrap()).stderr(both).spawn().unwrap();
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if begun.elapsed() > NEVER {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("{args}: hangs");
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    (status.code(), fs::read_to_string(told).unwrap())
}

/// A folder with valid inputs of every kind.
fn place() -> Place {
    let place = Place::with_bench("kind = \"exposures\"\nexposures_ms = [3, 6, 9]\n", BENCH);
    nacre(place.capture("session")).expect(0);
    let surface = ["brdf", "surface", "blazed", "--period-um", "2.5", "--depth-um", "0.3", "--pixels", "16", "--out"];
    nacre(surface.map(str::to_owned).into_iter().chain([place.text("height.exr")])).expect(0);
    image::GrayImage::from_fn(16, 16, |x, y| image::Luma([(9 * x + 5 * y) as u8]))
        .save(place.path("photo.png"))
        .unwrap();
    let gltf = r#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 36, "uri": "UNFIT"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0}"#;
    fs::write(place.path("buffer.gltf"), gltf).unwrap();
    let plane = "type = \"plane\"\nsize = [9, 9]";
    let grey = "[material.a.base]\nalbedo = [1, 1, 1]\nroughness = 0.5\n";
    let white = "[[light]]\ntype = \"environment\"\ncolor = [1, 1, 1]\n";
    for (name, shape, material, light) in [
        ("plain", plane, grey, white),
        ("mesh", "type = \"mesh\"\nfile = \"UNFIT.obj\"", grey, white),
        ("buffer", "type = \"mesh\"\nfile = \"buffer.gltf\"", grey, white),
        ("heights", plane, "[material.a]\ndiffraction = { type = \"heightfield\", file = \"UNFIT\" }\n", white),
        ("texture", plane, "[material.a.base]\nalbedo = \"UNFIT\"\nroughness = 0.5\n", white),
        ("sky", plane, grey, "[[light]]\ntype = \"environment\"\nfile = \"UNFIT\"\n"),
        ("spectrum", plane, grey, "[[light]]\ntype = \"directional\"\ndirection = [0, 0, -1]\nspectrum = \"UNFIT\"\n"),
    ] {
        let camera = "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 14\nwidth = 12\nheight = 12\n";
        let text = format!("{camera}[[shape]]\n{shape}\nmaterial = \"a\"\n{material}{light}");
        fs::write(place.path(&format!("{name}.toml")), text).unwrap();
    }
    fs::write(place.path("simulated.toml"), "[bench]\nsim = true\nfile = \"UNFIT\"\n").unwrap();
    place
}

/// Commands that read the input UNFIT, and the number of [`KINDS`] that they reject, since some accept folders.
const READERS: [(&str, usize); 53] = [
    ("capture UNFIT --sim --out out", 4),
    ("capture UNFIT --sim --dry-run", 4),
    ("capture plan.toml --sim --bench UNFIT --out out", 4),
    ("capture plan.toml --config UNFIT --out out", 4),
    ("plan check UNFIT", 4),
    ("plan estimate UNFIT --sim", 4),
    ("devices --config UNFIT", 4),
    ("devices --config simulated.toml", 4),
    ("devices --sim --bench UNFIT", 4),
    ("serve --config UNFIT --data data --listen 127.0.0.1:0", 4),
    ("serve --sim --bench UNFIT --data data --listen 127.0.0.1:0", 4),
    ("serve --sim --config UNFIT --data data --listen 127.0.0.1:0", 4),
    ("stage where --config UNFIT", 4),
    ("snap --sim --bench UNFIT --out out", 4),
    ("calibrate panel --config UNFIT --out out", 4),
    ("sim bench --socket socket --bench UNFIT", 4),
    ("sim render --bench UNFIT --out out", 4),
    ("check UNFIT", 3),
    ("capture --sim --resume UNFIT", 3),
    ("import UNFIT", 3),
    ("recommend UNFIT", 3),
    ("reconstruct polarization UNFIT --out out", 3),
    ("reconstruct hdr UNFIT --out out", 3),
    ("reconstruct hdr session --response UNFIT --out out", 4),
    ("reconstruct spots UNFIT --out out", 3),
    ("reconstruct flash UNFIT --out out", 3),
    ("reconstruct foil photo.png --geometry UNFIT --out out", 3),
    ("reconstruct bokeh UNFIT --psf-sigma 2 --out out", 3),
    ("reconstruct bokeh photo.png --transfer linear --psf UNFIT --out out", 3),
    ("reconstruct bokeh photo.png --transfer linear --psf-sigma 2 --calibration UNFIT --out out", 3),
    ("reconstruct lut UNFIT --wavelength 560 --scale 0.002 --transfer linear --out out", 3),
    ("reconstruct lut photo.png --wavelength 560 --geometry UNFIT --transfer linear --out out", 3),
    ("map edit UNFIT --rotate 5 --out out", 3),
    ("map compare UNFIT UNFIT --out out", 3),
    ("synthesize UNFIT --size 5,5 --pixel-um 9 --square-px 2 --out out", 3),
    ("factor UNFIT --out out", 3),
    ("calibrate geometry UNFIT --out out", 3),
    ("brdf map UNFIT --size 8 --out out.exr", 4),
    ("brdf map height.exr --size 8 --illuminant UNFIT --out out.exr", 4),
    ("brdf slice UNFIT --out out.csv", 4),
    ("brdf terms UNFIT --out out", 4),
    ("brdf heights UNFIT --out out.exr", 4),
    ("brdf orders --period-um 2.5 --profile UNFIT --out out.csv", 4),
    ("render UNFIT --samples 1 --out out.exr", 4),
    ("render mesh.toml --samples 1 --out out.exr", 4),
    ("render buffer.toml --samples 1 --out out.exr", 4),
    ("render heights.toml --samples 1 --out out.exr", 4),
    ("render texture.toml --samples 1 --out out.exr", 4),
    ("render sky.toml --samples 1 --out out.exr", 4),
    ("render spectrum.toml --samples 1 --out out.exr", 4),
    ("render plain.toml --samples 1 --keep UNFIT --resume --out out.exr", 4),
    ("catalogue add UNFIT", 3),
    ("catalogue list --catalogue UNFIT", 4),
];

#[test]
fn inputs_that_are_no_files_are_refused_by_name() {
    let place = place();
    let folder = place.path("");
    for kind in KINDS {
        let at = place.path("UNFIT");
        make(kind, &at);
        symlink(&at, place.path("UNFIT.obj")).unwrap();
        for (args, kinds) in READERS {
            if kinds == 3 && kind == "folder" {
                continue;
            }
            let (code, told) = run(&folder, args);
            assert_eq!(code, Some(2), "{args} with {kind}: {told}");
            // The catalogue resolves links.
            let named = told.contains("UNFIT") || (kind == "zeros" && told.contains("/dev/zero"));
            assert!(named && !told.contains("panicked"), "{args} with {kind}: {told}");
        }
        let made = ["out", "out.exr", "out.csv", "data/nacre.db"].into_iter().find(|name| place.path(name).exists());
        assert_eq!(made, None, "{kind}");
        remove(&at);
        remove(&place.path("UNFIT.obj"));
    }
}

/// The files of a session are inputs of any command that resumes it.
#[test]
fn files_of_sessions_that_are_none_are_refused_by_name() {
    let place = place();
    let folder = place.path("");
    let file = |name: &str| place.path("session").join(name);
    let frame = fs::read_dir(file("frames")).unwrap().next().unwrap().unwrap().file_name();
    let frame = format!("frames/{}", frame.to_str().unwrap());
    for kind in KINDS {
        for (name, args, expected) in [
            ("session.json", "check session", 1),
            ("session.json", "capture --sim --resume session", 2),
            ("journal", "check session", 2),
            ("journal", "capture --sim --resume session", 2),
            ("frames.json", "check session", 1),
            ("frames.json", "reconstruct hdr session --out out", 2),
            (&frame, "check session", 1),
            (&frame, "reconstruct hdr session --out out", 2),
        ] {
            let kept = place.path("kept");
            fs::rename(file(name), &kept).unwrap();
            make(kind, &file(name));
            let (code, told) = run(&folder, args);
            assert_eq!(code, Some(expected), "{args} with {kind} as {name}: {told}");
            let name_alone = Path::new(name).file_name().unwrap().to_str().unwrap();
            assert!(told.contains(name_alone), "{args} with {kind} as {name}: {told}");
            remove(&file(name));
            fs::rename(&kept, file(name)).unwrap();
        }
    }
    nacre(["check", &place.text("session")]).expect(0);
}

/// All files in a folder, with their contents.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = vec![];
    for entry in fs::read_dir(folder).unwrap().flatten() {
        match entry.path() {
            path if path.is_dir() => found.extend(contents(&path)),
            path if path.is_file() && !path.ends_with("told") => found.push((path.clone(), fs::read(&path).unwrap())),
            _ => {}
        }
    }
    found.sort();
    found
}

#[test]
fn no_output_replaces_an_input() {
    let place = place();
    let folder = place.path("");
    let run = |args: &str| run(&folder, args);
    let ok = |args: &str| assert_eq!(run(args).0, Some(0), "{args}: {}", run(args).1);
    symlink("height.exr", place.path("link.exr")).unwrap();
    fs::hard_link(place.path("height.exr"), place.path("same.exr")).unwrap();
    fs::copy(place.path("photo.png"), place.path("beside.png")).unwrap();
    fs::write(place.path("heights.csv"), "x_um,height_um\n0,0\n1,0.25\n2,0\n").unwrap();
    fs::write(
        place.path("textured.toml"),
        fs::read_to_string(place.path("texture.toml")).unwrap().replace("UNFIT", "photo.png"),
    )
    .unwrap();
    ok("sim render --sample cd --size 32 --angles-deg 0,45,90 --out series");
    ok("reconstruct polarization series --out maps");
    // A series with a photograph named like a result.
    fs::create_dir(place.path("named")).unwrap();
    fs::create_dir(place.path("photos")).unwrap();
    for (k, angle) in [0, 45, 90, 135].iter().enumerate() {
        let name = if k == 0 { "aolp.png".into() } else { format!("{angle:03}.png") };
        image::GrayImage::from_fn(16, 16, |x, y| image::Luma([(60 + 9 * x + y + 7 * k as u32) as u8]))
            .save(place.path("named").join(&name))
            .unwrap();
        fs::copy(place.path("named").join(name), place.path(&format!("photos/{angle:03}.png"))).unwrap();
    }
    let frames = "{\"kind\": \"polarization\", \"transfer\": \"linear\", \"frames\": [\
        {\"file\": \"aolp.png\", \"analyser_deg\": 0}, {\"file\": \"045.png\", \"analyser_deg\": 45}, \
        {\"file\": \"090.png\", \"analyser_deg\": 90}, {\"file\": \"135.png\", \"analyser_deg\": 135}]}";
    fs::write(place.path("named/frames.json"), frames).unwrap();
    ok("render plain.toml --samples 1 --keep state.exr --out kept.exr");
    let before = contents(&folder);
    for (args, named) in [
        ("brdf map height.exr --size 8 --out height.exr --force", "height.exr"),
        ("brdf map height.exr --size 8 --out ./maps/../height.exr --force", "height.exr"),
        ("brdf map height.exr --size 8 --out link.exr --force", "link.exr"),
        ("brdf map height.exr --size 8 --out same.exr --force", "same.exr"),
        ("brdf map link.exr --size 8 --out height.exr --force", "height.exr"),
        // The picture is written beside the map.
        ("brdf map photo.png --pixel-um 1 --range-um 1 --size 8 --out photo.exr --force", "photo.png"),
        ("brdf heights height.exr --out height.exr --force", "height.exr"),
        ("brdf slice height.exr --out height.exr --force", "height.exr"),
        ("brdf orders --period-um 2 --profile heights.csv --out heights.csv --force", "heights.csv"),
        ("render plain.toml --samples 1 --out plain.toml --force", "plain.toml"),
        ("render plain.toml --samples 1 --keep plain.toml --out other.exr", "plain.toml"),
        // Named by the scene rather than on the command line.
        ("render textured.toml --samples 1 --out photo.exr --force", "photo.png"),
        ("snap --sim --bench bench.toml --out bench.toml --force", "bench.toml"),
        ("calibrate panel --sim --bench bench.toml --out bench.toml --force", "bench.toml"),
        ("map edit maps --rotate 5 --out maps --force", "maps"),
        ("map edit maps/orientation.exr --rotate 5 --out ./maps --force", "maps"),
        ("reconstruct polarization named --out named --force", "aolp.png"),
        ("import photos --transfer linear --out photos --force", "photos"),
    ] {
        let (code, told) = run(args);
        assert_eq!(code, Some(2), "{args}: {told}");
        assert!(told.contains(named) && told.contains("is an input of this command"), "{args}: {told}");
        assert!(contents(&folder) == before, "{args} changed something");
    }
    // Files that a command resumes from are its own, and outputs of earlier commands are not inputs.
    ok("render plain.toml --samples 2 --keep state.exr --resume --out kept.exr --force");
    ok("brdf map height.exr --size 8 --out map.exr");
    ok("brdf map height.exr --size 8 --out map.exr --force");
    ok("reconstruct polarization series --out maps --force");
}

#[test]
fn outputs_are_regular_files() {
    let place = place();
    let folder = place.path("");
    make("pipe", &place.path("pipe.exr"));
    symlink("/dev/null", place.path("null.exr")).unwrap();
    fs::create_dir(place.path("folder.exr")).unwrap();
    fs::create_dir(place.path("maps")).unwrap();
    make("pipe", &place.path("maps/report.json"));
    let surface = "brdf surface blazed --period-um 2.5 --depth-um 0.3 --pixels 16 --force --out";
    for (args, named) in [
        (format!("{surface} pipe.exr"), "pipe.exr: is a pipe"),
        (format!("{surface} null.exr"), "null.exr: is a device"),
        (format!("{surface} /dev/null"), "/dev/null: is a device"),
        (format!("{surface} folder.exr"), "folder.exr: is a folder"),
        ("snap --sim --bench bench.toml --out null.exr --force".into(), "null.exr: is a device"),
        ("reconstruct hdr session --out maps --force".into(), "maps/report.json: is a pipe"),
    ] {
        let (code, told) = run(&folder, &args);
        assert_eq!(code, Some(2), "{args}: {told}");
        assert!(told.contains(named), "{args}: {told}");
    }
}
