//! `nacre plan`.

use super::capture::simulated_bench;
use crate::Failure;
use crate::console::Console;
use crate::plan::Plan;
use clap::Subcommand;
use nacre_sim::Bench;
use std::path::PathBuf;

/// Commands on plans.
#[derive(Subcommand)]
pub enum PlanCommand {
    /// Check a plan against the limits of the simulated bench.
    Check(PlanArgs),
    /// Say how long a session takes and how much disk it needs.
    Estimate(PlanArgs),
}

/// Arguments of `nacre plan check` and `estimate`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre plan check plan.toml
  nacre plan estimate plan.toml --bench bench.toml --json")]
pub struct PlanArgs {
    /// The plan (TOML).
    plan: PathBuf,
    /// Description of the simulated bench (TOML).
    #[arg(long)]
    bench: Option<PathBuf>,
}

/// Runs a command on a plan.
pub fn run(command: &PlanCommand, console: &Console) -> Result<(), Failure> {
    let (PlanCommand::Check(args) | PlanCommand::Estimate(args)) = command;
    let plan = Plan::read(&args.plan)?;
    let config = simulated_bench(args.bench.as_ref(), &args.plan, &plan)?;
    let (stage, camera, _) = nacre_sim::describe(&config);
    match command {
        PlanCommand::Check(_) => {
            let frames = plan.steps().len();
            console.result(&format!("the plan is sound: {frames} frames"), &serde_json::json!({ "frames": frames }));
        }
        PlanCommand::Estimate(_) => {
            let exposure_ms = match plan.camera.exposure_ms {
                Some(ms) => ms,
                // What metering will find depends on the sample, so it has to be looked at.
                None => Bench::new(&config, console)?.exposure_ms(),
            };
            let estimate = plan.estimate(exposure_ms / 1000.0, &camera, &stage);
            let text = format!(
                "{} frames, about {:.1} s of the devices' time, at most {:.1} MB{}",
                estimate.frames,
                estimate.seconds,
                estimate.bytes as f64 / 1e6,
                if plan.camera.exposure_ms.is_none() { " (exposure to be metered, which is not counted)" } else { "" }
            );
            console.result(&text, &estimate);
        }
    }
    Ok(())
}
