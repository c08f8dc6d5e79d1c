//! `nacre capture`.

use super::sim::read_bench;
use crate::console::Console;
use crate::engine::Bench;
use crate::plan::{ModelPlan, Plan};
use crate::session::{RealDisk, SESSION_FILE, Session, SessionFile};
use crate::{Failure, session};
use nacre_drivers::{Camera, Clock, Display, Stage};
use nacre_processing::Error;
use nacre_processing::polarimetry::{self, Model, Options};
use nacre_sim::{BenchConfig, SharedBench};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Arguments of `nacre capture`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre capture plan.toml --sim --out session
  nacre capture plan.toml --sim --bench bench.toml --out session --dry-run
  nacre capture --sim --resume session           goes on after a stop, a crash or a kill

Only the simulated bench can be driven so far.")]
pub struct Args {
    /// The plan (TOML); `nacre schema plan` lists its keys.
    #[arg(required_unless_present = "resume")]
    plan: Option<PathBuf>,
    /// Use the simulated bench.
    #[arg(long, required = true)]
    sim: bool,
    /// Description of the simulated bench (TOML).
    #[arg(long)]
    bench: Option<PathBuf>,
    /// New folder for the session.
    #[arg(long, required_unless_present = "resume")]
    out: Option<PathBuf>,
    /// Go on with a session that was stopped.
    #[arg(long, value_name = "SESSION", conflicts_with_all = ["plan", "bench", "out"])]
    resume: Option<PathBuf>,
    /// Check and list the steps; take nothing.
    #[arg(long)]
    dry_run: bool,
}

/// Captures a session, or what is missing of one.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .build()
        .map_err(|e| Error::input("tokio", format!("cannot start: {e}"), "free some memory"))?;
    match (&args.resume, &args.plan, &args.out) {
        (Some(folder), ..) => runtime.block_on(resume(folder, console)),
        (None, Some(plan), Some(out)) => {
            let loaded = Plan::read(plan)?;
            let config = simulated_bench(args.bench.as_ref(), plan, &loaded)?;
            if args.dry_run {
                return dry_run(&loaded, console);
            }
            runtime.block_on(begin(loaded, &config, out, console))
        }
        // The command line asks for plan and out unless there is a session to resume.
        _ => Err(Error::input("capture", "has no plan", "give a plan and --out, or --resume").into()),
    }
}

/// Configuration of the bench that a plan is to run on, with the plan's disc; refuses a plan that asks more than the
/// devices can do.
pub(super) fn simulated_bench(bench: Option<&PathBuf>, path: &Path, plan: &Plan) -> Result<BenchConfig, Failure> {
    let mut config = read_bench(bench)?;
    config.panel.disc_mm = Some(plan.display.diameter_mm);
    check_bench(path, plan, &config)?;
    Ok(config)
}

fn check_bench(path: &Path, plan: &Plan, config: &BenchConfig) -> Result<(), Failure> {
    let (_, camera, display) = nacre_sim::describe(config);
    let problems = plan.check_limits(&camera, &display);
    if !problems.is_empty() {
        return Err(Error::file(path, problems.join("; "), "change the plan or the bench").into());
    }
    config.validate().map_err(|problem| Error::input("bench", problem, "`nacre schema bench` lists all keys"))?;
    Ok(())
}

fn build(config: &BenchConfig, console: &Console) -> Result<SharedBench, Failure> {
    Ok(SharedBench::new(nacre_sim::Bench::new(config, console)?))
}

fn dry_run(plan: &Plan, console: &Console) -> Result<(), Failure> {
    let steps = plan.steps();
    let line = |s: &crate::plan::Step| format!("{:>9.3}°  {:?}  {}", s.analyser_deg, s.pattern, s.file);
    let text: Vec<String> = steps.iter().map(line).collect();
    console.result(&text.join("\n"), &text);
    Ok(())
}

async fn begin(plan: Plan, config: &BenchConfig, out: &Path, console: &Console) -> Result<(), Failure> {
    if out.exists() {
        return Err(Error::file(out, "is already there", "choose another --out, or --resume it").into());
    }
    let shared = build(config, console)?;
    let (mut stage, mut camera, mut display) = shared.devices();
    let ids = vec![stage.describe().id, camera.describe().id, display.describe().id];
    let mut bench = Bench { stage: &mut stage, camera: &mut camera, display: &mut display };
    let exposure = match plan.camera.exposure_ms {
        Some(ms) => Duration::from_secs_f64(ms / 1000.0),
        None => bench.meter(&plan).await?,
    };
    let description = SessionFile {
        software: concat!("nacre ", env!("CARGO_PKG_VERSION")).into(),
        plan,
        devices: ids,
        exposure_s: exposure.as_secs_f64(),
        bench: Some(config.clone()),
    };
    let mut session = Session::create(RealDisk, out, &description).map_err(|e| Error::output(out, e))?;
    let _lock = lock(out)?;
    take(&mut bench, &description, &mut session, &shared, console).await
}

async fn resume(folder: &Path, console: &Console) -> Result<(), Failure> {
    let bad = |e: std::io::Error| {
        Error::file(folder, format!("cannot be resumed: {e}"), "give a folder that `nacre capture` made")
    };
    let _lock = lock(folder)?;
    let description = SessionFile::read(folder).map_err(bad)?;
    let Some(config) = &description.bench else {
        return Err(
            Error::file(folder, "was not captured on the simulated bench", "resume it on its own devices").into()
        );
    };
    // The file may have been edited since, so it is checked like a new plan, before anything is changed.
    check_bench(&folder.join(SESSION_FILE), &description.plan, config)?;
    let mut session = Session::open(RealDisk, folder).map_err(bad)?;
    let shared = build(config, console)?;
    let (mut stage, mut camera, mut display) = shared.devices();
    let mut bench = Bench { stage: &mut stage, camera: &mut camera, display: &mut display };
    take(&mut bench, &description, &mut session, &shared, console).await
}

async fn take(
    bench: &mut Bench<'_>,
    description: &SessionFile,
    session: &mut Session<RealDisk>,
    shared: &SharedBench,
    console: &Console,
) -> Result<(), Failure> {
    let (begun, wall) = (shared.lock().now(), std::time::Instant::now());
    let exposure = Duration::from_secs_f64(description.exposure_s);
    bench.run(&description.plan, exposure, session, console).await?;
    let device_s = (shared.lock().now() - begun).as_secs_f64();
    let condition = session::check(session.folder())?;
    let results = reconstruct_as_planned(&description.plan, session.folder(), console)?;
    let folder = session.folder().display();
    let next = match &results {
        Some(results) => format!("results   {}", results.display()),
        None => format!("next      nacre reconstruct polarization {folder} --out result"),
    };
    let text = format!(
        "{} frames of {:.1} ms; {device_s:.1} s of the devices' time, {:.2} s on the clock\nsession   {folder}\n{next}",
        condition.intact,
        1000.0 * description.exposure_s,
        wall.elapsed().as_secs_f64(),
    );
    let json = serde_json::json!({
        "session": session.folder(), "frames": condition.intact, "exposure_s": description.exposure_s,
        "device_seconds": device_s, "seconds": wall.elapsed().as_secs_f64(), "results": results,
    });
    console.result(&text, &json);
    Ok(())
}

/// Runs the reconstruction that the plan asks for; results of an earlier run of the same session are replaced.
fn reconstruct_as_planned(plan: &Plan, folder: &Path, console: &Console) -> Result<Option<PathBuf>, Failure> {
    let Some(planned) = plan.reconstruct else { return Ok(None) };
    let model = match planned.model {
        ModelPlan::Auto => Model::Auto,
        ModelPlan::Sinusoid => Model::Sinusoid,
    };
    let results = folder.join("results");
    let options = Options { model, overwrite: true, ..Options::default() };
    let report = polarimetry::reconstruct(folder, &results, &options, console)?;
    for warning in &report.warnings {
        console.note(&format!("warning: {warning}"));
    }
    Ok(Some(results))
}

/// Keeps a second process from capturing into the same session; released when it is dropped.
fn lock(folder: &Path) -> Result<std::fs::File, Failure> {
    let path = folder.join(SESSION_FILE);
    let taken =
        std::fs::File::open(&path).and_then(|file| file.try_lock().map(|()| file).map_err(std::io::Error::from));
    taken.map_err(|e| match e.kind() {
        std::io::ErrorKind::WouldBlock => {
            Error::file(folder, "is being captured by another process", "wait for it or stop it").into()
        }
        _ => Error::file(&path, format!("cannot be read: {e}"), "give a folder that `nacre capture` made").into(),
    })
}
