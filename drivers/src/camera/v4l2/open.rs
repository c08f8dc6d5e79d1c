//! Set-up of a camera from its device node: format, frame rate and capabilities.

use super::controls::{self, Ranges};
use super::driver::failure;
use super::formats::{FORMATS, Layout, PixelFormat};
use super::node::{Format, Node};
use super::pixels::Picture;
use super::settings::Settings;
use crate::camera::measure::refresh_multiples;
use crate::{CameraInfo, Class, DeviceError, DeviceResult};
use std::io;
use std::time::Duration;

/// A camera after set-up, with its capabilities.
pub(super) struct Opened {
    pub picture: Picture,
    pub format: Format,
    pub ranges: Ranges,
    /// Frame interval in s, if the camera reports it.
    pub interval_s: Option<f64>,
    pub exposure: Duration,
    pub exposures_s: [f64; 2],
    pub warnings: Vec<String>,
}

/// Assumed frame interval in s, if the camera does not report it.
pub(super) const INTERVAL_S: f64 = 0.05;

impl Opened {
    pub(super) fn new(node: &mut dyn Node, id: &str, settings: &Settings) -> DeviceResult<Self> {
        settings.check().map_err(|wrong| {
            setup(id, "settings of a V4L2 camera", wrong).remedy("correct the camera's settings in the configuration")
        })?;
        let (picture, format) = choose_format(node, id, settings)?;
        let failed = |e| failure(id, "open", "a camera", &e);
        let interval_s = set_interval(node, &format, settings.fps).map_err(failed)?;
        let mut warnings = controls::all_manual(node).map_err(failed)?;
        warnings.extend(Settings::warning(picture.format));
        let ranges = Ranges::read(node, settings.exposure_unit_us).map_err(failed)?;
        let (exposures_s, exposure) = exposures(node, id, settings, &ranges, interval_s)?;
        Ok(Self { picture, format, ranges, interval_s, exposure, exposures_s, warnings })
    }

    pub(super) fn info(&self, id: &str, settings: &Settings) -> CameraInfo {
        // Luma has foot- and headroom unless the camera reports full range. If that is wrong, only some code range is
        // lost.
        let luma = !self.picture.format.raw() && !self.picture.is_jpeg();
        let narrow = luma && self.format.full_range != Some(true);
        let [black, white] = if narrow { [16, 235] } else { [0, self.picture.format.white()] };
        CameraInfo {
            id: id.to_owned(),
            width: self.picture.width,
            height: self.picture.height,
            exposure_s: self.exposures_s,
            exposure_now_s: self.exposure.as_secs_f64(),
            gain: self.ranges.gains(settings.gain),
            black: settings.black.unwrap_or(black),
            white: settings.white.unwrap_or(white),
            // A rolling shutter reads the rows over most of a frame period.
            readout_s: settings.readout_ms.map_or(self.interval_s.unwrap_or(INTERVAL_S), |ms| ms / 1e3),
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
}

fn setup(id: &str, expected: impl Into<Box<str>>, got: impl Into<Box<str>>) -> DeviceError {
    DeviceError::new(id, "open", expected, got).class(Class::Setup)
}

fn choose_format(node: &mut dyn Node, id: &str, settings: &Settings) -> DeviceResult<(Picture, Format)> {
    let failed = |e| failure(id, "set the format", "a picture format", &e);
    let offered = node.formats().map_err(failed)?;
    if offered.is_empty() {
        let got = "a device without picture formats";
        let remedy = "cameras have several devices, for pictures and for other data: give the one with video-index0";
        return Err(setup(id, "a camera", got).remedy(remedy));
    }
    let wanted = match &settings.format {
        Some(name) => PixelFormat::named(name).filter(|f| offered.contains(&f.fourcc)),
        None => FORMATS.into_iter().find(|f| offered.contains(&f.fourcc)),
    };
    let Some(wanted) = wanted else {
        let names: Vec<_> = offered.iter().take(64).map(|f| String::from_utf8_lossy(f).trim_end().to_owned()).collect();
        let expected = settings.format.clone().unwrap_or_else(|| "a format that Nacre reads".into());
        return Err(setup(id, expected, format!("only {}", names.join(", "))).remedy("choose another format or camera"));
    };
    let largest = |sizes: Vec<[u32; 2]>| sizes.into_iter().max_by_key(|[w, h]| u64::from(*w) * u64::from(*h));
    let size = match settings.size {
        Some(size) => size,
        None => largest(node.sizes(wanted.fourcc).map_err(failed)?).unwrap_or([640, 480]),
    };
    let got = node.set_format(wanted.fourcc, size).map_err(failed)?;
    let named = |fourcc: [u8; 4], [w, h]: [u32; 2]| format!("{} of {w} × {h}", String::from_utf8_lossy(&fourcc));
    let another = settings.size.is_some_and(|requested| requested != got.size);
    if got.fourcc != wanted.fourcc || another {
        let remedy = "choose a format and size that the camera offers";
        return Err(setup(id, named(wanted.fourcc, size), named(got.fourcc, got.size)).remedy(remedy));
    }
    let picture = picture(wanted, &got);
    picture.check().map_err(|wrong| setup(id, "pictures", wrong).remedy("choose another size or format"))?;
    Ok((picture, got))
}

/// Pictures of a stream's format, not yet checked.
pub(super) fn picture(format: PixelFormat, stream: &Format) -> Picture {
    let [width, height, stride] = [stream.size[0], stream.size[1], stream.stride].map(|v| v as usize);
    let stride = if format.layout == Layout::Jpeg { 0 } else { stride };
    Picture { format, width, height, stride }
}

/// Sets the frame rate, if requested; returns the frame interval.
fn set_interval(node: &mut dyn Node, format: &Format, fps: Option<f64>) -> io::Result<Option<f64>> {
    let wanted = match fps {
        None => None,
        Some(fps) => {
            let nearest = |a: &f64, b: &f64| (a * fps).ln().abs().total_cmp(&(b * fps).ln().abs());
            // A camera with a continuous range lists no intervals.
            let offered = node.intervals(format)?.into_iter().filter(|s| s.is_finite() && *s > 0.0);
            Some(offered.min_by(nearest).unwrap_or(1.0 / fps))
        }
    };
    Ok(node.interval(wanted)?.filter(|s| s.is_finite() && *s > 0.0 && *s < 3600.0))
}

/// Shortest and longest exposure, and the one in force.
fn exposures(
    node: &mut dyn Node,
    id: &str,
    settings: &Settings,
    ranges: &Ranges,
    interval_s: Option<f64>,
) -> DeviceResult<([f64; 2], Duration)> {
    if let Some(ms) = settings.exposure_ms {
        return Ok(([ms / 1e3; 2], Duration::from_secs_f64(ms / 1e3)));
    }
    let (Some([low, high]), Some(control)) = (ranges.exposures(), ranges.exposure) else {
        if controls::has_unitless_exposure(node).map_err(|e| failure(id, "read the exposure", "a value", &e))? {
            let remedy = "give the duration of one step as `exposure_unit_us`, for a sensor its line time";
            return Err(setup(id, "an exposure in 100 µs", "an exposure control of unknown unit").remedy(remedy));
        }
        let remedy = "choose another camera, or set its exposure by its maker's tools and give it as `exposure_ms`";
        return Err(setup(id, "a manual exposure in 100 µs", "a camera without this control").remedy(remedy));
    };
    let now = control.get(node).map_err(|e| failure(id, "read the exposure", "a value", &e))?;
    // Most cameras accept exposures longer than a frame without applying them.
    Ok(([low, interval_s.map_or(high, |s| high.min(s)).max(low)], now))
}
