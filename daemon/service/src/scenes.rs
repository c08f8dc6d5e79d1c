//! Uploads of scenes: complete, started from the gallery, or made from the maps of a result.

use super::problem::{Answer, Problem};
use super::{App, blocking, files, naming};
use nacre_base::OutputFolder;
use nacre_base::operation::Operation;
use nacre_capture::naming::ABOUT_FILE;
use nacre_render::{Options, gallery_scene, scene_of_maps};
use std::path::Path;

/// Extensions of scene files and of the files that scenes may name.
pub const EXTENSIONS: &[&str] = &[
    "toml", "exr", "hdr", "png", "tif", "tiff", "jpg", "jpeg", "bmp", "obj", "ply", "gltf", "glb", "bin", "csv", "txt",
    "asc", "dat",
];

/// Most characters of the name of a subfolder.
const LONGEST_FOLDER: usize = 64;

/// Maps of a result that a scene can use.
const MAPS: [&str; 3] = ["orientation.exr", "period.exr", "lut.exr"];

/// The parts of a form from which a scene starts.
#[derive(Default)]
pub struct Start {
    begun: bool,
    /// Subfolder for the maps of the next result.
    subfolder: Option<String>,
}

impl Start {
    /// Adds a part to the folder of a scene: a `gallery` scene by its name, the files of an `upload` by its id, or the
    /// maps of a `result`. A part `folder` only names the subfolder of the next result. Returns the name of the scene,
    /// upload or result from which the scene starts.
    ///
    /// # Errors
    /// `bad-request` for unknown scenes, results without maps and a second start; `not-found` for unknown ids.
    pub async fn add(&mut self, app: &App, part: &str, named: String, folder: &Path) -> Answer<Option<String>> {
        let folder = folder.to_path_buf();
        if part == "folder" {
            let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
            if named.is_empty() || named.len() > LONGEST_FOLDER || !named.chars().all(plain) {
                let remedy = format!("give 1 to {LONGEST_FOLDER} letters, digits, - and _");
                return Err(Problem::bad("folder is not the name of a subfolder").remedy(remedy));
            }
            self.subfolder = Some(named);
            return Ok(None);
        }
        if let Some(subfolder) = self.subfolder.take().filter(|_| part == "result") {
            let results = app.place(&named).await?.results;
            blocking(move || add_maps(&folder.join(subfolder), &results)).await?;
            return Ok(None);
        }
        if std::mem::replace(&mut self.begun, true) {
            let problem = "a scene begins with more than one gallery, upload or result";
            return Err(Problem::bad(problem).remedy("give one, or a folder before each further result"));
        }
        match part {
            "gallery" => blocking(move || from_gallery(&folder, &named).map(|()| Some(named))).await,
            "upload" => {
                let earlier = app.existing_upload(&named)?;
                blocking(move || take_over(&folder, &earlier).map(|()| Some(naming::of_upload(&earlier)))).await
            }
            _ => {
                let results = app.place(&named).await?.results;
                blocking(move || add_maps(&folder, &results)).await?;
                app.name_of_result(&named).await.map(Some)
            }
        }
    }
}

/// Takes over the files of an earlier upload of a scene. Files of uploads never change, so that they are linked where
/// the file system can.
fn take_over(folder: &Path, earlier: &Path) -> Answer<()> {
    let refused = |e: std::io::Error| Problem::refused("the files of the upload cannot be taken over", &e);
    for (name, _) in files::list(earlier).into_iter().filter(|(name, _)| name != ABOUT_FILE) {
        let target = folder.join(&name);
        target.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(refused)?;
        let from = earlier.join(&name);
        std::fs::hard_link(&from, &target).or_else(|_| std::fs::copy(&from, &target).map(drop)).map_err(refused)?;
    }
    Ok(())
}

fn from_gallery(folder: &Path, name: &str) -> Answer<()> {
    let target = OutputFolder::begin(folder, true)?;
    gallery_scene(&target, name)?;
    // A dropped request removes the folder; it must not be created again.
    if !folder.exists() {
        return Err(Problem::bad("the upload was interrupted"));
    }
    Ok(target.commit()?)
}

/// Copies the maps; files that exist are kept.
fn add_maps(folder: &Path, results: &Path) -> Answer<()> {
    let found: Vec<&str> = MAPS.into_iter().filter(|name| results.join(name).is_file()).collect();
    if found.is_empty() {
        let remedy = "give a result that holds one, such as that of the method polarization";
        return Err(Problem::bad(format!("the result holds none of {}", MAPS.join(", "))).remedy(remedy));
    }
    std::fs::create_dir_all(folder).map_err(|e| Problem::refused("the maps cannot be stored", &e))?;
    for name in found.into_iter().filter(|name| !folder.join(name).exists()) {
        std::fs::copy(results.join(name), folder.join(name))
            .map_err(|e| Problem::refused(format!("{name} cannot be stored"), &e))?;
    }
    Ok(())
}

/// Writes a scene for maps without one, and checks that it can be rendered. Returns the number of files and bytes.
///
/// # Errors
/// `bad-request`, naming key or file.
pub fn complete(folder: &Path) -> Answer<(usize, u64)> {
    let toml = |name: &str| Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let scene = files::list(folder).iter().any(|(name, _)| toml(name));
    if !scene && let Some(text) = scene_of_maps(folder)? {
        std::fs::write(folder.join("scene.toml"), text)
            .map_err(|e| Problem::refused("the scene cannot be stored", &e))?;
    }
    Options::default().check(folder)?;
    let all = files::list(folder);
    Ok((all.len(), all.iter().map(|file| file.1).sum()))
}
