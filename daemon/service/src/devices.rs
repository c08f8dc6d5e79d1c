//! `/api/v1/devices` and `/api/v1/stop`: manual control.

use super::bench::{Owner, PANEL};
use super::problem::{Answer, Problem};
use super::{App, Body};
use axum::Json;
use axum::extract::State;
use nacre_capture::Failure;
use nacre_drivers::Pattern;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;
use utoipa::{IntoParams, ToSchema};

/// Longest time of a preview frame in seconds, exposure included.
const LONGEST_PREVIEW_S: f64 = 2.0;

/// State of the bench.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Devices {
    /// Activity of the devices: `idle`, `session`, or `manual` while the panel is measured.
    activity: &'static str,
    /// Id of the session that has the devices.
    session: Option<String>,
    stage: StageState,
    camera: CameraState,
    display: PanelState,
    flash: Option<FlashState>,
    /// Interlocks, such as door switches.
    interlocks: Vec<InterlockState>,
    /// Whether the whole bench is simulated.
    simulated: bool,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
struct StageState {
    id: String,
    /// Last known analyser angle in degrees.
    analyser_deg: Option<f64>,
    limits_deg: [f64; 2],
    speed_deg_s: f64,
    by_hand: bool,
    /// Whether a movement can be interrupted. If not, STOP waits for its end.
    halts: bool,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
struct CameraState {
    id: String,
    width: usize,
    height: usize,
    /// Exposure time of the preview in ms.
    exposure_ms: f64,
    /// Gain of the preview.
    gain: f64,
    exposure_range_ms: [f64; 2],
    gain_range: [f64; 2],
    black: u16,
    white: u16,
    /// Warnings of the camera's driver.
    warnings: Vec<String>,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
struct PanelState {
    id: String,
    size_mm: [f64; 2],
    pattern: PatternBody,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
struct FlashState {
    id: String,
    on: bool,
    max_on_s: f64,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
struct InterlockState {
    id: String,
    /// Whether it is closed. Unknown while a session has the devices, and when the interlock does not answer.
    holds: Option<bool>,
}

/// Pattern on the panel: `"black"`, a white disc, or fringes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PatternBody {
    /// No light.
    Black,
    /// A white disc.
    Disc {
        /// Centre relative to the panel's centre, to the right and up, in mm.
        #[schema(min_items = 2, max_items = 2)]
        center_mm: [f64; 2],
        /// Diameter in mm.
        #[schema(exclusive_minimum = 0.0)]
        diameter_mm: f64,
    },
    /// Stripes over the whole panel, luminance (1 + cos 2π(f · x + phase)) / 2; uniform light without `frequency`.
    Fringes {
        /// Frequency to the right and up, in cycles per mm.
        #[schema(min_items = 2, max_items = 2)]
        cycles_per_mm: [f64; 2],
        /// Phase at the panel's centre, in cycles.
        phase: f64,
        /// Exponent of the panel's tone curve if no measured curve is configured.
        #[schema(minimum = 0.2, maximum = 5)]
        gamma: f64,
    },
}

/// Target angle of the analyser.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Move {
    #[schema(example = 45.0)]
    analyser_deg: f64,
}

/// Exposure and gain of the preview.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSettings {
    #[schema(example = 10.0)]
    exposure_ms: f64,
    #[schema(example = 1.0)]
    gain: f64,
}

/// Pattern to show.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "pattern": { "disc": { "center_mm": [0, 0], "diameter_mm": 180 } } }))]
pub struct ShowBody {
    pattern: PatternBody,
}

/// Switches the flash; it goes off after `seconds`, at most its longest on-time.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SwitchBody {
    on: bool,
    #[schema(example = 0.1)]
    seconds: Option<f64>,
}

/// An empty body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Nothing {}

/// Width of a picture.
#[derive(Clone, Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Width {
    /// Most pixels per row.
    #[param(minimum = 1, maximum = 16384)]
    pub width: Option<usize>,
}

/// The bench has been stopped.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Stopped {
    stopped: bool,
}

impl From<Pattern> for PatternBody {
    fn from(pattern: Pattern) -> Self {
        match pattern {
            Pattern::Black => Self::Black,
            Pattern::Disc { center_mm, diameter_mm } => Self::Disc { center_mm, diameter_mm },
            Pattern::Fringes { cycles_per_mm, phase, gamma } => Self::Fringes { cycles_per_mm, phase, gamma },
        }
    }
}

impl PatternBody {
    /// Checks that the pattern fits on the panel.
    fn checked(self, size_mm: [f64; 2]) -> Answer<Pattern> {
        let pattern = match self {
            Self::Black => return Ok(Pattern::Black),
            Self::Fringes { cycles_per_mm, phase, gamma } => {
                let sane =
                    cycles_per_mm.iter().all(|f| f.abs() <= 1.0) && phase.abs() <= 1e6 && (0.2..=5.0).contains(&gamma);
                let problem =
                    || Problem::bad("fringes have at most 1 cycle per mm, a finite phase and a gamma of 0.2 to 5");
                return sane.then_some(Pattern::Fringes { cycles_per_mm, phase, gamma }).ok_or_else(problem);
            }
            Self::Disc { center_mm, diameter_mm } => Pattern::Disc { center_mm, diameter_mm },
        };
        let reach = pattern.reach_mm();
        let positive = matches!(self, Self::Disc { diameter_mm, .. } if diameter_mm > 0.0);
        if !positive || !reach.iter().zip(size_mm).all(|(r, s)| *r <= 0.5 * s) {
            let [w, h] = size_mm;
            return Err(Problem::bad(format!("the disc does not fit on the panel of {w} × {h} mm")));
        }
        Ok(pattern)
    }
}

/// State of the devices, read from the devices.
fn describe(app: &App, owner: &Owner) -> Devices {
    Devices { activity: "idle", session: None, ..at_rest(app) }.with(owner)
}

fn at_rest(app: &App) -> Devices {
    let (stage, camera, display) = (&app.limits.stage, &app.limits.camera, &app.limits.display);
    let session = app.bench.session();
    Devices {
        activity: if session.as_deref() == Some(PANEL) { "manual" } else { "session" },
        session: session.filter(|id| id != PANEL),
        stage: StageState {
            id: stage.id.clone(),
            analyser_deg: None,
            limits_deg: stage.limits_deg,
            speed_deg_s: stage.speed_deg_s,
            by_hand: stage.by_hand,
            halts: stage.halts,
        },
        camera: CameraState {
            id: camera.id.clone(),
            width: camera.width,
            height: camera.height,
            exposure_ms: 1000.0 * camera.exposure_now_s,
            gain: camera.gain[0],
            exposure_range_ms: camera.exposure_s.map(|s| 1000.0 * s.min(LONGEST_PREVIEW_S)),
            gain_range: camera.gain,
            black: camera.black,
            white: camera.white,
            warnings: camera.warnings.clone(),
        },
        display: PanelState { id: display.id.clone(), size_mm: display.size_mm, pattern: PatternBody::Black },
        flash: app.limits.flash.as_ref().map(|f| FlashState { id: f.id.clone(), on: false, max_on_s: f.max_on_s }),
        interlocks: app.interlocks.iter().map(|id| InterlockState { id: id.clone(), holds: None }).collect(),
        simulated: app.simulated,
    }
}

impl Devices {
    fn with(mut self, owner: &Owner) -> Self {
        self.stage.analyser_deg = owner.analyser_deg;
        (self.camera.exposure_ms, self.camera.gain) = (1000.0 * owner.settings.0.as_secs_f64(), owner.settings.1);
        self.display.pattern = owner.pattern.into();
        let levels = owner.runtime.block_on(owner.rig.watch.levels());
        self.interlocks = levels.into_iter().map(|(id, holds)| InterlockState { id, holds }).collect();
        if let Some(flash) = &mut self.flash {
            flash.on = owner.flash_is_on();
        }
        self
    }
}

/// Runs a manual operation and answers with the new state of the bench.
async fn and_describe(
    app: &Arc<App>,
    work: impl FnOnce(&mut Owner) -> Result<(), Failure> + Send + 'static,
) -> Answer<Json<Devices>> {
    let for_description = app.clone();
    let done = app.bench.work(move |owner| {
        work(owner)?;
        Ok(describe(&for_description, owner))
    });
    Ok(Json(done.await?))
}

/// Reads the state of the bench.
#[utoipa::path(get, path = "/api/v1/devices", tag = "devices", operation_id = "devices",
    responses((status = 200, body = Devices)))]
pub async fn state(State(app): State<Arc<App>>) -> Json<Devices> {
    match and_describe(&app, |_| Ok(())).await {
        Ok(devices) => devices,
        // A session has the devices: only stored state is reported.
        Err(_) => Json(at_rest(&app)),
    }
}

/// Turns the analyser to an angle, approaching it from below.
#[utoipa::path(post, path = "/api/v1/devices/stage/move", tag = "devices", operation_id = "move_stage",
    request_body = Move,
    responses((status = 200, body = Devices), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn move_stage(State(app): State<Arc<App>>, Body(body): Body<Move>) -> Answer<Json<Devices>> {
    let [low, high] = app.limits.stage.limits_deg;
    if !(low..=high).contains(&body.analyser_deg) {
        return Err(Problem::bad(format!("analyser_deg is {}; give {low} to {high}", body.analyser_deg)));
    }
    and_describe(&app, move |owner| owner.turn(Some(body.analyser_deg))).await
}

/// Homes the stage: finds its mechanical zero.
#[utoipa::path(post, path = "/api/v1/devices/stage/home", tag = "devices", operation_id = "home_stage",
    request_body = Nothing,
    responses((status = 200, body = Devices), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn home_stage(State(app): State<Arc<App>>, Body(_nothing): Body<Nothing>) -> Answer<Json<Devices>> {
    and_describe(&app, |owner| owner.turn(None)).await
}

/// Shows a pattern until another one is shown or the light is switched off.
#[utoipa::path(post, path = "/api/v1/devices/display/show", tag = "devices", operation_id = "show_pattern",
    request_body = ShowBody,
    responses((status = 200, body = Devices), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn show(State(app): State<Arc<App>>, Body(body): Body<ShowBody>) -> Answer<Json<Devices>> {
    let pattern = body.pattern.checked(app.limits.display.size_mm)?;
    and_describe(&app, move |owner| owner.show(pattern)).await
}

/// Sets exposure and gain of the preview.
#[utoipa::path(post, path = "/api/v1/devices/camera/set", tag = "devices", operation_id = "set_camera",
    request_body = CameraSettings,
    responses((status = 200, body = Devices), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn set_camera(State(app): State<Arc<App>>, Body(body): Body<CameraSettings>) -> Answer<Json<Devices>> {
    let camera = &app.limits.camera;
    let (seconds, [shortest, longest], [low, high]) = (body.exposure_ms / 1000.0, camera.exposure_s, camera.gain);
    let longest = longest.min(LONGEST_PREVIEW_S);
    if !(shortest..=longest).contains(&seconds) || !(low..=high).contains(&body.gain) {
        let [a, b] = [shortest, longest].map(|s| 1000.0 * s);
        return Err(Problem::bad(format!("give an exposure of {a} to {b} ms and a gain of {low} to {high}")));
    }
    and_describe(&app, move |owner| {
        owner.settings = (Duration::from_secs_f64(seconds), body.gain);
        Ok(())
    })
    .await
}

/// Sets the preview's exposure by metering the present light. The analyser stays where it is.
#[utoipa::path(post, path = "/api/v1/devices/camera/meter", tag = "devices", operation_id = "meter_camera",
    request_body = Nothing,
    responses((status = 200, body = Devices), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn meter_camera(State(app): State<Arc<App>>, Body(_nothing): Body<Nothing>) -> Answer<Json<Devices>> {
    and_describe(&app, |owner| owner.meter(Duration::from_secs_f64(LONGEST_PREVIEW_S))).await
}

/// Switches the flash.
#[utoipa::path(post, path = "/api/v1/devices/flash/switch", tag = "devices", operation_id = "switch_flash",
    request_body = SwitchBody,
    responses((status = 200, body = Devices), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem)))]
pub async fn switch_flash(State(app): State<Arc<App>>, Body(body): Body<SwitchBody>) -> Answer<Json<Devices>> {
    let Some(flash) = &app.limits.flash else { return Err(Problem::not_found("flash")) };
    // Slightly less than the flash's own limit, so that the service ends the flash.
    let seconds = body.seconds.unwrap_or(f64::INFINITY).min(flash.max_on_s - 0.2);
    if body.on && seconds <= 0.0 {
        return Err(Problem::bad("seconds must be above 0"));
    }
    and_describe(&app, move |owner| owner.flash(body.on.then_some(seconds))).await
}

/// Aborts everything and switches all light off.
#[utoipa::path(post, path = "/api/v1/stop", tag = "devices", operation_id = "stop",
    responses((status = 200, body = Stopped), (status = 409, body = Problem)))]
pub async fn stop(State(app): State<Arc<App>>) -> Answer<Json<Stopped>> {
    app.samples.abort();
    app.bench.stop().await?;
    Ok(Json(Stopped { stopped: true }))
}
