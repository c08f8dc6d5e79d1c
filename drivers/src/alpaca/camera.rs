//! Cameras of Alpaca servers.

use super::client::{Device, Fault, Role, misconfigured};
use super::image_bytes::Image;
use crate::camera::commanded::{CommandedCamera, Exposer, Facts, GainUnit, Picture};
use crate::camera::measure::refresh_multiples;
use crate::{Camera, Class, Clock, DeviceError, DeviceResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest side of a picture in pixels.
const MAX_SIDE: u32 = 32_768;
/// State of a camera: idle, and error.
const IDLE: i32 = 0;
const ERROR: i32 = 5;
/// Shortest exposure in s where a camera states none.
const SHORTEST_S: f64 = 1e-6;
/// Longest exposure in s.
const LONGEST_S: f64 = 3600.0;

/// A camera of an ASCOM Alpaca server.
///
/// Each exposure starts by command; pictures arrive as `ImageBytes`. Colour cameras deliver the mosaic of their sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Host of the server, or host and port; the default port is 11111.
    pub address: String,
    /// Number of the camera on the server.
    #[serde(default)]
    pub camera: u32,
    /// Region on the sensor in pixels: left, top, width, height; default: the whole sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<[u32; 4]>,
    /// Name or number of the readout mode; default: as set in the server.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readout_mode: Option<String>,
    /// Unit of the gain control. Cameras with a list of gains keep the one that is set in the server.
    #[serde(default)]
    pub gain: GainUnit,
    /// Offset in the camera's unit; default: as set in the server.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<i32>,
    /// Code of black; default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black: Option<u16>,
    /// Code of a saturated pixel; default: the camera's `MaxADU`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white: Option<u16>,
    /// Refresh rate of the display in Hz: exposures should be multiples of its period.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_refresh_hz: Option<f64>,
    /// Maximum time for an answer of the server, in ms.
    #[serde(default = "answer_ms")]
    pub answer_ms: u64,
    /// Maximum time between the end of an exposure and the picture, in s.
    #[serde(default = "download_s")]
    pub download_s: f64,
}

pub(crate) fn answer_ms() -> u64 {
    5000
}

pub(crate) fn download_s() -> f64 {
    25.0
}

/// Checks the settings that cameras of all servers have in common.
pub(crate) fn check_common(answer_ms: u64, download_s: f64, region: Option<[u32; 4]>) -> Result<(), String> {
    if !(10..=20_000).contains(&answer_ms) {
        return Err(format!("answer_ms is {answer_ms}; give 10 to 20000"));
    }
    if !(0.1..=50.0).contains(&download_s) {
        return Err(format!("download_s is {download_s}; give 0.1 to 50"));
    }
    match region {
        Some([_, _, width, height]) if width == 0 || height == 0 || width.max(height) > MAX_SIDE => {
            Err(format!("region is {region:?}; give left, top, width and height"))
        }
        _ => Ok(()),
    }
}

/// Opens a camera.
///
/// # Errors
/// `Setup` if the server or the camera cannot be reached, or is not usable as configured.
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    let checked = check_common(settings.answer_ms, settings.download_s, settings.region);
    checked.map_err(|wrong| misconfigured(Role::Camera, wrong))?;
    let limit = Duration::from_millis(settings.answer_ms);
    let device = Device::open(&settings.address, Role::Camera, settings.camera, limit)?;
    let camera = AlpacaCamera::new(device, settings).map_err(|e| e.class(Class::Setup))?;
    Ok(Box::new(CommandedCamera::new(camera, clock.clone())))
}

struct AlpacaCamera {
    device: Device,
    facts: Facts,
    aborts: bool,
    /// Whether the camera states the exposure of its last picture.
    states_exposure: bool,
}

const OPEN: &str = "open";

impl AlpacaCamera {
    fn new(mut device: Device, settings: &Settings) -> DeviceResult<Self> {
        let [width, height] = set_region(&mut device, settings.region)?;
        set_readout_mode(&mut device, settings.readout_mode.as_deref())?;
        if let Some(offset) = settings.offset {
            device.put("offset", "set the offset", &[("Offset", &offset.to_string())])?;
        }
        let colour: i32 = device.get_optional("sensortype", OPEN)?.unwrap_or(0);
        if colour == 1 {
            return Err(DeviceError::new(
                device.id(),
                OPEN,
                "a monochrome camera or the mosaic of a sensor",
                "RGB pictures",
            )
            .remedy("choose the raw format in the settings of the camera's server"));
        }
        let exposure_s = exposures(&mut device)?;
        let gains = gains(&mut device)?;
        let white: i64 = device.get_optional("maxadu", OPEN)?.unwrap_or(i64::from(u16::MAX));
        let white = u16::try_from(white).ok().filter(|white| *white > 0).unwrap_or(u16::MAX);
        let facts = Facts {
            id: device.id().to_owned(),
            width: width as usize,
            height: height as usize,
            exposure_s,
            exposure_step_s: device.get_optional("exposureresolution", OPEN)?.unwrap_or(0.0),
            gains,
            gain_unit: settings.gain,
            black: settings.black.unwrap_or(0),
            white: settings.white.unwrap_or(white),
            shutter: device.get_optional("hasshutter", OPEN)?.unwrap_or(false),
            steady_exposures_s: settings.panel_refresh_hz.map_or(vec![], |hz| refresh_multiples(hz, exposure_s)),
            download: Duration::from_secs_f64(settings.download_s),
            warnings: cooler(&mut device)?.into_iter().collect(),
        };
        let aborts = device.get_optional("canabortexposure", OPEN)?.unwrap_or(false);
        Ok(Self { device, facts, aborts, states_exposure: true })
    }

    fn state(&mut self, what: &str) -> DeviceResult<i32> {
        self.device.get("camerastate", what)
    }
}

/// Sets the region without binning; returns its width and height.
fn set_region(device: &mut Device, region: Option<[u32; 4]>) -> DeviceResult<[u32; 2]> {
    const WHAT: &str = "set the region";
    for (property, name) in [("binx", "BinX"), ("biny", "BinY")] {
        if device.get_optional::<i32>(property, WHAT)?.is_some_and(|bin| bin != 1) {
            device.put(property, "switch binning off", &[(name, "1")])?;
        }
    }
    let (columns, rows): (u32, u32) = (device.get("cameraxsize", WHAT)?, device.get("cameraysize", WHAT)?);
    let [left, top, width, height] = region.unwrap_or([0, 0, columns, rows]);
    let fits = |start: u32, size: u32, all: u32| size > 0 && size <= MAX_SIDE && start.saturating_add(size) <= all;
    if !fits(left, width, columns) || !fits(top, height, rows) {
        let got = format!("{:?}", [left, top, width, height]);
        return Err(DeviceError::new(device.id(), WHAT, format!("a region within {columns} × {rows} pixels"), got)
            .remedy("correct `region` in the camera's settings"));
    }
    for (property, name, value) in
        [("numx", "NumX", width), ("numy", "NumY", height), ("startx", "StartX", left), ("starty", "StartY", top)]
    {
        if device.get::<u32>(property, WHAT)? != value {
            device.put(property, WHAT, &[(name, &value.to_string())])?;
        }
    }
    for (property, value) in [("numx", width), ("numy", height), ("startx", left), ("starty", top)] {
        let got: u32 = device.get(property, WHAT)?;
        if got != value {
            return Err(DeviceError::new(device.id(), WHAT, format!("{property} {value}"), got.to_string())
                .remedy("give a region in the camera's steps"));
        }
    }
    Ok([width, height])
}

fn set_readout_mode(device: &mut Device, wanted: Option<&str>) -> DeviceResult<()> {
    const WHAT: &str = "set the readout mode";
    let Some(wanted) = wanted else { return Ok(()) };
    let modes: Vec<String> = device.get("readoutmodes", WHAT)?;
    let named = modes.iter().position(|mode| mode == wanted);
    let number = named.or_else(|| wanted.parse().ok().filter(|n| *n < modes.len()));
    let Some(number) = number else {
        return Err(DeviceError::new(device.id(), WHAT, format!("a mode {wanted:?}"), format!("only {modes:?}"))
            .remedy("correct `readout_mode` in the camera's settings"));
    };
    device.put("readoutmode", WHAT, &[("ReadoutMode", &number.to_string())])
}

fn exposures(device: &mut Device) -> DeviceResult<[f64; 2]> {
    let low: f64 = device.get("exposuremin", OPEN)?;
    let high: f64 = device.get("exposuremax", OPEN)?;
    let [low, high] = [low.max(SHORTEST_S), high.min(LONGEST_S)];
    if low <= high {
        return Ok([low, high]);
    }
    Err(DeviceError::new(device.id(), OPEN, "a range of exposures", format!("{low} to {high} s"))
        .remedy("choose another camera"))
}

/// Range of the gain; `None` without a control, and where the gains are a list of names, which is in no unit.
fn gains(device: &mut Device) -> DeviceResult<Option<[f64; 2]>> {
    let limits = [device.get_optional::<f64>("gainmin", OPEN)?, device.get_optional::<f64>("gainmax", OPEN)?];
    let [Some(low), Some(high)] = limits else { return Ok(None) };
    Ok((low <= high && low.abs().max(high.abs()) < 1e9).then_some([low, high]))
}

/// Warning for a sensor whose cooler is off. The driver changes no cooler.
fn cooler(device: &mut Device) -> DeviceResult<Option<String>> {
    if device.get_optional::<bool>("cooleron", OPEN)? != Some(false) {
        return Ok(None);
    }
    let now = device.get_optional::<f64>("ccdtemperature", OPEN)?;
    let at = now.map_or_else(String::new, |now| format!(" at {now:.1} °C"));
    Ok(Some(format!(
        "the cooler of the sensor is off{at}, so that dark current varies: switch it on in the program of its server"
    )))
}

impl Exposer for AlpacaCamera {
    fn facts(&self) -> &Facts {
        &self.facts
    }

    fn set_gain(&mut self, value: f64) -> DeviceResult<f64> {
        const WHAT: &str = "set the gain";
        let [low, high] = self.facts.gains.unwrap_or_default();
        let value = value.clamp(low, high.max(low));
        self.device.put("gain", WHAT, &[("Gain", &format!("{value:.0}"))])?;
        self.device.get("gain", WHAT)
    }

    fn start(&mut self, exposure_s: f64, dark: bool) -> DeviceResult<()> {
        let light = if dark { "False" } else { "True" };
        let form = [("Duration", &*format!("{exposure_s:.6}")), ("Light", light)];
        self.device.put("startexposure", "start an exposure", &form)
    }

    fn is_ready(&mut self, limit: Duration) -> DeviceResult<bool> {
        const WHAT: &str = "take a frame";
        if self.device.get("imageready", WHAT)? {
            return Ok(true);
        }
        if self.state(WHAT)? == ERROR {
            return Err(DeviceError::new(self.device.id(), WHAT, "a picture", "the camera's state `error`")
                .remedy("see the program of the server, then resume the session")
                .class(Class::Retry));
        }
        std::thread::sleep(limit);
        Ok(false)
    }

    fn fetch(&mut self) -> DeviceResult<Picture> {
        let Facts { width, height, download, .. } = self.facts;
        let (width, height, codes) = match self.device.image(width, height, download)? {
            Image::Plane { width, height, codes } => (width, height, codes),
            Image::Refused { number, message } => {
                return Err(self.device.error("fetch the picture", "a picture", &Fault::Refused(number, message)));
            }
        };
        let exposure_s = match self.states_exposure {
            true => self.device.get_optional("lastexposureduration", "take a frame")?,
            false => None,
        };
        self.states_exposure = exposure_s.is_some();
        Ok(Picture { width, height, codes, exposure_s })
    }

    fn abort(&mut self) -> DeviceResult<()> {
        const WHAT: &str = "end an exposure";
        if self.aborts && self.state(WHAT)? != IDLE {
            self.device.put("abortexposure", WHAT, &[])?;
        }
        // A camera that cannot abort ends its exposure by itself.
        let begun = Instant::now();
        while ![IDLE, ERROR].contains(&self.state(WHAT)?) {
            if begun.elapsed() > self.facts.download {
                return Err(DeviceError::new(self.device.id(), WHAT, "an idle camera", "one that is still busy")
                    .remedy("end the exposure in the program of the server, then resume the session")
                    .class(Class::Retry));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }
}
