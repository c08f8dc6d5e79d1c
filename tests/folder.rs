//! Sessions whose camera is a folder: an operator, played by the test, sets the camera and takes the photographs.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use crate::panel::Page;
use crate::still::{Tags, camera_time, completed, dng, jpeg};
use nacre_tests::fault_table::{committed, record};
use nacre_tests::http::{Service, begin};
use nacre_tests::{BENCH, BenchProcess, Place, nacre, test_data};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};

/// A service with an emulated stage, the page as panel, and a folder of photographs.
struct Bench {
    place: Place,
    _stage: BenchProcess,
    service: Service,
    _page: Page,
    /// Requests so far.
    asked: Arc<Mutex<Vec<String>>>,
}

/// Starts a bench whose folder is filled by `fill`. The operator then acts on each request, by its number.
fn bench(fill: impl Fn(&Path), more: &str, act: impl Fn(usize, &str, &Path) + Send + 'static) -> Bench {
    let place = Place::with_bench("", BENCH);
    let (stage, lamp, folder) = (place.text("stage"), place.text("lamp"), place.path("photographs"));
    fs::create_dir(&folder).unwrap();
    fill(&folder);
    let config = format!(
        "[bench.stage]\ndriver = {{ kind = \"elliptec\", port = {stage:?}, answer_ms = 60000, move_ms = 60000, \
         settling_ms = 0 }}\n[bench.camera]\ndriver = {{ kind = \"folder\", path = {folder:?}{} }}\n\
         [bench.display]\ndriver = {{ kind = \"page\", size_mm = [500, 300] }}\n",
        more.replace("LAMP", &lamp)
    );
    fs::write(place.path("nacre.toml"), config).unwrap();
    let devices = [format!("elliptec={stage}"), format!("relay={lamp}")];
    let more = ["--real-time", "--device", &devices[0], "--device", &devices[1]];
    let stage = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &more);
    let asked: Arc<Mutex<Vec<String>>> = Arc::default();
    let requests = asked.clone();
    let service = Service::at_terminal(&place, &["--config", &place.text("nacre.toml")], move |line| {
        let number = {
            let mut requests = requests.lock().unwrap();
            requests.push(line.to_owned());
            requests.len()
        };
        act(number, line, &folder);
    });
    let page = Page::open(&service);
    Bench { place, _stage: stage, service, _page: page, asked }
}

fn tags(exposure: [u32; 2], shift_s: i64) -> Tags {
    Tags { exposure, iso: 100, taken: camera_time(shift_s), serial: "4711" }
}

/// Frames of the session, in the order of their angles and exposures.
fn frames(bench: &Bench) -> Vec<PathBuf> {
    let folder = bench.place.only_session().join("frames");
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().flatten().map(|e| e.path()).collect();
    files.sort();
    files
}

fn greens(file: &Path) -> Vec<u16> {
    image::open(file).unwrap().to_luma16().into_raw()
}

/// Raw files with a JPEG beside each, late ones, links, notes and halves: each request is answered by the raw file that
/// was taken after it.
#[test]
fn raw_photographs_are_matched_to_their_requests() {
    let green = |number: usize| 1000 + 100 * number as u16;
    let bench = bench(
        |folder| fs::write(folder.join("IMG_0000.DNG"), dng(64, 48, 900, &tags([1, 100], -500))).unwrap(),
        "",
        move |number, _, folder| {
            let path = |name: &str| folder.join(format!("{name}_{number}"));
            // Taken before the request, and late. Before the first photograph, the camera's clock is not yet known.
            let late = dng(64, 48, 3000, &tags([1, 100], if number == 1 { -600 } else { -100 }));
            fs::write(path("A_LATE").with_extension("DNG"), late).unwrap();
            fs::write(path("A_NOTE").with_extension("txt"), "x").unwrap();
            std::os::unix::fs::symlink("/dev/zero", path("A_LINK").with_extension("DNG")).unwrap();
            // The JPEG of the pair comes first, and the raw file in two halves under a temporary name.
            fs::write(path("IMG").with_extension("JPG"), jpeg(64, 48, Some(&tags([1, 100], 0)))).unwrap();
            let whole = dng(64, 48, green(number), &tags([1, 100], 0));
            let (part, raw) = (path("IMG").with_extension("part"), path("IMG").with_extension("DNG"));
            fs::write(&part, &whole[..whole.len() / 2]).unwrap();
            std::thread::sleep(Duration::from_millis(50));
            fs::rename(&part, &raw).unwrap();
            std::thread::sleep(Duration::from_millis(400));
            fs::write(&raw, &whole).unwrap();
        },
    );
    let plan = json!({ "plan": {
        "kind": "polarization", "name": "a tile", "camera": { "exposure_ms": 10.0 },
        "analyser": { "angles_deg": [0.0, 45.0, 90.0, 135.0] },
    } });
    let id = begin(&bench.service, &plan);
    let done = completed(&bench.service, &id);
    assert_eq!(done["frames_committed"], 4, "{done}");
    let asked = bench.asked.lock().unwrap().clone();
    assert_eq!(asked.len(), 4, "{asked:?}");
    let files = frames(&bench);
    for (k, file) in files.iter().enumerate() {
        let values = greens(file);
        assert_eq!(values.len(), 32 * 24);
        assert!(values.iter().all(|v| *v == green(k + 1)), "{}: {}", file.display(), values[0]);
    }
    let described = fs::read_to_string(bench.place.only_session().join("session.json")).unwrap();
    assert!(described.contains("photographs of Acme Eye s/n 4711"), "{described}");
    let described: Value =
        serde_json::from_slice(&fs::read(bench.place.only_session().join("frames.json")).unwrap()).unwrap();
    assert!(described.to_string().contains("512") && described.to_string().contains("4095"), "{described}");
    nacre(["check", bench.place.only_session().to_str().unwrap()]).expect(0);
    // Nothing was moved or deleted.
    assert_eq!(fs::read_dir(bench.place.path("photographs")).unwrap().count(), 1 + 4 * 5);
}

/// A wrong dial stops the session with both values; the session is resumed after the camera was set.
#[test]
fn a_camera_with_other_settings_stops_the_session_until_it_is_set() {
    let bench = bench(
        |folder| fs::write(folder.join("0.jpg"), jpeg(64, 48, Some(&tags([1, 30], -500)))).unwrap(),
        "",
        |number, line, folder| {
            assert!(number > 2 || line.contains("set the camera to 1/100 s (10 ms) and ISO 100"), "{line}");
            let exposure = if number == 1 { [1, 30] } else { [1, 100] };
            fs::write(folder.join(format!("{number}.jpg")), jpeg(64, 48, Some(&tags(exposure, 0)))).unwrap();
        },
    );
    let plan = json!({ "plan": {
        "kind": "free", "steps": [{ "analyser_deg": 20.0, "exposure_ms": 10.0 }, { "analyser_deg": 40.0, "exposure_ms": 10.0 }],
    } });
    let refused = json!({ "plan": { "kind": "free", "steps": [{ "exposure_ms": 11.0 }] } });
    let refused = bench.service.post("/api/v1/sessions", &refused);
    assert!(refused.status >= 400 && refused.text().contains("10 ms or 12.5 ms"), "{}", refused.text());
    let id = begin(&bench.service, &plan);
    let base = format!("/api/v1/sessions/{id}");
    let stopped = bench.service.until(&base, |s| s["error"].is_string() && s["stage"].is_null());
    let told = stopped["error"].as_str().unwrap();
    println!("{told}");
    assert!(told.contains("1/100 s (10 ms)") && told.contains("1/30 s (33.33 ms) in 1.jpg"), "{told}");
    bench.service.post(&format!("{base}/resume"), &json!({})).expect(202);
    let done = bench.service.until(&base, |s| s["state"] == "finished");
    assert_eq!(done["frames_committed"], 2, "{done}");
    let told = told.replace(&bench.place.text("photographs"), "/photographs");
    record("folder", "another exposure set on the camera", &[committed(&stopped)], &told);
    assert_eq!(bench.asked.lock().unwrap().len(), 3);
}

/// A shutter cable at an emulated relay; the operator only sets the camera where the exposure changes.
#[test]
fn a_relay_releases_the_shutter() {
    let bench = bench(
        |folder| fs::write(folder.join("0.jpg"), jpeg(64, 48, Some(&tags([1, 100], -500)))).unwrap(),
        ", trigger = { kind = \"relay\", path = \"unix:LAMP\" }, hold_ms = 3000, wait_s = 60",
        |_, line, _| panic!("nobody need be asked: {line}"),
    );
    let plan = json!({ "plan": {
        "kind": "free", "steps": [{ "analyser_deg": 20.0, "exposure_ms": 10.0 }, { "analyser_deg": 40.0, "exposure_ms": 10.0 }],
    } });
    let id = begin(&bench.service, &plan);
    let state = || bench.service.get(&format!("/api/v1/sessions/{id}")).text();
    // The camera photographs when its cable is closed.
    let folder = bench.place.path("photographs");
    for number in 1..=2 {
        let begun = std::time::Instant::now();
        while nacre_tests::light(&bench._stage) != [false, true] {
            assert!(begun.elapsed() < nacre_tests::NEVER, "the cable is not closed: {}", state());
            std::thread::sleep(Duration::from_millis(2));
        }
        fs::write(folder.join(format!("{number}.jpg")), jpeg(64, 48, Some(&tags([1, 100], 0)))).unwrap();
        while nacre_tests::light(&bench._stage) != [false, false] {
            assert!(begun.elapsed() < nacre_tests::NEVER, "the cable stays closed");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
    let done = completed(&bench.service, &id);
    assert_eq!(done["frames_committed"], 2, "{done}");
}

/// Seven photographs of a real camera, with its Exif tags; only the times are those of the test.
#[test]
fn real_photographs_of_a_bracket_become_the_frames_of_a_plan() {
    let Some(data) = test_data() else { return };
    let real: Vec<Vec<u8>> =
        (0..7).map(|k| fs::read(data.join(format!("hdr/stack_room_exp_{k}.jpg"))).unwrap()).collect();
    let dated = |photograph: &[u8], shift_s: i64| {
        let mut bytes = photograph.to_vec();
        let hundredths = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().subsec_millis() / 10;
        let (now, parts) = (camera_time(shift_s), format!("{hundredths:02}"));
        let places =
            |pattern: &[u8]| (0..4000).filter(|at| photograph[*at..].starts_with(pattern)).collect::<Vec<usize>>();
        let (dates, subseconds) = (places(b"2015:08:21 09:1"), places(b"\x92\x91\0\x02\0\0\0\x03"));
        assert!(!dates.is_empty() && subseconds.len() == 1, "{dates:?} {subseconds:?}");
        dates.into_iter().for_each(|at| bytes[at..at + 19].copy_from_slice(now.as_bytes()));
        subseconds.into_iter().for_each(|at| bytes[at + 8..at + 10].copy_from_slice(parts.as_bytes()));
        bytes
    };
    let (first, rest) = (dated(&real[0], -500), real[1..].to_vec());
    let photographs = rest.clone();
    let bench = bench(
        move |folder| fs::write(folder.join("IMG_0.JPG"), &first).unwrap(),
        ", iso = 200",
        move |number, _, folder| {
            let photograph = dated(&photographs[number - 1], 0);
            fs::write(folder.join(format!("IMG_{number}.JPG")), photograph).unwrap();
        },
    );
    let steps: Vec<Value> =
        [500.0, 125.0, 1000.0 / 30.0, 8.0, 1.0, 0.25].iter().map(|ms| json!({ "exposure_ms": ms })).collect();
    let id = begin(&bench.service, &json!({ "plan": { "kind": "free", "steps": steps } }));
    let done = completed(&bench.service, &id);
    assert_eq!(done["frames_committed"], 6, "{done}");
    let asked = bench.asked.lock().unwrap().clone();
    for (request, speed) in asked.iter().zip(["0.5 s", "1/8 s", "1/30 s", "1/125 s", "1/1000 s", "1/4000 s"]) {
        assert!(request.contains(&format!("set the camera to {speed}")) && request.contains("ISO 200"), "{request}");
    }
    let described = fs::read_to_string(bench.place.only_session().join("session.json")).unwrap();
    assert!(described.contains("photographs of Canon EOS REBEL T2i"), "{described}");
    for (file, photograph) in frames(&bench).iter().zip(&rest) {
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
            sum / count
        };
        let expected = image::load_from_memory(photograph).unwrap().to_rgb8();
        let expected = mean(&mut expected.pixels().map(|p| f64::from(p.0[1])));
        let frame = mean(&mut greens(file).into_iter().map(f64::from));
        assert!((frame - expected).abs() < 0.5, "{frame} and {expected} in {}", file.display());
    }
}
