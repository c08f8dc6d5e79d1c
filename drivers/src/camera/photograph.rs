//! Photographs of still cameras: files that a camera takes one at a time, on command.
//!
//! Drivers do not decode files. The program passes a [`PhotographReader`] to them, which limits memory and time.
//!
//! A photograph that was triggered after the last change of the bench is fresh by construction. `Shutter` numbers
//! photographs accordingly, and answers requests for any frame without an exposure.

use crate::{CameraInfo, Class, Clock, DeviceError, DeviceResult, Frame, Freshness, Prompt, Stamp};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Longest wait for the bench to become steady before a photograph.
const LONGEST_SETTLING: Duration = Duration::from_secs(120);

/// Largest difference between the black levels of two photographs, as a part of the range, that is equalised.
const BLACK_DRIFT: f64 = 0.02;

/// Colour channel of a photograph that becomes the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Red.
    Red,
    /// Green, the mean of both green filters of a cell.
    #[default]
    Green,
    /// Blue.
    Blue,
}

/// Statements of a photograph about itself; `None` where the file does not state them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shot {
    /// Whether this is a camera raw file.
    pub raw: bool,
    /// Start of the exposure on the camera's clock.
    pub taken: Option<Taken>,
    /// Exposure time in s.
    pub exposure_s: Option<f64>,
    /// Sensitivity (ISO).
    pub iso: Option<f64>,
    /// f-number.
    pub aperture: Option<f64>,
    /// Model of the camera.
    pub model: Option<String>,
    /// Serial number of the camera.
    pub serial: Option<String>,
}

/// Time of an exposure on the camera's clock, which may be wrong by years and is in an unknown time zone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taken {
    /// Seconds since 1970.
    pub seconds: f64,
    /// Resolution in s: the exposure began within this time after `seconds`.
    pub resolution_s: f64,
}

/// A decoded photograph: codes of one channel, row-major, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// Statements of the file.
    pub shot: Shot,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Codes.
    pub codes: Vec<u16>,
    /// Code of black.
    pub black: u16,
    /// Code of a saturated pixel.
    pub white: u16,
}

/// Reads photographs for the drivers.
pub trait PhotographReader: Send + Sync {
    /// Whether a file of this name may be a photograph of a still camera, and whether it would be a raw file.
    fn kind(&self, name: &str) -> Option<bool>;

    /// Statements of a file, without its pixels.
    ///
    /// # Errors
    /// The problem, if it is no photograph or is incomplete.
    fn shot(&self, file: &Path) -> Result<Shot, String>;

    /// Decodes a file.
    ///
    /// # Errors
    /// The problem with its remedy, if it is no photograph, is incomplete or exceeds the limits.
    fn read(&self, file: &Path, channel: Channel) -> Result<Photograph, String>;

    /// Decodes a file in memory; `name` is its name on the camera.
    ///
    /// # Errors
    /// As [`Self::read`].
    fn read_bytes(&self, name: &str, bytes: &[u8], channel: Channel) -> Result<Photograph, String>;
}

/// Services of the program for drivers of still cameras.
#[derive(Clone)]
pub struct Photography {
    /// Reads photographs.
    pub reader: Arc<dyn PhotographReader>,
    /// Makes a prompt that asks the operator.
    pub prompt: Arc<dyn Fn() -> Box<dyn Prompt> + Send + Sync>,
}

/// Numbers and times of photographs.
pub(super) struct Shutter {
    clock: Arc<dyn Clock>,
    sequence: u64,
    /// Exposure in force.
    pub exposure: Duration,
    last: Duration,
}

impl Shutter {
    pub(super) fn new(clock: Arc<dyn Clock>, exposure: Duration) -> Self {
        Self { clock, sequence: 0, exposure, last: Duration::ZERO }
    }

    /// Time for the report of new controls.
    pub(super) fn set(&mut self, exposure: Duration) -> Duration {
        self.exposure = exposure;
        self.clock.now()
    }

    /// Answers a request that accepts no photograph: a stale frame with the next number, without an exposure. The next
    /// photograph is triggered later, so it has the present controls.
    pub(super) fn unexposed(&mut self, info: &CameraInfo, fresh: Freshness) -> Option<Frame> {
        (fresh.steady_since == Duration::MAX).then(|| {
            let timestamp = self.later(self.clock.now());
            self.frame(info, timestamp, vec![])
        })
    }

    /// Waits until the bench is steady: an earlier photograph would not be used.
    ///
    /// # Errors
    /// `Stop` if that is too long.
    pub(super) fn steady(&self, info: &CameraInfo, fresh: Freshness) -> DeviceResult<Duration> {
        let rest = fresh.steady_since.saturating_sub(self.clock.now());
        if rest > LONGEST_SETTLING {
            let expected = format!("a bench that is steady within {} s", LONGEST_SETTLING.as_secs());
            let got = format!("one that is steady in {:.0} s", rest.as_secs_f64());
            return Err(DeviceError::new(&info.id, "take a photograph", expected, got)
                .remedy("check the settling times in the configuration"));
        }
        if !rest.is_zero() {
            self.clock.wait(rest);
        }
        Ok(self.clock.now())
    }

    /// Frame of a photograph that was triggered at this time.
    ///
    /// # Errors
    /// `Stop` for another size or level than announced.
    pub(super) fn photographed(
        &mut self,
        info: &CameraInfo,
        triggered: Duration,
        mut photograph: Photograph,
    ) -> DeviceResult<Frame> {
        let wrong = |expected: String, got: String| {
            DeviceError::new(&info.id, "take a photograph", expected, got)
                .remedy("set the camera's image size and quality back, then resume the session")
        };
        let size = |width: usize, height: usize| format!("{width} × {height} pixels");
        if (photograph.width, photograph.height) != (info.width, info.height) {
            return Err(wrong(size(info.width, info.height), size(photograph.width, photograph.height)));
        }
        let range = f64::from(info.white.saturating_sub(info.black).max(1));
        let drift = i32::from(info.black) - i32::from(photograph.black);
        let whiter = i32::from(info.white) - i32::from(photograph.white);
        if f64::from(drift.abs().max(whiter.abs())) > BLACK_DRIFT * range {
            let levels = |black: u16, white: u16| format!("codes from {black} (black) to {white} (white)");
            let got = levels(photograph.black, photograph.white);
            return Err(wrong(levels(info.black, info.white), got));
        }
        equalise(&mut photograph, info, drift);
        let end = triggered + self.exposure;
        // No camera returns a photograph before the end of its exposure.
        let rest = end.saturating_sub(self.clock.now());
        if !rest.is_zero() {
            self.clock.wait(rest.min(LONGEST_SETTLING));
        }
        let timestamp = self.later(end);
        Ok(self.frame(info, timestamp, photograph.codes))
    }

    fn later(&self, timestamp: Duration) -> Duration {
        timestamp.max(self.last + Duration::from_nanos(1))
    }

    fn frame(&mut self, info: &CameraInfo, timestamp: Duration, codes: Vec<u16>) -> Frame {
        self.sequence += 1;
        self.last = timestamp;
        let stamp = Stamp { sequence: self.sequence, timestamp };
        Frame { stamp, width: info.width, height: info.height, damaged: false, codes }
    }
}

/// Shifts codes to the announced black level. Cameras measure black in each photograph. Saturated pixels stay so.
fn equalise(photograph: &mut Photograph, info: &CameraInfo, drift: i32) {
    let white = photograph.white;
    for code in &mut photograph.codes {
        let shifted = (i32::from(*code) + drift).clamp(0, i32::from(u16::MAX)) as u16;
        *code = if *code >= white { shifted.max(info.white) } else { shifted };
    }
}

/// Description of a still camera by a photograph of it.
pub(super) fn describe(id: String, sample: &Photograph, exposures: Vec<f64>, gain: [f64; 2]) -> CameraInfo {
    let low = exposures.iter().copied().fold(f64::INFINITY, f64::min);
    let high = exposures.iter().copied().fold(0.0, f64::max);
    let mut warnings = vec![];
    if !sample.shot.raw {
        warnings.push(
            "JPEG is lossy and not linear in light: use raw files, or calibrate the response with the same settings"
                .into(),
        );
    }
    CameraInfo {
        id,
        width: sample.width,
        height: sample.height,
        exposure_s: [low.min(high), high],
        exposure_now_s: sample.shot.exposure_s.unwrap_or(low).clamp(low.min(high), high),
        gain,
        black: sample.black,
        white: sample.white,
        // The exposure begins after the trigger, so its readout does not matter.
        readout_s: 0.0,
        control_lag_frames: 0,
        shutter: false,
        full_scale_e: None,
        read_noise_e: None,
        steady_exposures_s: vec![],
        exposure_choices_s: exposures,
        by_hand: false,
        warnings,
    }
}

/// Whether an exposure or sensitivity of Exif tags is the set one. Cameras state either the label or the exact value of
/// a step: 1/60 s or 1/64 s. Neighbouring thirds of a stop differ by 26 %.
pub(super) fn is_same_step(stated: f64, set: f64) -> bool {
    const TOLERANCE: f64 = 0.13;
    (stated / set - 1.0).abs() <= TOLERANCE
}

/// The exposure among the camera's choices, or the error that names the nearest ones.
///
/// # Errors
/// `Setup` if none is within the tolerance.
pub(super) fn choose_exposure(info: &CameraInfo, exposure: Duration) -> DeviceResult<f64> {
    let wanted = exposure.as_secs_f64();
    info.choice(wanted).map_err(|nearest| {
        let nearest: Vec<String> = nearest.iter().map(|s| speed(*s)).collect();
        let got = format!("none; the nearest are {}", nearest.join(" and "));
        DeviceError::new(&info.id, "set the exposure", format!("a shutter speed of {}", speed(wanted)), got)
            .remedy("choose one of the camera's exposures")
            .class(Class::Setup)
    })
}

/// An exposure as cameras and photographers write it, with its value: "1/60 s (16.67 ms)".
pub fn speed(seconds: f64) -> String {
    let inverse = (1.0 / seconds).round();
    match seconds {
        s if !(s > 0.0 && s.is_finite()) => format!("{seconds} s"),
        s if s < 0.3 && inverse * s > 0.97 && inverse * s < 1.03 => {
            format!("1/{inverse} s ({} ms)", (s * 1e5).round() / 100.0)
        }
        s => format!("{} s", (s * 1e4).round() / 1e4),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;

    fn sample(black: u16, codes: Vec<u16>) -> Photograph {
        let shot = Shot { raw: true, ..Shot::default() };
        Photograph { shot, width: 2, height: 1, codes, black, white: 1000 }
    }

    #[test]
    fn black_levels_are_equalised_and_saturation_is_kept() {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let info = describe("x".into(), &sample(100, vec![0, 0]), vec![0.01], [1.0, 1.0]);
        let mut shutter = Shutter::new(clock.clone(), Duration::from_millis(1));
        let now = clock.now();
        let frame = shutter.photographed(&info, now, sample(103, vec![203, 1000])).unwrap();
        assert_eq!(frame.codes, [200, 1000]);
        let next = shutter.photographed(&info, now, sample(97, vec![197, 0])).unwrap();
        assert_eq!(next.codes, [200, 3]);
        assert!(next.stamp.timestamp > frame.stamp.timestamp && next.stamp.sequence == frame.stamp.sequence + 1);
        assert!(shutter.photographed(&info, now, sample(300, vec![0, 0])).is_err());
        let wider = Photograph { width: 3, ..sample(100, vec![0; 3]) };
        assert!(shutter.photographed(&info, now, wider).unwrap_err().got.contains("3 × 1"));
    }

    #[test]
    fn a_request_that_accepts_nothing_costs_no_exposure_and_makes_the_next_photograph_fresh() {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let info = describe("x".into(), &sample(100, vec![0, 0]), vec![0.01], [1.0, 1.0]);
        let mut shutter = Shutter::new(clock, Duration::ZERO);
        let set_at = shutter.set(Duration::from_millis(10));
        let stale = shutter.unexposed(&info, Freshness::NEVER).unwrap();
        assert!(stale.codes.is_empty());
        let first_sequence = Freshness::first_with_controls(stale.stamp, set_at, 0).unwrap();
        let fresh = Freshness { steady_since: set_at, first_sequence, duration: Duration::from_millis(10) };
        assert!(shutter.unexposed(&info, fresh).is_none());
        let triggered = shutter.steady(&info, fresh).unwrap();
        let frame = shutter.photographed(&info, triggered, sample(100, vec![5, 6])).unwrap();
        assert!(fresh.accepts(frame.stamp) && !fresh.accepts(stale.stamp));
        let never = Freshness { steady_since: triggered + Duration::from_secs(3600), ..fresh };
        assert!(shutter.steady(&info, never).is_err());
    }

    #[test]
    fn an_exposure_that_the_camera_lacks_is_refused_with_the_nearest_ones() {
        let info = describe("x".into(), &sample(0, vec![0, 0]), vec![0.01, 1.0 / 80.0, 1.0 / 60.0], [1.0, 1.0]);
        assert_eq!(choose_exposure(&info, Duration::from_micros(16_670)).unwrap(), 1.0 / 60.0);
        let error = choose_exposure(&info, Duration::from_millis(11)).unwrap_err();
        assert!(error.got.contains("1/100 s (10 ms) and 1/80 s (12.5 ms)"), "{error}");
        assert!(choose_exposure(&info, Duration::from_secs(3)).unwrap_err().got.contains("1/60"));
    }
}
