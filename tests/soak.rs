//! Successive sessions with random faults, stops, kills and full disks: no frame is lost, every end has a reason, and
//! the service does not grow.
//!
//! `NACRE_SESSIONS` sets the number of sessions (default 200), `NACRE_SEED` the random seed.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::{Service, SmallDisk, fill, free};
use nacre_tests::{Place, data};
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

/// A bench without unnecessary delays, since the service waits for devices, with a flash that is visible in frames.
const BENCH: &str = "camera = { width = 64, height = 48, readout_ms = 1 }\n\
    stage = { speed_deg_s = 50000, settle_ms = 1 }\n\
    flash = { power = 30000 }\n";

/// Approximate number of device commands per session, over which faults are distributed.
const COMMANDS: u64 = 60;

/// Number of commands at the start of the service. If the light cannot be switched off then, it reports that and does
/// not start.
const FIRST: u64 = 8;

/// Maximum number of attempts to complete a session, above the duration of any fault.
const TRIES: usize = 40;

/// Tolerated growth of resident memory in KiB, for filling caches.
const GROWTH_KB: u64 = 16 << 10;

fn variable(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |v| v.parse().unwrap())
}

/// Random numbers (SplitMix64).
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % most
    }

    /// A bench with random faults during this number of sessions.
    fn bench(&mut self, sessions: u64) -> String {
        const FAULTS: [(&str, &str); 13] = [
            ("stage", "stops_short"),
            ("stage", "nonsense"),
            ("stage", "silent"),
            ("stage", "lost"),
            ("camera", "silent"),
            ("camera", "lost"),
            ("camera", "wrong_size"),
            ("camera", "damaged"),
            ("display", "silent"),
            ("display", "other_pattern"),
            ("flash", "wrong_state"),
            ("clock", "set_back"),
            ("interlock", "opens"),
        ];
        let fault = |_| {
            let (device, kind) = FAULTS[self.below(FAULTS.len() as u64) as usize];
            let (after, times) = (FIRST + self.below(COMMANDS * sessions), 1 + self.below(5));
            format!("{{ device = \"{device}\", kind = \"{kind}\", after = {after}, times = {times} }}")
        };
        let faults: Vec<String> = (0..sessions).map(fault).collect();
        format!("{BENCH}faults = [{}]", faults.join(", "))
    }
}

/// Open files, threads and resident memory in KiB of the service.
fn resources(service: &Service) -> [u64; 3] {
    let folder = |name: &str| fs::read_dir(format!("/proc/{}/{name}", service.pid())).unwrap().count() as u64;
    [folder("fd"), folder("task"), service.memory()]
}

struct Soak {
    place: Place,
    /// Data folder, as seen from this process.
    data: PathBuf,
    dice: Dice,
    /// Data set of an undisturbed session.
    whole: Vec<(String, Vec<u8>)>,
    /// Sessions interrupted by a kill.
    interrupted: Vec<String>,
    /// Number of ends by reason.
    ends: std::collections::BTreeMap<String, usize>,
    complete: u64,
    /// Number of times that the disk was full.
    filled: u64,
}

/// Most severe disturbance of a session.
#[derive(Clone, Copy, PartialEq)]
enum Worst {
    Stop,
    Kill,
    FullDisk,
}

impl Soak {
    /// Runs a session from its start to the comparison with the undisturbed one. Returns the service, unless it was
    /// killed.
    fn session(&mut self, service: Service, worst: Worst) -> Option<Service> {
        let id = begin(&service);
        let base = format!("/api/v1/sessions/{id}");
        let wait = |dice: &mut Dice| std::thread::sleep(Duration::from_millis(dice.below(60)));
        match self.dice.below(if worst == Worst::Stop { 7 } else { 8 }) {
            0 => {
                wait(&mut self.dice);
                let stopped = service.post("/api/v1/stop", &json!({}));
                // A device that a fault prevents from going dark is named.
                let named = ["simulated panel", "switch it off by hand"];
                assert!(
                    stopped.status == 200 || named.iter().any(|name| stopped.text().contains(name)),
                    "{}",
                    stopped.text()
                );
            }
            // Rejected if the session has already ended.
            which @ 1..=3 => {
                wait(&mut self.dice);
                service.post(&format!("{base}/{}", ["stop", "abort", "pause"][which as usize - 1]), &json!({}));
                wait(&mut self.dice);
                service.post(&format!("{base}/resume"), &json!({}));
            }
            7 if worst == Worst::FullDisk => {
                wait(&mut self.dice);
                fill(&self.data);
                wait(&mut self.dice);
                free(&self.data);
                self.filled += 1;
            }
            7 => {
                wait(&mut self.dice);
                service.kill();
                self.interrupted.push(id);
                return None;
            }
            _ => {}
        }
        self.finish(&service, &id);
        Some(service)
    }

    /// Resumes a session until it is complete.
    fn finish(&mut self, service: &Service, id: &str) {
        let base = format!("/api/v1/sessions/{id}");
        if service.get(&base).status == 404 {
            // The service was killed before the session was created.
            assert!(!self.data.join("sessions").join(id).join("session.json").exists(), "{id}");
            return self.finish(service, &begin(service));
        }
        for tries in 0.. {
            assert!(tries < TRIES, "session {id} is not complete after {TRIES} ends: {:?}", self.ends);
            let over = |s: &Value| match s["state"].as_str().unwrap() {
                "paused" => true,
                state => s["stage"].is_null() && ["finished", "failed", "idle"].contains(&state),
            };
            let session = service.until(&base, over);
            if session["state"] == "finished" {
                return self.compare(service, id);
            }
            let why = session["error"].as_str().unwrap_or_default();
            assert!(!why.is_empty() || session["state"] == "paused", "an end without a reason: {session}");
            // Device and command, after the file of the frame; or the word for a user's action.
            let kind = why.split(": ").skip(1).collect::<Vec<_>>().join(": ");
            let why = if kind.is_empty() { why.to_owned() } else { kind };
            *self.ends.entry(why).or_default() += 1;
            let resumed = service.post(&format!("{base}/resume"), &json!({}));
            if resumed.status == 404 {
                // The disk was full before the session was created.
                assert!(!self.data.join("sessions").join(id).join("session.json").exists(), "{}", resumed.text());
                return self.finish(service, &begin(service));
            }
            assert!([202, 409].contains(&resumed.status), "{}", resumed.text());
        }
    }

    /// Its data equal those of the undisturbed session; it is then deleted.
    fn compare(&mut self, service: &Service, id: &str) {
        let folder = self.data.join("sessions").join(id);
        let found = data(&folder);
        assert_eq!(found.len(), self.whole.len(), "{id}");
        for ((name, bytes), (wanted_name, wanted)) in found.iter().zip(&self.whole) {
            assert_eq!(name, wanted_name, "{id}");
            let journal = || fs::read_to_string(folder.join("journal")).unwrap_or_default();
            let light = || [bytes, wanted].map(|bytes| mean_light(bytes));
            assert!(
                bytes == wanted || differs_by_noise(bytes, wanted),
                "{id}: {name} differs: {:?} found and wanted\n{}",
                light(),
                journal()
            );
        }
        let base = format!("/api/v1/sessions/{id}");
        let token = service.get(&format!("{base}/deletion")).expect(200).json()["token"].as_str().unwrap().to_owned();
        service.send("DELETE", &format!("{base}?token={token}"), &[], b"").expect(204);
        assert!(!folder.exists());
        self.complete += 1;
    }
}

/// Starts a session, once the service has noticed that a previously full disk is free again.
fn begin(service: &Service) -> String {
    loop {
        let answer = service.post("/api/v1/sessions", &plan());
        if answer.status != 507 {
            return answer.expect(202).json()["id"].as_str().unwrap().to_owned();
        }
        service.until_full(false);
    }
}

/// Mean value of a frame's pixels; 0 for other files.
fn mean_light(bytes: &[u8]) -> f64 {
    let Ok(frame) = image::load_from_memory(bytes).map(|picture| picture.to_luma16()) else { return 0.0 };
    frame.iter().map(|v| f64::from(*v)).sum::<f64>() / frame.len() as f64
}

/// True if two frames differ by noise alone. The bench draws new noise if a fault has cost an earlier frame: 3 % of the
/// light in a pixel, 0.05 % in the mean of 3072.
fn differs_by_noise(one: &[u8], other: &[u8]) -> bool {
    let [one, other] = [one, other].map(|bytes| image::load_from_memory(bytes).map(|picture| picture.to_luma16()));
    let (Ok(one), Ok(other)) = (one, other) else { return false };
    let light: f64 = other.iter().map(|v| f64::from(*v)).sum();
    let differences = one.iter().zip(other.iter()).map(|(a, b)| f64::from(*a) - f64::from(*b));
    let (sum, squares) = differences.fold((0.0, 0.0), |(sum, squares), d| (sum + d, squares + d * d));
    let pixels = one.len() as f64;
    one.dimensions() == other.dimensions()
        && sum.abs() < 0.005 * light
        && (squares / pixels).sqrt() < 0.06 * light / pixels
}

fn plan() -> Value {
    json!({ "plan": {
        "kind": "free",
        "steps": [
            { "analyser_deg": 30.0, "exposure_ms": 8.0 },
            { "analyser_deg": 30.0, "exposure_ms": 8.0, "flash": true },
            { "analyser_deg": 10.0, "exposure_ms": 3.0, "display": { "diameter_mm": 40.0 } },
            { "analyser_deg": 10.0, "exposure_ms": 3.0, "flash": true, "display": { "pattern": "black" } },
        ],
    } })
}

#[test]
fn sessions_by_the_hundred_lose_no_frame() {
    let sessions = variable("NACRE_SESSIONS", 200);
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = begin(&service);
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "finished" && s["stage"].is_null());
    let whole = data(&place.path("data/sessions").join(&id));
    // Another angle and other light are not noise.
    let frames: Vec<_> = whole.iter().filter(|(name, _)| name.ends_with(".png")).collect();
    for (k, (name, one)) in frames.iter().enumerate() {
        let alike = frames[..k].iter().find(|(_, other)| differs_by_noise(one, other));
        assert!(alike.is_none(), "{name} and {} are told apart by nothing", alike.map_or("", |(name, _)| name));
    }
    drop(service);
    let dice = Dice(variable("NACRE_SEED", 1));
    let (data, ends) = (place.path("data"), Default::default());
    let mut soak = Soak { place, data, dice, whole, interrupted: vec![], ends, complete: 0, filled: 0 };

    // Half of the sessions run on services that end by a kill.
    let mut kills = 0;
    while soak.complete < sessions / 2 {
        let mut service = Some(begun(&mut soak, 20, false).0);
        while let Some(alive) = service.take() {
            if soak.complete >= sessions / 2 {
                break;
            }
            service = soak.session(alive, Worst::Kill);
            kills += u64::from(service.is_none());
        }
    }
    // The others run on one service, whose resources must not grow, on an occasionally full disk where one can be
    // mounted.
    let (mut service, worst) = begun(&mut soak, sessions / 2, true);
    let mut first = None;
    let begin = soak.complete;
    while soak.complete < sessions {
        service = soak.session(service, worst).unwrap();
        if soak.complete >= begin + 10 && first.is_none() {
            first = Some(resources(&service));
        }
    }
    let [before, after] = [first.unwrap(), resources(&service)];
    println!(
        "{} sessions, {kills} kills, {} full disks, {} early ends of {} kinds; files, threads and KiB of memory of the service: {before:?}, then {after:?}",
        soak.complete,
        soak.filled,
        soak.ends.values().sum::<usize>(),
        soak.ends.len()
    );
    assert!(after[0] <= before[0] + 4 && after[1] <= before[1] + 4, "{before:?} {after:?}");
    assert!(after[2] <= before[2] + GROWTH_KB, "{before:?} {after:?}");
    assert!(worst == Worst::Stop || soak.filled > 0);
    assert!(kills > 0 && soak.ends.len() > 5, "{kills} {:?}", soak.ends);
}

/// A service on a bench with faults during this number of sessions, which first completes interrupted ones; on a small
/// private disk, if requested and available.
fn begun(soak: &mut Soak, sessions: u64, small_disk: bool) -> (Service, Worst) {
    fs::write(soak.place.path("bench.toml"), soak.dice.bench(sessions)).unwrap();
    let disk = if small_disk {
        fs::rename(soak.place.path("data"), soak.place.path("before")).unwrap();
        // The trash of a long run would fill the disk at once.
        SmallDisk::new(&soak.place, "24m", "rm -rf ../before/trash && cp -a ../before/. .")
    } else {
        None
    };
    let (service, worst) = match disk {
        Some(SmallDisk { service, data }) => {
            soak.data = data;
            (service, Worst::FullDisk)
        }
        None if small_disk => {
            fs::rename(soak.place.path("before"), soak.place.path("data")).unwrap();
            (Service::start(&soak.place, &[]), Worst::Stop)
        }
        None => (Service::start(&soak.place, &[]), Worst::Kill),
    };
    for id in std::mem::take(&mut soak.interrupted) {
        soak.finish(&service, &id);
    }
    (service, worst)
}
