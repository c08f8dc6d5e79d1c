//! Interlocks of the configuration, read through their driver from an emulated HID device.

#![allow(clippy::unwrap_used)]

use nacre_tests::{BENCH, BenchProcess, NEVER, PLAN, Place, assert_gone, command, light, nacre};
use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// Writes a configuration with an emulated lamp and door contact, and starts their bench.
fn bench(place: &Place, section: &str) -> BenchProcess {
    let devices = [format!("relay={}", place.text("lamp")), format!("interlock={}", place.text("door"))];
    let args = ["--device", &devices[0], "--device", &devices[1]];
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &args);
    write(place, section, &place.text("door"));
    bench
}

fn write(place: &Place, section: &str, door: &str) {
    let (lamp, socket) = (place.text("lamp"), place.text("socket"));
    let config = format!(
        "{}\n[bench.flash]\ndriver = {{ kind = \"relay\", path = \"unix:{lamp}\" }}\nmax_on_s = 120\n\
         [[bench.interlocks]]\nname = \"door\"\ndriver = {{ kind = \"hid\", path = \"unix:{door}\" }}\n",
        section.replace("SOCKET", &socket)
    );
    fs::write(place.path("nacre.toml"), config).unwrap();
}

fn until_lit(bench: &BenchProcess, flash: &mut Child) {
    let begun = Instant::now();
    while light(bench) != [false, true] {
        assert!(begun.elapsed() < NEVER && flash.try_wait().unwrap().is_none(), "the flash is not on");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Switches the flash on, lets `open` open the door, and returns the error of the command, whose light is off.
fn opened_while_lit(place: &Place, bench: &BenchProcess, open: impl FnOnce()) -> String {
    let (mut command, mark) = command();
    command.args(["flash", "on", "--config", &place.text("nacre.toml")]).stderr(Stdio::piped()).stdout(Stdio::null());
    let mut flash = command.spawn().unwrap();
    until_lit(bench, &mut flash);
    open();
    let ended = flash.wait_with_output().unwrap();
    let told = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(1), "{told}");
    assert_eq!(light(bench), [false, false], "{told}");
    assert_gone(&mark);
    told
}

#[test]
fn light_goes_off_when_the_door_opens_and_nothing_starts_while_it_is_open() {
    // Opens after about two seconds of readings.
    let faults = "faults = [{ device = \"interlock\", kind = \"opens\", after = 200 }]\n";
    let place = Place::with_bench("", &format!("{BENCH}{faults}"));
    let bench = bench(&place, "");
    let config = place.text("nacre.toml");
    let listed = nacre(["--json", "devices", "--config", &config]).expect(0).json();
    assert!(listed[4]["kind"] == "interlock" && listed[4]["limits"] == "closed", "{listed}");
    let told = opened_while_lit(&place, &bench, || {});
    assert!(told.contains("door (bit 0 of unix:") && told.contains("open interlock"), "{told}");
    let told = nacre(["flash", "test", "--config", &config]).expect(1).stderr();
    assert!(told.contains("open interlock") && told.contains("close it"), "{told}");
    let text = nacre(["devices", "--config", &config]).expect(0).stdout();
    assert!(text.contains("interlock door") && text.contains("open: nothing moves"), "{text}");
}

#[test]
fn an_interlock_that_is_unplugged_counts_as_open() {
    let place = Place::with_bench("", BENCH);
    let bench = bench(&place, "");
    let attach = || {
        let (mut command, mark) = command();
        let (socket, device) = (place.text("socket"), format!("interlock={}", place.text("unplugged")));
        command.args(["sim", "attach", "--socket", &socket, "--device", &device]).stderr(Stdio::null());
        let child = command.spawn().unwrap();
        let begun = Instant::now();
        while !place.path("unplugged").exists() {
            assert!(begun.elapsed() < NEVER);
            std::thread::sleep(Duration::from_millis(2));
        }
        (child, mark)
    };
    write(&place, "", &place.text("unplugged"));
    let (mut plugged, mark) = attach();
    let told = opened_while_lit(&place, &bench, || {
        plugged.kill().unwrap();
        plugged.wait().unwrap();
    });
    assert_gone(&mark);
    assert!(told.contains("door (bit 0 of unix:") && told.contains("check its cable and plug"), "{told}");
    let refused = nacre(["flash", "test", "--config", &place.text("nacre.toml")]).expect(1).stderr();
    assert!(refused.contains("door (bit 0 of unix:"), "{refused}");
    fs::remove_file(place.path("unplugged")).unwrap();
    let (mut plugged, _) = attach();
    nacre(["flash", "test", "--config", &place.text("nacre.toml")]).expect(0);
    plugged.kill().unwrap();
    plugged.wait().unwrap();
    assert_eq!(light(&bench), [false, false]);
}

#[test]
fn a_session_needs_its_interlocks() {
    const SIMULATED: &str = "[bench]\nsim = true\nsocket = \"SOCKET\"";
    let place = Place::with_bench(PLAN, BENCH);
    let capture = |session: &str| {
        let (plan, out, config) = (place.text("plan.toml"), place.text(session), place.text("nacre.toml"));
        nacre(["capture", &plan, "--out", &out, "--config", &config])
    };
    {
        let bench = bench(&place, SIMULATED);
        write(&place, SIMULATED, "/no/such/door");
        let told = capture("refused").expect(1).stderr();
        assert!(told.contains("door (bit 0 of unix:/no/such/door)"), "{told}");
        assert_eq!(light(&bench), [false, false]);
    }
    let bench = bench(&place, SIMULATED);
    capture("s").expect(0);
    nacre(["check", &place.text("s")]).expect(0);
    assert_eq!(light(&bench), [false, false]);
}
