//! A session killed at any step and at any time can be resumed to identical bytes, and its light is off.

#![allow(clippy::unwrap_used)]

use nacre_tests::{BenchProcess, NEVER, Place, assert_gone, command, data, light, nacre};
use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// All kinds of light, a burst, and a change of exposure.
const PLAN: &str = r#"
    kind = "free"
    extras = ["dark"]
    steps = [
        { analyser_deg = 30, exposure_ms = 8 },
        { analyser_deg = 30, exposure_ms = 8 },
        { flash = true, exposure_ms = 8 },
        { analyser_deg = 10, exposure_ms = 3, display = { diameter_mm = 40, center_mm = [50, 0] } },
        { flash = true, exposure_ms = 3, display = { pattern = "black" } },
    ]
"#;

/// A killed capture: time until all light was off, and true if any was on at first.
fn watch_light(bench: &BenchProcess, child: &mut Child, mark: &str) -> (Duration, bool) {
    let begun = Instant::now();
    let lit = light(bench) != [false, false];
    while light(bench) != [false, false] {
        assert!(begun.elapsed() < NEVER, "light stays on after the kill");
        std::thread::sleep(Duration::from_millis(1));
    }
    let off = begun.elapsed();
    child.wait().unwrap();
    assert_gone(mark);
    (off, lit)
}

/// Resumes a killed session, or starts it if it was killed too early; its data must then equal `whole`.
fn complete(place: &Place, name: &str, bench: &BenchProcess, whole: &[(String, Vec<u8>)]) {
    if place.path(name).join("session.json").exists() {
        let check = nacre(["check", &place.text(name)]);
        assert!([0, 1].contains(&check.code()) && !check.stdout().contains("differs"), "{}", check.stdout());
        nacre(Place::on(place.resume(name), bench)).expect(0);
    } else {
        nacre(Place::on(place.capture(name), bench)).expect(0);
    }
    assert!(data(&place.path(name)) == whole, "{name}: the data set differs");
    nacre(["check", &place.text(name)]).expect(0);
    fs::remove_dir_all(place.path(name)).unwrap();
}

#[test]
fn a_kill_at_any_disk_operation_is_made_good() {
    let place = Place::new(PLAN);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
    let mut killed = 0;
    loop {
        let (mut command, mark) = command();
        command.args(Place::on(place.capture("s"), &bench)).env("NACRE_DIE_AT", killed.to_string());
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let status = child.wait().unwrap();
        watch_light(&bench, &mut child, &mark);
        complete(&place, "s", &bench, &whole);
        if status.success() {
            break;
        }
        killed += 1;
    }
    println!("killed before each of {killed} disk operations");
    assert!(killed > 30, "{killed}");
}

/// Entries of a session's journal.
fn entries(place: &Place, name: &str) -> Vec<String> {
    let text = fs::read_to_string(place.path(name).join("journal")).unwrap_or_default();
    text.lines().map(str::to_owned).collect()
}

/// Waits until the journal has this number of entries, or the process has ended.
fn until_entry(place: &Place, name: &str, count: usize, child: &mut Child) {
    while entries(place, name).len() < count && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Killed after each entry of the journal in turn, repeatedly and a little later each time, until enough kills have hit
/// a session in progress. The bench is a separate process.
#[test]
fn a_kill_at_any_instant_is_made_good() {
    const HITS: usize = 100;
    const LATER: Duration = Duration::from_micros(300);
    let place = Place::new(PLAN);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    let all = entries(&place, "whole").len();
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
    let (mut kills, mut partial, mut lit, mut slowest) = (0, 0, 0, Duration::ZERO);
    while partial < HITS {
        let (mut command, mark) = command();
        command.args(Place::on(place.capture("s"), &bench)).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        // Before the first entry there is no session yet; after the last one it is complete.
        until_entry(&place, "s", kills % (all + 1), &mut child);
        std::thread::sleep(LATER * (kills / (all + 1)) as u32);
        child.kill().unwrap();
        assert!(kills < 100 * HITS, "no kill hits a session");
        let (off, was_lit) = watch_light(&bench, &mut child, &mark);
        (kills, lit, slowest) = (kills + 1, lit + u32::from(was_lit), slowest.max(off));
        let journal = entries(&place, "s").join("\n");
        partial += usize::from(journal.contains("begun") && !journal.contains("finished"));
        complete(&place, "s", &bench, &whole);
    }
    println!(
        "{kills} kills, {partial} of them in a session in progress; light was on at {lit}, off after at most {:.0} ms",
        1000.0 * slowest.as_secs_f64()
    );
}

/// On a bench at real pace, killed while the flash is on.
#[test]
fn a_kill_under_the_flash_leaves_no_light() {
    const HITS: u32 = 5;
    let plan = "kind = \"free\"\nsteps = [{ flash = true, exposure_ms = 400 }]";
    let place = Place::new(plan);
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &["--real-time"]);
    let (mut tries, mut hits) = (0, 0);
    while hits < HITS {
        let (mut command, mark) = command();
        tries += 1;
        let session = format!("s{tries}");
        command.args(Place::on(place.capture(&session), &bench)).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        // A busy machine may miss the flash; the session has then ended, and another one is tried.
        while light(&bench) != [true, true] && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        hits += u32::from(child.try_wait().unwrap().is_none());
        assert!(tries < 100 * HITS, "the flash never comes on");
        child.kill().unwrap();
        let (off, _) = watch_light(&bench, &mut child, &mark);
        println!("light off {:.1} ms after the kill", 1000.0 * off.as_secs_f64());
    }
}
