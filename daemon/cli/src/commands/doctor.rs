//! `nacre doctor`.

use crate::console::Console;
use nacre_base::Error;
use nacre_base::estimate::Machine;
use nacre_capture::Failure;
use nacre_drivers::camera::{genicam, v4l2};
use nacre_drivers::discovery::Root;
use nacre_drivers::doctor::{Check, Health, examine};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre doctor`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre doctor
  nacre doctor --data /data/sessions --json

Checks permissions, disk, clock, USB and versions, and suggests a remedy for each problem. Writes a 64 MiB file into the
folder and removes it again. Exits with code 1 if a check fails.")]
pub struct Args {
    /// Folder for captured sessions.
    #[arg(long, default_value = ".")]
    data: PathBuf,
}

/// Examines this machine.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    if !args.data.is_dir() {
        return Err(Error::file(&args.data, "is no folder", "give the folder that sessions go into").into());
    }
    let mut checks = examine(&Root::default(), &args.data);
    let install = "for GenICam, install aravis 0.8 (Debian: libaravis-0.8-0)";
    let (ok, found, remedy) = match (v4l2::SUPPORTED, genicam::load().is_ok()) {
        (true, true) => (Health::Ok, "V4L2 and GenICam can be used", None),
        (false, true) => (Health::Ok, "GenICam can be used, V4L2 not on this system", None),
        (true, false) => {
            (Health::Ok, "V4L2 can be used; for GenICam, aravis 0.8 is not installed", Some(install.into()))
        }
        (false, false) => (Health::Warn, "neither V4L2 nor GenICam can be used on this system", Some(install.into())),
    };
    checks.insert(0, Check { name: "cameras".into(), ok, found: found.into(), remedy });
    let machine = Machine::here();
    let learned = match machine.learned.len() {
        0 => String::new(),
        1 => "; estimates learned from one kind of operation".into(),
        n => format!("; estimates learned from {n} kinds of operations"),
    };
    let found = format!("{:.2} times the speed of the reference machine{learned}", machine.speed);
    checks.push(Check { name: "speed".into(), ok: Health::Ok, found, remedy: None });
    let width = checks.iter().map(|c| c.name.chars().count()).max().unwrap_or_default();
    let mut text = String::new();
    for check in &checks {
        let mark = match check.ok {
            Health::Ok => "ok  ",
            Health::Warn => "warn",
            Health::Bad => "BAD ",
        };
        let _ = writeln!(text, "{mark}  {:width$}  {}", check.name, check.found);
        if let Some(remedy) = &check.remedy {
            let _ = writeln!(text, "      {:width$}  → {remedy}", "");
        }
    }
    console.result(text.trim_end(), &checks);
    let bad = checks.iter().filter(|c| c.ok == Health::Bad).count();
    if bad > 0 {
        return Err(Failure::Bound(format!("{bad} of {} checks are bad", checks.len())));
    }
    Ok(())
}
