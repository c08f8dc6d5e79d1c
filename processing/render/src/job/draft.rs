//! Drafts: small noisy pictures of a scene while it is edited.

use super::render;
use crate::picture::{exposure, png};
use crate::scene::Scene;
use crate::settings::Settings;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use std::path::Path;

/// Samples per pixel of a draft: two passes.
const SAMPLES: usize = 8;

/// Target error of a draft, relative to the mean luminance.
const NOISE: f64 = 0.2;

/// Renders a scene (TOML) with files of the folder as a small PNG, at most `side` pixels wide and high.
///
/// # Errors
/// `Input` for invalid scenes, which names key or file; `Cancelled`.
pub fn draft(text: &str, folder: &Path, side: usize, progress: &dyn Progress) -> Result<Vec<u8>> {
    let mut scene = Scene::beside(text, folder)?;
    let camera = &mut scene.camera;
    let longest = camera.width.max(camera.height).max(1);
    if longest > side {
        (camera.width, camera.height) =
            ((camera.width * side / longest).max(1), (camera.height * side / longest).max(1));
    }
    let settings = Settings { samples: SAMPLES, max_error: NOISE, ..Settings::default() };
    let (picture, _) = render(&scene, folder, &settings, progress)?;
    let encoded = png(&picture, scene.exposure.unwrap_or_else(|| exposure(&picture)));
    encoded.map_err(|problem| Error::input("draft", problem, "report this with its scene"))
}
