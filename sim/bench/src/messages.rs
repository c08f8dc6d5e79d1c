//! Messages between the simulated devices and the bench: requests, replies and errors.

use crate::config::{BenchConfig, FaultyDevice};
use nacre_drivers::{
    Arrived, CameraInfo, Class, Controls, DeviceError, DisplayInfo, FlashInfo, Freshness, InterlockInfo, Level,
    Pattern, Shown, StageInfo, Stamp, Switched,
};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Range of the camera's exposure time in seconds.
pub(crate) const EXPOSURE_S: [f64; 2] = [1e-5, 60.0];

/// Range of the camera's gain.
pub(crate) const GAIN: [f64; 2] = [1.0, 100.0];

/// A request to a device of the bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "named as the calls of the device traits")]
pub enum Request {
    Describe,
    Home,
    MoveTo {
        angle_deg: f64,
    },
    /// Waits for a movement, in steps of 20 ms on a bench that runs in real time.
    Arrive,
    /// Stops a movement.
    Halt,
    Position,
    /// Reads the clock, without a device.
    Now,
    Configure {
        exposure: Duration,
        gain: f64,
    },
    Cover {
        closed: bool,
    },
    NextFrame {
        fresh: Freshness,
    },
    Show {
        pattern: Pattern,
    },
    Switch {
        on: bool,
    },
    IsOn,
    Level,
    /// Reads the state of the light, without a device.
    Light,
}

/// The reply to a request.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "named as the results of the device traits")]
pub enum Reply {
    Described(Box<Devices>),
    Arrived(Arrived),
    /// The movement continues.
    Turning,
    Angle(f64),
    Controls(Controls),
    At(Duration),
    /// On a socket, the codes follow the text, unless the frame is not fresh.
    Frame {
        stamp: Stamp,
        width: usize,
        height: usize,
        damaged: bool,
        #[serde(skip)]
        codes: Vec<u16>,
    },
    Shown(Shown),
    Switched(Switched),
    On(bool),
    Level(Level),
    Light {
        panel: bool,
        flash: bool,
    },
}

/// Properties and limits of a bench's devices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Devices {
    /// The rotation stage.
    pub stage: StageInfo,
    /// The camera.
    pub camera: CameraInfo,
    /// The panel.
    pub display: DisplayInfo,
    /// The flash.
    pub flash: FlashInfo,
    /// The door switch.
    pub interlock: InterlockInfo,
    /// Optics and distances, for the description of frames.
    pub bench: BenchConfig,
    /// Size of a pixel on the sample in µm.
    pub pixel_um: f64,
}

/// The device that executes a request; `None` for requests without faults.
pub(crate) fn device(request: &Request) -> Option<FaultyDevice> {
    match request {
        Request::Home | Request::MoveTo { .. } | Request::Position | Request::Halt => Some(FaultyDevice::Stage),
        Request::Configure { .. } | Request::Cover { .. } | Request::NextFrame { .. } => Some(FaultyDevice::Camera),
        Request::Show { .. } => Some(FaultyDevice::Display),
        Request::Switch { .. } | Request::IsOn => Some(FaultyDevice::Flash),
        Request::Level => Some(FaultyDevice::Interlock),
        Request::Describe | Request::Light | Request::Arrive | Request::Now => None,
    }
}

/// Name of a simulated device, which is also its id.
fn name(device: Option<FaultyDevice>) -> &'static str {
    match device {
        Some(FaultyDevice::Stage) => "simulated stage",
        Some(FaultyDevice::Camera) => "simulated camera",
        Some(FaultyDevice::Display) => "simulated panel",
        Some(FaultyDevice::Flash) => "simulated flash",
        Some(FaultyDevice::Interlock) => "simulated door switch",
        Some(FaultyDevice::Clock) | None => "simulated bench",
    }
}

/// Device error of the class that allows a retry.
pub(crate) fn error(request: &Request, expected: &str, got: &str) -> DeviceError {
    let command = match request {
        Request::Describe | Request::Light => "describe itself".to_owned(),
        Request::Now => "tell the time".into(),
        Request::Home => "home".into(),
        Request::Arrive => "arrive".into(),
        Request::Halt => "halt".into(),
        Request::MoveTo { angle_deg } => format!("move to {angle_deg}°"),
        Request::Position => "report its position".into(),
        Request::Configure { exposure, gain } => {
            format!("set an exposure of {} s and a gain of {gain}", exposure.as_secs_f64())
        }
        Request::Cover { closed: true } => "close the shutter".into(),
        Request::Cover { closed: false } => "open the shutter".into(),
        Request::NextFrame { .. } => "take a frame".into(),
        Request::Show { .. } => "show a pattern".into(),
        Request::Switch { on } => format!("switch {}", if *on { "on" } else { "off" }),
        Request::IsOn => "report its state".into(),
        Request::Level => "report its level".into(),
    };
    DeviceError::new(name(device(request)), command, expected, got).class(Class::Retry)
}

/// Properties and limits of a bench's devices, without building the bench.
pub fn describe(bench: &BenchConfig) -> Devices {
    let (stage, camera) = (&bench.stage, &bench.camera);
    let id = |device| name(Some(device)).to_owned();
    Devices {
        stage: StageInfo {
            id: id(FaultyDevice::Stage),
            speed_deg_s: stage.speed_deg_s,
            settling_s: stage.settle_ms / 1000.0,
            limits_deg: stage.limits_deg,
            tolerance_deg: 0.5,
            approach_deg: 5.0,
            longest_s: (stage.limits_deg[1] - stage.limits_deg[0]) / stage.speed_deg_s + stage.settle_ms / 1000.0,
            halts: true,
            by_hand: false,
        },
        camera: CameraInfo {
            id: id(FaultyDevice::Camera),
            width: camera.width as usize,
            height: camera.height as usize,
            exposure_s: EXPOSURE_S,
            exposure_now_s: camera.power_on_exposure_s(),
            gain: GAIN,
            black: camera.black_level as u16,
            white: ((1u32 << camera.bits) - 1) as u16,
            readout_s: camera.readout_ms / 1000.0,
            control_lag_frames: camera.lag_frames,
            shutter: true,
            full_scale_e: Some(camera.well_e),
            read_noise_e: Some(camera.read_noise_e),
            steady_exposures_s: vec![],
            exposure_choices_s: vec![],
            by_hand: false,
            warnings: vec![],
        },
        display: DisplayInfo { id: id(FaultyDevice::Display), size_mm: bench.panel.size_mm },
        flash: FlashInfo {
            id: id(FaultyDevice::Flash),
            settling_s: bench.flash.settle_ms / 1000.0,
            max_on_s: bench.flash.max_on_s,
        },
        interlock: InterlockInfo { id: id(FaultyDevice::Interlock) },
        pixel_um: 1000.0 * bench.sample.field_mm() / f64::from(camera.width.min(camera.height)),
        bench: bench.clone(),
    }
}
