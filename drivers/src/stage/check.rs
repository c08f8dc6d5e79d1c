//! Common checks of stages: configured values, with the invalid key and its valid values, and angles.

use crate::{Class, DeviceError, DeviceResult};
use std::path::Path;

/// Longest configurable time in ms.
const MAX_MS: u64 = 3_600_000;

pub(super) fn port(port: &Path) -> Result<(), String> {
    if port.as_os_str().is_empty() {
        return Err("port is missing; give the serial port, such as /dev/ttyUSB0".into());
    }
    Ok(())
}

pub(super) fn milliseconds(key: &str, value: u64, least: u64) -> Result<(), String> {
    if (least..=MAX_MS).contains(&value) {
        return Ok(());
    }
    Err(format!("{key} is {value}; give {least} to {MAX_MS}"))
}

pub(super) fn number(key: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(format!("{key} is {value}; give {low} to {high}"))
}

pub(super) fn limits([low, high]: [f64; 2]) -> Result<(), String> {
    number("limits_deg", low, -1e5, 1e5)?;
    number("limits_deg", high, -1e5, 1e5)?;
    if high - low >= 1.0 {
        return Ok(());
    }
    Err(format!("limits_deg is [{low}, {high}]; give the lower angle first"))
}

/// Checks that an angle lies within the limits. `whose` names the limits to correct: those of the stage or of the
/// mounting.
pub(super) fn angle(device: &str, what: &str, angle_deg: f64, limits_deg: [f64; 2], whose: &str) -> DeviceResult<()> {
    let [low, high] = limits_deg;
    if angle_deg >= low && angle_deg <= high {
        return Ok(());
    }
    Err(DeviceError::new(device, what, format!("an angle from {low}° to {high}°"), format!("{angle_deg}°"))
        .remedy(format!("correct the plan, or limits_deg of the {whose}"))
        .class(Class::Setup))
}
