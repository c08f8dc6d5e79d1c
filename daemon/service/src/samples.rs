//! `/api/v1/samples`: simulated samples, to try Nacre without a bench. Their sessions leave the bench alone.

use super::pace::Expected;
use super::plans::PlanBody;
use super::problem::{Answer, Kind, Problem};
use super::runs::Run;
use super::sessions::{accepted, capture, failed, tell_states};
use super::{App, At, Body, Params, blocking, devices, png};
use axum::Json;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use nacre_base::progress::Silent;
use nacre_capture::Failure;
use nacre_capture::engine::Input;
use nacre_capture::plan::{Limits, Plan, PlanKind};
use nacre_capture::rig::{Rig, SimulatedBench, Stop, Uses, runtime};
use nacre_drivers::Pattern;
use nacre_image::{Palette, Rgb, encode_png8};
use nacre_sim::surface::{Sample, SampleConfig, SampleKind, Surface};
use nacre_sim::{Bench, BenchConfig, CameraConfig, Shining};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use utoipa::ToSchema;

/// Width and height of the photographs in pixels: a session with its results takes about ten seconds.
const SIDE: u32 = 512;

/// The same for fringes, of which each takes as long to simulate as sixteen discs.
const FRINGES_SIDE: u32 = 128;

/// Distance from sample to panel in mm, and size of the panel in mm, at which first orders of periods from 1.2 µm reach
/// the panel.
const NEAR_MM: f64 = 250.0;
const NEAR_PANEL_MM: [f64; 2] = [520.0, 320.0];

/// Analyser angles in degrees: twice as many as are needed, so that the uncertainty is that of a real session.
const ANGLES_DEG: [f64; 8] = [0.0, 22.5, 45.0, 67.5, 90.0, 112.5, 135.0, 157.5];

/// Assumed exposure until metering has found it.
const EXPOSURE: Duration = Duration::from_millis(40);

/// Usual and largest side of a picture in pixels.
const PICTURE: [usize; 2] = [192, 512];

/// Side of the photographs in pixels, and their analyser angles in degrees.
const PHOTOGRAPH: u32 = 128;
const PHOTOGRAPHED_DEG: [f64; 4] = [0.0, 45.0, 90.0, 135.0];

/// Exponent of a display's tone curve.
const DISPLAY_GAMMA: f64 = 2.2;

/// Surface points per pixel and direction, for smooth edges.
const POINTS: usize = 3;

/// Colours of surfaces without orientation, under full light.
const MIRROR: Rgb = [205, 210, 214];
const PAPER: Rgb = [150, 147, 140];
const NOTHING: Rgb = [8, 9, 10];

/// A simulated sample.
#[derive(Debug, Serialize, ToSchema)]
pub struct SampleDoc {
    #[schema(example = "stars")]
    kind: &'static str,
    /// Description for people.
    about: String,
}

/// The simulated samples.
#[derive(Debug, Serialize, ToSchema)]
pub struct SampleList {
    items: Vec<SampleDoc>,
}

/// The newest session of a simulated sample; one runs at a time.
#[derive(Default)]
pub struct Samples(Mutex<Option<(Arc<Run>, JoinHandle<()>)>>);

impl Samples {
    fn locked(&self) -> MutexGuard<'_, Option<(Arc<Run>, JoinHandle<()>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Aborts the session under way, if any.
    pub fn abort(&self) {
        if let Some((run, _)) = self.locked().as_ref() {
            // A run that has ended needs no abort.
            let _ = run.control.send(Input::Abort);
        }
    }

    /// Aborts the session under way and waits for its end.
    pub fn close(&self) {
        self.abort();
        let current = self.locked().take();
        if let Some((_, thread)) = current {
            let _ = thread.join();
        }
    }
}

/// Lists the simulated samples.
#[utoipa::path(get, path = "/api/v1/samples", tag = "samples", operation_id = "samples",
    responses((status = 200, body = SampleList)))]
pub async fn list() -> Json<SampleList> {
    let schema = serde_json::to_value(schemars::schema_for!(SampleKind)).unwrap_or_default();
    let about = |kind: &str| {
        let kinds = schema["oneOf"].as_array().into_iter().flatten();
        kinds.filter(|k| k["const"] == kind).find_map(|k| k["description"].as_str()).unwrap_or_default().to_owned()
    };
    let items = SampleKind::ALL.map(|kind| SampleDoc { kind: kind.name(), about: about(kind.name()) });
    Json(SampleList { items: items.into() })
}

/// Picture of a simulated sample: its orientations in the colours of maps.
#[utoipa::path(get, path = "/api/v1/samples/{kind}/picture.png", tag = "samples", operation_id = "sample_picture",
    params(("kind" = String, Path, description = "A `kind` of the list"), devices::Width),
    responses((status = 200, content_type = "image/png", body = [u8]), (status = 400, body = Problem),
        (status = 404, body = Problem)))]
pub async fn picture(At(kind): At<String>, Params(query): Params<devices::Width>) -> Answer<Response> {
    let kind = named(&kind)?;
    let side = super::picture_width(query.width, PICTURE[0])?.min(PICTURE[1]);
    let body = blocking(move || png(encode_png8(side, side, 3, &drawn(kind, side)))).await?;
    Ok(body.into_response())
}

/// Photographs of a simulated sample at analyser angles of 0°, 45°, 90° and 135°, in a row.
#[utoipa::path(get, path = "/api/v1/samples/{kind}/photographs.png", tag = "samples", operation_id = "sample_photographs",
    params(("kind" = String, Path, description = "A `kind` of the list")),
    responses((status = 200, content_type = "image/png", body = [u8]), (status = 404, body = Problem)))]
pub async fn photographs(At(kind): At<String>) -> Answer<Response> {
    let kind = named(&kind)?;
    let body = blocking(move || {
        let [width, height] = [PHOTOGRAPHED_DEG.len(), 1].map(|n| n * PHOTOGRAPH as usize);
        png(encode_png8(width, height, 1, &photographed(kind)?))
    });
    Ok(body.await?.into_response())
}

/// A session of a simulated sample.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// The plan; default: eight analyser angles and a map of orientations. Plans of the kind spots are carried out with
    /// the panel near the sample, where it catches the first orders.
    #[schema(value_type = Option<Object>)]
    plan: Option<Value>,
}

/// Starts a session with results of a simulated sample. It runs beside the bench and moves no device.
#[utoipa::path(post, path = "/api/v1/samples/{kind}/sessions", tag = "samples", operation_id = "try_sample",
    params(("kind" = String, Path, description = "A `kind` of the list")), request_body = Trial,
    responses((status = 202, body = super::session_doc::SessionDoc, headers(("Location" = String, description = "The session"))),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn begin(
    State(app): State<Arc<App>>,
    At(kind): At<String>,
    Body(Trial { plan: asked }): Body<Trial>,
) -> Answer<Response> {
    let kind = named(&kind)?;
    if app.stores.is_full() {
        return Err(Problem::full());
    }
    let plan = match asked {
        Some(asked) => PlanBody::from(asked).plan()?,
        None => plan(kind)?,
    };
    let limits = limits(&bench(kind, plan.kind));
    let problems = plan.check_limits(&limits);
    if !problems.is_empty() {
        return Err(Problem::bad(problems.join("; ")).remedy("change the plan"));
    }
    let id = super::new_id();
    let expected = {
        let plan = plan.clone();
        blocking(move || Ok(Expected::of(&plan, EXPOSURE, &limits))).await?
    };
    let run = Arc::new(Run::new(id.clone(), app.session_folder(&id)?, plan, expected));
    start(&app, &run, kind, true)?;
    accepted(&app, &id)
}

/// Starts or resumes a run on the bench of a sample.
///
/// # Errors
/// `busy` while another sample's session runs.
pub fn start(app: &Arc<App>, run: &Arc<Run>, kind: SampleKind, new: bool) -> Answer<()> {
    let mut current = app.samples.locked();
    if let Some((other, _)) = current.as_ref().filter(|(run, _)| !run.is_over()) {
        let problem = format!("the session {} of a simulated sample is under way", other.id);
        return Err(Problem::new(Kind::Busy, problem).remedy("wait until it is done, or stop it"));
    }
    let before = app.runs.insert(run.clone());
    let (working, finished) = (run.clone(), app.clone());
    let work = move || {
        if let Err(failure) = perform(&working, kind, new) {
            failed(&working, failure);
        }
        working.end();
        finished.metrics.session_ended(working.control.state());
    };
    match std::thread::Builder::new().name("sample".into()).spawn(work) {
        Ok(thread) => *current = Some((run.clone(), thread)),
        Err(error) => {
            app.runs.restore(&run.id, before);
            return Err(Problem::refused("the session's thread", &error));
        }
    }
    drop(current);
    let (app, run) = (app.clone(), run.clone());
    tokio::spawn(async move { tell_states(&app, &run).await });
    Ok(())
}

fn perform(run: &Run, kind: SampleKind, new: bool) -> Result<(), Failure> {
    let runtime = runtime()?;
    let place = SimulatedBench::Here { config: Box::new(bench(kind, run.plan.kind)), real_time: true }.into();
    let mut rig = Rig::open(&runtime, &place, Uses::SESSION, &Silent, &Stop::default())?;
    // The bench of a sample is not the one that calibrations describe.
    capture(run, &runtime, &mut rig, new, None);
    Ok(())
}

fn named(name: &str) -> Answer<SampleKind> {
    let kind = SampleKind::ALL.into_iter().find(|kind| kind.name() == name);
    kind.ok_or_else(|| Problem::not_found("such sample").remedy("GET /api/v1/samples lists them"))
}

/// Bench of a sample for a kind of plan.
fn bench(kind: SampleKind, plan: PlanKind) -> BenchConfig {
    let near = plan == PlanKind::Spots;
    let side = if near { FRINGES_SIDE } else { SIDE };
    let mut bench = BenchConfig {
        sample: SampleConfig { kind, ..SampleConfig::default() },
        camera: CameraConfig { width: side, height: side, ..CameraConfig::default() },
        ..BenchConfig::default()
    };
    if near {
        bench.geometry.distance_mm = NEAR_MM;
        bench.panel.size_mm = NEAR_PANEL_MM;
    }
    bench
}

/// The sample whose bench this is.
pub fn kind_of(config: &BenchConfig) -> Option<SampleKind> {
    let kind = config.sample.kind;
    [PlanKind::Polarization, PlanKind::Spots].iter().any(|plan| bench(kind, *plan) == *config).then_some(kind)
}

fn limits(bench: &BenchConfig) -> Limits {
    let devices = nacre_sim::describe(bench);
    Limits { stage: devices.stage, camera: devices.camera, display: devices.display, flash: Some(devices.flash) }
}

fn plan(kind: SampleKind) -> Answer<Plan> {
    let plan: Value = json!({
        "kind": "polarization", "name": format!("Sample: {}", kind.name()), "sample": kind.name(),
        "notes": "A simulated sample.", "camera": { "exposure": "meter" }, "analyser": { "angles_deg": ANGLES_DEG },
        "extras": ["dark", "display_black"], "reconstruct": { "operation": "polarization" },
    });
    serde_json::from_value(plan).map_err(|error| Problem::new(Kind::Internal, error.to_string()))
}

/// RGB bytes of a sample's picture.
fn drawn(kind: SampleKind, side: usize) -> Vec<u8> {
    let config = bench(kind, PlanKind::Polarization);
    let sample = Sample::new(&config.sample, config.seed);
    let (palette, field) = (Palette::default().table(), sample.field_mm());
    let at = |k: usize| ((k as f64 + 0.5) / (side * POINTS) as f64 - 0.5) * field;
    let color = |column: usize, row: usize| -> [f64; 3] {
        let point = sample.at(at(column), -at(row));
        let color = match point.surface {
            Surface::Grating { orientation, .. } => palette.color(orientation),
            Surface::Mirror | Surface::Bare { .. } => MIRROR,
            Surface::Diffuse => PAPER,
            Surface::Nothing => NOTHING,
        };
        color.map(f64::from)
    };
    let pixel = |column: usize, row: usize| {
        let points = (0..POINTS * POINTS).map(|k| color(column * POINTS + k % POINTS, row * POINTS + k / POINTS));
        let sum = points.fold([0.0; 3], |sum, color| std::array::from_fn(|c| sum[c] + color[c]));
        sum.map(|v| (v / (POINTS * POINTS) as f64).round() as u8)
    };
    (0..side * side).flat_map(|k| pixel(k % side, k / side)).collect()
}

/// Grey levels of the photographs in a row.
fn photographed(kind: SampleKind) -> Answer<Vec<u8>> {
    let camera = CameraConfig { width: PHOTOGRAPH, height: PHOTOGRAPH, ..CameraConfig::default() };
    let config = BenchConfig { camera, ..bench(kind, PlanKind::Polarization) };
    let mut bench = Bench::new(&config, &Silent).map_err(Failure::from)?;
    let pattern = Pattern::Disc { center_mm: [0.0; 2], diameter_mm: config.disc_mm() };
    bench.shine(Shining { pattern, flash: false, covered: false }, Duration::ZERO);
    let codes: Vec<Vec<u16>> = PHOTOGRAPHED_DEG.map(|angle| photograph(&mut bench, angle)).into();
    let [dark, light] = [codes.iter().flatten().min(), codes.iter().flatten().max()].map(|c| c.copied().unwrap_or(0));
    let grey = |code: u16| {
        let level = f64::from(code - dark) / f64::from((light - dark).max(1));
        (255.0 * level.powf(1.0 / DISPLAY_GAMMA)) as u8
    };
    let row = |y: usize| codes.iter().flat_map(move |frame| frame.chunks(PHOTOGRAPH as usize).nth(y));
    Ok((0..PHOTOGRAPH as usize).flat_map(row).flatten().map(|code| grey(*code)).collect())
}

/// Sensor codes of a photograph that begins once the analyser has arrived.
fn photograph(bench: &mut Bench, angle_deg: f64) -> Vec<u16> {
    let arrived = bench.turn_analyser(angle_deg);
    bench.advance_to(arrived);
    // The exposure in progress began earlier.
    while bench.take_frame().is_some() {}
    for _ in 0..2 {
        bench.advance_to(bench.next_frame_at());
    }
    let mut newest = vec![];
    while let Some(frame) = bench.take_frame() {
        newest = bench.codes(&frame);
    }
    newest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_has_a_valid_plan_and_a_picture_of_its_own() {
        let mut pictures: Vec<Vec<u8>> = vec![];
        for kind in SampleKind::ALL {
            let plan = plan(kind).unwrap();
            for of in [PlanKind::Polarization, PlanKind::Spots] {
                assert_eq!(kind_of(&bench(kind, of)), Some(kind));
            }
            assert_eq!(plan.check_limits(&limits(&bench(kind, plan.kind))), [""; 0], "{kind:?}");
            let picture = drawn(kind, 24);
            assert!(picture.chunks(3).any(|rgb| rgb != &picture[..3]), "{kind:?} is uniform");
            assert!(!pictures.contains(&picture), "{kind:?}");
            pictures.push(picture);
            let frames = photographed(kind).unwrap();
            assert_eq!(frames.len(), 4 * 128 * 128);
            assert!(frames.contains(&0) && frames.contains(&255), "{kind:?}");
        }
        assert_eq!(kind_of(&BenchConfig::default()), None);
    }
}
