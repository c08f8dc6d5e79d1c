//! `nacre init`: detects the devices, tests the camera and writes a configuration.

use super::bench::place;
use crate::console::Console;
use nacre_base::progress::Progress;
use nacre_base::{Error, vacant};
use nacre_capture::Failure;
use nacre_capture::engine::BenchController;
use nacre_capture::rig::{Rig, Uses, photography, runtime};
use nacre_capture::setup::BenchSection;
use nacre_drivers::camera::{CameraConfig, measure};
use nacre_drivers::discovery::{Kind, Root, discover};
use nacre_drivers::display::desktop_warnings;
use nacre_drivers::{Camera, CameraHandle, Clock, Frame, Freshness, Patience, SystemClock};
use nacre_image::{write_png16_gray, write_whole};
use nacre_service::config::Config;
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Arguments of `nacre init`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre init                                     with the devices that are plugged in
  nacre init --sim
  nacre init --flash none --stage '{ kind = \"hand\" }'
  nacre init --sim --out /etc/nacre.toml

`nacre devices` lists connected devices and their drivers. `nacre init` captures a trial frame and measures the control
lag and linearity of the camera. Point the camera at an evenly lit scene first.")]
pub struct Args {
    /// Use the simulated bench.
    #[arg(long, conflicts_with_all = ["stage", "camera", "display", "flash"])]
    sim: bool,
    /// Driver of the stage, in the notation of `nacre devices`.
    #[arg(long, value_name = "DRIVER")]
    stage: Option<String>,
    /// Driver of the camera, in the notation of `nacre devices`.
    #[arg(long, value_name = "DRIVER")]
    camera: Option<String>,
    /// Driver of the panel, in the notation of `nacre devices`.
    #[arg(long, value_name = "DRIVER")]
    display: Option<String>,
    /// Driver of the flash, or none.
    #[arg(long, value_name = "DRIVER")]
    flash: Option<String>,
    /// Configuration file to write.
    #[arg(long, default_value = "nacre.toml")]
    out: PathBuf,
    /// Replace an existing configuration.
    #[arg(long)]
    force: bool,
}

/// Result of the trial.
#[derive(Default)]
struct Trial {
    ids: Vec<String>,
    frame: Option<Frame>,
    notes: Vec<String>,
}

/// Exposure of the trial frame.
const EXPOSURE: Duration = Duration::from_millis(10);

/// Detects the devices, captures one trial frame and writes a configuration.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let picture = args.out.with_extension("trial.png");
    vacant(&[args.out.clone(), picture.clone()], args.force)?;
    let (mut section, chosen_notes) =
        if args.sim { (BenchSection { sim: true, ..BenchSection::default() }, vec![]) } else { chosen(args)? };
    let mut trial = if args.sim { simulated(&section, console)? } else { real(&mut section, console)? };
    trial.notes.splice(0..0, chosen_notes);
    console.check()?;
    let config = Config { bench: section, ..Config::default() };
    if let Some(frame) = &trial.frame {
        write_png16_gray(&picture, frame.width, frame.height, &frame.codes)?;
    }
    let text = toml::to_string(&config).map_err(|e| Error::input("configuration", e, "report this"))?;
    let text = format!("# Configuration of Nacre; `nacre schema config` lists all keys.\n{text}");
    write_whole(&args.out, text.as_bytes())?;
    let mut message = format!("devices   {}\n", trial.ids.join("\n          "));
    if let Some(frame) = &trial.frame {
        message += &format!("frame     {} ({} × {} pixels)\n", picture.display(), frame.width, frame.height);
    }
    trial.notes.iter().for_each(|note| message += &format!("note      {note}\n"));
    let out = args.out.display();
    message += &format!("wrote     {out}\nnext      nacre devices --config {out}, then nacre serve --config {out}");
    let json = serde_json::json!({
        "devices": trial.ids, "trial": trial.frame.is_some().then_some(&picture), "notes": trial.notes, "config": args.out,
    });
    console.result(&message, &json);
    Ok(())
}

/// Bench section from the given and the detected drivers, and notes about guessed values.
fn chosen(args: &Args) -> Result<(BenchSection, Vec<String>), Failure> {
    let found = discover(&Root::default());
    let first = |kind: Kind| {
        // Only a safely identified device is opened unasked: an unknown one might react to our commands.
        found.iter().find(|f| f.kind == kind && f.sure).and_then(|f| f.setting.clone())
    };
    let driver = |said: &Option<String>, kind: Kind| match said.as_deref() {
        Some("none") => None,
        Some(said) => Some(said.to_owned()),
        None => first(kind),
    };
    let camera = driver(&args.camera, Kind::Camera).ok_or_else(|| {
        let remedy = "plug one in (`nacre devices` says whether it may be opened), or use --sim";
        Error::input("camera", "none was found", remedy)
    })?;
    // Without a motor, a person rotates the analyser; without a dedicated screen, the panel is a browser window.
    let stage = driver(&args.stage, Kind::Stage).unwrap_or_else(|| "{ kind = \"hand\" }".into());
    let mut notes: Vec<String> = found
        .iter()
        .filter(|f| f.kind == Kind::Stage && args.stage.is_none())
        .filter_map(|f| f.setting.as_ref().map(|s| format!("{} may be the stage: --stage '{s}'", f.what)))
        .collect();
    let page = |size: [f64; 2]| format!("{{ kind = \"page\", size_mm = [{:?}, {:?}] }}", size[0], size[1]);
    let display = match (&args.display, found.iter().find_map(|f| f.size_mm)) {
        (Some(said), _) => said.clone(),
        (None, Some(size)) => page(size),
        (None, None) => {
            notes.push("the panel's size_mm is a guess: measure it and correct it".into());
            page([531.0, 299.0])
        }
    };
    let flash = driver(&args.flash, Kind::Flash);
    let section = BenchSection {
        stage: Some(read("stage", &stage)?),
        camera: Some(read("camera", &camera)?),
        display: Some(read("display", &display)?),
        flash: flash.map(|f| read("flash", &f)).transpose()?,
        ..BenchSection::default()
    };
    section.check().map_err(|problem| Error::input("bench", problem, "`nacre schema config` lists all keys"))?;
    Ok((section, notes))
}

/// Parses a driver in the notation of `nacre devices`.
fn read<T: DeserializeOwned>(what: &str, driver: &str) -> Result<T, Error> {
    toml::from_str(&format!("driver = {driver}")).map_err(|e| {
        let problem = format!("--{what} {driver}: {}", e.message());
        Error::input(what, problem, "write it as `nacre devices` does, such as '{ kind = \"hand\" }'")
    })
}

fn simulated(section: &BenchSection, console: &Console) -> Result<Trial, Failure> {
    let runtime = runtime()?;
    let mut rig = Rig::open(&runtime, &place(section, true)?, Uses::SESSION, console, &console.interrupted())?;
    let mut controller = BenchController::new(&mut rig.devices);
    let (frame, _) = runtime.block_on(async {
        controller.expose(EXPOSURE, 1.0).await?;
        controller.fresh().await
    })?;
    Ok(Trial { ids: rig.ids.clone(), frame: Some(frame), notes: vec![] })
}

/// Opens each device alone and characterises the camera. A device that cannot be opened is an error; a failed
/// measurement becomes a note.
fn real(section: &mut BenchSection, console: &Console) -> Result<Trial, Failure> {
    let (runtime, clock): (_, Arc<dyn Clock>) = (runtime()?, Arc::new(SystemClock));
    let _locks = section.lock()?;
    let mut trial = Trial::default();
    if let Some(opened) = section.stage.as_ref().and_then(|s| s.open(&clock)) {
        trial.ids.push(opened?.describe().id);
    }
    if let Some(opened) = section.display.as_ref().and_then(|d| d.open(&clock)) {
        trial.ids.push(opened?.describe().id);
    }
    trial.notes.extend(desktop_warnings());
    if let Some(opened) = section.flash.as_ref().and_then(|f| f.open(&clock)) {
        trial.ids.push(opened?.describe().id);
    }
    let Some(config) = section.camera.clone() else { return Ok(trial) };
    let again = clock.clone();
    let program = photography(&console.interrupted());
    let connect = Box::new(move || {
        config.open(&again, &program).unwrap_or_else(|| {
            Err(nacre_drivers::DeviceError::new("camera", "open", "a device of this machine", "a simulated one"))
        })
    });
    runtime.block_on(async {
        let patience = Patience { total: Duration::from_secs(2), clock };
        let mut camera = CameraHandle::start(connect, patience).await?;
        let info = camera.describe();
        trial.ids.push(info.id);
        trial.notes.extend(info.warnings);
        console.stage("measuring the camera", 0);
        trial.frame = Some(first_frame(&mut camera).await?);
        if let Some(frames) = section.camera.as_mut().and_then(CameraConfig::control_lag_frames) {
            *frames = measure(&mut camera, &mut trial.notes).await.unwrap_or(*frames);
        }
        Ok::<(), Failure>(())
    })?;
    Ok(trial)
}

/// Captures a frame with the trial exposure.
async fn first_frame(camera: &mut CameraHandle) -> Result<Frame, Failure> {
    let info = camera.describe();
    let exposure = EXPOSURE.clamp(seconds(info.exposure_s[0]), seconds(info.exposure_s[1]));
    let exposure = seconds(info.at_most(exposure.as_secs_f64()));
    let controls = camera.configure(exposure, info.gain[0]).await?;
    let duration = controls.exposure + seconds(info.readout_s);
    let mut fresh = Freshness { steady_since: controls.set_at, first_sequence: 0, duration };
    let mut failures = 0;
    for _ in 0..20 + info.control_lag_frames {
        // Before the controls are certain, no frame is used, so that a still camera takes no photograph in vain.
        let asked = if fresh.first_sequence == 0 { Freshness::NEVER } else { fresh };
        let frame = measure::next_frame(camera, asked, &mut failures).await?;
        if fresh.first_sequence == 0 {
            let first = Freshness::first_with_controls(frame.stamp, controls.set_at, info.control_lag_frames);
            fresh.first_sequence = first.unwrap_or(0);
        } else if fresh.accepts(frame.stamp) && !frame.damaged {
            return Ok(frame);
        }
    }
    let error =
        nacre_drivers::DeviceError::new(&info.id, "take a trial frame", "a fresh one", "only old or damaged ones");
    Err(error.remedy("check cable and hub, and the camera's timestamps in the configuration").into())
}

/// Measures the camera's control lag in frames and checks its linearity; `None` if the lag cannot be measured.
async fn measure(camera: &mut CameraHandle, notes: &mut Vec<String>) -> Option<u32> {
    let info = camera.describe();
    let [low, high] = info.exposure_s;
    let (short, long) = (seconds(low.max(1e-3).min(high)), seconds(high.min(0.02)));
    let lag = match measure::control_lag(camera, [short, long], info.gain[0]).await {
        Ok(lag) => Some(lag),
        Err(e) => {
            notes.push(format!("the control lag was not measured ({e})"));
            None
        }
    };
    let ramp: Vec<Duration> = (1..=6).map(|k| short + (long.saturating_sub(short)) * k / 6).collect();
    match measure::exposure_ramp(camera, &ramp, info.gain[0]).await {
        Ok(ramp) if ramp.linear => {
            notes.push(format!("the camera is linear to {:.1} %", 100.0 * ramp.max_deviation));
        }
        Ok(ramp) => notes.push(format!(
            "the camera is not linear: its levels are off a line through black by up to {:.0} %; choose a raw format, or \
             calibrate its response",
            100.0 * ramp.max_deviation
        )),
        Err(e) => notes.push(format!("its linearity was not measured ({e})")),
    }
    lag
}

fn seconds(value: f64) -> Duration {
    Duration::from_secs_f64(value.clamp(0.0, 1e6))
}
