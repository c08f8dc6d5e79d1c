//! Set-up of a camera: format, region, frame rate, trigger and capabilities.

use super::faults;
use super::node::{Failure, Gains, Node};
use super::settings::{GainUnit, Settings, Trigger};
use crate::camera::measure::refresh_multiples;
use crate::camera::pfnc::{Picture, PixelFormat};
use crate::{CameraInfo, Class, DeviceError, DeviceResult};
use std::time::Duration;

/// Assumed frame interval in s, if the camera does not report it.
const INTERVAL_S: f64 = 0.05;
/// Maximum number of format names in a message.
const MAX_NAMED: usize = 32;

/// A camera after set-up, with its capabilities.
pub(super) struct Opened {
    pub id: String,
    pub picture: Picture,
    /// 32-bit value of the pixel format.
    pub format: u32,
    pub gains: Option<Gains>,
    pub interval: Duration,
    pub exposure: Duration,
    pub exposures_s: [f64; 2],
    /// Size of network packets; `None` for USB cameras.
    pub packet_size: Option<u32>,
    pub warnings: Vec<String>,
}

impl Opened {
    pub(super) fn new(node: &mut dyn Node, settings: &Settings) -> DeviceResult<Self> {
        settings.check().map_err(|wrong| wrong_settings(&settings.device, wrong))?;
        let id = node.identity().map_err(|e| faults::opening(&settings.device, &e))?.words();
        let failed = |command: &'static str, expected: &'static str| {
            let id = id.clone();
            move |e: Failure| faults::command(&id, command, expected, &e)
        };
        let (format_name, pixels) = choose_format(node, &id, settings)?;
        let format = node.set_format(&format_name).map_err(failed("set the pixel format", "a format"))?;
        if !pixels.fits(format) {
            let got = format!("{format:#010X}, which has other bits per pixel");
            return Err(setup(&id, format_name, got).remedy("choose another format"));
        }
        let region = node.set_region(settings.region).map_err(failed("set the region", "a region of the sensor"))?;
        if let Some(wanted) = settings.region.filter(|wanted| *wanted != region) {
            let remedy = "give a region within the sensor, in the camera's steps";
            return Err(setup(&id, format!("the region {wanted:?}"), format!("{region:?}")).remedy(remedy));
        }
        let [_, _, width, height] = region.map(|v| v as usize);
        let picture = Picture { format: pixels, width, height, padding: 0 };
        picture.check().map_err(|wrong| setup(&id, "pictures", wrong).remedy("choose another region"))?;
        let mut warnings = node.all_manual().map_err(failed("disable automatic functions", "manual control"))?;
        let interval_s = node.frame_rate(settings.fps).map_err(failed("set the frame rate", "a frame rate"))?;
        let interval_s = interval_s.filter(|hz| hz.is_finite() && *hz > 1e-3).map(|hz| 1.0 / hz);
        if let Some(level) = settings.black_level {
            let set = node.set_black_level(level).map_err(failed("set the black level", "a black level"))?;
            if (set - level).abs() > 0.01 * level.abs().max(1.0) {
                warnings.push(format!("the black level is {set} in place of {level}"));
            }
        }
        let software = settings.trigger == Trigger::Software;
        node.set_software_trigger(software).map_err(failed("set the trigger", "a software trigger or none"))?;
        let packet_size = node.packet_size(settings.packet_size).map_err(failed("set the packet size", "a size"))?;
        let exposures = node.exposures().map_err(failed("read the exposures", "a range"))?;
        let Some([low, high]) = exposures.filter(|[low, high]| *low > 0.0 && high >= low && high.is_finite()) else {
            let remedy = "choose another camera: this one has no exposure control";
            return Err(setup(&id, "a manual exposure", "a camera without this control").remedy(remedy));
        };
        // Only a frame rate that the user chose limits the exposure: cameras slow down for longer exposures.
        let most = settings.fps.map_or(high, |fps| high.min(1.0 / fps)).max(low);
        let exposure = node.exposure(None).map_err(failed("read the exposure", "a value"))?;
        let gains = node.gains().map_err(failed("read the gains", "a range"))?;
        let interval = Duration::from_secs_f64(interval_s.unwrap_or(INTERVAL_S));
        let exposures_s = [low, most];
        Ok(Self { id, picture, format, gains, interval, exposure, exposures_s, packet_size, warnings })
    }

    pub(super) fn info(&self, settings: &Settings) -> CameraInfo {
        // The exposure begins after the trigger, so its readout does not matter.
        let triggered = settings.trigger == Trigger::Software;
        let readout_s = if triggered { 0.0 } else { self.interval.as_secs_f64() };
        CameraInfo {
            id: self.id.clone(),
            width: self.picture.width,
            height: self.picture.height,
            exposure_s: self.exposures_s,
            exposure_now_s: self.exposure.as_secs_f64(),
            gain: settings.gain.range(self.gains),
            black: settings.black.unwrap_or(0),
            white: settings.white.unwrap_or(self.picture.format.white()),
            readout_s: settings.readout_ms.map_or(readout_s, |ms| ms / 1e3),
            control_lag_frames: settings.control_lag_frames,
            shutter: false,
            full_scale_e: None,
            read_noise_e: None,
            steady_exposures_s: settings.panel_refresh_hz.map_or(vec![], |hz| refresh_multiples(hz, self.exposures_s)),
            exposure_choices_s: vec![],
            by_hand: false,
            warnings: self.warnings.clone(),
        }
    }

    /// Unit of the gain, and its lowest value.
    pub(super) fn gain_unit(&self, settings: &Settings) -> (GainUnit, f64) {
        (settings.gain.resolved(self.gains), self.gains.map_or(0.0, |gains| gains.low))
    }
}

fn setup(id: &str, expected: impl Into<Box<str>>, got: impl Into<Box<str>>) -> DeviceError {
    DeviceError::new(id, "open", expected, got).class(Class::Setup)
}

/// Error of an invalid configuration.
pub(super) fn wrong_settings(device: &str, wrong: String) -> DeviceError {
    setup(device, "settings of a GenICam camera", wrong).remedy("correct the camera's settings in the configuration")
}

fn choose_format(node: &mut dyn Node, id: &str, settings: &Settings) -> DeviceResult<(String, PixelFormat)> {
    let offered = node.formats().map_err(|e| faults::command(id, "list the pixel formats", "a list", &e))?;
    let known = offered.iter().filter_map(|name| Some((name, PixelFormat::named(name)?)));
    let chosen = match &settings.format {
        Some(wanted) => known.into_iter().find(|(name, _)| *name == wanted),
        None => known.max_by_key(|(_, format)| format.preference()),
    };
    chosen.map(|(name, format)| (name.clone(), format)).ok_or_else(|| {
        let names: Vec<&str> = offered.iter().take(MAX_NAMED).map(String::as_str).collect();
        let expected = settings.format.clone().unwrap_or_else(|| "a format that Nacre reads".into());
        setup(id, expected, format!("only {}", names.join(", "))).remedy("choose another format or camera")
    })
}
