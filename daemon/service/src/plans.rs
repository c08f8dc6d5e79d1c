//! `/api/v1/plans`: checks and estimates of plans.

use super::paths::without_folders;
use super::problem::{Answer, Problem};
use super::{App, Body};
use axum::Json;
use axum::extract::State;
use nacre_base::estimate::Machine;
use nacre_base::text::from_toml;
use nacre_capture::calibrations::Chosen;
use nacre_capture::plan::Plan;
use nacre_frames::Calibration;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;
use utoipa::ToSchema;

/// Longest wait for the preview's exposure, for instance while the stage moves.
const PATIENCE: Duration = Duration::from_secs(1);

/// A plan, as JSON or as the text of a plan.toml.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "plan": {
    "kind": "polarization", "name": "first look", "camera": { "exposure_ms": 5 },
    "analyser": { "angles_deg": [0, 60, 120] }, "reconstruct": { "operation": "polarization" }
} }))]
pub struct PlanBody {
    /// The plan as JSON; its JSON Schema is at `/api/v1/plans/schema`.
    #[schema(value_type = Option<Object>)]
    plan: Option<serde_json::Value>,
    /// The plan as TOML.
    toml: Option<String>,
}

/// Result of checking a plan against the bench.
#[derive(Debug, Serialize, ToSchema)]
pub struct Checked {
    /// Whether the plan has no problems.
    sound: bool,
    /// Most frames that it stores.
    frames: usize,
    /// Fewest frames that it stores. Less than `frames` for a series that stops at a σ.
    least_frames: usize,
    /// Limits of the bench that it exceeds, and listed calibrations that do not apply.
    problems: Vec<String>,
    /// Reasons why stored calibrations are not used, such as their age.
    warnings: Vec<String>,
    /// Stored calibrations that the session would use now, with their origins.
    #[schema(value_type = Option<Object>)]
    calibration: Option<Calibration>,
    /// For fringes: shortest period in µm whose first order reaches the panel from the middle of the sample, for
    /// grating vectors at 0, 15, … 165 degrees; null where none does.
    shortest_um: Option<Vec<Option<f64>>>,
    /// The plan as JSON, also if it was sent as TOML.
    #[schema(value_type = Object)]
    plan: Plan,
}

/// Time and disk space of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct Estimated {
    /// Frames that are stored.
    frames: usize,
    /// Time in seconds until the last frame, metering included.
    seconds: f64,
    /// Time of metering in seconds, contained in `seconds`.
    metering_seconds: f64,
    /// Time in seconds from the last frame until the results are complete, if the plan asks for results.
    results_seconds: Option<f64>,
    /// Size of the results in bytes.
    results_bytes: Option<u64>,
    /// Exposure time in seconds.
    exposure_s: f64,
    /// Whether the exposure time is assumed to be the preview's, since the session will meter.
    exposure_assumed: bool,
    /// Largest total size of the frames in bytes.
    bytes: u64,
    /// Fewest frames that are stored: a series that stops at a σ may end early. All other values assume the longest
    /// series.
    least_frames: usize,
    /// Time in seconds until the last of `least_frames`.
    least_seconds: f64,
}

impl From<serde_json::Value> for PlanBody {
    fn from(plan: serde_json::Value) -> Self {
        Self { plan: Some(plan), toml: None }
    }
}

impl PlanBody {
    /// The plan, checked without the bench.
    ///
    /// # Errors
    /// `bad-request`, naming the key.
    pub fn plan(self) -> Answer<Plan> {
        let plan: Plan = match (self.plan, self.toml) {
            (Some(value), None) => serde_path_to_error::deserialize(value)
                .map_err(|e| Problem::bad(format!("plan.{}: {}", e.path(), e.inner())))?,
            (None, Some(text)) => from_toml(&text).map_err(|e| Problem::bad(format!("toml: {e}")))?,
            _ => return Err(Problem::bad("give either plan (JSON) or toml (text)")),
        };
        plan.check_texts()
            .and_then(|()| plan.check_values())
            .map_err(|problem| Problem::bad(problem).remedy("see /api/v1/plans/schema"))?;
        Ok(plan.completed())
    }
}

/// The JSON Schema of a plan.
#[utoipa::path(get, path = "/api/v1/plans/schema", tag = "plans", operation_id = "plan_schema",
    responses((status = 200, description = "JSON Schema", body = Object)))]
pub async fn schema() -> Json<serde_json::Value> {
    Json(serde_json::to_value(schemars::schema_for!(Plan)).unwrap_or_default())
}

/// Checks a plan against the limits of the bench.
#[utoipa::path(post, path = "/api/v1/plans/check", tag = "plans", operation_id = "check_plan", request_body = PlanBody,
    responses((status = 200, body = Checked), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn check(State(app): State<Arc<App>>, Body(body): Body<PlanBody>) -> Answer<Json<Checked>> {
    let plan = body.plan()?;
    let mut problems = plan.check_limits(&app.limits);
    let [least_frames, frames] = plan.clone().with_fringes(&app.setup, &app.limits).frame_counts();
    let (chooser, asked) = (app.clone(), plan.clone());
    let chosen = super::blocking(move || Ok(chooser.chosen_calibrations(&asked))).await?;
    let chosen = chosen.unwrap_or_else(|problem| {
        problems.push(problem.detail().to_owned());
        Chosen::default()
    });
    Ok(Json(Checked {
        sound: problems.is_empty(),
        frames,
        least_frames,
        problems,
        warnings: chosen.warnings.iter().map(|warning| without_folders(warning)).collect(),
        calibration: chosen.calibration,
        shortest_um: plan.reach(&app.setup, &app.limits).map(|reach| reach.shortest_um),
        plan,
    }))
}

/// Exposure time of a plan before metering: as stated, or the preview's.
pub async fn assumed_exposure(app: &App, plan: &Plan) -> Duration {
    match plan.camera.exposure_ms {
        Some(ms) => Duration::from_secs_f64(ms / 1000.0),
        // The preview's exposure cannot be read while the bench is busy; a typical value is used.
        None if plan.is_metered() => {
            let asked = tokio::time::timeout(PATIENCE, app.bench.work(|owner| Ok(owner.settings.0))).await;
            asked.ok().and_then(Result::ok).unwrap_or(Duration::from_millis(40))
        }
        None => Duration::from_millis(10),
    }
}

/// Estimates the time and disk space of a session.
#[utoipa::path(post, path = "/api/v1/plans/estimate", tag = "plans", operation_id = "estimate_plan",
    request_body = PlanBody,
    responses((status = 200, body = Estimated), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn estimate(State(app): State<Arc<App>>, Body(body): Body<PlanBody>) -> Answer<Json<Estimated>> {
    let plan = body.plan()?.with_fringes(&app.setup, &app.limits);
    let metered = plan.is_metered();
    let assumed = assumed_exposure(&app, &plan).await;
    let estimate = plan.estimate(assumed, &app.limits, 0.0);
    let metering_seconds = plan.metering_s(assumed, &app.limits);
    let results = match plan.results_work(&app.limits) {
        Some(work) => Some(super::blocking(move || Ok(Machine::here().estimate(&work))).await?),
        None => None,
    };
    Ok(Json(Estimated {
        frames: estimate.frames,
        seconds: estimate.seconds + metering_seconds,
        metering_seconds,
        results_seconds: results.map(|results| results.seconds),
        results_bytes: results.map(|results| results.disk_bytes),
        exposure_s: estimate.exposure_s,
        exposure_assumed: metered,
        bytes: estimate.bytes,
        least_frames: estimate.least.map_or(estimate.frames, |l| l.frames),
        least_seconds: estimate.least.map_or(estimate.seconds, |l| l.seconds) + metering_seconds,
    }))
}
