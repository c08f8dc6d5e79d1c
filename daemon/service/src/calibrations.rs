//! `/api/v1/calibrations`: stored calibrations of the bench.

use super::config::LONGEST_AGE;
use super::deletion::Deletion;
use super::keys::Keyed;
use super::paths::without_folders;
use super::problem::{Answer, Problem};
use super::trash::{Deleted, Thing};
use super::{App, At, Params, blocking, files};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_capture::calibrations::{Calibrations, Choice, Chosen, Conditions, Found, Origin, Present, Stored, age_days};
use nacre_capture::plan::{CalibrationKind, Plan};
use nacre_capture::session::SessionFile;
use nacre_frames::Calibration;
use nacre_store::jobs::JobState;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::SystemTime;
use utoipa::{IntoParams, ToSchema};

/// Most calibrations in a list.
const MOST: usize = 1000;

/// A stored calibration.
#[derive(Debug, Serialize, ToSchema)]
pub struct CalibrationDoc {
    id: String,
    /// `camera`, `flat`, `analyser`, `retarder` or `orientation`.
    #[schema(value_type = String)]
    kind: CalibrationKind,
    name: String,
    notes: String,
    /// Time of its photographs in Unix seconds.
    taken: u64,
    /// Age in days.
    age_days: f64,
    /// Identities of the devices that it depends on.
    devices: Vec<String>,
    /// Exposure, gain, wavelength, region and mounting of its photographs. Unknown ones are absent.
    #[schema(value_type = Object)]
    conditions: Conditions,
    /// Session of its photographs.
    session: Option<String>,
    /// Reconstruction from which it was kept.
    reconstruction: Option<String>,
    /// Version of the program that kept it.
    software: String,
    /// Whether it applies to a session of whole frames on the present bench, and is not too old. Sessions use the
    /// newest one of each kind.
    applies: bool,
    /// Why it does not apply.
    reason: Option<String>,
    /// Contents of `calibration.json`.
    #[schema(value_type = Object)]
    values: Calibration,
    /// Contents of `report.json`; omitted in lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    report: Option<serde_json::Value>,
}

/// Calibrations, the newest photographs first.
#[derive(Debug, Serialize, ToSchema)]
pub struct CalibrationList {
    items: Vec<CalibrationDoc>,
    /// Problems of calibrations that cannot be read.
    problems: Vec<String>,
    /// Maximum age in days (`calibration.max_age_days`).
    max_age_days: u32,
}

/// Filter of calibrations.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct CalibrationQuery {
    /// Only this kind.
    #[param(value_type = Option<String>, pattern = "^(camera|flat|analyser|retarder|orientation)$")]
    kind: Option<CalibrationKind>,
    /// Only those that apply to the present bench, or only those that do not.
    applies: Option<bool>,
    /// Only those up to this age in days.
    #[param(minimum = 0, maximum = 36500)]
    max_age_days: Option<u32>,
}

/// A finished result to keep as a calibration.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCalibration {
    /// Id of a reconstruction by `camera`, `flat`, `analyser`, `retarder` or `orientation`, or of a session with such
    /// results.
    from: String,
    /// At most 200 characters. Default: the name in the plan of the session.
    #[schema(max_length = 200)]
    name: Option<String>,
    /// At most 10,000 characters. Default: the notes in the plan of the session.
    #[schema(max_length = 10_000)]
    notes: Option<String>,
    /// For photographs that were uploaded: identities of the calibrated devices, as `/api/v1/devices` has them. For a
    /// flat field camera and panel.
    devices: Option<Vec<String>>,
}

/// A file of a calibration.
#[derive(Debug, Serialize, ToSchema)]
pub struct CalibrationFile {
    /// Name of the file.
    name: String,
    /// Size in bytes.
    bytes: u64,
}

/// Current time in Unix seconds.
fn now() -> u64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs())
}

impl App {
    /// Calibrations for sessions on the bench.
    pub fn calibration_choice(&self) -> Choice {
        let config = self.config();
        let calibrations = Calibrations::of_data(&config.data);
        Choice { calibrations, max_age_days: config.calibration.max_age_days }
    }

    /// Devices of the bench, with the region of interest of a plan.
    fn present(&self, roi: Option<[u32; 4]>) -> Present {
        Present::new(&self.limits, self.config().bench.mounting(), &self.setup, roi)
    }

    /// Calibrations that a plan would use now.
    ///
    /// # Errors
    /// `bad-request` if the plan lists one that does not exist or does not apply.
    pub fn chosen_calibrations(&self, plan: &Plan) -> Answer<Chosen> {
        Ok(self.calibration_choice().choose(plan, &self.present(plan.camera.roi), now())?)
    }

    fn describe_calibration(&self, stored: Stored, with_report: bool) -> CalibrationDoc {
        let Stored { record, calibration, folder } = stored;
        let time = now();
        let reason = self.calibration_choice().refusal(&record, &self.present(None), time);
        let report =
            || serde_json::from_str(&without_folders(std::str::from_utf8(&files::report(&folder).ok()?).ok()?)).ok();
        CalibrationDoc {
            age_days: age_days(&record, time),
            applies: reason.is_none(),
            reason,
            values: calibration,
            report: if with_report { report() } else { None },
            id: record.id,
            kind: record.kind,
            name: record.name,
            notes: record.notes,
            taken: record.taken,
            devices: record.devices,
            conditions: record.conditions,
            session: record.session,
            reconstruction: record.reconstruction,
            software: record.software,
        }
    }

    /// Folder of an existing calibration.
    ///
    /// # Errors
    /// `not-found` when there is none.
    fn existing_calibration(&self, id: &str) -> Answer<PathBuf> {
        super::check_id(id)?;
        let folder = Calibrations::of_data(&self.config().data).folder_of(id).filter(|folder| folder.is_dir());
        folder.ok_or_else(|| self.missing("calibration", id))
    }

    async fn calibration(self: &Arc<Self>, id: &str) -> Answer<CalibrationDoc> {
        self.existing_calibration(id)?;
        let (app, id) = (self.clone(), id.to_owned());
        blocking(move || {
            let stored = app.calibration_choice().calibrations.read(&id)?;
            Ok(app.describe_calibration(stored, true))
        })
        .await
    }

    /// Results and origin of a calibration to keep.
    async fn found_calibration(self: &Arc<Self>, body: NewCalibration) -> Answer<(Found, Origin)> {
        let NewCalibration { from, name, notes, devices } = body;
        let place = self.place(&from).await?;
        let job = if self.session_folder(&from)? == place.input { None } else { Some(self.job(&from).await?) };
        if job.as_ref().is_some_and(|job| job.state != JobState::Done) {
            return Err(
                Problem::bad(format!("the reconstruction {from} has no results")).remedy("wait until it is done")
            );
        }
        // An operation on results has the session of these.
        let session = match &job {
            None => Some(from),
            Some(job) => job.session.clone().or_else(|| job.spec.results.iter().find_map(|r| r.session.clone())),
        };
        let photographs = session.map(|id| self.session_folder(&id)).transpose()?;
        if photographs.is_some() && devices.is_some() {
            return Err(Problem::bad("devices are those of the session").remedy("leave devices out"));
        }
        let (created, reconstruction) = job.map_or((0, None), |job| (job.created, Some(job.id)));
        blocking(move || {
            let found = Found::read(&place.results)?;
            let of_session =
                |folder: &PathBuf| Some(Origin::of_session(found.kind, folder, &SessionFile::read(folder).ok()?));
            let unknown = || Origin { taken: created, devices: devices.unwrap_or_default(), ..Origin::default() };
            let mut origin = photographs.as_ref().and_then(of_session).unwrap_or_else(unknown);
            origin.name = name.unwrap_or(origin.name);
            origin.notes = notes.unwrap_or(origin.notes);
            origin.reconstruction = reconstruction;
            Ok((found, origin))
        })
        .await
    }
}

/// Lists calibrations, at most 1000, the newest photographs first.
#[utoipa::path(get, path = "/api/v1/calibrations", tag = "calibrations", operation_id = "calibrations",
    params(CalibrationQuery), responses((status = 200, body = CalibrationList), (status = 400, body = Problem)))]
pub async fn list(
    State(app): State<Arc<App>>,
    Params(query): Params<CalibrationQuery>,
) -> Answer<Json<CalibrationList>> {
    if let Some(days) = query.max_age_days.filter(|days| *days > LONGEST_AGE) {
        return Err(Problem::bad(format!("max_age_days is {days}; give 0 to {LONGEST_AGE}")));
    }
    let list = blocking(move || {
        let choice = app.calibration_choice();
        let (mut items, mut problems) = (vec![], vec![]);
        for entry in choice.calibrations.entries() {
            match entry {
                Ok(stored) => items.push(app.describe_calibration(stored, false)),
                Err(error) => problems.push(without_folders(&error.to_string())),
            }
        }
        items.retain(|doc| {
            query.kind.is_none_or(|kind| doc.kind == kind)
                && query.applies.is_none_or(|applies| doc.applies == applies)
                && query.max_age_days.is_none_or(|days| doc.age_days <= f64::from(days))
        });
        items.truncate(MOST);
        Ok(CalibrationList { items, problems, max_age_days: choice.max_age_days })
    });
    Ok(Json(list.await?))
}

/// Keeps a finished result as a calibration.
#[utoipa::path(post, path = "/api/v1/calibrations", tag = "calibrations", operation_id = "keep_calibration",
    request_body = NewCalibration,
    params(("Idempotency-Key" = Option<String>, Header, description = "Keep it once only", min_length = 1, max_length = 200)),
    responses((status = 201, body = CalibrationDoc, headers(("Location" = String, description = "The calibration"))),
        (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn keep(State(app): State<Arc<App>>, Keyed { body, key }: Keyed<NewCalibration>) -> Answer<Response> {
    let (found, origin) = app.found_calibration(body).await?;
    let mut turn = app.keys.turn(key).await;
    // If the calibration was deleted since, it is kept again.
    let made = turn.made().filter(|id| app.existing_calibration(id).is_ok());
    let id = match made {
        Some(id) => {
            turn.same()?;
            id
        }
        None => {
            let (id, calibrations) = (turn.begin(), app.calibration_choice().calibrations);
            blocking(move || Ok(calibrations.keep(id, &found, origin)?.id)).await?
        }
    };
    let location = [(header::LOCATION, format!("/api/v1/calibrations/{id}"))];
    Ok((StatusCode::CREATED, location, Json(app.calibration(&id).await?)).into_response())
}

/// Reads a calibration with its report.
#[utoipa::path(get, path = "/api/v1/calibrations/{id}", tag = "calibrations", operation_id = "calibration",
    params(("id" = String, Path)), responses((status = 200, body = CalibrationDoc), (status = 404, body = Problem)))]
pub async fn get(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<CalibrationDoc>> {
    Ok(Json(app.calibration(&id).await?))
}

/// Lists the files of a calibration.
#[utoipa::path(get, path = "/api/v1/calibrations/{id}/files", tag = "calibrations", operation_id = "calibration_files",
    params(("id" = String, Path)),
    responses((status = 200, body = Vec<CalibrationFile>), (status = 404, body = Problem)))]
pub async fn list_files(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Vec<CalibrationFile>>> {
    let folder = app.existing_calibration(&id)?;
    let files = blocking(move || Ok(files::list(&folder))).await?;
    Ok(Json(files.into_iter().map(|(name, bytes)| CalibrationFile { name, bytes }).collect()))
}

/// Downloads a file of a calibration.
#[utoipa::path(get, path = "/api/v1/calibrations/{id}/files/{file}", tag = "calibrations",
    operation_id = "calibration_file",
    params(("id" = String, Path), ("file" = String, Path, description = "For instance calibration.json")),
    responses((status = 200, content_type = "application/octet-stream", body = [u8]), (status = 404, body = Problem)))]
pub async fn file(
    State(app): State<Arc<App>>,
    At((id, name)): At<(String, String)>,
    wishes: HeaderMap,
) -> Answer<Response> {
    let folder = app.existing_calibration(&id)?;
    files::send(&files::inside(&folder, &name)?, files::BYTES, &wishes).await
}

/// Summarises the deletion of a calibration. Its token is not required for the deletion.
#[utoipa::path(get, path = "/api/v1/calibrations/{id}/deletion", tag = "calibrations",
    operation_id = "calibration_deletion", params(("id" = String, Path)),
    responses((status = 200, body = Deletion), (status = 404, body = Problem)))]
pub async fn deletion(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Deletion>> {
    let folder = app.existing_calibration(&id)?;
    let files = blocking(move || Ok(files::list(&folder))).await?;
    Ok(Deletion::of(&app, &id, &files, app.trash_days()))
}

/// Deletes a calibration: it goes to the trash. Sessions that used it keep their copy.
#[utoipa::path(delete, path = "/api/v1/calibrations/{id}", tag = "calibrations", operation_id = "delete_calibration",
    params(("id" = String, Path)), responses((status = 204), (status = 404, body = Problem)))]
pub async fn delete(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<StatusCode> {
    let _turn = app.trash_turn.lock().await;
    let folder = app.existing_calibration(&id)?;
    let owner = app.clone();
    blocking(move || {
        let stored = owner.calibration_choice().calibrations.read(&id);
        let named = stored.map_or_else(|_| String::new(), |stored| stored.record.name);
        let name = if named.is_empty() { format!("Calibration {id}") } else { named };
        owner.discard(&id, &Deleted::now(Thing::Calibration, name, None), &[folder])
    })
    .await?;
    Ok(StatusCode::NO_CONTENT)
}
