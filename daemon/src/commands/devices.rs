//! `nacre devices`.

use super::bench::BenchArgs;
use crate::Failure;
use crate::console::Console;
use nacre_drivers::DeviceLock;
use serde::Serialize;

/// Arguments of `nacre devices`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre devices --sim
  nacre devices --sim --socket /tmp/bench --json")]
pub struct Args {
    #[command(flatten)]
    bench: BenchArgs,
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
    let limits = args.bench.place()?.limits()?;
    let place = args.bench.socket.as_ref().map(|p| p.canonicalize().unwrap_or_else(|_| p.clone()));
    let device = |kind, id: &str, limits| Device {
        kind,
        id: id.to_owned(),
        limits,
        used_by: place.as_ref().and_then(|place| DeviceLock::holder(id, &place.to_string_lossy())),
    };
    let (stage, camera, display) = (&limits.stage, &limits.camera, &limits.display);
    let [low, high] = stage.limits_deg;
    let turn = format!("{low}° to {high}°, {} °/s, settles in {:.0} ms", stage.speed_deg_s, 1000.0 * stage.settling_s);
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
    let width = devices.iter().map(|d| d.id.chars().count()).max().unwrap_or_default();
    let line = |d: &Device| {
        let used = d.used_by.as_ref().map_or_else(String::new, |by| format!("  (used by {by})"));
        format!("{:8} {:width$}  {}{used}", d.kind, d.id, d.limits)
    };
    let text: Vec<String> = devices.iter().map(line).collect();
    console.result(&text.join("\n"), &devices);
    Ok(())
}
