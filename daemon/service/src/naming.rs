//! Names of sessions, uploads and reconstructions: given by people, or derived from the sample, the files or the
//! input.

use super::problem::{Answer, Kind, Problem};
use super::reconstructions::Reconstruction;
use super::session_doc::SessionDoc;
use super::stored_uploads::StoredUpload;
use super::{App, At, Body, blocking};
use axum::Json;
use axum::extract::State;
use nacre_capture::naming::{ABOUT_FILE, capitalised, checked, give, given, of_kind, of_session, shortened};
use nacre_capture::plan::Method;
use nacre_capture::session::{SESSION_FILE, SessionFile};
use nacre_frames::FILE_NAME;
use nacre_store::jobs::Spec;
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;
use utoipa::ToSchema;

/// Names of results by operation. Results of other operations have the operation's name.
const RESULTS: [(&str, &str); 11] = [
    ("hdr", "Merged exposures"),
    ("lut", "Diffraction table"),
    ("bokeh", "Lines"),
    ("brdf", "Diffracted light"),
    ("spots", "Periods"),
    ("flash", "Flash orientation"),
    ("foil", "Dots"),
    ("calibrate", "Calibration"),
    ("map", "Edited maps"),
    ("render", "Rendering"),
    ("inspect", "Inspection"),
];

/// A new name.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewName {
    /// At most 200 characters, none of them a control character. Empty: the derived name.
    #[schema(max_length = 200, example = "Hologram 7, front")]
    name: String,
}

impl NewName {
    fn checked(&self) -> Answer<String> {
        checked(&self.name).map_err(|problem| Problem::bad(problem).remedy("give another name"))
    }
}

/// Checks the name in a request; empty where none is given.
///
/// # Errors
/// `bad-request` for a name that is too long or contains control characters.
pub fn asked(name: Option<String>) -> Answer<String> {
    name.map_or_else(|| Ok(String::new()), |name| NewName { name }.checked())
}

/// Names a session.
#[utoipa::path(patch, path = "/api/v1/sessions/{id}", tag = "sessions", operation_id = "name_session", request_body = NewName,
    params(("id" = String, Path)), responses((status = 200, body = SessionDoc), (status = 400, body = Problem),
        (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn session(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Body(body): Body<NewName>,
) -> Answer<Json<SessionDoc>> {
    let (folder, name) = (app.existing_session(&id)?, body.checked()?);
    let place = folder.clone();
    blocking(move || Ok(give(&place, &name)?)).await?;
    app.note(&folder).await;
    Ok(Json(blocking(move || SessionDoc::read(&app, &id, false)).await?))
}

/// Names an upload.
#[utoipa::path(patch, path = "/api/v1/uploads/{id}", tag = "reconstructions", operation_id = "name_upload", request_body = NewName,
    params(("id" = String, Path)), responses((status = 200, body = StoredUpload), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn upload(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Body(body): Body<NewName>,
) -> Answer<Json<StoredUpload>> {
    let (folder, name) = (app.existing_upload(&id)?, body.checked()?);
    blocking(move || Ok(give(&folder, &name)?)).await?;
    Ok(Json(app.stored_upload(id).await?))
}

/// Names a reconstruction or rendering. Results of a session have the session's name.
#[utoipa::path(patch, path = "/api/v1/reconstructions/{id}", tag = "reconstructions", operation_id = "name_reconstruction",
    request_body = NewName, params(("id" = String, Path)),
    responses((status = 200, body = Reconstruction), (status = 400, body = Problem), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn reconstruction(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Body(body): Body<NewName>,
) -> Answer<Json<Reconstruction>> {
    let name = body.checked()?;
    super::check_id(&id)?;
    if app.session_folder(&id)?.join(SESSION_FILE).exists() {
        return Err(
            Problem::new(Kind::Conflict, "results of a session are called as the session").remedy("name the session")
        );
    }
    let mut spec = app.job(&id).await?.spec;
    spec.name = name;
    let job = app.jobs()?.rename(&id, &app.name_of(&spec)).await?;
    Ok(Json(app.describe(job, false)))
}

impl App {
    /// Name of a job: as given, or else its result and the name of its input.
    pub fn name_of(&self, spec: &Spec) -> String {
        if !spec.name.is_empty() {
            return spec.name.clone();
        }
        let input = match spec.results.as_slice() {
            [] => None,
            [only] => Some(only.name.clone()),
            [first, rest @ ..] => Some(format!("{} and {} more", first.name, rest.len())),
        };
        if let Some(input) = input {
            let trains = spec.options.get("train").and_then(serde_json::Value::as_bool) == Some(true);
            return if trains { shortened(&format!("Limits from {input}")) } else { result_of(spec.operation, &input) };
        }
        let folder = match (&spec.session, &spec.upload) {
            (Some(id), _) => self.session_folder(id),
            (None, Some(id)) => self.upload_folder(id),
            (None, None) => return result_of(spec.operation, ""),
        };
        result_of(spec.operation, &folder.map(|folder| of_input(&folder)).unwrap_or_default())
    }

    /// Name of a job, or of a session with its own results, by id; empty if there is none.
    pub async fn name_of_result(&self, id: &str) -> Answer<String> {
        let folder = self.session_folder(id)?;
        match SessionFile::read(&folder) {
            Ok(session) => Ok(of_session(&folder, &session.plan)),
            Err(_) => Ok(self.name_of(&self.job(id).await?.spec)),
        }
    }
}

/// Name of an operation's result, from the name of its input.
pub fn result_of(method: Method, input: &str) -> String {
    let known = RESULTS.iter().find(|(operation, _)| method.is(operation));
    let result = known.map_or_else(|| capitalised(method.name()), |(_, result)| (*result).to_owned());
    if input.is_empty() { result } else { shortened(&format!("{result} of {input}")) }
}

/// Name of a session or upload by its folder; empty if the folder is gone, or if a session is called as its kind.
fn of_input(folder: &Path) -> String {
    match SessionFile::read(folder) {
        Ok(session) => {
            Some(of_session(folder, &session.plan)).filter(|name| *name != of_kind(&session.plan)).unwrap_or_default()
        }
        Err(_) => of_upload(folder),
    }
}

/// Name of an upload: as given, or that of its scene, or the common beginning of its file names.
pub fn of_upload(folder: &Path) -> String {
    given(folder).unwrap_or_else(|| {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.retain(|name| name != FILE_NAME && name != ABOUT_FILE);
        names.sort();
        of_files(&names)
    })
}

fn of_files(names: &[String]) -> String {
    let stem =
        |name: &String| Path::new(name).file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let stems: Vec<String> = match names.iter().find(|name| name.to_lowercase().ends_with(".toml")) {
        Some(scene) => vec![stem(scene)],
        None => names.iter().map(stem).collect(),
    };
    let name = match (stems.as_slice(), beginning(&stems)) {
        ([], _) => String::new(),
        ([only], _) => only.clone(),
        ([first, rest @ ..], "") => format!("{first} and {} more", rest.len()),
        (_, shared) => shared.to_owned(),
    };
    shortened(&name)
}

/// Words that all texts begin with, without numbers at the end; empty if there are none.
fn beginning(texts: &[String]) -> &str {
    let Some(first) = texts.first() else { return "" };
    let common = |other: &String| {
        let different = first.char_indices().zip(other.chars()).find(|((_, a), b)| a != b);
        different.map_or(first.len().min(other.len()), |((at, _), _)| at)
    };
    let length = texts.iter().map(common).min().unwrap_or(0);
    let mut shared = &first[..length];
    // A word that continues differently is not common.
    if texts.iter().any(|text| text[length..].starts_with(char::is_alphabetic)) {
        shared = shared.trim_end_matches(char::is_alphabetic);
    }
    shared.trim_end_matches(|c: char| !c.is_alphabetic())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uploads_are_called_as_their_files() {
        for (files, name) in [
            (&["cd-photo.png"][..], "cd-photo"),
            (&["disc_000.png", "disc_045.png", "disc_090.png"], "disc"),
            (&["left01.jpg", "left02.jpg"], "left"),
            (&["000.png", "045.png", "090.png"], "000 and 2 more"),
            (&["cat.png", "car.png"], "cat and 1 more"),
            (&["red cat.png", "red car.png"], "red"),
            (&["grünes-Blatt-1.tif", "grünes-Blatt-12.tif"], "grünes-Blatt"),
            (&["bunny.ply", "room.hdr", "table.toml"], "table"),
            (&["tile.png", "tile.tif"], "tile"),
            (&[], ""),
        ] {
            let files: Vec<String> = files.iter().map(|f| (*f).to_owned()).collect();
            assert_eq!(of_files(&files), name);
        }
    }
}
