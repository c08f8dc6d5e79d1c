//! Renders the gallery's scenes as tiles beside each other, for the page:
//! `cargo run --release --example thumbnails -- web/page/gallery.jpg`.

use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, replace, resize};
use image::{RgbImage, load_from_memory};
use nacre_processing::image::OutputFolder;
use nacre_processing::progress::Silent;
use nacre_processing::render::{GALLERY, Scene, Settings, exposure, gallery_scene, png, render};
use std::fs::File;

/// Side of a tile in pixels; scenes are rendered twice as large.
const TILE: u32 = 144;

/// Quality of the JPEG: tiles of about 5 kB.
const QUALITY: u8 = 74;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = std::env::args().nth(1).ok_or("give the name of the picture")?;
    let dir = tempfile::tempdir()?;
    let mut tiles = RgbImage::new(TILE * GALLERY.len() as u32, TILE);
    for (k, name) in GALLERY.iter().enumerate() {
        let scenes = dir.path().join(name);
        let folder = OutputFolder::begin(&scenes, false)?;
        gallery_scene(&folder, name)?;
        folder.commit()?;
        let mut scene = Scene::read(&scenes.join(format!("{name}.toml")))?;
        (scene.camera.width, scene.camera.height) = (2 * TILE as usize, 2 * TILE as usize);
        let settings = Settings { samples: 64, max_error: 0.02, ..Settings::default() };
        let (picture, _) = render(&scene, &scenes, &settings, &Silent)?;
        let large = load_from_memory(&png(&picture, exposure(&picture))?)?.into_rgb8();
        replace(&mut tiles, &resize(&large, TILE, TILE, FilterType::Lanczos3), i64::from(TILE) * k as i64, 0);
    }
    tiles.write_with_encoder(JpegEncoder::new_with_quality(File::create(out)?, QUALITY))?;
    Ok(())
}
