//! The blink(1) lamp, mk2 or newer: older ones cannot report their colour.
//!
//! A watchdog in the lamp switches the light off. It is set each time the light is switched on, to slightly more than
//! the maximum on-time, and cancelled when the light is switched off. Old firmware plays its stored pattern when the
//! watchdog expires, so the pattern is overwritten with black when the lamp is opened. The lamp forgets this when it is
//! unplugged.

pub mod protocol;

use super::lamp::{Lamp, Switchable, Timing};
use crate::discovery::{HidNode, Root, hid_nodes};
use crate::hid::{self, Reports};
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const NUMBERS: (u16, u16) = (0x27b8, 0x01ed);
const DEVICE: &str = "blink(1)";
const BLACK: [u8; 3] = [0; 3];

/// Time from the maximum on-time to the expiry of the watchdog.
const GRACE: Duration = Duration::from_millis(500);

/// A blink(1) and its colour.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Serial number; required if several are connected.
    #[serde(default)]
    pub serial: Option<String>,
    /// Device node, such as `/dev/hidraw0`, or `unix:/path` for an emulated one; default: found automatically.
    #[serde(default)]
    pub path: Option<String>,
    /// Red, green and blue of the light, 0 to 255.
    #[serde(default = "white")]
    pub rgb: [u8; 3],
}

fn white() -> [u8; 3] {
    [255; 3]
}

/// Opens the lamp and switches it off.
///
/// # Errors
/// `Setup` if the lamp is missing, may not be opened or is too old.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    if settings.rgb == BLACK {
        return Err(DeviceError::new(DEVICE, "read its settings", "a colour", "black")
            .remedy("correct `rgb` in the flash's settings")
            .class(Class::Setup));
    }
    let (path, serial) = place(settings)?;
    let mut lamp = Blink1 {
        reports: hid::open(DEVICE, &path)?,
        id: if serial.is_empty() { format!("{DEVICE} at {path}") } else { format!("{DEVICE} {serial}") },
        rgb: settings.rgb,
        watch: timing.max_on + GRACE,
    };
    lamp.prepare()?;
    Ok(Box::new(Switchable::new(lamp, timing, clock.clone())?))
}

/// Path and serial number of the configured lamp.
fn place(settings: &Settings) -> DeviceResult<(String, String)> {
    let root = Root::default();
    if let Some(path) = &settings.path {
        let meant = Path::new(path).canonicalize().ok();
        let node = hid_nodes(&root).into_iter().find(|hid| Some(&hid.node) == meant.as_ref());
        return Ok((path.clone(), node.map_or_else(String::new, |hid| hid.serial)));
    }
    let mut nodes = hid::find(&root, NUMBERS, "");
    nodes.retain(|hid| settings.serial.as_ref().is_none_or(|serial| *serial == hid.serial));
    let node: HidNode = hid::only(DEVICE, nodes, |hid| format!("serial = \"{}\"", hid.serial))?;
    Ok((node.node.to_string_lossy().into_owned(), node.serial))
}

struct Blink1 {
    reports: Box<dyn Reports>,
    id: String,
    rgb: [u8; 3],
    watch: Duration,
}

impl Blink1 {
    /// Checks that the lamp can report its colour, and erases its stored pattern.
    fn prepare(&mut self) -> DeviceResult<()> {
        let [major, minor] = self.query(protocol::ask_version(), protocol::version, "its version")?;
        if major < 2 {
            return Err(DeviceError::new(&self.id, "report its version", "2.0 or newer", format!("{major}.{minor}"))
                .remedy("use a blink(1) mk2 or newer: this one cannot tell whether it is on")
                .class(Class::Setup));
        }
        self.reports.set_feature(&protocol::stop_playing())?;
        (0..protocol::PATTERN_LINES).try_for_each(|line| self.reports.set_feature(&protocol::black_line(line)))
    }

    fn query<T>(&mut self, question: protocol::Report, read: fn(&[u8]) -> Option<T>, what: &str) -> DeviceResult<T> {
        self.reports.set_feature(&question)?;
        let mut report = [0; protocol::LENGTH + 1];
        let length = self.reports.feature(protocol::REPORT, &mut report)?;
        read(&report[..length]).ok_or_else(|| {
            let got = format!("bytes without meaning: {:02x?}", &report[..length]);
            DeviceError::new(&self.id, format!("report {what}"), what, got)
                .remedy("unplug the lamp and plug it in again, then resume the session")
                .class(Class::Retry)
        })
    }
}

impl Lamp for Blink1 {
    fn id(&self) -> String {
        self.id.clone()
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        if on {
            let time_ms = u64::try_from(self.watch.as_millis()).unwrap_or(u64::MAX);
            self.reports.set_feature(&protocol::watch(time_ms))?;
            return self.reports.set_feature(&protocol::set(self.rgb));
        }
        let dark = self.reports.set_feature(&protocol::set(BLACK));
        // If the lamp could not be switched off, its watchdog stays active.
        dark.and_then(|()| self.reports.set_feature(&protocol::unwatch()))
    }

    fn state(&mut self) -> DeviceResult<bool> {
        Ok(self.query(protocol::ask_colour(), protocol::colour, "its colour")? != BLACK)
    }
}
