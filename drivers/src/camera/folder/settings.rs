//! Configuration of a folder of photographs as the camera of a bench.

use crate::camera::photograph::Channel;
use crate::flash::{lcus, relay, serial_line};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Photographs in a folder, where another program or a memory card puts them.
///
/// Exposure and sensitivity are set on the camera, and compared with the Exif tags of each photograph. The folder must
/// contain one photograph before the camera is opened, from which size, levels and camera are known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Folder in which photographs appear.
    pub path: String,
    /// Release of the shutter.
    #[serde(default)]
    pub trigger: Trigger,
    /// Duration in ms for which a switched shutter cable is closed.
    #[serde(default = "hold_ms")]
    pub hold_ms: f64,
    /// Maximum time in s from the end of an exposure until its photograph is complete in the folder.
    #[serde(default = "wait_s")]
    pub wait_s: f64,
    /// Sensitivity (ISO) that has a gain of 1.
    #[serde(default = "iso")]
    pub iso: f64,
    /// Exposures in s that the camera offers; default: the usual ones in thirds of a stop, from 1/8000 s to 30 s.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exposures_s: Vec<f64>,
    /// Colour channel that becomes the frame.
    #[serde(default)]
    pub channel: Channel,
}

/// Release of the shutter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Trigger {
    /// The operator takes the photograph on request.
    Hand {},
    /// A control line of a serial port closes the shutter cable.
    SerialLine(serial_line::Settings),
    /// A HID relay closes the shutter cable.
    Relay(relay::Settings),
    /// A relay of an LCUS board closes the shutter cable.
    Lcus(lcus::Settings),
}

impl Default for Trigger {
    fn default() -> Self {
        Self::Hand {}
    }
}

fn hold_ms() -> f64 {
    200.0
}

fn wait_s() -> f64 {
    30.0
}

fn iso() -> f64 {
    100.0
}

/// Exposures in s that cameras offer, with the values of their labels.
const USUAL_S: [f64; 19] =
    [30.0, 25.0, 20.0, 15.0, 13.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.2, 2.5, 2.0, 1.6, 1.3, 1.0, 0.8, 0.6, 0.5];
/// Denominators of the shorter ones.
const USUAL_PARTS: [f64; 36] = [
    2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 125.0, 160.0,
    200.0, 250.0, 320.0, 400.0, 500.0, 640.0, 800.0, 1000.0, 1250.0, 1600.0, 2000.0, 2500.0, 3200.0, 4000.0, 5000.0,
    6400.0, 8000.0,
];

impl Settings {
    /// Default settings for a folder.
    pub fn new(path: &str) -> Self {
        Self {
            path: path.to_owned(),
            trigger: Trigger::default(),
            hold_ms: hold_ms(),
            wait_s: wait_s(),
            iso: iso(),
            exposures_s: vec![],
            channel: Channel::default(),
        }
    }

    /// Exposures of the camera in s.
    pub(super) fn exposures(&self) -> Vec<f64> {
        if !self.exposures_s.is_empty() {
            return self.exposures_s.clone();
        }
        USUAL_S.into_iter().chain(USUAL_PARTS.into_iter().map(|part| 1.0 / part)).collect()
    }

    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
    pub fn check(&self) -> Result<(), String> {
        let within = |key: &str, value: f64, low: f64, high: f64| match value {
            v if v >= low && v <= high => Ok(()),
            v => Err(format!("{key} is {v}; give {low} to {high}")),
        };
        if self.path.is_empty() || self.path.contains('\0') || !Path::new(&self.path).is_absolute() {
            return Err(format!("path is {:?}; give an absolute path of a folder", self.path));
        }
        if let Trigger::Lcus(board) = &self.trigger {
            board.check().map_err(|e| format!("trigger: {e}"))?;
        }
        within("hold_ms", self.hold_ms, 10.0, 10_000.0)?;
        within("wait_s", self.wait_s, 1.0, 3600.0)?;
        within("iso", self.iso, 1.0, 1e6)?;
        self.exposures_s.iter().try_for_each(|s| within("exposures_s", *s, 1e-6, 3600.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_are_wrong_are_named() {
        let right = Settings::new("/srv/photographs");
        assert_eq!(right.check(), Ok(()));
        let text = "{\"path\":\"/srv/photographs\",\"trigger\":{\"kind\":\"hand\"}}";
        assert_eq!(serde_json::from_str::<Settings>(text).unwrap(), right);
        for (wrong, key) in [
            (Settings::new("photographs"), "path"),
            (Settings { hold_ms: f64::NAN, ..right.clone() }, "hold_ms"),
            (Settings { wait_s: 0.0, ..right.clone() }, "wait_s"),
            (Settings { iso: 0.0, ..right.clone() }, "iso"),
            (Settings { exposures_s: vec![0.0], ..right.clone() }, "exposures_s"),
        ] {
            assert!(wrong.check().unwrap_err().contains(key), "{key}");
        }
        let usual = right.exposures();
        assert!(usual.contains(&(1.0 / 60.0)) && usual.contains(&30.0) && usual.contains(&(1.0 / 8000.0)));
    }
}
