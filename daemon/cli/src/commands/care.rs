//! `nacre stage search-frequency` and `nacre stage clean`: maintenance of an Elliptec stage.

use super::bench::BenchArgs;
use super::manual::{Stage, hold};
use crate::console::Console;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::engine::{Control, Input, guarded};
use nacre_capture::rig::{Use, Uses, interlocks, runtime};
use nacre_drivers::SystemClock;
use nacre_drivers::stage::StageDriver;
use nacre_drivers::stage::elliptec::Elliptec;
use std::sync::Arc;

/// Runs the maintenance of an Elliptec stage.
pub fn run(command: &Stage, bench: &BenchArgs, console: &Console) -> Result<(), Failure> {
    let place = bench.place()?;
    let uses = Uses { stage: Use::Always, ..Uses::NONE };
    place.require(uses)?;
    let section = place.section.only(uses);
    let Some(StageDriver::Elliptec(settings)) = section.stage.as_ref().map(|s| &s.driver) else {
        let remedy = "describe one as [bench.stage] in nacre.toml";
        return Err(Error::input("stage", "is no Elliptec stage", remedy).into());
    };
    let _locks = section.lock()?;
    let runtime = runtime()?;
    let mut stage = Elliptec::open(settings, Arc::new(SystemClock))?;
    let (watch, control) = (interlocks(&section)?, Control::default());
    let _ = control.send(Input::Start);
    console.stage("the stage looks after itself", 0);
    runtime.block_on(async {
        let interrupted = async {
            hold(console, f64::INFINITY).await;
        };
        let work = async {
            match command {
                Stage::Clean(_) => stage.clean().await?,
                _ => stage.search_frequency().await?,
            }
            Ok(())
        };
        let done = tokio::select! {
            biased;
            () = interrupted => None,
            done = guarded(&watch, &control, work) => Some(done),
        };
        match done {
            Some(Ok(())) => Ok(()),
            stopped => {
                let halted = nacre_drivers::Stage::halt(&mut stage).await;
                stopped.transpose()?;
                halted?;
                Err(Failure::from(Error::Cancelled))
            }
        }
    })?;
    console.result("done; home the stage before the next session", &serde_json::json!({ "done": true }));
    Ok(())
}
