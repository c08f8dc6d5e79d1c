//! Camera controls: automatic functions off, then manual values, then readback of the values in force.

use super::node::{Node, Range};
use super::settings::GainScale;
use std::io;
use std::time::Duration;

/// Exposure control of cameras, in units of 100 µs.
pub const EXPOSURE: u32 = 0x009a_0902;
/// Exposure control without a defined unit, for drivers without [`EXPOSURE`].
pub const UNITLESS_EXPOSURE: u32 = 0x0098_0911;
/// Gain control, in camera-specific units.
pub const GAIN: u32 = 0x0098_0913;
/// Analogue gain control of the sensor, for drivers without [`GAIN`].
pub const ANALOGUE_GAIN: u32 = 0x009e_0903;

/// Unit of [`EXPOSURE`] in µs.
const EXPOSURE_UNIT_US: f64 = 100.0;

/// Automatic functions to disable: control, name, and the value that disables it. Mode switches come first, since
/// cameras refuse manual values before. Missing controls are skipped.
const OFF: [(u32, &str, i64); 14] = [
    (0x009a_0901, "automatic exposure", 1),
    (0x009a_0903, "priority of exposure over the frame rate", 0),
    (0x0098_0912, "automatic gain", 0),
    (0x0098_090c, "automatic white balance", 0),
    (0x009a_090c, "automatic focus", 0),
    (0x0098_0918, "suppression of mains flicker", 0),
    (0x0098_0920, "automatic brightness", 0),
    (0x0098_0919, "automatic hue", 0),
    (0x0098_091c, "backlight compensation", 0),
    (0x009a_0915, "wide dynamic range", 0),
    (0x009a_0916, "image stabilization", 0),
    (0x009a_0913, "bias of the exposure", 0),
    (0x0098_091b, "sharpening", 0),
    // Hundredths of the exponent.
    (0x0098_0910, "gamma", 100),
];

/// Control of the exposure.
#[derive(Clone, Copy, Debug)]
pub struct ExposureControl {
    id: u32,
    range: Range,
    /// Duration of one step of the value in µs.
    unit_us: f64,
}

/// Ranges of exposure and gain.
#[derive(Clone, Copy, Debug)]
pub struct Ranges {
    /// Exposure control; `None` without one, or with one of unknown unit.
    pub exposure: Option<ExposureControl>,
    /// Gain control and its range; `None` without a control.
    pub gain: Option<(u32, Range)>,
}

impl Ranges {
    /// Reads the ranges. `exposure_unit_us` is the duration of one step of the exposure control, if the user knows it.
    ///
    /// # Errors
    /// As the kernel.
    pub fn read(node: &mut dyn Node, exposure_unit_us: Option<f64>) -> io::Result<Self> {
        let mut exposure = None;
        for (id, unit) in
            [(EXPOSURE, exposure_unit_us.or(Some(EXPOSURE_UNIT_US))), (UNITLESS_EXPOSURE, exposure_unit_us)]
        {
            if let (None, Some(unit_us), Some(range)) = (exposure, unit, usable(node.range(id)?)) {
                exposure = Some(ExposureControl { id, range, unit_us });
            }
        }
        for id in [GAIN, ANALOGUE_GAIN] {
            if let Some(range) = usable(node.range(id)?) {
                return Ok(Self { exposure, gain: Some((id, range)) });
            }
        }
        Ok(Self { exposure, gain: None })
    }

    /// Lowest and highest gain.
    pub fn gains(&self, scale: GainScale) -> [f64; 2] {
        match self.gain {
            // A gain of 0 is invalid, even if the camera's range includes it.
            Some((_, Range { low, high, .. })) => match scale {
                GainScale::Unity(_) => [low.max(1), high].map(|v| scale.linear(v, low)),
                GainScale::DbPerStep(_) => [low, high].map(|v| scale.linear(v, low)),
                GainScale::Lowest => [1.0, 1.0],
            },
            None => [1.0, 1.0],
        }
    }

    /// Shortest and longest exposure in s; `None` without a control.
    pub fn exposures(&self) -> Option<[f64; 2]> {
        self.exposure
            .map(|control| [control.range.low.max(1), control.range.high].map(|v| v as f64 * control.unit_us / 1e6))
    }
}

/// The range of a control that can be set.
fn usable(range: Option<Range>) -> Option<Range> {
    range.filter(|r| !r.fixed && r.high > 0 && r.high >= r.low)
}

/// Disables the automatic functions. Returns the names of those that remain active.
///
/// # Errors
/// If the device is gone.
pub fn all_manual(node: &mut dyn Node) -> io::Result<Vec<String>> {
    let mut left = Vec::new();
    for (id, name, off) in OFF {
        let Some(range) = node.range(id)? else { continue };
        let wanted = range.nearest(off as f64);
        if !range.fixed {
            match node.set(id, wanted) {
                Err(e) if is_gone(&e) => return Err(e),
                // The readback decides, not the error of the setter.
                _ => {}
            }
        }
        match node.get(id) {
            Err(e) if is_gone(&e) => return Err(e),
            Ok(value) if value != off => left.push(format!("{name} is {value} in place of {off}")),
            _ => {}
        }
    }
    Ok(left)
}

impl ExposureControl {
    /// Sets the exposure, rounded to the nearest supported value; returns the one in force.
    ///
    /// # Errors
    /// As the kernel.
    pub fn set(&self, node: &mut dyn Node, exposure: Duration) -> io::Result<Duration> {
        let Range { low, step, .. } = self.range;
        // An exposure of 0 is invalid, even if the camera's range includes it.
        let range = Range { low: if low < 1 { low + step.max(1) } else { low }, ..self.range };
        node.set(self.id, range.nearest(exposure.as_secs_f64() * 1e6 / self.unit_us).max(1))?;
        self.get(node)
    }

    /// Exposure in force.
    ///
    /// # Errors
    /// As the kernel.
    pub fn get(&self, node: &mut dyn Node) -> io::Result<Duration> {
        let value = node.get(self.id)?.clamp(0, 1 << 32);
        // Whole ns, so that equal values give equal times.
        Ok(Duration::from_nanos((value as f64 * self.unit_us * 1e3).round() as u64))
    }
}

/// Whether the camera has an exposure control of unknown unit.
///
/// # Errors
/// As the kernel.
pub fn has_unitless_exposure(node: &mut dyn Node) -> io::Result<bool> {
    Ok(usable(node.range(UNITLESS_EXPOSURE)?).is_some())
}

/// Sets the gain, rounded to the nearest supported value; returns the one in force.
///
/// # Errors
/// As the kernel.
pub fn amplify(node: &mut dyn Node, ranges: &Ranges, scale: GainScale, gain: f64) -> io::Result<f64> {
    let Some((id, range)) = ranges.gain else { return Ok(1.0) };
    node.set(id, range.nearest(scale.value(gain, range.low)))?;
    let value = node.get(id)?;
    Ok(match scale {
        // The unit is unknown: the result only shows that the gain is not the lowest.
        GainScale::Lowest if value != range.low => 1.0 + value.abs_diff(range.low) as f64,
        _ => scale.linear(value, range.low),
    })
}

/// Whether the error means that the device is gone.
pub fn is_gone(e: &io::Error) -> bool {
    const GONE: [rustix::io::Errno; 3] =
        [rustix::io::Errno::NODEV, rustix::io::Errno::NXIO, rustix::io::Errno::SHUTDOWN];
    e.raw_os_error().is_some_and(|code| GONE.iter().any(|g| g.raw_os_error() == code))
}
