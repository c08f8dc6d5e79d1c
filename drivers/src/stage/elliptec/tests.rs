//! Transcripts written from the protocol manual.

use super::*;
use crate::SystemClock;
use crate::wire::replay::Replay;

const IDENTITY: (&str, &str) = ("2in", "2IN0E1140051720231701016800023000\r\n");
const IDLE: (&str, &str) = ("2gs", "2GS00\r\n");
const AT_ZERO: (&str, &str) = ("2gp", "2PO00000000\r\n");
const HOMED: [(&str, &str); 3] = [("2ho0", "2GS09\r\n2PO00000000\r\n"), IDLE, AT_ZERO];

fn settings() -> Settings {
    let address = protocol::Address::try_from('2').unwrap();
    Settings { address, answer_ms: 20, move_ms: 400, settling_ms: 50, port: "replay".into(), ..Settings::default() }
}

fn open(steps: &[(&str, &str)]) -> DeviceResult<Elliptec> {
    Elliptec::on(Box::new(Replay::new(steps)), &settings(), Arc::new(SystemClock))
}

/// Opens and homes the stage, then follows the transcript.
fn homed(steps: &[(&str, &str)]) -> Elliptec {
    let steps: Vec<(&str, &str)> = [IDLE, IDENTITY].iter().chain(&HOMED).chain(steps).copied().collect();
    let mut stage = open(&steps).unwrap();
    assert_eq!(wait(stage.home()).unwrap().angle_deg, 0.0);
    stage
}

#[test]
fn it_says_who_it_is() {
    let stage = open(&[IDLE, IDENTITY]).unwrap();
    let info = stage.describe();
    assert_eq!(info.id, "Elliptec ELL14 s/n 11400517 address 2");
    assert!(!info.halts);
    assert_eq!((stage.identity().travel, stage.identity().pulses), (360, 143_360));
}

#[test]
fn an_old_error_is_cleared_once_it_was_reported() {
    open(&[("2gs", "2GS02\r\n"), IDLE, IDENTITY]).unwrap();
    assert!(open(&[("2gs", "2GS02\r\n"), ("2gs", "2GS02\r\n")]).err().unwrap().got.contains("mechanical"));
}

#[test]
fn a_linear_stage_is_refused_by_name() {
    let error = open(&[IDLE, ("2in", "2IN141140051720231701003C00000400\r\n")]).err().unwrap();
    assert!(error.class == Class::Setup && error.got.contains("ELL20, a linear stage"), "{error}");
}

#[test]
fn a_silent_address_is_answered_by_the_modules_on_the_bus() {
    let silent = [("2gs", ""); 4];
    let scan: Vec<(String, &str)> = "013456789ABCDEF"
        .chars()
        .map(|digit| {
            let answer = match digit {
                '0' => "0IN0E1140051720231701016800023000\r\n",
                'A' => "AIN091140051820231701001F00000400\r\n",
                _ => "",
            };
            (format!("{digit}in"), answer)
        })
        .collect();
    let steps: Vec<(&str, &str)> =
        silent.into_iter().chain(scan.iter().map(|(sent, answer)| (sent.as_str(), *answer))).collect();
    let error = open(&steps).err().unwrap();
    assert!(error.class == Class::Setup && error.got.contains("nothing within"), "{error}");
    let remedy =
        "this bus has ELL14 s/n 11400517 at address 0; ELL9 (a slider of four positions) s/n 11400518 at address A";
    assert!(error.remedy.contains(remedy), "{error}");
}

#[test]
fn a_move_is_over_when_it_says_so_and_not_sooner() {
    let mut stage = homed(&[
        AT_ZERO,
        // Two late answers, messages of other modules on the bus, then the end.
        ("2ma00008C00", "2PO00000000\r\n5PO00001234\r\n"),
        ("2gs", "2GS09\r\n"),
        ("2gs", "2GS09\r\n"),
        ("2gs", "2GS09\r\n2PO00008BFF\r\n"),
        IDLE,
        ("2gp", "2PO00008BFF\r\n"),
    ]);
    let before = SystemClock.now();
    let arrived = wait(stage.move_to(90.0)).unwrap();
    assert!((arrived.angle_deg - 90.0).abs() < 0.01);
    assert!(arrived.since >= before + Duration::from_millis(50));
}

#[test]
fn an_unhomed_stage_homes_before_it_moves() {
    let at = "2PO00008C00\r\n";
    let moved = [AT_ZERO, ("2ma00008C00", at), IDLE, ("2gp", at)];
    let steps: Vec<_> = [IDLE, IDENTITY].iter().chain(&HOMED).chain(&moved[1..]).copied().collect();
    assert_eq!(wait(open(&steps).unwrap().move_to(90.0)).unwrap().angle_deg, 90.0);
}

#[test]
fn errors_are_never_arrivals() {
    for code in [1_u8, 2, 3, 4, 5, 6, 7, 8, 10, 11, 12, 13, 14, 255] {
        let status = format!("2GS{code:02X}\r\n");
        let mut stage = homed(&[AT_ZERO, ("2ma00008C00", &status)]);
        let error = wait(stage.move_to(90.0)).unwrap_err();
        assert!(error.got.contains(Status::of(code).name()), "{error}");
        assert_eq!(error.class == Class::Retry, code == 1 || code == 3, "{error}");
    }
}

#[test]
fn a_status_of_error_after_the_end_counts() {
    let mut stage = homed(&[AT_ZERO, ("2ma00008C00", "2PO00008C00\r\n"), ("2gs", "2GS0A\r\n")]);
    assert!(wait(stage.move_to(90.0)).unwrap_err().got.contains("sensor error"));
}

#[test]
fn a_reset_is_found_before_the_next_move() {
    let at = "2PO00008C00\r\n";
    let mut stage = homed(&[AT_ZERO, ("2ma00008C00", at), IDLE, ("2gp", at), AT_ZERO, AT_ZERO]);
    wait(stage.move_to(90.0)).unwrap();
    let error = wait(stage.move_to(10.0)).unwrap_err();
    assert!(error.class == Class::Stop && error.remedy.contains("home it"), "{error}");
    let error = wait(stage.position()).unwrap_err();
    assert!(error.remedy.contains("home it"), "{error}");
}

#[test]
fn a_lost_end_is_no_arrival_and_the_next_move_homes() {
    let mut steps = vec![AT_ZERO, ("2ma00008C00", "2PO0000")];
    // Bytes after half a line belong to that line. The module then reports idle, without a position.
    steps.extend([IDLE; 4]);
    steps.extend(HOMED);
    steps.extend([("2ma00001000", "2PO00001000\r\n"), IDLE, ("2gp", "2PO00001000\r\n")]);
    let mut stage = homed(&steps);
    let error = wait(stage.move_to(90.0)).unwrap_err();
    assert_eq!(error.class, Class::Retry, "{error}");
    assert!((wait(stage.move_to(degrees(0x1000, 143_360))).unwrap().angle_deg - 10.2857).abs() < 1e-3);
}

#[test]
fn questions_are_asked_again_once() {
    let mut stage = homed(&[("2gp", ""), ("2gp", "2PO00000001\r\n")]);
    assert!(wait(stage.position()).unwrap() > 0.0);
    let mut stage = homed(&[("2gp", "?!\r\n"), ("2gp", "")]);
    let error = wait(stage.position()).unwrap_err();
    assert!(error.class == Class::Retry && error.got.contains("within 20 ms"), "{error}");
}

#[test]
fn endless_busy_states_are_an_error() {
    let mut steps = vec![AT_ZERO, ("2ma00008C00", "")];
    steps.extend([("2gs", "2GS09\r\n"); 20]);
    let error = wait(homed(&steps).move_to(90.0)).unwrap_err();
    assert!(error.class == Class::Stop && error.got.contains("busy"), "{error}");
}

#[test]
fn nothing_is_sent_for_angles_out_of_limits() {
    for angle in [-1.0, 361.0, f64::NAN, f64::INFINITY] {
        let error = wait(homed(&[]).move_to(angle)).unwrap_err();
        assert_eq!(error.class, Class::Setup, "{error}");
    }
}

#[test]
fn halting_waits_and_stops_only_cleaning() {
    wait(homed(&[("2gs", "2GS09\r\n"), IDLE]).halt()).unwrap();
    let mut stage = homed(&[("2cm", ""), ("2gs", "2GS09\r\n"), ("2st", "2GS00\r\n"), IDLE]);
    let mut cleaning = Box::pin(stage.clean());
    assert!(cleaning.as_mut().poll_once().is_none());
    drop(cleaning);
    wait(stage.halt()).unwrap();
}

#[test]
fn frequencies_are_searched_for_both_motors() {
    let busy = ("2gs", "2GS09\r\n");
    wait(homed(&[("2s1", ""), busy, IDLE, ("2s2", ""), busy, IDLE]).search_frequency()).unwrap();
}

/// Polls a future once; the call is then dropped.
trait PollOnce {
    fn poll_once(&mut self) -> Option<()>;
}

impl<F: Future<Output = DeviceResult<()>> + ?Sized> PollOnce for std::pin::Pin<&mut F> {
    fn poll_once(&mut self) -> Option<()> {
        let mut context = std::task::Context::from_waker(std::task::Waker::noop());
        self.as_mut().poll(&mut context).is_ready().then_some(())
    }
}
