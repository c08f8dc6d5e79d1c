//! Killed and hung guardians of the flash: the light goes off, and the owner continues.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use nacre_tests::http::Service;
use nacre_tests::{BENCH, BenchProcess, Place, assert_gone, command, data, light, nacre};
use serde_json::json;
use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit of any wait, on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// Kinds of loss: the guardian hangs, or is killed.
const LOSSES: [&str; 2] = ["-STOP", "-KILL"];

fn until(what: &str, done: impl Fn() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < PATIENCE, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A bench whose maximum on-time exceeds any test, so that no time limit switches the flash off.
fn bench(place: &Place) -> BenchProcess {
    fs::write(place.path("bench.toml"), format!("{BENCH}flash = {{ max_on_s = 3600 }}\n")).unwrap();
    BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &["--real-time"])
}

fn serve(place: &Place) -> Service {
    let config = format!("[bench]\nsim = true\nsocket = {:?}\n", place.path("socket"));
    fs::write(place.path("nacre.toml"), config).unwrap();
    Service::serve(place, &["--config", &place.text("nacre.toml")])
}

fn signal(pid: u32, name: &str) -> bool {
    Command::new("kill").args([name, &pid.to_string()]).stderr(Stdio::null()).status().unwrap().success()
}

/// Value of a line of `/proc/PID/status`.
fn status(pid: u32, key: &str) -> Option<String> {
    let text = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    text.lines().find_map(|line| line.strip_prefix(key)).map(|value| value.trim().to_owned())
}

fn has_ended(pid: u32) -> bool {
    status(pid, "State:").is_none_or(|state| state.starts_with('Z'))
}

/// Guardians of a process: two while one replaces the other.
fn guardians(owner: u32) -> Vec<u32> {
    let is_it = |pid: &u32| {
        let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        line.split(|byte| *byte == 0).any(|word| word == b"guardian")
            && status(*pid, "PPid:") == Some(owner.to_string())
    };
    let processes = fs::read_dir("/proc").unwrap().flatten().filter_map(|p| p.file_name().to_str()?.parse().ok());
    processes.filter(is_it).collect()
}

/// The only guardian of a process.
fn guardian(owner: u32) -> u32 {
    let found = guardians(owner);
    assert_eq!(found.len(), 1, "guardians of {owner}: {found:?}");
    found[0]
}

/// A hung guardian, which continues when this is dropped, so that a failed test ends.
struct Lost(u32);

impl Lost {
    fn guardian_of(owner: u32, loss: &str) -> Self {
        let lost = Self(guardian(owner));
        assert!(signal(lost.0, loss));
        lost
    }
}

impl Drop for Lost {
    fn drop(&mut self) {
        signal(self.0, "-CONT");
    }
}

/// A command on a bench, once the flash is on.
fn with_light(bench: &BenchProcess, args: Vec<String>) -> (Child, String) {
    let (mut command, mark) = command();
    let child = command.args(Place::on(args, bench)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    until("the flash is on", || light(bench)[1]);
    (child, mark)
}

#[test]
fn the_flash_of_the_service_goes_off_and_the_service_goes_on() {
    let place = Place::new("");
    let (bench, service) = (bench(&place), serve(&place));
    let switch = |on: bool| {
        let devices = service.post("/api/v1/devices/flash/switch", &json!({ "on": on })).expect(200).json();
        assert!(devices["flash"]["on"] == on && light(&bench)[1] == on, "{devices}");
    };
    for loss in LOSSES {
        switch(true);
        let begun = Instant::now();
        let lost = Lost::guardian_of(service.pid(), loss);
        until("the flash is off", || !light(&bench)[1]);
        println!("{loss}: off after {:.0} ms", 1000.0 * begun.elapsed().as_secs_f64());
        assert!(has_ended(lost.0), "{loss}: the guardian that was lost still has the device");
        service.until("/api/v1/devices", |d| d["flash"]["on"] == false);
        // In the dark, the next guardian handles the request.
        let _lost = Lost::guardian_of(service.pid(), loss);
        switch(true);
        let _lost = Lost::guardian_of(service.pid(), loss);
        for _ in 0..2 {
            service.post("/api/v1/stop", &json!({})).expect(200);
            assert_eq!(light(&bench), [false, false], "{loss}: STOP has answered");
        }
        let _lost = Lost::guardian_of(service.pid(), loss);
        service.post("/api/v1/stop", &json!({})).expect(200);
        switch(true);
        switch(false);
    }
}

#[test]
fn sigterm_ends_a_service_whose_guardian_is_lost() {
    let place = Place::new("");
    let bench = bench(&place);
    for loss in LOSSES {
        for on in [true, false] {
            let service = serve(&place);
            service.post("/api/v1/devices/flash/switch", &json!({ "on": on })).expect(200);
            let lost = Lost::guardian_of(service.pid(), loss);
            let begun = Instant::now();
            assert!(signal(service.pid(), "-TERM"));
            until("the service has ended", || has_ended(service.pid()));
            println!("{loss}: ended after {:.0} ms", 1000.0 * begun.elapsed().as_secs_f64());
            assert_eq!(light(&bench), [false, false], "{loss}");
            assert!(has_ended(lost.0), "{loss}: the guardian is left behind");
        }
    }
}

/// A guardian is lost during an exposure under the flash: the light goes off before the exposure ends, and the frame is
/// captured again.
///
/// A guardian that is lost before it has answered the request for light is replaced at once, and the frame is captured
/// in its light. Such a session is repeated.
fn during_an_exposure(loss: &str) {
    const EXPOSURE: Duration = Duration::from_secs(8);
    const TRIES: u32 = 10;
    let step = format!("{{ flash = true, exposure_ms = {} }}", EXPOSURE.as_millis());
    let place = Place::new(&format!("kind = \"free\"\nsteps = [{step}]"));
    let bench = bench(&place);
    nacre(place.capture("whole")).expect(0);
    let journal = || fs::read_to_string(place.path("s/journal")).unwrap();
    for _ in 0..TRIES {
        let (child, mark) = with_light(&bench, place.capture("s"));
        let begun = Instant::now();
        let lost = Lost::guardian_of(child.id(), loss);
        until("another guardian has the flash", || guardians(child.id()).iter().any(|pid| *pid != lost.0));
        let replaced = begun.elapsed();
        until("the flash is off", || !light(&bench)[1]);
        let off = begun.elapsed();
        println!("{loss}: replaced after {replaced:.1?}, off after {off:.1?}");
        assert!(replaced < EXPOSURE, "{loss}: replaced after {replaced:?}, which is the end of the exposure");
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert_gone(&mark);
        assert!(data(&place.path("s")) == data(&place.path("whole")), "the data set differs");
        assert_eq!(light(&bench), [false, false]);
        drop(lost);
        if !journal().contains("retried") {
            fs::remove_dir_all(place.path("s")).unwrap();
            continue;
        }
        assert!(off < EXPOSURE, "{loss}: off after {off:?}, which is the end of the exposure");
        assert!(journal().contains("flash guardian"), "{}", journal());
        return;
    }
    panic!("{loss}: no guardian was lost during an exposure");
}

#[test]
fn a_guardian_that_hangs_during_an_exposure_costs_the_frame_only() {
    during_an_exposure("-STOP");
}

#[test]
fn a_guardian_that_is_killed_during_an_exposure_costs_the_frame_only() {
    during_an_exposure("-KILL");
}

#[test]
fn light_by_hand_goes_off_and_the_command_ends_with_an_error() {
    let place = Place::new("");
    let bench = bench(&place);
    for loss in LOSSES {
        let args = ["flash", "on", "--sim"].map(str::to_owned).to_vec();
        let (child, mark) = with_light(&bench, args);
        let _lost = Lost::guardian_of(child.id(), loss);
        until("the flash is off", || !light(&bench)[1]);
        assert!(signal(child.id(), "-INT"));
        let output = child.wait_with_output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && stderr.contains("flash guardian"), "{loss}: {stderr}");
        assert_gone(&mark);
    }
}
