//! A fake camera for tests: it clamps values, is late, loses, damages and reorders frames, hangs, and disconnects.

use super::node::{Buffer, Format, Node, Range};
use crate::Clock;
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

pub const ENODEV: i32 = 19;
pub const SIZE: [u32; 2] = [8, 4];
/// Code of black, and code increase at an exposure of 10 ms.
pub const BLACK: f64 = 16.0;
pub const LIGHT: f64 = 50.0;

/// Simulated time that advances only while someone waits.
#[derive(Clone, Default)]
pub struct FakeClock(Arc<Mutex<Duration>>);

impl Clock for FakeClock {
    fn now(&self) -> Duration {
        *self.0.lock().unwrap()
    }

    fn wait(&self, duration: Duration) {
        *self.0.lock().unwrap() += duration;
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The kernel had no free buffer.
    Drop,
    /// The frame is flagged as damaged.
    Damage,
    /// Only half of the frame arrives.
    Truncate,
    /// The previous frame is repeated.
    Again,
    /// No frame for this long.
    Silence(Duration),
    /// Timestamps of another clock.
    WallClock,
    Fail(i32),
}

pub struct State {
    pub controls: BTreeMap<u32, (Range, i64)>,
    /// Controls that are clamped to this value.
    pub clamps: BTreeMap<u32, i64>,
    /// Controls in the order in which they were set.
    pub set: Vec<(u32, i64)>,
    pub faults: VecDeque<Fault>,
    pub formats: Vec<[u8; 4]>,
    pub interval_s: Option<f64>,
    pub start_of_exposure: bool,
    pub lag: usize,
    pub gamma: f64,
    pub starts: u32,
    pub resets: u32,
    /// The last exposures set, the newest last, one per frame.
    exposures: VecDeque<i64>,
    sequence: u32,
    streaming: bool,
    frame: Vec<u8>,
    ended: Duration,
}

#[derive(Clone)]
pub struct FakeNode {
    pub state: Arc<Mutex<State>>,
    pub clock: FakeClock,
}

impl FakeNode {
    pub fn new() -> Self {
        let range = |low, high| Range { low, high, step: 1, fixed: false };
        let controls = [
            (0x009a_0901, (range(0, 3), 3)),
            (super::controls::EXPOSURE, (range(3, 2047), 100)),
            (super::controls::GAIN, (range(0, 255), 64)),
            (0x0098_0912, (range(0, 1), 1)),
            (0x0098_0910, (range(72, 500), 220)),
        ];
        let clock = FakeClock::default();
        clock.wait(Duration::from_secs(100));
        let state = State {
            controls: controls.into(),
            clamps: BTreeMap::new(),
            set: Vec::new(),
            faults: VecDeque::new(),
            formats: vec![*b"MJPG", *b"GREY", *b"YUYV"],
            interval_s: Some(0.1),
            start_of_exposure: false,
            lag: 0,
            gamma: 1.0,
            starts: 0,
            resets: 0,
            exposures: VecDeque::new(),
            sequence: 0,
            streaming: false,
            frame: Vec::new(),
            ended: Duration::ZERO,
        };
        Self { state: Arc::new(Mutex::new(state)), clock }
    }

    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    /// Value of a control.
    pub fn value(&self, id: u32) -> i64 {
        self.state().controls[&id].1
    }
}

impl State {
    fn level(&mut self) -> u8 {
        let now = self.controls[&super::controls::EXPOSURE].1;
        self.exposures.push_back(now);
        while self.exposures.len() > self.lag + 1 {
            self.exposures.pop_front();
        }
        let light = LIGHT * self.exposures[0] as f64 / 100.0;
        (BLACK + 239.0 * (light / 239.0).powf(self.gamma)).round().min(255.0) as u8
    }
}

fn gone() -> io::Error {
    io::Error::from_raw_os_error(ENODEV)
}

impl Node for FakeNode {
    fn range(&mut self, id: u32) -> io::Result<Option<Range>> {
        Ok(self.state().controls.get(&id).map(|c| c.0))
    }

    fn set(&mut self, id: u32, value: i64) -> io::Result<()> {
        let mut state = self.state();
        let value = state.clamps.get(&id).map_or(value, |most| value.min(*most));
        state.set.push((id, value));
        state.controls.get_mut(&id).ok_or_else(gone)?.1 = value;
        Ok(())
    }

    fn get(&mut self, id: u32) -> io::Result<i64> {
        self.state().controls.get(&id).map(|c| c.1).ok_or_else(gone)
    }

    fn formats(&mut self) -> io::Result<Vec<[u8; 4]>> {
        Ok(self.state().formats.clone())
    }

    fn sizes(&mut self, _: [u8; 4]) -> io::Result<Vec<[u32; 2]>> {
        Ok(vec![[4, 4], SIZE, [2, 2]])
    }

    fn set_format(&mut self, fourcc: [u8; 4], _: [u32; 2]) -> io::Result<Format> {
        Ok(Format { fourcc, size: SIZE, stride: 10, full_range: None })
    }

    fn intervals(&mut self, _: &Format) -> io::Result<Vec<f64>> {
        Ok(vec![0.2, 0.1, 0.05])
    }

    fn interval(&mut self, seconds: Option<f64>) -> io::Result<Option<f64>> {
        let mut state = self.state();
        state.interval_s = seconds.or(state.interval_s);
        Ok(state.interval_s)
    }

    fn start(&mut self, _: u32) -> io::Result<()> {
        let mut state = self.state();
        (state.streaming, state.sequence) = (true, 0);
        state.starts += 1;
        state.ended = self.clock.now();
        Ok(())
    }

    fn stop(&mut self) -> io::Result<()> {
        self.state().streaming = false;
        Ok(())
    }

    fn dequeue(&mut self, timeout: Duration) -> io::Result<Option<Buffer<'_>>> {
        let mut state = self.state.lock().unwrap();
        assert!(state.streaming);
        let fault = state.faults.pop_front();
        match fault {
            Some(Fault::Fail(code)) => return Err(io::Error::from_raw_os_error(code)),
            Some(Fault::Silence(left)) if left > timeout => {
                state.faults.push_front(Fault::Silence(left - timeout));
                self.clock.wait(timeout);
                state.ended = self.clock.now();
                return Ok(None);
            }
            _ => {}
        }
        let interval = Duration::from_secs_f64(state.interval_s.unwrap_or(0.1));
        if fault != Some(Fault::Again) {
            let lost = if fault == Some(Fault::Drop) { 2 } else { 1 };
            state.ended += interval * lost;
            let wait = state.ended.saturating_sub(self.clock.now());
            self.clock.wait(wait);
            state.sequence += lost;
            let level = state.level();
            // Rows of 8 pixels in 10 bytes.
            let rows = if fault == Some(Fault::Truncate) { 2 } else { SIZE[1] as usize };
            let frame = vec![[[level; 8].as_slice(), &[0, 255]].concat(); rows].concat();
            state.frame = frame;
        }
        let timestamp = match state.start_of_exposure {
            true => state.ended - Duration::from_micros(state.controls[&super::controls::EXPOSURE].1 as u64 * 100),
            false => state.ended,
        };
        let (sequence, start_of_exposure) = (state.sequence - 1, state.start_of_exposure);
        // Tests examine one frame at a time.
        let bytes: &'static [u8] = Box::leak(state.frame.clone().into_boxed_slice());
        let (monotonic, error) = (fault != Some(Fault::WallClock), fault == Some(Fault::Damage));
        Ok(Some(Buffer { bytes, sequence, timestamp, monotonic, start_of_exposure, error }))
    }
}
