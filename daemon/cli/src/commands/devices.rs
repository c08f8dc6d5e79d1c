//! `nacre devices`.

use super::bench::BenchArgs;
use crate::console::Console;
use nacre_capture::Failure;
use nacre_capture::plan::Limits;
use nacre_drivers::DeviceLock;
use nacre_drivers::discovery::{Access, Found, Kind, Root, discover, udev_rules};
use serde::Serialize;
use std::fmt::Write;

/// Arguments of `nacre devices`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre devices                                  what is plugged in, and whether it may be opened
  nacre devices --udev | sudo tee /etc/udev/rules.d/70-nacre.rules
  nacre devices --config nacre.toml              opens what the configuration describes
  nacre devices --sim --socket /tmp/bench --json

Nothing is opened or moved unless a configuration or --sim is given.")]
pub struct Args {
    #[command(flatten)]
    bench: BenchArgs,
    /// Print udev rules that let whoever sits at the machine open the devices.
    #[arg(long, conflicts_with_all = ["sim", "bench", "socket", "config"])]
    udev: bool,
    /// Also list serial ports of which nothing is known: a stage or a flash may be behind one.
    #[arg(long)]
    all: bool,
}

#[derive(Serialize)]
struct Device {
    kind: &'static str,
    id: String,
    /// What it can do, in words.
    limits: String,
    /// Who uses it now.
    used_by: Option<String>,
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
    let found: Vec<Found> =
        discover(&Root::default()).into_iter().filter(|f| args.all || f.kind != Kind::Other).collect();
    console.result(&plugged_in(&found), &found.iter().map(Listed::from).collect::<Vec<_>>());
    Ok(())
}

/// A device that was found, with who uses it.
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

/// What is plugged in, as a person reads it.
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
        }
        if let Some(setting) = &device.setting {
            let _ = write!(text, "\n         driver = {setting}");
        }
        text.push('\n');
    }
    text.push_str("next     nacre init");
    text
}

/// What a configuration describes, opened to ask what it can do.
fn described(args: &Args, console: &Console) -> Result<(), Failure> {
    let place = args.bench.place()?;
    let limits = place.limits()?;
    let socket = args.bench.socket.as_ref().map(|p| p.canonicalize().unwrap_or_else(|_| p.clone()));
    let holder = |id: &str| DeviceLock::holder(id, &socket.as_ref()?.to_string_lossy());
    let devices = list(&limits, holder);
    let width = devices.iter().map(|d| d.id.chars().count()).max().unwrap_or_default();
    let line = |d: &Device| {
        let used = d.used_by.as_ref().map_or_else(String::new, |by| format!("  (used by {by})"));
        format!("{:8} {:width$}  {}{used}", d.kind, d.id, d.limits)
    };
    let text: Vec<String> = devices.iter().map(line).collect();
    console.result(&text.join("\n"), &devices);
    let suiting: Vec<String> =
        limits.camera.steady_exposures_s.iter().take(12).map(|s| format!("{:.2}", 1000.0 * s)).collect();
    if !suiting.is_empty() {
        console.note(&format!("exposures that suit the panel's refresh: {} ms", suiting.join(", ")));
    }
    for warning in &limits.camera.warnings {
        console.note(&format!("warning: {warning}"));
    }
    Ok(())
}

fn list(limits: &Limits, holder: impl Fn(&str) -> Option<String>) -> Vec<Device> {
    let device = |kind, id: &str, limits| Device { kind, id: id.to_owned(), limits, used_by: holder(id) };
    let (stage, camera, display) = (&limits.stage, &limits.camera, &limits.display);
    let [low, high] = stage.limits_deg;
    let turn = format!(
        "{low}° to {high}°, {} °/s, settles in {:.0} ms{}",
        stage.speed_deg_s,
        1000.0 * stage.settling_s,
        if stage.halts { "" } else { ", finishes a movement that is stopped" }
    );
    let picture = format!(
        "{} × {} pixels, {} to {} s, {} frames lag{}",
        camera.width,
        camera.height,
        camera.exposure_s[0],
        camera.exposure_s[1],
        camera.control_lag_frames,
        if camera.shutter { ", with a shutter" } else { "" }
    );
    let panel = format!("{} × {} mm", display.size_mm[0], display.size_mm[1]);
    let mut devices = vec![
        device("stage", &stage.id, turn),
        device("camera", &camera.id, picture),
        device("display", &display.id, panel),
    ];
    if let Some(flash) = &limits.flash {
        devices.push(device("flash", &flash.id, format!("on for at most {} s at a time", flash.max_on_s)));
    }
    devices
}
