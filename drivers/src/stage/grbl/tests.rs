//! Transcripts written from the protocol documentation.

use super::*;
use crate::SystemClock;
use crate::wire::replay::Replay;

const START: [(&str, &str); 2] = [
    ("?", "\r\nGrbl 1.1h ['$' for help]\r\n<Idle|MPos:0.000,0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000,0.000>\r\n"),
    ("$I\n", "[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"),
];
const IDLE_0: (&str, &str) = ("?", "<Idle|MPos:0.000,0.000,0.000,0.000|FS:0,0>\r\n");
const HOME: (&str, &str) = ("$H\n", "ok\r\n");
const GO: &str = "G21G90G94G53G1A90.0000F3600.0\n";

fn settings() -> Settings {
    let port = "/dev/replay".into();
    Settings { port, answer_ms: 20, start_ms: 60, move_ms: 300, home_ms: 300, settling_ms: 50, ..Settings::default() }
}

fn stage(settings: &Settings, steps: &[(&str, &str)]) -> Grbl {
    let steps: Vec<_> = START.iter().chain(steps).copied().collect();
    Grbl::on(Box::new(Replay::new(&steps)), settings, Arc::new(SystemClock)).unwrap()
}

fn homed(steps: &[(&str, &str)]) -> Grbl {
    let steps: Vec<_> = [HOME, IDLE_0].iter().chain(steps).copied().collect();
    let mut stage = stage(&settings(), &steps);
    assert_eq!(wait(stage.home()).unwrap().angle_deg, 0.0);
    stage
}

fn report(state: &str, a: f64) -> String {
    format!("<{state}|MPos:0.000,0.000,0.000,{a:.3}|FS:0,0>\r\n")
}

#[test]
fn it_says_who_it_is() {
    let info = stage(&settings(), &[]).describe();
    assert_eq!(info.id, "GRBL 1.1h.20190825 on /dev/replay");
    assert!(info.halts);
}

#[test]
fn other_controllers_are_refused() {
    let steps = [("?", "hello\r\n"), ("?", ""), ("?", ""), ("?", ""), ("?", ""), ("?", "")];
    let opened = Grbl::on(Box::new(Replay::new(&steps)), &settings(), Arc::new(SystemClock));
    let error = opened.err().unwrap();
    assert!(error.class == Class::Setup && error.remedy.contains("GRBL 1.1"), "{error}");
}

#[test]
fn ok_is_not_the_end() {
    let (run, there) = (report("Run", 45.0), report("Idle", 90.0));
    let mut stage = homed(&[IDLE_0, (GO, "ok\r\n"), IDLE_0, ("?", &run), ("?", &run), ("?", &there)]);
    assert_eq!(wait(stage.move_to(90.0)).unwrap().angle_deg, 90.0);
}

#[test]
fn rest_elsewhere_is_no_arrival() {
    let short = report("Idle", 45.0);
    let steps = [IDLE_0, (GO, "ok\r\n"), ("?", &short), ("?", &short), ("?", &short)];
    let error = wait(homed(&steps).move_to(90.0)).unwrap_err();
    assert!(error.class == Class::Retry && error.got.contains("45.00°"), "{error}");
}

#[test]
fn work_coordinates_are_those_of_the_machine_with_their_start() {
    let settings = Settings { homes: false, ..settings() };
    let (work, start) =
        ("<Idle|WPos:0.000,0.000,0.000,7.000>\r\n", "<Idle|WPos:0.000,0.000,0.000,7.000|WCO:0,0,0,3>\r\n");
    let mut stage = stage(&settings, &[("?", work), ("?", start)]);
    stage.offset = None;
    assert_eq!(wait(stage.position()).unwrap(), 10.0);
}

#[test]
fn alarms_errors_and_states_are_named() {
    for (answer, class, word) in [
        ("ALARM:1\r\n", Class::Stop, "limit switch"),
        ("ALARM:2\r\n", Class::Stop, "beyond its travel"),
        ("error:9\r\n", Class::Stop, "locked"),
        ("error:22\r\n", Class::Setup, "feed rate"),
        ("error:2\r\n", Class::Retry, "format"),
        ("\r\nGrbl 1.1h ['$' for help]\r\n", Class::Stop, "started anew"),
        ("", Class::Retry, "nothing"),
        ("\u{7f}?\r\n", Class::Retry, "“"),
    ] {
        let error = wait(homed(&[IDLE_0, (GO, answer)]).move_to(90.0)).unwrap_err();
        assert!(error.class == class && error.got.contains(word), "{error}");
    }
    for (state, class) in
        [("Check", Class::Setup), ("Alarm", Class::Stop), ("Door:0", Class::Stop), ("Hold:0", Class::Stop)]
    {
        let answer = report(state, 0.0);
        let error = wait(homed(&[("?", &answer)]).move_to(90.0)).unwrap_err();
        assert_eq!(error.class, class, "{error}");
    }
}

#[test]
fn soft_limits_are_remedied_by_the_settings_of_the_axis() {
    let error = wait(homed(&[IDLE_0, (GO, "ALARM:2\r\n")]).move_to(90.0)).unwrap_err();
    assert!(["limits_deg", "$133", "$20=0"].iter().all(|word| error.remedy.contains(word)), "{error}");
}

#[test]
fn a_restart_between_two_calls_is_noticed() {
    let mut stage = homed(&[("?", "\r\nGrbl 1.1h ['$' for help]\r\n<Idle|MPos:0.000,0.000,0.000,0.000>\r\n")]);
    let error = wait(stage.move_to(90.0)).unwrap_err();
    assert!(error.class == Class::Stop && error.remedy.contains("home it"), "{error}");
}

#[test]
fn without_homing_a_restart_ends_the_session() {
    let settings = Settings { homes: false, ..settings() };
    let mut stage = stage(&settings, &[IDLE_0, (GO, "Grbl 1.1h ['$' for help]\r\n")]);
    assert!(wait(stage.move_to(90.0)).unwrap_err().remedy.contains("turn the analyser to 0°"));
    assert!(wait(stage.move_to(90.0)).unwrap_err().got.contains("reset"));
    // The transcript is over, which is a lost link. An axis without homing must not reconnect.
    assert_eq!(wait(stage.halt()).unwrap_err().class, Class::Stop);
}

#[test]
fn halting_holds_and_then_resets() {
    let (slowing, held, idle) = (report("Hold:1", 40.0), report("Hold:0", 41.0), report("Idle", 41.0));
    let restart = "\r\nGrbl 1.1h ['$' for help]\r\n";
    let mut stage = homed(&[("!", ""), ("?", &slowing), ("?", &held), ("\u{18}", restart), ("?", &idle), ("?", &idle)]);
    wait(stage.halt()).unwrap();
    assert_eq!(wait(stage.position()).unwrap(), 41.0);
}

#[test]
fn a_run_for_ever_is_an_error() {
    let run = report("Run", 1.0);
    let steps: Vec<_> = [IDLE_0, (GO, "ok\r\n")].into_iter().chain([("?", run.as_str()); 20]).collect();
    let error = wait(homed(&steps).move_to(90.0)).unwrap_err();
    assert!(error.class == Class::Stop && error.got.contains("Run"), "{error}");
}
