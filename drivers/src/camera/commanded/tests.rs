//! The driver on a scripted camera.

use super::*;
use crate::SystemClock;
use crate::wire::wait;
use proptest::prelude::*;
use std::collections::VecDeque;
use std::sync::Mutex;

/// A camera whose pictures and delays are scripted; it records commands.
#[derive(Clone, Default)]
struct Fake(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    log: Vec<String>,
    /// Whether the next pictures are there at once, and the exposure that they state.
    pictures: VecDeque<(bool, Option<f64>)>,
    began: Duration,
    exposure_s: f64,
    gain: f64,
}

struct Scripted(Fake, Facts);

impl Exposer for Scripted {
    fn facts(&self) -> &Facts {
        &self.1
    }

    fn set_gain(&mut self, value: f64) -> DeviceResult<f64> {
        let mut state = self.0.0.lock().unwrap();
        state.gain = value;
        state.log.push(format!("gain {value}"));
        Ok(value)
    }

    fn start(&mut self, exposure_s: f64, dark: bool) -> DeviceResult<()> {
        let mut state = self.0.0.lock().unwrap();
        (state.began, state.exposure_s) = (SystemClock.now(), exposure_s);
        state.log.push(format!("start {exposure_s} {dark}"));
        Ok(())
    }

    fn is_ready(&mut self, limit: Duration) -> DeviceResult<bool> {
        std::thread::sleep(limit.min(Duration::from_millis(1)));
        let state = self.0.0.lock().unwrap();
        let there = state.pictures.front().is_some_and(|(at_once, _)| *at_once);
        let never = state.pictures.is_empty();
        Ok(!never && (there || SystemClock.now() >= state.began + Duration::from_secs_f64(state.exposure_s)))
    }

    fn fetch(&mut self) -> DeviceResult<Picture> {
        let (_, exposure_s) = self.0.0.lock().unwrap().pictures.pop_front().unwrap();
        Ok(Picture { width: 2, height: 1, codes: vec![1, 2], exposure_s })
    }

    fn abort(&mut self) -> DeviceResult<()> {
        self.0.0.lock().unwrap().log.push("abort".into());
        Ok(())
    }
}

/// A clock that does not wait, so that pictures which are there at once arrive early.
struct Hasty;

impl Clock for Hasty {
    fn now(&self) -> Duration {
        SystemClock.now()
    }

    fn wait(&self, _: Duration) {}
}

fn camera(pictures: &[(bool, Option<f64>)], shutter: bool) -> (CommandedCamera<Scripted>, Fake) {
    let fake = Fake::default();
    fake.0.lock().unwrap().pictures.extend(pictures);
    let facts = Facts {
        id: "fake".into(),
        width: 2,
        height: 1,
        exposure_s: [0.001, 10.0],
        exposure_step_s: 0.001,
        gains: Some([10.0, 210.0]),
        gain_unit: GainUnit::TenthDecibel,
        black: 0,
        white: 255,
        shutter,
        steady_exposures_s: vec![],
        download: Duration::from_millis(50),
        warnings: vec![],
    };
    (CommandedCamera::new(Scripted(fake.clone(), facts), Arc::new(Hasty)), fake)
}

fn fresh() -> Freshness {
    Freshness { steady_since: SystemClock.now(), first_sequence: 0, duration: Duration::from_millis(50) }
}

fn set(camera: &mut CommandedCamera<Scripted>) -> Controls {
    wait(camera.configure(Duration::from_millis(50), 10.0)).unwrap()
}

#[test]
fn pictures_of_earlier_commands_are_passed_over() {
    let (mut camera, fake) = camera(&[(true, None), (false, Some(0.05))], false);
    let controls = set(&mut camera);
    assert!((controls.gain - 10.0).abs() < 1e-9 && controls.exposure == Duration::from_millis(50));
    let fresh = fresh();
    let frame = wait(camera.next_frame(fresh)).unwrap();
    assert!(fresh.accepts(frame.stamp) && frame.codes == [1, 2]);
    drop(camera);
    let log = fake.0.lock().unwrap().log.clone();
    assert_eq!(log, ["gain 210", "abort", "start 0.05 false", "abort", "start 0.05 false"]);
}

#[test]
fn early_late_and_foreign_pictures_are_errors() {
    let error = |pictures: &[(bool, Option<f64>)]| {
        let (mut camera, fake) = camera(pictures, false);
        set(&mut camera);
        let error = wait(camera.next_frame(fresh())).unwrap_err();
        assert_eq!(error.class, Class::Retry);
        drop(camera);
        (error.got.to_string(), fake.0.lock().unwrap().log.last().cloned())
    };
    assert!(error(&[(true, None); 3]).0.contains("earlier"));
    assert!(error(&[(false, Some(0.07))]).0.contains("0.07 s"));
    let (none, last) = error(&[]);
    // The exposure that has no picture is ended.
    assert!(none.contains("none within") && last.as_deref() == Some("abort"), "{none}");
}

#[test]
fn dark_frames_need_a_shutter() {
    let (mut without, _) = camera(&[], false);
    assert_eq!(wait(without.cover(true)).unwrap_err().class, Class::Setup);
    let (mut with, fake) = camera(&[(false, None)], true);
    set(&mut with);
    wait(with.cover(true)).unwrap();
    wait(with.next_frame(fresh())).unwrap();
    assert_eq!(fake.0.lock().unwrap().log.last().unwrap(), "start 0.05 true");
}

#[test]
fn a_change_of_controls_costs_no_picture() {
    let (mut camera, fake) = camera(&[], false);
    let controls = set(&mut camera);
    let stamp = wait(camera.next_frame(Freshness::NEVER)).unwrap().stamp;
    assert_eq!(Freshness::first_with_controls(stamp, controls.set_at, 0), Some(stamp.sequence + 1));
    assert!(!fake.0.lock().unwrap().log.iter().any(|line| line.starts_with("start")));
}

proptest! {
    #[test]
    fn gains_come_back(linear in 1.0..100.0_f64, low in 0.5..100.0_f64) {
        for unit in [GainUnit::Decibel, GainUnit::TenthDecibel, GainUnit::Factor] {
            prop_assert!((unit.linear(unit.value(linear, low), low) / linear - 1.0).abs() < 1e-9);
        }
        prop_assert_eq!(GainUnit::Lowest.linear(GainUnit::Lowest.value(linear, low), low), 1.0);
    }
}
