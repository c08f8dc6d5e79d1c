//! `nacre plan`.

use super::bench::BenchArgs;
use crate::console::{Console, duration};
use clap::Subcommand;
use nacre_base::estimate::{self, Machine};
use nacre_capture::Failure;
use nacre_capture::engine::{Control, Engine};
use nacre_capture::plan::{Estimate, Least, Limits, Plan};
use nacre_capture::rig::{Rig, SimulatedBench, Uses, runtime};
use nacre_capture::run::check_limits;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Duration;

/// Predicted time, memory and disk space of a session and of its results.
#[derive(Serialize)]
struct Needs {
    #[serde(flatten)]
    estimate: Estimate,
    /// Prediction for the reconstruction that the plan requests.
    #[serde(skip_serializing_if = "Option::is_none")]
    results: Option<estimate::Estimate>,
}

/// Longer side in pixels of the pictures used to meter a simulated bench for an estimate.
const METERED_PX: u32 = 128;

/// Commands on plans.
#[derive(Subcommand)]
pub enum PlanCommand {
    /// Check a plan against the limits of a bench.
    Check(PlanArgs),
    /// Estimate the duration and disk space of a session. Meters the exposure if the plan asks for metering.
    Estimate(PlanArgs),
}

/// Arguments of `nacre plan check` and `estimate`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre plan check plan.toml
  nacre plan estimate plan.toml --bench bench.toml --json")]
pub struct PlanArgs {
    /// Plan (TOML, or JSON by file extension).
    plan: PathBuf,
    #[command(flatten)]
    bench: BenchArgs,
}

/// Runs the selected command.
pub fn run(command: &PlanCommand, console: &Console) -> Result<(), Failure> {
    let (PlanCommand::Check(args) | PlanCommand::Estimate(args)) = command;
    let plan = Plan::read(&args.plan)?;
    let place = args.bench.described()?;
    let limits = place.limits()?;
    check_limits(&plan, &args.plan, &limits)?;
    let plan = plan.with_fringes(&place.setup(), &limits);
    match command {
        PlanCommand::Check(_) => {
            let [least, frames] = plan.frame_counts();
            let range = if least < frames { format!("{least} to {frames} frames") } else { format!("{frames} frames") };
            let mut value = serde_json::json!({ "frames": frames, "least_frames": least });
            let mut text = format!("the plan is sound: {range}");
            if let Some(reach) = plan.reach(&place.setup(), &limits) {
                text += &reach.text();
                value["shortest_um"] = serde_json::json!(reach.shortest_um);
                value["predicted"] = serde_json::json!(reach.predicted);
            }
            console.result(&text, &value);
        }
        PlanCommand::Estimate(_) => {
            let results = plan.results_work(&limits).map(|work| Machine::here().estimate(&work));
            let estimate = estimate(&plan, limits, &args.bench, console)?;
            let metering = estimate.metering_seconds.map_or_else(String::new, |s| {
                format!(" ({s:.1} s of it metering, which finds {:.2} ms)", 1000.0 * estimate.exposure_s)
            });
            let (seconds, megabytes) = (estimate.seconds, estimate.bytes as f64 / 1e6);
            let [frames, time] = match estimate.least {
                Some(least) => [
                    format!("{} to {} frames", least.frames, estimate.frames),
                    format!("{:.1} to {seconds:.1} s", least.seconds),
                ],
                None => [format!("{} frames", estimate.frames), format!("{seconds:.1} s")],
            };
            let mut text = format!("{frames}, about {time} of the devices' time{metering}, at most {megabytes:.1} MB");
            if let Some(results) = &results {
                let (time, megabytes) = (duration(results.seconds), results.disk_bytes as f64 / 1e6);
                text += &format!("; then about {time} for the results, {megabytes:.1} MB");
            }
            console.result(&text, &Needs { estimate, results });
        }
    }
    Ok(())
}

/// Estimates a plan. The metered exposure depends on the sample, so a simulated bench is metered first.
fn estimate(plan: &Plan, mut limits: Limits, bench: &BenchArgs, console: &Console) -> Result<Estimate, Failure> {
    if !plan.is_metered() {
        let exposure = Duration::from_secs_f64(plan.camera.exposure_ms.unwrap_or(10.0) / 1000.0);
        return Ok(plan.estimate(exposure, &limits, 0.0));
    }
    let (runtime, control) = (runtime()?, Control::default());
    let mut place = bench.described()?;
    if let Some(SimulatedBench::Here { config, .. }) = place.simulated.as_mut().filter(|_| plan.camera.roi.is_none()) {
        // A smaller picture of the same sample has the same brightness and renders faster.
        let size = [config.camera.width, config.camera.height];
        let factor = (size[0].max(size[1]) / METERED_PX).max(1);
        [config.camera.width, config.camera.height] = size.map(|pixels| (pixels / factor).max(1));
    }
    let mut rig = Rig::open(&runtime, &place, Uses::SESSION, console, &console.interrupted())?;
    let mut engine = Engine {
        runtime: &runtime,
        devices: &mut rig.devices,
        watch: &rig.watch,
        control: &control,
        observer: console,
    };
    let (metered, timing) = engine.meter(plan)?;
    let (exposure, plan) = (metered.exposure, plan.clone().with_bracket(metered.bracket_ms));
    limits.camera.exposure_now_s = exposure.as_secs_f64();
    let stands_deg = runtime.block_on(rig.devices.stage.position())?;
    let estimate = plan.estimate(exposure, &limits, stands_deg);
    let seconds = estimate.seconds + timing.device_s;
    let least = estimate.least.map(|least| Least { seconds: least.seconds + timing.device_s, ..least });
    Ok(Estimate { seconds, metering_seconds: Some(timing.device_s), least, ..estimate })
}
