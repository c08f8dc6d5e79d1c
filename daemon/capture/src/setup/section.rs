//! `[bench]` of `nacre.toml`: devices of the bench.

use super::Setup;
use nacre_drivers::camera::{CameraConfig, CameraDriver};
use nacre_drivers::display::{DisplayConfig, DisplayDriver};
use nacre_drivers::flash::{FlashConfig, FlashDriver};
use nacre_drivers::interlock::InterlockConfig;
use nacre_drivers::stage::{Mounting, StageConfig, StageDriver};
use nacre_drivers::{DeviceLock, DeviceResult};
use nacre_frames::Distances;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Devices of the bench: simulated ones, devices of this machine, or a mixture of both.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BenchSection {
    /// True to simulate all devices that are not configured below.
    pub sim: bool,
    /// Description of the simulated bench (bench.toml).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Socket of a simulated bench in another process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub socket: Option<PathBuf>,
    /// Stage that rotates the analyser.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<StageConfig>,
    /// Camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraConfig>,
    /// Panel that lights the sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display: Option<DisplayConfig>,
    /// Flash.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flash: Option<FlashConfig>,
    /// Interlocks, which must be closed while anything moves or emits light.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub interlocks: Vec<InterlockConfig>,
    /// Wavelength and distances, for a bench with a real camera.
    #[serde(skip_serializing_if = "Optics::is_unknown")]
    pub optics: Optics,
}

/// Wavelength and distances of a bench, if known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Optics {
    /// Centre wavelength of the filter in nm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Bandwidth of the filter in nm (full width at half maximum).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_nm: Option<f64>,
    /// Distance in mm from the sample to camera and panel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_mm: Option<f64>,
    /// Distance in mm from the camera's lens to the centre of the panel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baseline_mm: Option<f64>,
    /// Pixel size on the sample in µm.
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

    /// Optics and distances for a session's description.
    pub fn setup(&self) -> Setup {
        let geometry = match (self.distance_mm, self.baseline_mm) {
            (Some(distance_mm), Some(baseline_mm)) => {
                Some(Distances { distance_mm, baseline_mm, pixel_um: self.pixel_um, camera_px: None })
            }
            _ => None,
        };
        Setup {
            wavelength_nm: self.wavelength_nm,
            band_nm: self.band_nm.filter(|b| *b > 0.0),
            geometry,
            panel_mm: None,
        }
    }
}

impl BenchSection {
    /// Validates the section.
    ///
    /// # Errors
    /// The key and its permitted values.
    pub fn check(&self) -> Result<(), String> {
        self.stage.as_ref().map_or(Ok(()), |s| s.mounting.check().map_err(|e| format!("bench.stage.{e}")))?;
        self.display.as_ref().map_or(Ok(()), |d| d.check().map_err(|e| format!("bench.display.{e}")))?;
        self.flash.as_ref().map_or(Ok(()), |f| f.check().map_err(|e| format!("bench.flash.{e}")))?;
        self.check_interlocks()?;
        self.optics.check()?;
        if self.has_real_camera() && self.sim {
            return Err("bench.sim is true, but the camera is real: its clock is not that of simulated devices; \
                        describe all devices, or leave the camera out"
                .into());
        }
        if self.sim && self.socket.is_none() && self.has_real_device() {
            return Err(
                "bench.sim is true without a socket, but devices are described: the simulated sample would not \
                        see them; run `nacre sim bench --socket PATH` and `nacre sim attach`, and give bench.socket"
                    .into(),
            );
        }
        Ok(())
    }

    /// Checks the interlocks: each has its own name, and its serial port belongs to no other device, which would change
    /// the port's lines and speed.
    fn check_interlocks(&self) -> Result<(), String> {
        for (k, interlock) in self.interlocks.iter().enumerate() {
            interlock.check().map_err(|e| format!("bench.interlocks[{k}].{e}"))?;
            if self.interlocks[..k].iter().any(|other| other.name == interlock.name) {
                return Err(format!(
                    "bench.interlocks[{k}].name is {:?}, like that of another interlock",
                    interlock.name
                ));
            }
            let shared = interlock.port().and_then(|port| self.device_at(port));
            if let Some(device) = shared {
                return Err(format!(
                    "bench.interlocks[{k}].driver.port is that of bench.{device}; give the interlock its own port"
                ));
            }
        }
        Ok(())
    }

    /// The stage or flash at a serial port.
    fn device_at(&self, port: &str) -> Option<&'static str> {
        let node = |path: &str| Path::new(path).canonicalize().unwrap_or_else(|_| path.into());
        let drivers = [
            ("stage", self.stage.as_ref().map(|s| serde_json::to_value(&s.driver))),
            ("flash", self.flash.as_ref().map(|f| serde_json::to_value(&f.driver))),
        ];
        drivers.into_iter().find_map(|(name, driver)| {
            let driver = driver?.ok()?;
            (node(driver.get("port")?.as_str()?) == node(port)).then_some(name)
        })
    }

    /// True if the frames come from a camera of this machine.
    pub(crate) fn has_real_camera(&self) -> bool {
        self.camera.as_ref().is_some_and(|c| !matches!(c.driver, CameraDriver::Simulated {}))
    }

    /// True if any real device is configured; a person who rotates the analyser does not count.
    pub fn has_real_device(&self) -> bool {
        self.has_real_camera()
            || self
                .stage
                .as_ref()
                .is_some_and(|s| !matches!(s.driver, StageDriver::Simulated {} | StageDriver::Hand {}))
            || self.display.as_ref().is_some_and(|d| !matches!(d.driver, DisplayDriver::Simulated {}))
            || self.flash.as_ref().is_some_and(|f| !matches!(f.driver, FlashDriver::Simulated {}))
    }

    /// True if the panel is a page of the service.
    pub fn has_page(&self) -> bool {
        self.display.as_ref().is_some_and(|d| matches!(d.driver, DisplayDriver::Page { .. }))
    }

    /// Mounting of the analyser on its stage, if it is not the default.
    pub fn mounting(&self) -> Option<Mounting> {
        self.stage.as_ref().map(|stage| stage.mounting).filter(|mounting| *mounting != Mounting::default())
    }

    /// True if a person rotates the analyser.
    pub fn by_hand(&self) -> bool {
        self.stage.as_ref().is_some_and(|s| matches!(s.driver, StageDriver::Hand {}))
    }

    /// The first key with an effect on frames that differs from `other`, and both values. Zero, sense, delays and
    /// distances have an effect; the connection of a device, its time limits and the interlocks have none.
    pub fn differs(&self, other: &Self) -> Option<String> {
        let [here, there] = [self, other].map(|section| {
            let mut value = serde_json::to_value(section).unwrap_or_default();
            for device in ["stage", "camera", "display", "flash"] {
                if let Some(driver) = value.get_mut(device).and_then(|d| d.get_mut("driver")) {
                    forget(driver, &REACH);
                }
            }
            if let Some(bench) = value.as_object_mut() {
                bench.retain(|key, _| !["file", "socket", "interlocks"].contains(&key.as_str()));
            }
            value
        });
        difference("bench", &here, &there)
    }

    /// Locks all devices of this machine before any is opened, because opening a flash switches it off.
    ///
    /// # Errors
    /// `Setup`, naming the holder.
    pub fn lock(&self) -> DeviceResult<Vec<DeviceLock>> {
        let drivers = [
            self.stage.as_ref().map(|s| serde_json::to_value(&s.driver)),
            self.camera.as_ref().map(|c| serde_json::to_value(&c.driver)),
            self.display.as_ref().map(|d| serde_json::to_value(&d.driver)),
            self.flash.as_ref().map(|f| serde_json::to_value(&f.driver)),
        ];
        let drivers: Vec<Value> = drivers.into_iter().flatten().flatten().collect();
        // The output at a camera's shutter cable is a device, too.
        let triggers = drivers.iter().filter_map(|driver| driver.get("trigger").filter(|t| t.is_object()));
        let names = drivers.iter().chain(triggers).filter_map(lock_name);
        names.map(|(kind, place)| DeviceLock::take(&kind, &place)).collect()
    }
}

/// Driver settings for the connection of a device and its time limits; its identity shows whether it is the same
/// device.
const REACH: [&str; 17] = [
    "port",
    "baud",
    "address",
    "device",
    "path",
    "serial",
    "output",
    "card",
    "buffers",
    "packet_size",
    "answer_ms",
    "start_ms",
    "move_ms",
    "home_ms",
    "rotator",
    "camera",
    "switch",
];

fn forget(value: &mut Value, keys: &[&str]) {
    if let Some(object) = value.as_object_mut() {
        object.retain(|key, _| !keys.contains(&key.as_str()));
        object.values_mut().for_each(|inner| forget(inner, keys));
    }
}

/// The first key whose values differ, with both values.
fn difference(key: &str, here: &Value, there: &Value) -> Option<String> {
    match (here.as_object(), there.as_object()) {
        (Some(a), Some(b)) => a.keys().chain(b.keys()).find_map(|name| {
            let [a, b] = [a, b].map(|object| object.get(name).unwrap_or(&Value::Null));
            difference(&format!("{key}.{name}"), a, b)
        }),
        _ => (here != there).then(|| format!("{key} is {here} and not {there}")),
    }
}

/// Name of the lock of a device with these settings (kind and location), independent of their spelling: a device node
/// has the same number under each of its names. `None` for a device that is not of this machine.
///
/// Automatically detected lamps on HID and USB share one lock per kind, since detection opens all of them.
pub fn lock_name(driver: &Value) -> Option<(String, String)> {
    let kind = driver.get("kind")?.as_str()?;
    let path = ["port", "device", "path", "output"].iter().find_map(|key| driver.get(key)?.as_str());
    let place = match (kind, path) {
        ("simulated" | "hand" | "page", _) => return None,
        (_, Some(path)) if path.starts_with("unix:") => {
            let socket = Path::new(&path["unix:".len()..]);
            socket.canonicalize().unwrap_or_else(|_| socket.to_path_buf()).to_string_lossy().into_owned()
        }
        ("relay" | "blink1" | "bulk", _) => String::new(),
        ("alpaca" | "indi", _) => {
            let part = |key: &str| Some(format!("{key} {}", driver.get(key)?.to_string().to_ascii_lowercase()));
            let parts = ["address", "rotator", "camera", "switch", "device"].into_iter().filter_map(part);
            parts.collect::<Vec<_>>().join(" ")
        }
        (_, path) => {
            let path = path.unwrap_or_default();
            let node = Path::new(path).canonicalize().unwrap_or_default();
            // The numbers of pseudo-terminals, used by emulated devices, are soon reused by others.
            let found = std::fs::metadata(&node).ok().filter(|f| f.rdev() != 0 && !node.starts_with("/dev/pts"));
            found.map_or_else(|| path.to_owned(), |found| format!("{:x}", found.rdev()))
        }
    };
    Some((kind.to_owned(), place))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_has_one_lock_under_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("stage");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        let name = |port: &Path, kind: &str| lock_name(&serde_json::json!({ "kind": kind, "port": port })).unwrap();
        assert_eq!(name(&link, "elliptec"), name(Path::new("/dev/null"), "elliptec"));
        assert_ne!(name(&link, "elliptec"), name(Path::new("/dev/zero"), "elliptec"));
        let relay = |settings| lock_name(&settings).unwrap();
        let found = relay(serde_json::json!({ "kind": "relay", "channel": 1 }));
        assert_eq!(found, relay(serde_json::json!({ "kind": "relay", "serial": "6QMBS", "path": "/dev/nacre-relay" })));
        assert_ne!(found, relay(serde_json::json!({ "kind": "relay", "path": "unix:/tmp/a" })));
        let alpaca = |settings| lock_name(&settings).unwrap();
        let rotator = alpaca(serde_json::json!({ "kind": "alpaca", "address": "A:1", "rotator": 0 }));
        assert_eq!(
            rotator,
            alpaca(serde_json::json!({ "kind": "alpaca", "address": "a:1", "rotator": 0, "motion": {} }))
        );
        assert_ne!(rotator, alpaca(serde_json::json!({ "kind": "alpaca", "address": "a:1", "camera": 0 })));
        assert_eq!(lock_name(&serde_json::json!({ "kind": "page", "size_mm": [1, 2] })), None);
    }

    #[test]
    fn only_settings_that_affect_frames_make_another_bench() {
        let section = |text: &str| toml::from_str::<BenchSection>(text).unwrap();
        let text = "
            socket = \"/run/a\"
            [stage]
            driver = { kind = \"elliptec\", port = \"/dev/ttyUSB0\", settling_ms = 100, tolerance_deg = 0.2 }
            mounting = { zero_deg = 10 }
            [camera]
            driver = { kind = \"v4l2\", device = \"/dev/video0\", control_lag_frames = 2 }
            [display]
            driver = { kind = \"kms\", output = \"HDMI-A-1\" }
            response_ms = 50
            [flash]
            driver = { kind = \"blink1\", path = \"/dev/hidraw0\", rgb = [255, 255, 255] }
            [optics]
            distance_mm = 600
        ";
        let original = section(text);
        for (old, new) in [
            ("\"/run/a\"", "\"/run/b\""),
            ("ttyUSB0", "serial/by-id/usb-FTDI"),
            ("settling_ms = 100", "settling_ms = 100, answer_ms = 900, move_ms = 20000, address = \"2\""),
            ("/dev/video0", "/dev/v4l/by-id/usb-camera"),
            ("control_lag_frames = 2", "control_lag_frames = 2, buffers = 8"),
            ("\"HDMI-A-1\"", "\"HDMI-A-2\", card = \"/dev/dri/card1\""),
            ("path = \"/dev/hidraw0\"", "serial = \"1234\""),
            (
                "[optics]",
                "[[interlocks]]\nname = \"door\"\ndriver = { kind = \"gpio\", chip = \"/dev/gpiochip0\", line = 4 }\n[optics]",
            ),
        ] {
            let other = section(&text.replace(old, new));
            assert!(other != original, "{new}");
            assert_eq!(original.differs(&other), None, "{new}");
        }
        for (old, new, key) in [
            ("zero_deg = 10", "zero_deg = 11", "bench.stage.mounting.zero_deg is 10.0 and not 11.0"),
            ("zero_deg = 10", "zero_deg = 10, sense = \"clockwise\"", "bench.stage.mounting.sense"),
            ("settling_ms = 100", "settling_ms = 0", "bench.stage.driver.settling_ms"),
            ("tolerance_deg = 0.2", "tolerance_deg = 2", "bench.stage.driver.tolerance_deg"),
            ("control_lag_frames = 2", "control_lag_frames = 0", "bench.camera.driver.control_lag_frames"),
            ("control_lag_frames = 2", "black = 3", "bench.camera.driver.black"),
            ("response_ms = 50", "response_ms = 5", "bench.display.response_ms"),
            ("255, 255, 255", "255, 0, 0", "bench.flash.driver.rgb"),
            ("distance_mm = 600", "distance_mm = 601", "bench.optics.distance_mm"),
            ("distance_mm = 600", "", "bench.optics"),
        ] {
            let mismatch = original.differs(&section(&text.replace(old, new))).unwrap();
            assert!(mismatch.starts_with(key), "{mismatch}");
        }
    }

    #[test]
    fn inconsistent_settings_are_refused() {
        let read = |text: &str| toml::from_str::<BenchSection>(text).map_err(|e| e.to_string()).and_then(|s| s.check());
        assert_eq!(read("sim = true\nstage = { driver = { kind = \"hand\" } }"), Ok(()));
        for (text, words) in [
            ("stage = { driver = { kind = \"hand\" }, mounting = { gear = 0 } }", "bench.stage.mounting.gear"),
            ("stage = { driver = { kind = \"robot\" } }", "robot"),
            ("optics = { distance_mm = -3 }", "bench.optics.distance_mm"),
            ("display = { driver = { kind = \"page\", size_mm = [500, nan] } }", "bench.display.size_mm"),
            ("display = { driver = { kind = \"page\", size_mm = [500, 300] }, response_ms = nan }", "response_ms"),
            ("flash = { driver = { kind = \"relay\" }, settling_ms = 20000 }", "bench.flash"),
            (
                "interlocks = [{ name = \"\", driver = { kind = \"serial_line\", port = \"/dev/x\" } }]",
                "interlocks[0].name",
            ),
            (
                "flash = { driver = { kind = \"serial_line\", port = \"/dev/x\" } }\n\
                 interlocks = [{ name = \"door\", driver = { kind = \"serial_line\", port = \"/dev//x\" } }]",
                "that of bench.flash",
            ),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }
}
