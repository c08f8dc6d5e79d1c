//! Configuration of a camera of libgphoto2 in a bench.

use crate::camera::photograph::Channel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Longest accepted name of a camera.
const MAX_NAME: usize = 256;

/// A digital camera at a USB cable, through the library libgphoto2.
///
/// The driver sets shutter speed, aperture, sensitivity and image format, takes photographs and fetches them. The
/// camera's dial must be at M (manual exposure).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Model of the camera, as shown by `nacre devices`, or its port, such as `usb:001,005`; default: the only camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Serial number of the camera; required if several of the same model are connected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// f-number, such as 8; default: as set on the camera or lens.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aperture: Option<f64>,
    /// Format of the photographs.
    #[serde(default)]
    pub format: Format,
    /// Colour channel that becomes the frame.
    #[serde(default)]
    pub channel: Channel,
    /// Permitted sensitivities (ISO); the lowest has a gain of 1. Default: all of the camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub iso: Vec<f64>,
}

/// Format of photographs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Camera raw files, linear in light.
    #[default]
    Raw,
    /// JPEG, lossy and not linear.
    Jpeg,
}

impl Settings {
    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
    pub fn check(&self) -> Result<(), String> {
        for (key, text) in [("device", &self.device), ("serial", &self.serial)] {
            if text.as_ref().is_some_and(|t| t.trim().is_empty() || t.len() > MAX_NAME || t.contains('\0')) {
                return Err(format!("{key} is not the name of a camera; take one from `nacre devices`"));
            }
        }
        let within = |key: &str, value: f64, low: f64, high: f64| match value {
            v if v >= low && v <= high => Ok(()),
            v => Err(format!("{key} is {v}; give {low} to {high}")),
        };
        self.aperture.map_or(Ok(()), |f| within("aperture", f, 0.5, 256.0))?;
        self.iso.iter().try_for_each(|iso| within("iso", *iso, 1.0, 1e7))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_are_wrong_are_named() {
        let right = Settings::default();
        assert_eq!(right.check(), Ok(()));
        assert_eq!(serde_json::from_str::<Settings>("{}").unwrap(), right);
        for (wrong, key) in [
            (Settings { device: Some(" ".into()), ..right.clone() }, "device"),
            (Settings { serial: Some("a\0".into()), ..right.clone() }, "serial"),
            (Settings { aperture: Some(f64::NAN), ..right.clone() }, "aperture"),
            (Settings { iso: vec![100.0, 0.0], ..right.clone() }, "iso"),
        ] {
            assert!(wrong.check().unwrap_err().contains(key), "{key}");
        }
    }
}
