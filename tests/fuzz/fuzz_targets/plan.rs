//! Capture plans, their steps and estimates: TOML, or JSON if the first byte is a brace.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_capture::plan::{Limits, Plan};
use nacre_capture::rig::Place;
use nacre_sim::{BenchConfig, describe};
use std::sync::OnceLock;
use std::time::Duration;

fn limits() -> Limits {
    let bench = describe(&BenchConfig::default());
    Limits { stage: bench.stage, camera: bench.camera, display: bench.display, flash: Some(bench.flash) }
}

fuzz_target!(|bytes: &[u8]| {
    static LIMITS: OnceLock<Limits> = OnceLock::new();
    let limits = LIMITS.get_or_init(limits);
    let name = if bytes.starts_with(b"{") { "plan.json" } else { "plan.toml" };
    let Ok(plan) = Plan::read(&nacre_fuzz::file(name, bytes)) else { return };
    if plan.check_limits(limits).is_empty() {
        let plan = plan.with_fringes(&Place::here(BenchConfig::default()).setup(), limits);
        assert!(plan.steps().len() <= plan.most_steps().len());
        let estimate = plan.estimate(Duration::from_millis(40), limits, 0.0);
        assert!(estimate.seconds.is_finite() && estimate.seconds >= 0.0);
    }
});
