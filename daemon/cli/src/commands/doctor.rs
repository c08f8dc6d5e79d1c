//! `nacre doctor`.

use crate::console::Console;
use nacre_base::Error;
use nacre_base::estimate::Machine;
use nacre_capture::Failure;
use nacre_drivers::camera::{genicam, gphoto2, v4l2};
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
    checks.insert(0, cameras());
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

/// Kinds of cameras that this machine can use, with the packages for the others.
fn cameras() -> Check {
    let kinds = [
        ("V4L2", v4l2::SUPPORTED, None),
        ("GenICam", genicam::load().is_ok(), Some("for GenICam, install aravis 0.8 (Debian: libaravis-0.8-0)")),
        ("gphoto2", gphoto2::load().is_ok(), Some("for digital cameras, install libgphoto2 (Debian: libgphoto2-6)")),
    ];
    let list = |usable: bool| -> Vec<&str> { kinds.iter().filter(|k| k.1 == usable).map(|k| k.0).collect() };
    let (usable, missing) = (list(true), list(false));
    let install: Vec<&str> = kinds.iter().filter(|k| !k.1).filter_map(|k| k.2).collect();
    let remedy = (!install.is_empty()).then(|| install.join("; "));
    let name = "cameras".to_owned();
    let (ok, found) = match (usable.is_empty(), missing.is_empty()) {
        (true, _) => (Health::Warn, "no kind of camera can be used on this system but photographs in a folder".into()),
        (_, true) => (Health::Ok, format!("{} can be used", usable.join(", "))),
        _ => (Health::Ok, format!("{} can be used; not available: {}", usable.join(", "), missing.join(", "))),
    };
    Check { name, ok, found, remedy }
}
