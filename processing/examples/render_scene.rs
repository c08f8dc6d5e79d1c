//! Renders a compact disc under a lamp: `cargo run --release --example render_scene`. It writes `cd.png`.

use nacre_processing::image::OutputFolder;
use nacre_processing::progress::Silent;
use nacre_processing::render::{Scene, Settings, exposure, gallery_scene, render, write_png};
use std::path::Path;

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Scenes are TOML files; the gallery contains examples.
    let scenes = std::env::temp_dir().join(format!("nacre-scenes-{}", std::process::id()));
    let folder = OutputFolder::begin(&scenes, false)?;
    gallery_scene(&folder, "cd")?;
    folder.commit()?;

    let scene = Scene::read(&scenes.join("cd.toml"))?;
    let settings = Settings { max_error: 0.02, ..Settings::default() };
    let (picture, report) = render(&scene, &scenes, &settings, &Silent)?;
    write_png(Path::new("cd.png"), &picture, exposure(&picture))?;
    println!("{} x {} pixels, noise {:.2} %", picture.width, picture.height, 100.0 * report.noise);
    std::fs::remove_dir_all(&scenes)?;
    Ok(())
}
