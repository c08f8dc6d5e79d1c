//! `[bench]` of `nacre.toml`: which devices make the bench.

use nacre_drivers::camera::{CameraConfig, CameraDriver};
use nacre_drivers::display::{DisplayConfig, DisplayDriver};
use nacre_drivers::flash::{FlashConfig, FlashDriver};
use nacre_drivers::stage::{StageConfig, StageDriver};
use nacre_drivers::{DeviceLock, DeviceResult};
use nacre_processing::frames::Geometry;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

use crate::session::Setup;

/// Which bench: the simulated one, devices of this machine, or these beside simulated ones.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BenchSection {
    /// Devices that are not described below are simulated.
    pub sim: bool,
    /// Description of the simulated bench (bench.toml).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// The simulated bench in a process of its own, behind this socket.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub socket: Option<PathBuf>,
    /// What turns the analyser.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<StageConfig>,
    /// What takes the frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraConfig>,
    /// What lights the sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display: Option<DisplayConfig>,
    /// What lights it too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flash: Option<FlashConfig>,
    /// Colour and distances, for a bench whose camera is real.
    #[serde(skip_serializing_if = "Optics::is_unknown")]
    pub optics: Optics,
}

/// Colour and distances of a bench, where known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Optics {
    /// Middle of the filter's band.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Width of the filter's band.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_nm: Option<f64>,
    /// From the sample to camera and panel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_mm: Option<f64>,
    /// From the camera's lens to the middle of the panel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baseline_mm: Option<f64>,
    /// Size of a pixel on the sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_um: Option<f64>,
}

impl Optics {
    fn is_unknown(&self) -> bool {
        *self == Self::default()
    }

    fn check(&self) -> Result<(), String> {
        let values = [
            ("wavelength_nm", self.wavelength_nm, 100.0, 1e5),
            ("band_nm", self.band_nm, 0.0, 1e4),
            ("distance_mm", self.distance_mm, 1.0, 1e6),
            ("baseline_mm", self.baseline_mm, 0.0, 1e6),
            ("pixel_um", self.pixel_um, 1e-3, 1e6),
        ];
        let bad = values.iter().find(|(_, value, low, high)| value.is_some_and(|v| !(v >= *low && v <= *high)));
        bad.map_or(Ok(()), |(key, value, low, high)| {
            Err(format!("bench.optics.{key} is {}; give {low} to {high}", value.unwrap_or_default()))
        })
    }

    /// What a session's description says of it.
    pub fn setup(&self) -> Setup {
        let geometry = match (self.distance_mm, self.baseline_mm) {
            (Some(distance_mm), Some(baseline_mm)) => {
                Some(Geometry { distance_mm, baseline_mm, pixel_um: self.pixel_um, camera_px: None })
            }
            _ => None,
        };
        Setup { wavelength_nm: self.wavelength_nm, band_nm: self.band_nm.filter(|b| *b > 0.0), geometry }
    }
}

impl BenchSection {
    /// Says what is wrong with it.
    ///
    /// # Errors
    /// The key and what it must be.
    pub fn check(&self) -> Result<(), String> {
        self.stage.as_ref().map_or(Ok(()), |s| s.mounting.check().map_err(|e| format!("bench.stage.{e}")))?;
        self.optics.check()?;
        if self.has_real_camera() && self.sim {
            return Err("bench.sim is true, but the camera is real: its clock is not that of simulated devices; \
                        describe all devices, or leave the camera out"
                .into());
        }
        if self.sim && self.socket.is_none() && self.has_real_device() && !self.by_hand() {
            return Err(
                "bench.sim is true without a socket, but devices are described: the simulated sample would not \
                        see them; run `nacre sim bench --socket PATH` and `nacre sim attach`, and give bench.socket"
                    .into(),
            );
        }
        Ok(())
    }

    /// Whether the frames are of this machine's camera.
    pub fn has_real_camera(&self) -> bool {
        self.camera.as_ref().is_some_and(|c| !matches!(c.driver, CameraDriver::Simulated {}))
    }

    /// Whether any device is described that is not simulated.
    pub fn has_real_device(&self) -> bool {
        self.has_real_camera()
            || self.stage.as_ref().is_some_and(|s| !matches!(s.driver, StageDriver::Simulated {}))
            || self.display.as_ref().is_some_and(|d| !matches!(d.driver, DisplayDriver::Simulated {}))
            || self.flash.as_ref().is_some_and(|f| !matches!(f.driver, FlashDriver::Simulated {}))
    }

    /// Whether the analyser is turned by a person.
    pub fn by_hand(&self) -> bool {
        self.stage.as_ref().is_some_and(|s| matches!(s.driver, StageDriver::Hand {}))
    }

    /// Takes the locks of all devices of this machine, before any of them is opened: opening a flash switches it off.
    ///
    /// # Errors
    /// `Setup`, naming the holder.
    pub fn lock(&self) -> DeviceResult<Vec<DeviceLock>> {
        self.lock_names().iter().map(|name| DeviceLock::take(name, "")).collect()
    }

    /// What the locks of its devices are called: driver and whatever tells one from another.
    pub fn lock_names(&self) -> Vec<String> {
        let drivers = [
            self.stage.as_ref().map(|s| serde_json::to_value(&s.driver)),
            self.camera.as_ref().map(|c| serde_json::to_value(&c.driver)),
            self.display.as_ref().map(|d| serde_json::to_value(&d.driver)),
            self.flash.as_ref().map(|f| serde_json::to_value(&f.driver)),
        ];
        drivers.into_iter().flatten().flatten().filter_map(|driver| lock_name(&driver)).collect()
    }
}

/// Keys of settings that say which device it is.
const NAMING: [&str; 8] = ["kind", "port", "address", "device", "serial", "path", "output", "card"];

/// What the lock of a device with these settings is called; None for what is no device of this machine.
pub fn lock_name(driver: &serde_json::Value) -> Option<String> {
    let kind = driver.get("kind")?.as_str()?;
    if matches!(kind, "simulated" | "hand" | "page") {
        return None;
    }
    let plain = |v: &serde_json::Value| v.as_str().map_or_else(|| v.to_string(), str::to_owned);
    let words = NAMING.iter().filter_map(|key| driver.get(key)).filter(|v| !v.is_null()).map(plain);
    Some(words.collect::<Vec<_>>().join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_together_is_refused() {
        let read = |text: &str| toml::from_str::<BenchSection>(text).map_err(|e| e.to_string()).and_then(|s| s.check());
        assert_eq!(read("sim = true\nstage = { driver = { kind = \"hand\" } }"), Ok(()));
        for (text, words) in [
            ("stage = { driver = { kind = \"hand\" }, mounting = { gear = 0 } }", "bench.stage.mounting.gear"),
            ("stage = { driver = { kind = \"robot\" } }", "robot"),
            ("optics = { distance_mm = -3 }", "bench.optics.distance_mm"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }
}
