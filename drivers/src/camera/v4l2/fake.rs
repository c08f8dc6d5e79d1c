//! A fake camera for tests: it clamps values, is late, loses, damages and reorders frames, hangs, and disconnects.

use super::controls::{EXPOSURE, UNITLESS_EXPOSURE};
use super::formats::{Layout, PixelFormat};
use super::node::{Buffer, Format, Node, Range, plane_payload};
use crate::Clock;
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

pub const ENODEV: i32 = 19;
pub const SIZE: [u32; 2] = [8, 4];
pub const JPEG_SIZE: [u32; 2] = [16, 8];
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
    /// A timestamp of another clock, flagged as such.
    WallClock,
    /// A timestamp of zero.
    NoTime,
    /// A timestamp of another clock, which is ahead by an hour.
    Ahead,
    /// A timestamp of a clock that was put back by 3 s.
    Back,
    /// A JPEG file without these segments.
    Without(u8),
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
    pub format: Format,
    /// Bytes of a header before the picture, as in planes of multi-planar cameras.
    pub header: u32,
    /// Duration of one step of the exposure control in µs.
    pub unit_us: f64,
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
            (EXPOSURE, (range(3, 2047), 100)),
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
            // Rows of 8 pixels in 10 bytes.
            format: Format { fourcc: *b"GREY", size: SIZE, stride: 10, full_range: None },
            header: 0,
            unit_us: 100.0,
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
    /// Takes a picture of uniform light in the format in force.
    fn expose(&mut self, fault: Option<Fault>) {
        let level = u16::from(self.level());
        let Format { fourcc, size: [width, height], stride, .. } = self.format;
        let rows = if fault == Some(Fault::Truncate) { 2 } else { height as usize };
        let format = PixelFormat::of(fourcc).unwrap();
        let mut frame = vec![0xEE; self.header as usize];
        if format.layout == Layout::Jpeg {
            let without = if let Some(Fault::Without(marker)) = fault { vec![marker] } else { vec![] };
            frame.extend(grey_jpeg(&without));
        } else {
            let mut row = pack_row(format, &row_codes(format, level, width));
            row.resize(row.len().max(stride as usize), 255);
            frame.extend(row.repeat(rows));
        }
        self.frame = frame;
    }

    fn exposure(&self) -> i64 {
        let controls = [EXPOSURE, UNITLESS_EXPOSURE].map(|id| self.controls.get(&id));
        controls.into_iter().flatten().next().map_or(0, |control| control.1)
    }

    fn level(&mut self) -> u8 {
        let now = self.exposure();
        self.exposures.push_back(now);
        while self.exposures.len() > self.lag + 1 {
            self.exposures.pop_front();
        }
        let light = LIGHT * self.exposures[0] as f64 * self.unit_us / 10_000.0;
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
        let mut state = self.state();
        let size = if fourcc == *b"MJPG" { JPEG_SIZE } else { SIZE };
        state.format = Format { fourcc, size, ..state.format };
        Ok(state.format)
    }

    fn intervals(&mut self, _: &Format) -> io::Result<Vec<f64>> {
        Ok(vec![0.2, 0.1, 0.05])
    }

    fn interval(&mut self, seconds: Option<f64>) -> io::Result<Option<f64>> {
        let mut state = self.state();
        state.interval_s = seconds.or(state.interval_s);
        Ok(state.interval_s)
    }

    fn start(&mut self, _: u32) -> io::Result<Format> {
        let mut state = self.state();
        (state.streaming, state.sequence) = (true, 0);
        state.starts += 1;
        state.ended = self.clock.now();
        Ok(state.format)
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
        if fault != Some(Fault::Again) {
            let lost = if fault == Some(Fault::Drop) { 2 } else { 1 };
            let due = state.ended + Duration::from_secs_f64(state.interval_s.unwrap_or(0.1)) * lost;
            if due > self.clock.now() + timeout {
                fault.into_iter().for_each(|fault| state.faults.push_front(fault));
                self.clock.wait(timeout);
                return Ok(None);
            }
            state.ended = due;
            self.clock.wait(due.saturating_sub(self.clock.now()));
            state.sequence += lost;
            state.expose(fault);
        }
        let unit = Duration::from_nanos((state.unit_us * 1e3) as u64);
        let since_start = if state.start_of_exposure { unit * state.exposure() as u32 } else { Duration::ZERO };
        let timestamp = match fault {
            Some(Fault::NoTime) => Duration::ZERO,
            Some(Fault::Ahead) => state.ended + Duration::from_secs(3600),
            Some(Fault::Back) => state.ended - Duration::from_secs(3),
            _ => state.ended - since_start,
        };
        let (sequence, start_of_exposure) = (state.sequence - 1, state.start_of_exposure);
        // Tests examine one frame at a time.
        let memory: &'static [u8] = Box::leak(state.frame.clone().into_boxed_slice());
        let bytes = plane_payload(memory, memory.len() as u32, state.header);
        let (monotonic, error) = (fault != Some(Fault::WallClock), fault == Some(Fault::Damage));
        Ok(Some(Buffer { bytes, sequence, timestamp, monotonic, start_of_exposure, error }))
    }
}

/// Codes of a row of uniform light. Their bits below the upper 8 count the columns.
pub fn row_codes(format: PixelFormat, level: u16, width: u32) -> Vec<u16> {
    let low = format.bits - 8;
    (0..width).map(|column| (level << low) + (column % (1 << low)) as u16).collect()
}

/// The JPEG file of 16 × 8 pixels without the segments of these markers: 0xC4 for Huffman tables, 0xDB for quantization
/// tables.
pub fn grey_jpeg(without: &[u8]) -> Vec<u8> {
    let file = include_bytes!("grey.jpg");
    let (mut bare, mut at) = (file[..2].to_vec(), 2);
    while file[at + 1] != 0xda {
        let end = at + 2 + usize::from(u16::from_be_bytes([file[at + 2], file[at + 3]]));
        if !without.contains(&file[at + 1]) {
            bare.extend(&file[at..end]);
        }
        at = end;
    }
    bare.extend(&file[at..]);
    bare
}

/// Packs a row as a camera would, with complete groups.
pub fn pack_row(format: PixelFormat, row: &[u16]) -> Vec<u8> {
    let group = |pixels: usize, low: usize| -> Vec<u8> {
        let group = |g: &[u16]| -> Vec<u8> {
            let low_bits = |(i, c): (usize, &u16)| u32::from(c & ((1 << low) - 1)) << (i * low);
            let rest: u32 = g.iter().enumerate().map(low_bits).sum();
            let high = g.iter().map(|c| (c >> low) as u8).chain(std::iter::repeat_n(0, pixels - g.len()));
            high.chain(rest.to_le_bytes().into_iter().take(pixels * low / 8)).collect()
        };
        row.chunks(pixels).flat_map(group).collect()
    };
    match format.layout {
        Layout::Bytes | Layout::LumaPlane => row.iter().map(|c| *c as u8).collect(),
        Layout::Words => row.iter().flat_map(|c| c.to_le_bytes()).collect(),
        Layout::LumaFirst => row.iter().flat_map(|c| [*c as u8, 77]).collect(),
        Layout::LumaSecond => row.iter().flat_map(|c| [77, *c as u8]).collect(),
        Layout::TenPacked => group(4, 2),
        Layout::TwelvePacked => group(2, 4),
        Layout::FourteenPacked => group(4, 6),
        Layout::TenBits => {
            let bits: Vec<u8> = row.iter().flat_map(|c| (0..10).rev().map(move |bit| (c >> bit & 1) as u8)).collect();
            bits.chunks(8).map(|byte| byte.iter().enumerate().map(|(i, bit)| bit << (7 - i)).sum()).collect()
        }
        Layout::Jpeg => panic!("not packed here"),
    }
}
