//! Uploads of scenes: complete, started from the gallery, or made from the maps of a result.

use super::problem::{Answer, Problem};
use super::{App, blocking, files};
use nacre_base::OutputFolder;
use nacre_base::operation::Operation;
use nacre_render::{Options, gallery_scene, scene_of_maps};
use std::path::Path;

/// Extensions of scene files and of the files that scenes may name.
pub const EXTENSIONS: &[&str] = &[
    "toml", "exr", "hdr", "png", "tif", "tiff", "jpg", "jpeg", "bmp", "obj", "ply", "gltf", "glb", "bin", "csv", "txt",
    "asc", "dat",
];

/// Maps of a result that a scene can use.
const MAPS: [&str; 3] = ["orientation.exr", "period.exr", "lut.exr"];

/// Copies the start of a scene into a folder: a `gallery` scene by its name, or the maps of a `result` by its id.
/// Returns the name of the scene or result.
///
/// # Errors
/// `bad-request` for unknown scenes and results without maps; `not-found` for unknown ids.
pub async fn begin(app: &App, part: &str, named: String, folder: &Path) -> Answer<String> {
    let folder = folder.to_path_buf();
    if part == "gallery" {
        return blocking(move || from_gallery(&folder, &named).map(|()| named)).await;
    }
    let results = app.place(&named).await?.results;
    blocking(move || add_maps(&folder, &results)).await?;
    app.name_of_result(&named).await
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
