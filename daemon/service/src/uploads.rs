//! `/api/v1/uploads`: photographs from elsewhere, streamed to the disk.

use super::connections::Activity;
use super::problem::{Answer, Kind, Problem};
use super::{App, Body, blocking, naming, scenes};
use axum::extract::multipart::{Field, MultipartRejection};
use axum::extract::{Multipart, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use nacre_base::temporary::TemporaryFolder;
use nacre_base::text::read_text;
use nacre_brdf::height;
use nacre_capture::import::{from_names, named_angles, with_transfer};
use nacre_capture::naming::give;
use nacre_frames::{FILE_NAME, load};
use nacre_image::{EXTENSIONS, info};
use nacre_maps::Maps;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::io::AsyncWriteExt;
use utoipa::ToSchema;

/// Most photographs of one upload.
const MAX_FILES: usize = 4096;

/// Longest file name in bytes.
const LONGEST_NAME: usize = 200;

/// Longest text part of a form in bytes, except the last part.
const LONGEST_WORD: usize = 1024;

/// Largest description of an upload in bytes.
const MAX_DESCRIPTION: u64 = 16 << 20;

/// A new upload.
#[derive(Debug, Serialize, ToSchema)]
pub struct Uploaded {
    id: String,
    name: String,
    files: usize,
    bytes: u64,
}

/// Form parts of an upload. `kind` comes first.
///
/// - `polarization`: photographs as parts `file` with their names, and their description as part `frames` (a
///   frames.json). Without `frames`, names such as `045.png` give the analyser angles, and colour files use green.
/// - `photographs`: exposures of one view, or single photographs.
/// - `surface`: one part `file`, a height field, which may be a text grid of numbers.
/// - `maps`: `orientation.exr`, `period.exr` or both.
/// - `table`: one EXR table, `lut.exr` (for `factor`) or `histogram.exr` (for `synthesize`).
/// - `limits`: one TOML file with limits of good sheets, for `inspect`.
/// - `scene`: one scene (TOML) and the files that it names. Alternatively `gallery` names an initial scene, `upload` an
///   earlier upload of a scene, or `result` a reconstruction or session. The result's orientation.exr, period.exr and
///   lut.exr are added to the scene; without a scene, they cover a flat sheet. After a part `folder`, the maps of the
///   next `result` lie in that subfolder, for a material of the scene.
#[derive(ToSchema)]
#[allow(dead_code, reason = "describes the form")]
pub struct Form {
    /// `polarization` (the default), `photographs`, `surface`, `maps`, `table`, `limits` or `scene`.
    kind: Option<String>,
    /// At most 200 characters. Default: derived from the files, `gallery` or `result`.
    name: Option<String>,
    /// For `scene`: `cd`, `phone`, `tv`, `star-paper`, `kinematic-tile`, `logo`, `emblem`, `spiral-foil`, `rolled` or
    /// `snake`. With `-room` appended, an environment map replaces the small light sources.
    gallery: Option<String>,
    /// For `scene`: id of an upload, whose files are taken over.
    upload: Option<String>,
    /// For `scene`: subfolder for the maps of the next `result`; letters, digits, `-` and `_`.
    folder: Option<String>,
    /// For `scene`: id of a reconstruction or session.
    result: Option<String>,
    /// A frames.json. Default of its `transfer`: as stated in the files, or else the usual transfer function of their
    /// type.
    frames: Option<String>,
    #[schema(value_type = Vec<String>, format = Binary)]
    file: Vec<Vec<u8>>,
}

impl App {
    /// Folder of an upload, whether it exists or not.
    ///
    /// # Errors
    /// `not-found` for an invalid id.
    pub fn upload_folder(&self, id: &str) -> Answer<PathBuf> {
        super::check_id(id)?;
        Ok(self.config().data.join("uploads").join(id))
    }

    /// Folder of an existing upload.
    ///
    /// # Errors
    /// `not-found` when there is none.
    pub fn existing_upload(&self, id: &str) -> Answer<PathBuf> {
        let folder = self.upload_folder(id)?;
        if folder.is_dir() { Ok(folder) } else { Err(self.missing("upload", id)) }
    }
}

/// Uploads photographs; `POST /api/v1/reconstructions` then computes maps from them.
#[utoipa::path(post, path = "/api/v1/uploads", tag = "reconstructions", operation_id = "upload",
    request_body(content = Form, content_type = "multipart/form-data"),
    responses((status = 201, body = Uploaded), (status = 400, body = Problem), (status = 413, body = Problem)))]
pub async fn upload(
    State(app): State<Arc<App>>,
    Extension(activity): Extension<Arc<Activity>>,
    form: Result<Multipart, MultipartRejection>,
) -> Answer<Response> {
    let form = form.map_err(|e| Problem::bad(e.body_text()))?;
    let id = super::new_id();
    let target = app.upload_folder(&id)?;
    // An incomplete upload is deleted: the folder is removed with this request.
    let folder = TemporaryFolder::new(&app.config().data.join("uploads"), id.as_ref()).map_err(refused)?;
    let (files, bytes) = receive(&app, &activity, form, folder.path()).await?;
    std::fs::rename(folder.path(), &target).map_err(refused)?;
    // The folder has been renamed to its final place.
    folder.keep();
    let name = blocking(move || Ok(naming::of_upload(&target))).await?;
    Ok((StatusCode::CREATED, Json(Uploaded { id, name, files, bytes })).into_response())
}

fn refused(error: std::io::Error) -> Problem {
    Problem::refused("the upload cannot be stored", &error)
}

/// Names of photographs.
#[derive(Deserialize, ToSchema)]
pub struct Names {
    /// Names in any order.
    #[schema(example = json!(["000.png", "045.png", "090.png", "135.png"]))]
    names: Vec<String>,
}

/// Analyser angles from names.
#[derive(Debug, Serialize, ToSchema)]
pub struct Angles {
    /// Angles in degrees, in the order of the names.
    angles_deg: Vec<f64>,
}

/// Reads analyser angles from names of photographs, as an upload without `frames` does.
#[utoipa::path(post, path = "/api/v1/uploads/angles", tag = "reconstructions", operation_id = "angles_in_names",
    request_body = Names, responses((status = 200, body = Angles), (status = 400, body = Problem)))]
pub async fn angles(Body(Names { names }): Body<Names>) -> Answer<Json<Angles>> {
    if names.len() > MAX_FILES {
        return Err(Problem::new(Kind::TooLarge, format!("more than {MAX_FILES} names")));
    }
    if let Some(long) = names.iter().find(|name| name.len() > LONGEST_NAME) {
        return Err(Problem::bad(format!("{:?}… is longer than {LONGEST_NAME} bytes", clip(long))).remedy("rename it"));
    }
    let files: Vec<PathBuf> = names.into_iter().map(PathBuf::from).collect();
    Ok(Json(Angles { angles_deg: named_angles("names", &files, "enter the angles")? }))
}

async fn receive(app: &App, activity: &Arc<Activity>, mut form: Multipart, folder: &Path) -> Answer<(usize, u64)> {
    let most = app.config().limits.upload_mib << 20;
    let (mut files, mut bytes, mut what, mut name) = (0, 0, What::Polarization, String::new());
    let mut start = scenes::Start::default();
    loop {
        let Some(field) =
            form.next_field().await.map_err(|e| Problem::bad(format!("the form is damaged: {}", e.body_text())))?
        else {
            break;
        };
        match field.name() {
            Some("kind") => {
                what = kind(&word(field).await?)?;
                continue;
            }
            Some("name") => {
                name = naming::asked(Some(word(field).await?))?;
                continue;
            }
            Some(part @ ("gallery" | "upload" | "folder" | "result")) if what == What::Scene => {
                let part = part.to_owned();
                let word = word(field).await?;
                let _work = activity.work();
                let source = start.add(app, &part, word, folder).await?;
                name = Some(name).filter(|name| !name.is_empty()).or(source).unwrap_or_default();
                continue;
            }
            _ => {}
        }
        let file = file_name(&field, what)?;
        files += usize::from(file != FILE_NAME);
        if files > MAX_FILES {
            return Err(Problem::new(Kind::TooLarge, format!("more than {MAX_FILES} photographs")));
        }
        if matches!(what, What::Surface | What::Table | What::Limits) && files > 1 {
            return Err(Problem::bad("more than one file for this kind of upload").remedy("send one part named file"));
        }
        bytes += store(field, &folder.join(&file), most.saturating_sub(bytes)).await?;
    }
    if files == 0 && what != What::Scene {
        return Err(Problem::bad("the form holds no photograph").remedy("send parts named file with file names"));
    }
    let folder = folder.to_path_buf();
    // The body is complete: from here the request counts as work, and waits for a place.
    let _work = activity.work();
    let _place = app.requests.acquire().await;
    app.heavy
        .work(move || {
            match what {
                What::Polarization => describe(&folder)?,
                What::Photographs => decodable(&folder)?,
                // The operation checks these: the scale of a height field may be missing.
                What::Surface | What::Table | What::Limits => {}
                What::Maps => Maps::read(&folder).map(drop)?,
                What::Scene => (files, bytes) = scenes::complete(&folder)?,
            }
            if !name.is_empty() {
                give(&folder, &name)?;
            }
            Ok((files, bytes))
        })
        .await
}

/// Kind of an upload.
#[derive(Clone, Copy, PartialEq)]
enum What {
    /// Photographs at several analyser angles, with or without description.
    Polarization,
    /// Photographs without analyser angles.
    Photographs,
    /// A height field.
    Surface,
    /// Maps of orientation and period.
    Maps,
    /// A lookup table or a histogram.
    Table,
    /// Limits of good sheets.
    Limits,
    /// A scene with its files.
    Scene,
}

/// Accepts plain names with the extensions of this kind, so that nothing is written outside the folder.
fn file_name(field: &Field<'_>, what: What) -> Answer<String> {
    match field.name() {
        Some("frames") if matches!(what, What::Photographs | What::Polarization) => return Ok(FILE_NAME.into()),
        Some("file") => {}
        _ => return Err(Problem::bad("the form has an unknown part for this kind of upload")),
    }
    let name = field.file_name().unwrap_or_default();
    let extension = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase());
    let (of, endings) = match what {
        What::Surface => ("height field", height::EXTENSIONS),
        What::Maps => ("map", &["exr"][..]),
        What::Table => ("table", &["exr"][..]),
        What::Limits => ("file of limits", &["toml"][..]),
        What::Scene => ("file of a scene", scenes::EXTENSIONS),
        What::Photographs | What::Polarization => ("photograph", EXTENSIONS),
    };
    let known = extension.is_some_and(|e| endings.contains(&e.as_str()));
    let plain =
        name.chars().all(|c| c.is_alphanumeric() || "._- +()=,°\u{2212}\u{2013}".contains(c)) && !name.starts_with('.');
    if known && plain && name.len() <= LONGEST_NAME {
        return Ok(name.to_owned());
    }
    Err(Problem::bad(format!("{:?} is not a file name of a {of} ({})", clip(name), endings.join(", "))))
}

async fn store(mut field: Field<'_>, path: &Path, most: u64) -> Answer<u64> {
    let new = tokio::fs::OpenOptions::new().write(true).create_new(true).open(path).await;
    let mut file = new.map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => Problem::bad("two files have the same name"),
        _ => refused(e),
    })?;
    let mut bytes = 0;
    loop {
        let Some(chunk) =
            field.chunk().await.map_err(|e| Problem::bad(format!("the form is damaged: {}", e.body_text())))?
        else {
            break;
        };
        bytes += chunk.len() as u64;
        if bytes > most {
            return Err(Problem::new(Kind::TooLarge, "the upload is larger than limits.upload_mib allows"));
        }
        file.write_all(&chunk).await.map_err(refused)?;
    }
    file.flush().await.map_err(refused)?;
    Ok(bytes)
}

/// Reads a short text part.
async fn word(mut field: Field<'_>) -> Answer<String> {
    let mut word = vec![];
    while word.len() < LONGEST_WORD {
        match field.chunk().await.map_err(|e| Problem::bad(format!("the form is damaged: {}", e.body_text())))? {
            Some(chunk) => word.extend_from_slice(&chunk),
            None => break,
        }
    }
    Ok(String::from_utf8_lossy(&word).into_owned())
}

fn kind(word: &str) -> Answer<What> {
    match word {
        "photographs" => Ok(What::Photographs),
        "polarization" => Ok(What::Polarization),
        "surface" => Ok(What::Surface),
        "maps" => Ok(What::Maps),
        "table" => Ok(What::Table),
        "limits" => Ok(What::Limits),
        "scene" => Ok(What::Scene),
        other => {
            let said = clip(other);
            Err(Problem::bad(format!(
                "kind is {said:?}; give photographs, polarization, surface, maps, table, limits or scene"
            )))
        }
    }
}

fn clip(text: &str) -> String {
    text.chars().take(80).collect()
}

/// Checks that each file can be decoded as a photograph.
fn decodable(folder: &Path) -> Answer<()> {
    if folder.join(FILE_NAME).exists() {
        load(folder)?;
    }
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|e| e.path()).filter(|p| p.file_name() != Some(FILE_NAME.as_ref())).try_for_each(|path| {
        info(&path)?;
        Ok(())
    })
}

/// Writes a missing description, and checks the whole as a reconstruction does.
fn describe(folder: &Path) -> Answer<()> {
    let path = folder.join(FILE_NAME);
    let text = if path.exists() {
        with_transfer(folder, &read_text(&path, MAX_DESCRIPTION, "send a frames.json as the part frames")?)?
    } else {
        from_names(folder)?
    };
    std::fs::write(&path, text).map_err(refused)?;
    load(folder)?;
    Ok(())
}
