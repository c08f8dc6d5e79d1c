//! Transcripts of fictitious stages.

use super::*;
use crate::SystemClock;
use crate::wire::replay::Replay;

fn exchange(send: &str, reply: &str) -> Exchange {
    Exchange { send: send.into(), reply: reply.into() }
}

fn settings() -> Settings {
    Settings {
        port: "/dev/replay".into(),
        name: "belt stage".into(),
        baud: 9600,
        terminator: "\r\n".into(),
        home: None,
        go: exchange("MOVE {angle:.1}", "OK"),
        position: exchange("POS?", "POS {angle}"),
        poll: None,
        halt: None,
        errors: vec!["ERR{any}".into()],
        units_per_deg: 1.0,
        motion: Motion { answer_ms: 20, move_ms: 300, settling_ms: 50, ..Motion::default() },
    }
}

fn open(settings: &Settings, steps: &[(&str, &str)]) -> DeviceResult<LineStage> {
    LineStage::on(Box::new(Replay::new(steps)), settings, Arc::new(SystemClock))
}

const AT_0: (&str, &str) = ("POS?\r\n", "POS 0.0\r\n");
const AT_45: (&str, &str) = ("POS?\r\n", "POS 45.0\r\n");
/// Queries at opening, and until the stage certainly stands.
const RESTS: [(&str, &str); 6] = [AT_0; 6];
const GO: &str = "MOVE 45.0\r\n";

#[test]
fn a_move_ends_where_the_position_says() {
    let steps: Vec<_> = RESTS.into_iter().chain([(GO, "OK\r\n"), AT_0, AT_45, AT_45, AT_45]).collect();
    let mut stage = open(&settings(), &steps).unwrap();
    assert_eq!(stage.describe().id, "belt stage on /dev/replay");
    assert_eq!(wait(stage.move_to(45.0)).unwrap().angle_deg, 45.0);
    assert_eq!(wait(stage.position()).unwrap(), 45.0);
}

#[test]
fn units_polls_and_homing_are_as_configured() {
    let settings = Settings {
        home: Some(exchange("H", "OK")),
        go: exchange("A{units:.0}", "OK"),
        position: exchange("P", "{units}"),
        poll: Some(exchange("S", "READY")),
        halt: Some(exchange("X", "OK")),
        terminator: "\r".into(),
        units_per_deg: 100.0,
        ..settings()
    };
    let (at_0, at_9, ready) = (("P\r", "0\r"), ("P\r", "900\r"), ("S\r", "READY\r"));
    let moved = [("A900\r", "OK\r"), ("S\r", "BUSY\r"), ready, at_9, at_9, ("X\r", "OK\r"), ready, at_9, at_9];
    let steps: Vec<_> = [at_0, ("H\r", "OK\r"), ready, at_0, at_0].into_iter().chain(moved).collect();
    let mut stage = open(&settings, &steps).unwrap();
    assert_eq!(wait(stage.move_to(9.0)).unwrap().angle_deg, 9.0);
    assert!(stage.describe().halts);
    wait(stage.halt()).unwrap();
}

#[test]
fn errors_are_no_arrival() {
    for (answer, class, word) in
        [("ERR 5\r\n", Class::Stop, "ERR 5"), ("", Class::Retry, "nothing"), ("?\r\n", Class::Retry, "“?”")]
    {
        let steps: Vec<_> = RESTS.into_iter().chain([(GO, answer)]).collect();
        let mut stage = open(&settings(), &steps).unwrap();
        let error = wait(stage.move_to(45.0)).unwrap_err();
        assert!(error.class == class && error.got.contains(word), "{error}");
    }
    let steps: Vec<_> = RESTS.into_iter().chain([(GO, "OK\r\n")]).chain([AT_0; 6]).collect();
    let steps: Vec<_> = steps.into_iter().chain([AT_0; 6]).collect();
    let mut stage = open(&settings(), &steps).unwrap();
    let error = wait(stage.move_to(45.0)).unwrap_err();
    assert!(error.class == Class::Retry && error.got.contains("rest at 0.00°"), "{error}");
    // The stage may have restarted during the movement, so a later reading of 0 is not trusted.
    let error = wait(stage.home()).unwrap_err();
    assert!(error.class == Class::Stop && error.expected.contains("45.00°"), "{error}");
}

#[test]
fn a_stage_that_was_moved_by_others_is_noticed() {
    let steps: Vec<_> = RESTS.into_iter().chain([AT_45, AT_0]).collect();
    let mut stage = open(&settings(), &steps).unwrap();
    wait(stage.home()).unwrap();
    assert!(wait(stage.move_to(10.0)).unwrap_err().got.contains("45.00°"));
    assert!(wait(stage.position()).unwrap_err().remedy.contains("zero"));
    // The transcript is over: a lost link, after which the zero is unknown.
    assert_eq!(wait(stage.halt()).unwrap_err().class, Class::Stop);
}

#[test]
fn errors_of_the_configuration_name_the_key() {
    let wrong = [
        (Settings { port: "".into(), ..settings() }, "port"),
        (Settings { go: exchange("MOVE", "OK"), ..settings() }, "move.send"),
        (Settings { position: exchange("POS?", "OK"), ..settings() }, "position.reply"),
        (Settings { home: Some(exchange("H", "{x}")), ..settings() }, "home.reply"),
        (Settings { poll: Some(exchange("S{angle}", "R")), ..settings() }, "poll.send"),
        (Settings { errors: vec!["".into()], ..settings() }, "errors"),
        (Settings { terminator: "".into(), ..settings() }, "terminator"),
        (Settings { units_per_deg: 0.0, ..settings() }, "units_per_deg"),
        (Settings { motion: Motion { tolerance_deg: f64::NAN, ..Motion::default() }, ..settings() }, "tolerance_deg"),
    ];
    for (settings, key) in wrong {
        let error = LineStage::open(&settings, Arc::new(SystemClock)).err().unwrap();
        assert!(error.class == Class::Setup && error.got.contains(key), "{key}: {error}");
    }
}
