//! A fake camera for tests: it is late, loses packets and frames, refuses commands, hangs, and disconnects.

use super::node::{Buffer, Cause, Failure, Gains, Identity, Node, NodeResult, Packets, Status};
use crate::Clock;
use crate::camera::v4l2::fake::FakeClock;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

pub const SIZE: [u32; 2] = [8, 4];
/// 32-bit value of `Mono12p`.
const MONO_12P: u32 = 0x010C_0047;
const INTERVAL: Duration = Duration::from_millis(50);
/// Delay from the end of an exposure to the arrival of the frame.
const TRANSFER: Duration = Duration::from_millis(5);

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The frame is lost.
    Drop,
    /// The frame is incomplete.
    Incomplete(Status),
    /// The payload is too short, although the frame counts as complete.
    Short,
    /// The frame has another pixel format.
    OtherFormat,
    /// The frame waits on the network.
    Late(Duration),
    /// No frame for this long.
    Silence(Duration),
}

pub struct State {
    pub formats: Vec<&'static str>,
    pub faults: VecDeque<Fault>,
    pub gone: bool,
    /// Region refused by the camera, which keeps its own.
    pub fixed_region: bool,
    /// Exposure control in s.
    pub exposures: Option<[f64; 2]>,
    pub decibel: bool,
    pub exposure: Duration,
    pub gain: f64,
    pub rate: f64,
    pub starts: u32,
    /// Whether each trigger starts an exposure.
    pub software: bool,
    pub triggers: u32,
    pub packets: Packets,
    pub packet_size: Option<u32>,
    /// Ends of the exposures of triggered frames.
    pending: VecDeque<Duration>,
    id: u64,
    ended: Duration,
}

#[derive(Clone)]
pub struct FakeNode {
    pub state: Arc<Mutex<State>>,
    pub clock: FakeClock,
}

impl FakeNode {
    pub fn new() -> Self {
        let clock = FakeClock::default();
        clock.wait(Duration::from_secs(100));
        let state = State {
            formats: vec!["Mono8", "Mono12p", "RGB8"],
            faults: VecDeque::new(),
            gone: false,
            fixed_region: false,
            exposures: Some([1e-5, 10.0]),
            decibel: true,
            exposure: Duration::from_millis(10),
            gain: 0.0,
            rate: 20.0,
            starts: 0,
            software: false,
            triggers: 0,
            packets: Packets::default(),
            packet_size: Some(1400),
            pending: VecDeque::new(),
            id: 65_530,
            ended: Duration::ZERO,
        };
        Self { state: Arc::new(Mutex::new(state)), clock }
    }

    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    /// The state of a camera that answers.
    fn alive(&self) -> NodeResult<MutexGuard<'_, State>> {
        let state = self.state();
        if state.gone { Err(Failure::new(Cause::Gone, "no answer")) } else { Ok(state) }
    }
}

impl Node for FakeNode {
    fn identity(&mut self) -> NodeResult<Identity> {
        drop(self.alive()?);
        Ok(Identity { vendor: "Acme".into(), model: "Fake".into(), serial: "7".into() })
    }

    fn formats(&mut self) -> NodeResult<Vec<String>> {
        Ok(self.alive()?.formats.iter().map(|name| (*name).to_owned()).collect())
    }

    fn set_format(&mut self, name: &str) -> NodeResult<u32> {
        drop(self.alive()?);
        Ok(crate::camera::pfnc::code_of(name).unwrap_or(0))
    }

    fn set_region(&mut self, region: Option<[u32; 4]>) -> NodeResult<[u32; 4]> {
        let whole = [0, 0, SIZE[0], SIZE[1]];
        Ok(if self.alive()?.fixed_region { whole } else { region.unwrap_or(whole) })
    }

    fn all_manual(&mut self) -> NodeResult<Vec<String>> {
        Ok(vec![])
    }

    fn exposures(&mut self) -> NodeResult<Option<[f64; 2]>> {
        Ok(self.alive()?.exposures)
    }

    fn exposure(&mut self, set: Option<Duration>) -> NodeResult<Duration> {
        let mut state = self.alive()?;
        // In steps of 10 µs.
        state.exposure = set.map_or(state.exposure, |e| Duration::from_micros(e.as_micros() as u64 / 10 * 10));
        Ok(state.exposure)
    }

    fn gains(&mut self) -> NodeResult<Option<Gains>> {
        Ok(Some(Gains { low: 0.0, high: 24.0, decibel: self.alive()?.decibel }))
    }

    fn gain(&mut self, set: Option<f64>) -> NodeResult<f64> {
        let mut state = self.alive()?;
        state.gain = set.map_or(state.gain, |gain| (gain * 10.0).round() / 10.0);
        Ok(state.gain)
    }

    fn set_black_level(&mut self, level: f64) -> NodeResult<f64> {
        Ok(level.min(100.0))
    }

    fn frame_rate(&mut self, set: Option<f64>) -> NodeResult<Option<f64>> {
        let mut state = self.alive()?;
        state.rate = set.unwrap_or(state.rate);
        Ok(Some(state.rate))
    }

    fn set_software_trigger(&mut self, on: bool) -> NodeResult<()> {
        self.alive()?.software = on;
        Ok(())
    }

    fn trigger(&mut self) -> NodeResult<()> {
        let mut state = self.alive()?;
        state.triggers += 1;
        let end = self.clock.now() + state.exposure;
        state.pending.push_back(end);
        Ok(())
    }

    fn packet_size(&mut self, set: Option<u32>) -> NodeResult<Option<u32>> {
        let mut state = self.alive()?;
        state.packet_size = state.packet_size.map(|size| set.unwrap_or(size));
        Ok(state.packet_size)
    }

    fn start(&mut self, _: u32) -> NodeResult<()> {
        let mut state = self.alive()?;
        state.starts += 1;
        state.ended = self.clock.now();
        Ok(())
    }

    fn stop(&mut self) {
        self.state().pending.clear();
    }

    fn dequeue(&mut self, timeout: Duration) -> Option<Buffer<'_>> {
        let mut state = self.state.lock().unwrap();
        let fault = state.faults.pop_front();
        let silence = match fault {
            Some(Fault::Silence(left)) => left,
            _ if state.gone || (state.software && state.pending.is_empty()) => Duration::MAX,
            _ => Duration::ZERO,
        };
        if silence > timeout {
            if fault.is_some() {
                state.faults.push_front(Fault::Silence(silence - timeout));
            }
            self.clock.wait(timeout);
            state.ended = self.clock.now();
            return None;
        }
        state.id = state.id % 65_535 + 1;
        if fault == Some(Fault::Drop) {
            state.id = state.id % 65_535 + 1;
        }
        let triggered = state.pending.pop_front();
        state.ended = triggered.unwrap_or(state.ended + INTERVAL.max(state.exposure));
        let late = if let Some(Fault::Late(late)) = fault { late } else { Duration::ZERO };
        let arrival = state.ended + TRANSFER + late;
        self.clock.wait(arrival.saturating_sub(self.clock.now()));
        let status = if let Some(Fault::Incomplete(status)) = fault { status } else { Status::Complete };
        state.packets.received += 10;
        state.packets.missing += u64::from(status != Status::Complete);
        // All codes are 0x123.
        let bytes: &'static [u8] =
            &[0x23, 0x31, 0x12].repeat(16).leak()[..if fault == Some(Fault::Short) { 24 } else { 48 }];
        Some(Buffer {
            bytes,
            frame_id: state.id,
            arrival,
            device_ns: u64::try_from((state.ended - Duration::from_secs(90)).as_nanos()).unwrap(),
            status,
            width: SIZE[0] as usize,
            height: SIZE[1] as usize,
            padding: 0,
            format: if fault == Some(Fault::OtherFormat) { 1 } else { MONO_12P },
        })
    }

    fn packets(&mut self) -> Packets {
        self.state().packets
    }

    fn answers(&mut self) -> bool {
        !self.state().gone
    }
}
