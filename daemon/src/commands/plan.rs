//! `nacre plan`.

use super::bench::{BenchArgs, runtime};
use crate::Failure;
use crate::capture::check_limits;
use crate::console::Console;
use crate::engine::{Control, Engine};
use crate::plan::{Estimate, Limits, Plan};
use crate::rig::Rig;
use clap::Subcommand;
use std::path::PathBuf;
use std::time::Duration;

/// Commands on plans.
#[derive(Subcommand)]
pub enum PlanCommand {
    /// Check a plan against the limits of a bench.
    Check(PlanArgs),
    /// Say how long a session takes and how much disk it needs. Where the exposure is to be metered, it is.
    Estimate(PlanArgs),
}

/// Arguments of `nacre plan check` and `estimate`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre plan check plan.toml
  nacre plan estimate plan.toml --bench bench.toml --json")]
pub struct PlanArgs {
    /// The plan (TOML, or JSON by its name).
    plan: PathBuf,
    #[command(flatten)]
    bench: BenchArgs,
}

/// Runs a command on a plan.
pub fn run(command: &PlanCommand, console: &Console) -> Result<(), Failure> {
    let (PlanCommand::Check(args) | PlanCommand::Estimate(args)) = command;
    let plan = Plan::read(&args.plan)?;
    let limits = args.bench.described()?.limits()?;
    check_limits(&plan, &args.plan, &limits)?;
    match command {
        PlanCommand::Check(_) => {
            let frames = plan.steps().len();
            console.result(&format!("the plan is sound: {frames} frames"), &serde_json::json!({ "frames": frames }));
        }
        PlanCommand::Estimate(_) => {
            let estimate = estimate(&plan, limits, &args.bench, console)?;
            let metering = estimate.metering_seconds.map_or_else(String::new, |s| {
                format!(" ({s:.1} s of it metering, which finds {:.2} ms)", 1000.0 * estimate.exposure_s)
            });
            let text = format!(
                "{} frames, about {:.1} s of the devices' time{metering}, at most {:.1} MB",
                estimate.frames,
                estimate.seconds,
                estimate.bytes as f64 / 1e6,
            );
            console.result(&text, &estimate);
        }
    }
    Ok(())
}

/// What metering will find depends on the sample, so it has to be looked at.
fn estimate(plan: &Plan, mut limits: Limits, bench: &BenchArgs, console: &Console) -> Result<Estimate, Failure> {
    if !plan.is_metered() {
        let exposure = Duration::from_secs_f64(plan.camera.exposure_ms.unwrap_or(10.0) / 1000.0);
        return Ok(plan.estimate(exposure, &limits, 0.0));
    }
    let (runtime, control) = (runtime()?, Control::default());
    let mut rig = Rig::open(&runtime, &bench.described()?, false, console, &console.interrupted())?;
    let mut engine = Engine {
        runtime: &runtime,
        devices: &mut rig.devices,
        watch: &rig.watch,
        control: &control,
        observer: console,
    };
    let (exposure, timing) = engine.meter(plan)?;
    limits.camera.exposure_now_s = exposure.as_secs_f64();
    let stands_deg = runtime.block_on(rig.devices.stage.position())?;
    let estimate = plan.estimate(exposure, &limits, stands_deg);
    let seconds = estimate.seconds + timing.device_s;
    Ok(Estimate { seconds, metering_seconds: Some(timing.device_s), ..estimate })
}
