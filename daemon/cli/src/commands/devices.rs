//! `nacre devices`.

use super::bench::BenchArgs;
use crate::console::Console;
use nacre_capture::Failure;
use nacre_capture::rig::Described;
use nacre_drivers::discovery::{Access, Found, Kind, Root, discover, discover_servers, udev_rules};
use nacre_drivers::{CameraInfo, DeviceError, DeviceLock, DeviceResult, DisplayInfo, FlashInfo, StageInfo};
use serde::Serialize;
use std::fmt::Write;

/// Arguments of `nacre devices`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre devices                                  list connected devices and access to them
  nacre devices --udev | sudo tee /etc/udev/rules.d/70-nacre.rules
  nacre devices --config nacre.toml              open the configured devices
  nacre devices --sim --socket /tmp/bench --json

Opens and moves no device unless a configuration or --sim is given.")]
pub struct Args {
    #[command(flatten)]
    bench: BenchArgs,
    /// Print udev rules that let the logged-in user open the devices.
    #[arg(long, conflicts_with_all = ["sim", "bench", "socket", "config"])]
    udev: bool,
    /// Also list unidentified serial ports, which may belong to a stage or a flash.
    #[arg(long)]
    all: bool,
}

/// A device of the configuration. No `id` means that it is not configured or could not be opened; `error` gives the
/// reason.
#[derive(Serialize)]
struct Device {
    kind: &'static str,
    configured: bool,
    id: Option<String>,
    /// Limits of the device, as text.
    limits: Option<String>,
    /// Process that uses the device at present.
    used_by: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// Lists the devices.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    if args.udev {
        console.result(udev_rules().trim_end(), &serde_json::json!({ "rules": udev_rules() }));
        return Ok(());
    }
    if args.bench.is_given() || args.bench.sim {
        return described(args, console);
    }
    // Both wait about a second for answers.
    let servers = std::thread::spawn(|| discover_servers(&Root::default()));
    let mut found = discover(&Root::default());
    found.extend(servers.join().unwrap_or_default());
    let found: Vec<Found> = found.into_iter().filter(|f| args.all || f.kind != Kind::Other).collect();
    console.result(&plugged_in(&found), &found.iter().map(Listed::from).collect::<Vec<_>>());
    Ok(())
}

/// A detected device and its user.
#[derive(Serialize)]
struct Listed<'a> {
    #[serde(flatten)]
    found: &'a Found,
    used_by: Option<String>,
}

impl<'a> From<&'a Found> for Listed<'a> {
    fn from(found: &'a Found) -> Self {
        Self { found, used_by: used_by(found) }
    }
}

fn used_by(found: &Found) -> Option<String> {
    let driver: toml::Value = toml::from_str(&format!("driver = {}", found.setting.as_ref()?)).ok()?;
    let (kind, place) = nacre_capture::setup::lock_name(&serde_json::to_value(driver.get("driver")?).ok()?)?;
    DeviceLock::holder(&kind, &place)
}

/// List of connected devices for the terminal.
fn plugged_in(found: &[Found]) -> String {
    if found.is_empty() {
        return "no stage, camera, flash or panel was found; --all lists the other serial ports, --sim the simulated bench"
            .into();
    }
    let mut text = String::new();
    for device in found {
        let perhaps = if device.sure { "" } else { " (perhaps)" };
        let kind = nacre_capture::plan::word(device.kind);
        let node = device.stable.as_ref().or(device.node.as_ref());
        let node = node.map_or_else(String::new, |n| format!("  {}", n.display()));
        let _ = write!(text, "{kind:8} {}{perhaps}{node}", device.what);
        if let Some(by) = used_by(device) {
            let _ = write!(text, "  (used by {by})");
        }
        match &device.access {
            Access::Open | Access::NotNeeded => {}
            Access::Denied { remedy } | Access::NoNode { remedy } => {
                let _ = write!(text, "\n         may not be opened: {remedy}");
            }
            Access::InUse { remedy } => {
                let _ = write!(text, "\n         in use: {remedy}");
            }
        }
        if let Some(setting) = &device.setting {
            let _ = write!(text, "\n         driver = {setting}");
        }
        text.push('\n');
    }
    text.push_str("next     nacre init");
    text
}

/// Opens each configured device to read its description and limits. A device that cannot be opened does not hide the
/// others.
fn described(args: &Args, console: &Console) -> Result<(), Failure> {
    let found = args.bench.place()?.describe()?;
    let socket = args.bench.socket.as_ref().map(|p| p.canonicalize().unwrap_or_else(|_| p.clone()));
    let holder = |id: &str| DeviceLock::holder(id, &socket.as_ref()?.to_string_lossy());
    let devices = list(&found, holder);
    let width = devices.iter().filter_map(|d| d.id.as_ref()).map(|id| id.chars().count()).max().unwrap_or_default();
    let kinds = devices.iter().map(|d| d.kind.len()).max().unwrap_or_default().max(8);
    let line = |d: &Device| match (&d.id, &d.limits) {
        (Some(id), Some(limits)) => {
            let used = d.used_by.as_ref().map_or_else(String::new, |by| format!("  (used by {by})"));
            format!("{:kinds$} {id:width$}  {limits}{used}", d.kind)
        }
        _ if d.configured => format!("{:kinds$} cannot be opened", d.kind),
        _ => format!("{:kinds$} not configured: there is no [bench.{}]", d.kind, d.kind),
    };
    let text: Vec<String> = devices.iter().map(line).collect();
    console.result(&text.join("\n"), &devices);
    if let Some(Ok(camera)) = &found.camera {
        let suiting: Vec<String> =
            camera.steady_exposures_s.iter().take(12).map(|s| format!("{:.2}", 1000.0 * s)).collect();
        if !suiting.is_empty() {
            console.note(&format!("exposures that suit the panel's refresh: {} ms", suiting.join(", ")));
        }
        for warning in &camera.warnings {
            console.note(&format!("warning: {warning}"));
        }
    }
    failed(found, console)
}

/// Prints the error of every device that cannot be opened; the last error becomes the command's.
fn failed(found: Described, console: &Console) -> Result<(), Failure> {
    let Described { stage, camera, display, flash, interlocks } = found;
    let errors = [
        stage.and_then(Result::err),
        camera.and_then(Result::err),
        display.and_then(Result::err),
        flash.and_then(Result::err),
    ];
    let interlocks = interlocks.into_iter().filter_map(Result::err);
    let mut errors: Vec<DeviceError> = errors.into_iter().flatten().chain(interlocks).collect();
    let last = errors.pop();
    errors.iter().for_each(|error| console.note(&format!("nacre: {error}")));
    last.map_or(Ok(()), |error| Err(error.into()))
}

/// Stage, camera, display, flash and the configured interlocks.
fn list(found: &Described, holder: impl Fn(&str) -> Option<String>) -> Vec<Device> {
    let device = |kind, told: Option<Result<(String, String), String>>| {
        let configured = told.is_some();
        let (said, error) = match told {
            Some(Ok(said)) => (Some(said), None),
            Some(Err(error)) => (None, Some(error)),
            None => (None, None),
        };
        let (id, limits) = said.unzip();
        let used_by = id.as_ref().and_then(|id| holder(id));
        Device { kind, configured, id, limits, used_by, error }
    };
    let mut devices = vec![
        device("stage", told(found.stage.as_ref(), |s| (s.id.clone(), turns(s)))),
        device("camera", told(found.camera.as_ref(), |c| (c.id.clone(), pictures(c)))),
        device("display", told(found.display.as_ref(), |d| (d.id.clone(), size(d)))),
        device("flash", told(found.flash.as_ref(), |f| (f.id.clone(), longest(f)))),
    ];
    let contact = |closed: bool| if closed { "closed" } else { "open: nothing moves or emits light" };
    let interlocks = found.interlocks.iter();
    devices.extend(interlocks.map(|found| {
        device("interlock", told(Some(found), |(info, closed)| (info.id.clone(), contact(*closed).to_owned())))
    }));
    devices
}

/// Identity and limits of a device, or the error of opening it.
fn told<T>(
    found: Option<&DeviceResult<T>>,
    say: impl FnOnce(&T) -> (String, String),
) -> Option<Result<(String, String), String>> {
    found.map(|found| found.as_ref().map(say).map_err(ToString::to_string))
}

fn turns(stage: &StageInfo) -> String {
    let [low, high] = stage.limits_deg;
    format!(
        "{low}° to {high}°, {} °/s, settles in {:.0} ms{}",
        stage.speed_deg_s,
        1000.0 * stage.settling_s,
        if stage.halts { "" } else { ", finishes a movement that is stopped" }
    )
}

fn pictures(camera: &CameraInfo) -> String {
    format!(
        "{} × {} pixels, {} to {} s, {} frames lag{}",
        camera.width,
        camera.height,
        camera.exposure_s[0],
        camera.exposure_s[1],
        camera.control_lag_frames,
        if camera.shutter { ", with a shutter" } else { "" }
    )
}

fn size(display: &DisplayInfo) -> String {
    format!("{} × {} mm", display.size_mm[0], display.size_mm[1])
}

fn longest(flash: &FlashInfo) -> String {
    format!("on for at most {} s at a time", flash.max_on_s)
}
