//! `/api/v1/devices/display/measurement`: the panel's tone curve and delay, measured with the camera.

use super::bench::PANEL;
use super::problem::{Answer, Problem};
use super::{App, Body};
use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::engine::{Control, LEVELS, PanelFound, State as Steer};
use nacre_drivers::display::kms::Tone;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use utoipa::ToSchema;

/// Shares of the measurement's time of its stages: metering, changes, levels.
const PARTS: [f64; 3] = [0.05, 0.3, 0.65];

/// Number of levels of a measurement.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Levels {
    /// Number of levels: 6, 16, 18, 52 or 86, whose codes are whole numbers.
    #[schema(example = 16, minimum = 6, maximum = 86)]
    levels: usize,
}

/// The newest measurement of the panel since the service started.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Measurement {
    /// `none`, `running`, `done`, `failed` or `stopped`.
    state: &'static str,
    /// Current stage.
    stage: String,
    /// Fraction done of the measurement, 0 to 1.
    progress: f64,
    /// Cause of the failure and its remedy.
    error: Option<String>,
    /// Results, in the format of `nacre calibrate panel`.
    #[schema(value_type = Option<Object>)]
    found: Option<Found>,
}

/// Results: the measurement, the tone curve of a panel that draws patterns itself, and the configuration to use.
#[derive(Clone, Debug, Serialize)]
struct Found {
    #[serde(flatten)]
    found: PanelFound,
    tone: Tone,
    advice: Vec<String>,
}

/// State of a measurement.
pub struct Measuring {
    control: Arc<Control>,
    inner: Mutex<Inner>,
}

struct Inner {
    stage: String,
    steps: u64,
    done: u64,
    /// Number of stages before the current one.
    before: usize,
    end: Option<Result<Found, String>>,
}

impl Measuring {
    fn new() -> Self {
        let inner = Inner { stage: "waiting for the devices".into(), steps: 0, done: 0, before: 0, end: None };
        Self { control: Arc::default(), inner: Mutex::new(inner) }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stopped(&self) -> bool {
        self.control.state() == Steer::Aborting
    }

    fn end(&self, result: Result<Found, Failure>) {
        let end = result.map_err(|failure| Problem::from(failure).to_string());
        self.inner().end = Some(end);
    }

    fn describe(&self) -> Measurement {
        let stopped = self.stopped();
        let inner = self.inner();
        let share = inner.done as f64 / inner.steps.max(1) as f64;
        let stage = inner.before.saturating_sub(1).min(PARTS.len() - 1);
        let progress = PARTS[..stage].iter().sum::<f64>() + PARTS[stage] * share.min(1.0);
        let (state, progress, error, found) = match &inner.end {
            None => ("running", progress, None, None),
            Some(Ok(found)) => ("done", 1.0, None, Some(found.clone())),
            Some(Err(_)) if stopped => ("stopped", progress, None, None),
            Some(Err(why)) => ("failed", progress, Some(why.clone()), None),
        };
        Measurement { state, stage: inner.stage.clone(), progress, error, found }
    }
}

impl Progress for Measuring {
    fn stage(&self, name: &str, steps: u64) {
        let mut inner = self.inner();
        (inner.stage, inner.steps, inner.done) = (name.to_owned(), steps, 0);
        inner.before += 1;
    }

    fn step(&self) {
        self.inner().done += 1;
    }

    fn cancelled(&self) -> bool {
        self.stopped()
    }
}

/// Measures the panel with the camera: uniform levels from black to white and back, and changes between the two.
///
/// Takes about a minute; STOP ends it.
#[utoipa::path(post, path = "/api/v1/devices/display/measure", tag = "devices", operation_id = "measure_panel",
    request_body = Levels,
    responses((status = 202, body = Measurement, headers(("Location" = String, description = "The measurement"))),
        (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn begin(State(app): State<Arc<App>>, Body(body): Body<Levels>) -> Answer<Response> {
    if !LEVELS.contains(&body.levels) {
        return Err(
            Problem::bad(format!("{} levels have no whole codes", body.levels)).remedy("give 6, 16, 18, 52 or 86")
        );
    }
    let measuring = Arc::new(Measuring::new());
    let (work, display) = (measuring.clone(), app.display.clone());
    app.bench.begin(PANEL, measuring.control.clone(), move |owner| {
        let found = owner.measure(body.levels, display.as_ref(), &work.control, &*work);
        move || work.end(found.map(|found| Found { tone: found.tone(), advice: found.advice(display.as_ref()), found }))
    })?;
    let described = measuring.describe();
    *app.measurement.lock().unwrap_or_else(PoisonError::into_inner) = Some(measuring);
    let location = "/api/v1/devices/display/measurement";
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, location)], Json(described)).into_response())
}

/// Reads the newest measurement of the panel.
#[utoipa::path(get, path = "/api/v1/devices/display/measurement", tag = "devices", operation_id = "panel_measurement",
    responses((status = 200, body = Measurement)))]
pub async fn state(State(app): State<Arc<App>>) -> Json<Measurement> {
    let newest = app.measurement.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let none = Measurement { state: "none", stage: String::new(), progress: 0.0, error: None, found: None };
    Json(newest.map_or(none, |measuring| measuring.describe()))
}
