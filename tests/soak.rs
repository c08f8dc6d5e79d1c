//! Sessions one after the other, with faults, stops, kills and full disks at random: no frame is lost, every end is explained, and the service does not grow.
//!
//! `NACRE_SESSIONS` says how many (200), `NACRE_SEED` which.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::{Service, SmallDisk, fill, free};
use nacre_tests::{Place, data};
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

/// A bench that loses no time, since the service waits as long as devices take, with a flash that frames show.
const BENCH: &str = "camera = { width = 64, height = 48, readout_ms = 1 }\n\
    stage = { speed_deg_s = 50000, settle_ms = 1 }\n\
    flash = { power = 30000 }\n";

/// Commands to devices in a session, about; faults are spread over them.
const COMMANDS: u64 = 60;

/// Commands with which the service begins: it does not start, and says why, where light cannot be switched off then.
const FIRST: u64 = 8;

/// Most tries until a session is complete: no fault lasts longer.
const TRIES: usize = 40;

/// Growth of the resident memory that is none, in KiB: caches that fill.
const GROWTH_KB: u64 = 16 << 10;

fn variable(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |v| v.parse().unwrap())
}

/// Numbers at random (splitmix64).
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % most
    }

    /// A bench on which something goes wrong now and then during so many sessions.
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

/// Files, threads and resident memory in KiB of the service.
fn resources(service: &Service) -> [u64; 3] {
    let folder = |name: &str| fs::read_dir(format!("/proc/{}/{name}", service.pid())).unwrap().count() as u64;
    [folder("fd"), folder("task"), service.memory()]
}

struct Soak {
    place: Place,
    /// The data folder, as seen from here.
    data: PathBuf,
    dice: Dice,
    /// The data set of an undisturbed session.
    whole: Vec<(String, Vec<u8>)>,
    /// Sessions that a kill interrupted.
    interrupted: Vec<String>,
    /// Ends by their reasons.
    ends: std::collections::BTreeMap<String, usize>,
    complete: u64,
    /// How often the disk was full.
    filled: u64,
}

/// The worst that happens during a session.
#[derive(Clone, Copy, PartialEq)]
enum Worst {
    Stop,
    Kill,
    FullDisk,
}

impl Soak {
    /// A session from its begin to its comparison with the undisturbed one. Returns the service, unless it was killed.
    fn session(&mut self, service: Service, worst: Worst) -> Option<Service> {
        let id = begin(&service);
        let base = format!("/api/v1/sessions/{id}");
        let wait = |dice: &mut Dice| std::thread::sleep(Duration::from_millis(dice.below(60)));
        match self.dice.below(if worst == Worst::Stop { 7 } else { 8 }) {
            0 => {
                wait(&mut self.dice);
                let stopped = service.post("/api/v1/stop", &json!({}));
                // A device that a fault keeps from going dark is named.
                let named = ["simulated panel", "switch it off by hand"];
                assert!(
                    stopped.status == 200 || named.iter().any(|name| stopped.text().contains(name)),
                    "{}",
                    stopped.text()
                );
            }
            // These are refused where the session has ended before.
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

    /// Goes on with a session until it is complete.
    fn finish(&mut self, service: &Service, id: &str) {
        let base = format!("/api/v1/sessions/{id}");
        if service.get(&base).status == 404 {
            // The service was killed before there was a session.
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
            // Device and command, after the file of the frame; or the word for what a person did.
            let kind = why.split(": ").skip(1).collect::<Vec<_>>().join(": ");
            let why = if kind.is_empty() { why.to_owned() } else { kind };
            *self.ends.entry(why).or_default() += 1;
            let resumed = service.post(&format!("{base}/resume"), &json!({}));
            if resumed.status == 404 {
                // Its disk was full before there was a session.
                assert!(!self.data.join("sessions").join(id).join("session.json").exists(), "{}", resumed.text());
                return self.finish(service, &begin(service));
            }
            assert!([202, 409].contains(&resumed.status), "{}", resumed.text());
        }
    }

    /// Its data are those of the undisturbed session; then it is deleted.
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

/// Begins a session, as soon as a disk that was full a moment ago is known not to be.
fn begin(service: &Service) -> String {
    loop {
        let answer = service.post("/api/v1/sessions", &plan());
        if answer.status != 507 {
            return answer.expect(202).json()["id"].as_str().unwrap().to_owned();
        }
        service.until_full(false);
    }
}

/// Mean value of a frame's pixels; 0 for what is none.
fn mean_light(bytes: &[u8]) -> f64 {
    let Ok(frame) = image::load_from_memory(bytes).map(|picture| picture.to_luma16()) else { return 0.0 };
    frame.iter().map(|v| f64::from(*v)).sum::<f64>() / frame.len() as f64
}

/// Whether two frames differ by their noise alone, which the bench draws anew where a fault has cost a frame before them: 3 % of the light in a
/// pixel, 0.05 % in the mean of 3072.
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
    // Another angle and other light are no noise.
    let frames: Vec<_> = whole.iter().filter(|(name, _)| name.ends_with(".png")).collect();
    for (k, (name, one)) in frames.iter().enumerate() {
        let alike = frames[..k].iter().find(|(_, other)| differs_by_noise(one, other));
        assert!(alike.is_none(), "{name} and {} are told apart by nothing", alike.map_or("", |(name, _)| name));
    }
    drop(service);
    let dice = Dice(variable("NACRE_SEED", 1));
    let (data, ends) = (place.path("data"), Default::default());
    let mut soak = Soak { place, data, dice, whole, interrupted: vec![], ends, complete: 0, filled: 0 };

    // Half of them in lives of the service that end by a kill.
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
    // The others in one life, during which nothing grows, on a disk that is full now and then where one can be mounted.
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

/// A service on a bench with faults during so many sessions, which first completes what was interrupted; on a small disk of its own, if
/// it is asked for and can be had.
fn begun(soak: &mut Soak, sessions: u64, small_disk: bool) -> (Service, Worst) {
    fs::write(soak.place.path("bench.toml"), soak.dice.bench(sessions)).unwrap();
    let disk = if small_disk {
        fs::rename(soak.place.path("data"), soak.place.path("before")).unwrap();
        SmallDisk::new(&soak.place, "24m", "cp -a ../before/. .")
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
