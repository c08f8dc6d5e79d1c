//! Computations in separate processes: service and bench survive any failure of one of them.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::{Service, begin, finished, plan};
use nacre_tests::{BENCH, Place, assert_gone, command, listing, nacre};
use rustix::fs::inotify;
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// A tile under a lamp, with this picture size.
fn scene(width: usize, height: usize) -> String {
    format!(
        "[camera]\nposition = [0, 0, 300]\ntarget = [0, 0, 0]\nfov_deg = 20\nwidth = {width}\nheight = {height}\n
         [[shape]]\ntype = \"plane\"\nsize = [80, 80]\nmaterial = \"foil\"\n
         [[light]]\ntype = \"point\"\nposition = [0, 100, 280]\nsigma_mm = 3\n
         [material.foil.base]\nalbedo = [0.05, 0.05, 0.05]\n"
    )
}

fn upload(service: &Service, scene: &str) -> Value {
    let parts: [(&str, &str, &[u8]); 2] = [("kind", "", b"scene"), ("file", "scene.toml", scene.as_bytes())];
    service.upload(&parts).expect(201).json()["id"].clone()
}

/// Path of a job that renders an upload.
fn render(service: &Service, upload: &Value, options: &Value) -> String {
    let asked = json!({ "upload": upload, "method": "render", "options": options });
    let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
    format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap())
}

/// Starts a rendering without end; returns its path.
fn endless(service: &Service) -> String {
    let job =
        render(service, &upload(service, &scene(160, 40)), &json!({ "samples": 1_000_000, "max_error": 0.00001 }));
    under_way(service, &job);
    job
}

fn under_way(service: &Service, job: &str) {
    service.until(job, |r| r["so_far"]["passes"].as_u64() > Some(0));
}

fn ended(service: &Service, job: &str) -> Value {
    service.until(job, |r| !["queued", "running"].contains(&r["state"].as_str().unwrap()))
}

/// Fields of `/proc/PID/stat` after the name: state, parent, group, …
fn stat(pid: u32) -> Vec<String> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    text.rsplit(") ").next().unwrap_or_default().split(' ').map(str::to_owned).collect()
}

/// Computing processes of a service.
fn computing(service: &Service) -> Vec<u32> {
    let processes = fs::read_dir("/proc").unwrap().flatten();
    let pids = processes.filter_map(|p| p.file_name().to_str()?.parse::<u32>().ok());
    let parent = service.pid().to_string();
    let job = |pid: &u32| fs::read(format!("/proc/{pid}/cmdline")).is_ok_and(|line| line == b"nacre\0job\0");
    pids.filter(|pid| stat(*pid).get(1) == Some(&parent)).filter(job).collect()
}

fn signal(name: &str, pid: u32) {
    assert!(Command::new("kill").args([name, &pid.to_string()]).status().unwrap().success());
}

#[test]
fn a_job_whose_process_is_killed_fails_and_a_session_goes_on() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let session = begin(&service, &plan(6, 100.0));
    let at = format!("/api/v1/sessions/{session}");
    service.until(&at, |s| s["frames_committed"].as_u64() > Some(0));
    // Paused, so that its own results are not computed meanwhile.
    service.post(&format!("{at}/pause"), &json!({})).expect(202);
    service.until(&at, |s| s["state"] == "paused");
    for (name, words) in [("-KILL", "was killed"), ("-ABRT", "signal 6"), ("-XCPU", "signal 24")] {
        let job = endless(&service);
        let pids = computing(&service);
        let [pid] = pids[..] else { panic!("{pids:?}") };
        let fields = stat(pid);
        assert_eq!(fields[2], pid.to_string(), "a group of its own");
        assert!(fields[16].parse::<i32>().unwrap() >= 10, "the capture has precedence: {fields:?}");
        let score = fs::read_to_string(format!("/proc/{pid}/oom_score_adj")).unwrap();
        assert!(score.trim().parse::<i32>().unwrap() >= 500, "{score}");
        signal(name, pid);
        let failed = ended(&service, &job);
        let error = failed["error"].as_str().unwrap();
        assert!(failed["state"] == "failed" && error.contains(words), "{name}: {failed}");
        assert!(error.contains("; "), "no remedy: {error}");
        assert_eq!((&failed["attempts"], computing(&service)), (&json!(1), vec![]));
        service.get(&format!("{job}/picture.png")).expect(404);
    }
    service.post(&format!("{at}/resume"), &json!({})).expect(202);
    finished(&service, &session);
    nacre(["check", &place.text(&format!("data/sessions/{session}"))]).expect(0);
    assert!(listing(&place.path("data/reconstructions")).is_empty());
    // The next job succeeds.
    let job = render(&service, &upload(&service, &scene(16, 12)), &json!({ "samples": 4, "max_error": 1 }));
    assert_eq!(ended(&service, &job)["state"], "done");
}

/// A process that ignores the request to stop is killed, and its partial output is removed.
#[test]
fn a_cancelled_job_ends_whether_its_process_listens_or_not() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    for deaf in [false, true] {
        let job = endless(&service);
        let pids = computing(&service);
        let [pid] = pids[..] else { panic!("{pids:?}") };
        if deaf {
            signal("-STOP", pid);
        }
        service.post(&format!("{job}/cancel"), &json!({})).expect(202);
        assert_eq!(ended(&service, &job)["state"], "cancelled");
        assert!(computing(&service).is_empty() && listing(&place.path("data/reconstructions")).is_empty());
    }
}

#[test]
fn a_job_that_needs_more_memory_than_it_may_take_fails_and_says_so() {
    let place = Place::with_bench("", BENCH);
    fs::write(place.path("nacre.toml"), "limits = { job_memory_mib = 96 }").unwrap();
    let service = Service::start(&place, &["--config", &place.text("nacre.toml")]);
    let options = json!({ "samples": 4, "max_error": 1 });
    let small = render(&service, &upload(&service, &scene(64, 48)), &options);
    assert_eq!(ended(&service, &small)["state"], "done");
    // The number of triangles of a mesh is in no header.
    let mesh = scene(64, 48).replace("\"plane\"\nsize = [80, 80]", "\"mesh\"\nfile = \"fine.obj\"");
    let vertices: String = (0..700 * 700).map(|i| format!("v {} {} 0\n", i % 700, i / 700)).collect();
    let quad = |i: usize| format!("f {} {} {} {}\n", i + 1, i + 2, i + 702, i + 701);
    let faces: String = (0..699 * 699).map(|k| quad(k / 699 * 700 + k % 699)).collect();
    let fine = vertices + &faces;
    let parts: [(&str, &str, &[u8]); 3] =
        [("kind", "", b"scene"), ("file", "scene.toml", mesh.as_bytes()), ("file", "fine.obj", fine.as_bytes())];
    let sent = service.upload(&parts).expect(201).json()["id"].clone();
    let failed = ended(&service, &render(&service, &sent, &options));
    let error = failed["error"].as_str().unwrap();
    assert!(failed["state"] == "failed" && error.contains("more memory than the 0.09 GiB"), "{failed}");
    assert!(error.contains("fewer or smaller") && error.contains("limits.job_memory_mib"), "{error}");
    assert_eq!(failed["attempts"], 1);
    service.get("/api/v1/sessions").expect(200);
}

#[test]
fn a_job_during_which_the_service_died_twice_is_not_tried_again() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let job = endless(&service);
    assert_eq!(computing(&service).len(), 1);
    // `kill` asserts that no process remains.
    service.kill();
    let service = Service::start(&place, &[]);
    under_way(&service, &job);
    assert_eq!(service.get(&job).expect(200).json()["attempts"], 2);
    service.kill();
    let service = Service::start(&place, &[]);
    let failed = service.get(&job).expect(200).json();
    assert_eq!((&failed["state"], &failed["attempts"]), (&json!("failed"), &json!(2)), "{failed}");
    assert!(failed["error"].as_str().unwrap().contains("the service was killed"), "{failed}");
    assert!(computing(&service).is_empty());
    // A user can still retry it, and remains of killed processes are removed.
    service.post(&format!("{job}/retry"), &json!({})).expect(202);
    under_way(&service, &job);
    assert_eq!(listing(&place.path("data/reconstructions")).len(), 1);
    service.post(&format!("{job}/cancel"), &json!({})).expect(202);
    assert_eq!(ended(&service, &job)["state"], "cancelled");
    assert!(listing(&place.path("data/reconstructions")).is_empty());
}

/// The service stops in time, and the job waits for its next start.
#[test]
fn a_job_is_put_back_when_the_service_ends() {
    let place = Place::with_bench("", BENCH);
    let mut service = Service::start(&place, &[]);
    let job = endless(&service);
    service.signal("TERM");
    assert_eq!(service.ended(), Some(0));
    drop(service);
    let service = Service::start(&place, &[]);
    under_way(&service, &job);
    assert_eq!(service.get(&job).expect(200).json()["attempts"], 1);
    service.post(&format!("{job}/cancel"), &json!({})).expect(202);
    ended(&service, &job);
}

#[test]
fn the_hidden_command_refuses_a_person_and_ends_without_its_parent() {
    let (mut program, mark) = command();
    let run = program.arg("job").stdin(Stdio::null()).stderr(Stdio::piped()).output().unwrap();
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("for the program itself"));
    assert!(!nacre(["--help"]).stdout().contains("  job"));
    assert_gone(&mark);
    // Requested by a process that no longer exists.
    let (mut program, mark) = command();
    let mut child = program.arg("job").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let order =
        json!({ "limits": { "memory": null, "processor_s": null, "background": false }, "parent": 1, "task": {} });
    std::io::Write::write_all(child.stdin.as_mut().unwrap(), format!("{order}\n").as_bytes()).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1));
    assert_gone(&mark);
}

/// An uncompressed mosaic DNG.
fn dng(width: u32, height: u32) -> Vec<u8> {
    let pixels = width * height * 2;
    let short = |tag: u16, value: u32| (tag, 3_u16, 1_u32, value.to_le_bytes());
    let long = |tag: u16, value: u32| (tag, 4_u16, 1_u32, value.to_le_bytes());
    let tags = [
        long(254, 0),
        long(256, width),
        long(257, height),
        short(258, 16),
        short(259, 1),
        short(262, 32_803),
        (271, 2, 2, [b'N', 0, 0, 0]),
        (272, 2, 2, [b'T', 0, 0, 0]),
        long(273, 8),
        short(277, 1),
        long(278, height),
        long(279, pixels),
        (33_421, 3, 2, [2, 0, 2, 0]),
        (33_422, 1, 4, [0, 1, 1, 2]),
        (50_706, 1, 4, [1, 4, 0, 0]),
        short(50_714, 512),
        short(50_717, 4095),
    ];
    let mut file = [b"II*\0".to_vec(), (8 + pixels).to_le_bytes().to_vec()].concat();
    file.extend((0..pixels / 2).flat_map(|i| (600 + (i % 997) as u16).to_le_bytes()));
    file.extend((tags.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in tags {
        file.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value].concat());
    }
    file.extend([0; 4]);
    file
}

/// True if this build reads camera raw files.
fn reads_raw(place: &Place) -> bool {
    fs::create_dir(place.path("raw")).unwrap();
    fs::write(place.path("raw/000.dng"), dng(64, 48)).unwrap();
    let shown = nacre(["import", &place.text("raw")]);
    !shown.stderr().contains("this build of nacre does not read")
}

#[test]
fn a_camera_raw_file_that_needs_more_memory_than_allowed_is_refused_by_name() {
    let place = Place::with_bench("", BENCH);
    if !reads_raw(&place) {
        println!("skipped: this build reads no camera raw files");
        return;
    }
    fs::write(place.path("nacre.toml"), "limits = { job_memory_mib = 96 }").unwrap();
    let service = Service::start(&place, &["--config", &place.text("nacre.toml")]);
    let sent = |bytes: &[u8]| {
        let names = ["000.dng", "045.dng", "090.dng", "135.dng"];
        service.upload(&names.map(|name| ("file", name, bytes)))
    };
    sent(&dng(64, 48)).expect(201);
    let told = sent(&dng(6000, 4000)).expect(400).text();
    assert!(told.contains("dng") && told.contains("more memory than the 0.09 GiB"), "{told}");
    assert!(!told.contains("/data/"), "{told}");
    sent(&dng(64, 48)).expect(201);
}

/// The same pixels as from the command line, which also decodes the file in a separate process.
#[test]
fn a_contained_decoder_delivers_the_values_of_the_file() {
    let place = Place::with_bench("", BENCH);
    if !reads_raw(&place) {
        println!("skipped: this build reads no camera raw files");
        return;
    }
    let [width, height] = [64, 48];
    let files: Vec<PathBuf> = [0, 45, 90, 135].map(|n| place.path(&format!("raw/{n:03}.dng"))).into();
    files.iter().for_each(|file| fs::write(file, dng(width, height)).unwrap());
    nacre(["import", &place.text("raw"), "--force"]).expect(0);
    let set = fs::read_to_string(place.path("raw/frames.json")).unwrap();
    assert!(set.contains("\"black\": 512") && set.contains("\"white\": 4095"), "{set}");
    nacre(["reconstruct", "polarization", &place.text("raw"), "--out", &place.text("maps")]).expect(0);
    let report: Value = serde_json::from_slice(&fs::read(place.path("maps/report.json")).unwrap()).unwrap();
    assert_eq!((&report["width"], &report["height"]), (&json!(width / 2), &json!(height / 2)));
}

/// One process reads a file's size, levels and exposure; another reads its pixels.
#[test]
fn an_import_starts_two_decoders_per_file() {
    let place = Place::with_bench("", BENCH);
    if !reads_raw(&place) {
        println!("skipped: this build reads no camera raw files");
        return;
    }
    for n in [0, 45, 90, 135] {
        fs::write(place.path(&format!("raw/{n:03}.dng")), dng(64, 48)).unwrap();
    }
    // Each decoder has a folder for temporary files, created by its parent.
    fs::create_dir(place.path("tmp")).unwrap();
    let watch = inotify::init(inotify::CreateFlags::NONBLOCK).unwrap();
    inotify::add_watch(&watch, place.path("tmp"), inotify::WatchFlags::CREATE).unwrap();
    let (mut program, mark) = command();
    program.env("TMPDIR", place.path("tmp")).args(["import", &place.text("raw"), "--force"]);
    assert!(program.output().unwrap().status.success());
    assert_gone(&mark);
    let mut buffer = [std::mem::MaybeUninit::uninit(); 4096];
    let mut events = inotify::Reader::new(&watch, &mut buffer);
    let mut decoders = 0;
    while let Ok(event) = events.next() {
        decoders += usize::from(event.file_name().is_some_and(|name| name.to_bytes().starts_with(b"nacre-job-")));
    }
    assert_eq!(decoders, 8);
    assert!(listing(&place.path("tmp")).is_empty());
}

/// Third-party decoders may abort or hang on a damaged file, which counts as invalid input.
#[test]
fn a_decoder_that_aborts_or_hangs_is_bad_input() {
    let place = Place::with_bench("", BENCH);
    if !reads_raw(&place) {
        println!("skipped: this build reads no camera raw files");
        return;
    }
    for n in [45, 90, 135] {
        fs::write(place.path(&format!("raw/{n:03}.dng")), dng(64, 48)).unwrap();
    }
    fs::remove_file(place.path("raw/frames.json")).unwrap_or_default();
    for (fails, words) in [("abort", "its decoder crashed (signal 6)"), ("loop", "its decoder took more than")] {
        let (program, mark) = command();
        // A decoder has a time limit of two minutes, or the limit of processor time if that is lower.
        let mut limited = Command::new("sh");
        limited.args(["-c", "ulimit -S -t 2; exec \"$0\" \"$@\""]).arg(program.get_program());
        limited.envs(program.get_envs().filter_map(|(name, value)| Some((name, value?))));
        let run = limited.args(["import", &place.text("raw")]).env("NACRE_DECODER", fails).output().unwrap();
        let told = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{fails}: {told}");
        assert!(told.contains("000.dng") && told.contains(words) && told.contains("export the file again"), "{told}");
        assert!(!place.path("raw/frames.json").exists());
        assert_gone(&mark);
    }
}
