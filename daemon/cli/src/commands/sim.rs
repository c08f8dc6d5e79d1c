//! `nacre sim`.

use super::attach::Emulated;
use super::bench::read_bench;
use crate::console::Console;
use clap::Subcommand;
use nacre_base::Error;
use nacre_base::Version;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::engine::Control;
use nacre_capture::plan::{AnalyserPlan, CalibrationsPlan, CameraPlan, DisplayPlan, Plan, PlanKind};
use nacre_capture::rig::{Place, Rig, Uses, runtime};
use nacre_capture::run::{Capture, Taken, steer};
use nacre_capture::session::RealDisk;
use nacre_image::OutputFolder;
use nacre_sim::surface::SampleKind;
use nacre_sim::{Bench, BenchConfig, SharedBench, socket, write_truth};
use std::path::PathBuf;
use std::sync::Arc;

/// Commands of the simulated bench.
#[derive(Subcommand)]
pub enum Sim {
    /// Simulate a polarization session, with its ground truth.
    Render(Render),
    /// Run the simulated bench as a separate process until Ctrl-C.
    Bench(Serve),
    /// Emulate real devices on the simulated bench, down to the wire protocol, until Ctrl-C.
    Attach(super::attach::Args),
    /// Render photographs of diffracting surfaces, independent of the bench.
    #[command(subcommand)]
    Photograph(super::photograph::Photograph),
}

/// Arguments of `nacre sim bench`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim bench --socket /tmp/bench &
  nacre capture plan.toml --sim --socket /tmp/bench --out session
  nacre sim bench --socket /tmp/bench --bench bench.toml --real-time

The bench keeps running when a capture is killed, as a real one does. Simulated time advances
only when devices need it, unless --real-time is given.")]
pub struct Serve {
    /// Unix socket to listen on.
    #[arg(long)]
    socket: PathBuf,
    /// Description of the simulated bench (TOML; default: built-in values).
    #[arg(long)]
    bench: Option<PathBuf>,
    /// Run at the pace of a real bench.
    #[arg(long)]
    real_time: bool,
    #[command(flatten)]
    emulated: Emulated,
}

/// Arguments of `nacre sim render`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim render --sample cd --out cd
  nacre sim render --bench bench.toml --angles-deg 0,45,90,135 --out session
  nacre sim render --sample logo --retardance-deg 10 --out filmed

Samples: kinematic, stars, polygons, circles, fireworks, logo, emblem, cd, stochastic, mosaic.
Writes frames/, frames.json, truth.exr (orientation, period, purity) and bench.toml;
`nacre schema bench` lists all settings.")]
pub struct Render {
    /// Description of the simulated bench (TOML; default: built-in values).
    #[arg(long)]
    bench: Option<PathBuf>,
    #[command(flatten)]
    options: BenchOptions,
    /// Folder for the session.
    #[arg(long)]
    out: PathBuf,
    /// Replace an existing session in the folder.
    #[arg(long)]
    force: bool,
}

/// Frequently used bench settings; they override the bench file.
#[derive(clap::Args, Clone)]
pub struct BenchOptions {
    /// Sample on the bench.
    #[arg(long, value_parser = sample)]
    sample: Option<SampleKind>,
    /// Random seed of sample, defects and noise.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Width and height of the photographs in pixels.
    #[arg(long)]
    size: Option<u32>,
    /// Retardance in degrees of the film over the grating.
    #[arg(long)]
    retardance_deg: Option<f64>,
    /// Analyser angles in degrees.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "0,15,30,45,60,75,90,105,120,135,150,165",
        allow_negative_numbers = true
    )]
    pub angles_deg: Vec<f64>,
}

fn sample(name: &str) -> Result<SampleKind, String> {
    let known = || SampleKind::ALL.into_iter().chain(SampleKind::REFERENCES);
    let names = || known().map(SampleKind::name).collect::<Vec<_>>().join(", ");
    known().find(|k| k.name() == name).ok_or_else(|| format!("no such sample; choose one of {}", names()))
}

/// Runs the selected command.
pub fn run(command: &Sim, console: &Console) -> Result<(), Failure> {
    match command {
        Sim::Render(args) => render(args, console),
        Sim::Bench(args) => serve(args, console),
        Sim::Attach(args) => super::attach::run(args, console),
        Sim::Photograph(command) => super::photograph::run(command, console),
    }
}

fn serve(args: &Serve, console: &Console) -> Result<(), Failure> {
    let bench = Bench::new(&read_bench(args.bench.as_ref())?, console)?;
    let shared = if args.real_time { SharedBench::real_time(bench) } else { SharedBench::new(bench) };
    let port = shared.clone();
    let _attached = args.emulated.start(|| Ok(Box::new(port.clone())))?;
    console.note(&format!("the bench listens at {}; Ctrl-C ends it", args.socket.display()));
    let served = socket::serve(&shared, &args.socket, || console.cancelled());
    Ok(served.map_err(|e| Error::output(&args.socket, e))?)
}

fn render(args: &Render, console: &Console) -> Result<(), Failure> {
    let config = args.options.apply(read_bench(args.bench.as_ref())?)?;
    let folder = OutputFolder::begin(&args.out, args.force)?;
    let (taken, _) = simulate(&config, &args.options.angles_deg, &folder, console)?;
    folder.commit()?;
    let (frames, stale) = (taken.frames, taken.stale_frames_dropped);
    let text = format!(
        "{frames} photographs of the sample {} ({stale} stale frames dropped)\nsession   {}\nnext      nacre reconstruct \
         polarization {} --out result",
        config.sample.kind.name(),
        args.out.display(),
        args.out.display()
    );
    console.result(&text, &serde_json::json!({ "frames": frames, "stale_frames_dropped": stale, "out": args.out }));
    Ok(())
}

/// Captures a polarization session on a new bench into `folder`, with ground truth and bench description.
///
/// # Errors
/// Those of a capture.
pub fn simulate(
    config: &BenchConfig,
    angles_deg: &[f64],
    folder: &OutputFolder,
    console: &Console,
) -> Result<(Taken, SharedBench), Failure> {
    let plan = Plan {
        version: Version,
        kind: PlanKind::Polarization,
        name: format!("simulated {}", config.sample.kind.name()),
        sample: config.sample.kind.name().into(),
        operator: String::new(),
        notes: String::new(),
        camera: CameraPlan {
            exposure_ms: config.camera.exposure_ms,
            gain: config.camera.gain,
            ..CameraPlan::default()
        },
        display: DisplayPlan { diameter_mm: config.disc_mm(), ..DisplayPlan::default() },
        illumination: None,
        analyser: Some(AnalyserPlan::Listed(angles_deg.to_vec())),
        exposures_ms: vec![],
        bracket: None,
        spots: None,
        calibration: None,
        calibrations: CalibrationsPlan::default(),
        steps: vec![],
        extras: vec![],
        reconstruct: None,
    };
    let (runtime, control) = (runtime()?, Arc::new(Control::default()));
    let mut rig = Rig::open(&runtime, &Place::here(config.clone()), Uses::SESSION, console, &console.interrupted())?;
    steer(&runtime, &control, console.interrupted(), true)
        .map_err(|e| Error::input("signals", format!("cannot be caught: {e}"), "report this"))?;
    let mut capture =
        Capture { runtime: &runtime, rig: &mut rig, control, observer: console, elsewhere: None, calibrations: None };
    let taken = capture.begin(plan, &folder.path(""), RealDisk)?;
    let Some(bench) = rig.bench.take() else {
        return Err(Error::input("bench", "is not in this process", "report this").into());
    };
    bench.look(|bench| write_truth(bench, &folder.path("truth.exr")))?;
    let text = toml::to_string(config)
        .map_err(|e| Error::input("bench.toml", format!("cannot be written: {e}"), "report this"))?;
    folder.write("bench.toml", text.as_bytes())?;
    Ok((taken, bench))
}

impl BenchOptions {
    /// Bench with these options applied, validated.
    pub fn apply(&self, mut bench: BenchConfig) -> Result<BenchConfig, Failure> {
        if let Some(kind) = self.sample {
            bench.sample.kind = kind;
        }
        bench.seed = self.seed.unwrap_or(bench.seed);
        bench.film.retardance_deg = self.retardance_deg.unwrap_or(bench.film.retardance_deg);
        if let Some(size) = self.size {
            (bench.camera.width, bench.camera.height) = (size, size);
        }
        let check =
            bench.validate().and_then(|()| match self.angles_deg.iter().find(|a| !a.is_finite() || a.abs() > 1e6) {
                Some(bad) => Err(format!("angles-deg holds {bad}; give finite degrees")),
                None => Ok(()),
            });
        check.map_err(|problem| Error::input("bench", problem, "`nacre schema bench` lists all keys"))?;
        Ok(bench)
    }
}
