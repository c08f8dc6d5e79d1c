//! Killed at any step and at any instant, a session goes on to the same bytes, and its light is off.

#![allow(clippy::unwrap_used)]

use nacre_tests::{BenchProcess, Place, assert_gone, command, data, light, nacre};
use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// Every kind of light, a burst, and a change of exposure.
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

/// A killed capture: how long until all light was off, and whether any was on at first.
fn watch_light(bench: &BenchProcess, child: &mut Child, mark: &str) -> (Duration, bool) {
    let begun = Instant::now();
    let lit = light(bench) != [false, false];
    while light(bench) != [false, false] {
        assert!(begun.elapsed() < Duration::from_secs(1), "light is still on a second after the kill");
        std::thread::sleep(Duration::from_millis(1));
    }
    let off = begun.elapsed();
    child.wait().unwrap();
    assert_gone(mark);
    (off, lit)
}

/// Goes on with a killed session, or begins it if it was killed before there was one; the data is then as `whole`.
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

/// Waits for the session's journal, if that is wanted.
fn until_begun(place: &Place, name: &str, wanted: bool) {
    let begun = Instant::now();
    while wanted && !place.path(name).join("journal").exists() && begun.elapsed() < Duration::from_secs(5) {
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Instants spread over the run, with the bench in a process of its own.
#[test]
fn a_kill_at_any_instant_is_made_good() {
    const KILLS: u32 = 200;
    let place = Place::new(PLAN);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
    // From the start of the process, and from the start of the session, to the end.
    let lengths = [false, true].map(|session| {
        let name = format!("timed{session}");
        let (mut command, _) = command();
        let mut child = command.args(Place::on(place.capture(&name), &bench)).stdout(Stdio::null()).spawn().unwrap();
        let begun = Instant::now();
        until_begun(&place, &name, session);
        let waited = begun.elapsed();
        child.wait().unwrap();
        begun.elapsed() - waited
    });
    let (mut partial, mut lit, mut slowest) = (0, 0, Duration::ZERO);
    for k in 0..KILLS {
        let (mut command, mark) = command();
        command.args(Place::on(place.capture("s"), &bench)).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let session = k % 2 == 1;
        until_begun(&place, "s", session);
        std::thread::sleep(lengths[usize::from(session)] * k / KILLS);
        child.kill().unwrap();
        let (off, was_lit) = watch_light(&bench, &mut child, &mark);
        (lit, slowest) = (lit + u32::from(was_lit), slowest.max(off));
        let journal = fs::read_to_string(place.path("s/journal")).unwrap_or_default();
        partial += u32::from(journal.contains("begun") && !journal.contains("finished"));
        complete(&place, "s", &bench, &whole);
    }
    println!(
        "{KILLS} kills, {partial} of them in a session in progress; light was on at {lit}, off after at most {:.0} ms",
        1000.0 * slowest.as_secs_f64()
    );
    assert!(partial >= KILLS / 5, "only {partial} kills hit a session in progress");
}

/// On a bench that takes its time, killed while the flash is on.
#[test]
fn a_kill_under_the_flash_leaves_no_light() {
    let plan = "kind = \"free\"\nsteps = [{ flash = true, exposure_ms = 400 }]";
    let place = Place::new(plan);
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &["--real-time"]);
    for k in 0..5 {
        let (mut command, mark) = command();
        command.args(Place::on(place.capture(&format!("s{k}")), &bench)).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let begun = Instant::now();
        while light(&bench) != [true, true] {
            assert!(begun.elapsed() < Duration::from_secs(10), "the flash never came on");
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        let (off, _) = watch_light(&bench, &mut child, &mark);
        println!("light off {:.1} ms after the kill", 1000.0 * off.as_secs_f64());
    }
}
