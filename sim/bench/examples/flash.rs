//! Errors of maps from simulated flash photographs of tiles:
//! `cargo run --release -p nacre-sim --example flash -- [SCENE.toml] [SETTINGS.toml] [RESULTS]`.

#![allow(clippy::print_stdout)]

use nacre_base::operation::perform;
use nacre_base::progress::Silent;
use nacre_image::OutputFolder;
use nacre_periods::flash::Settings;
use nacre_sim::photographs::TilesPhotograph;
use std::path::PathBuf;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let scene: TilesPhotograph = args.next().map_or(Ok(TilesPhotograph::default()), |p| {
        toml::from_str(&std::fs::read_to_string(p)?).map_err(Into::<Box<dyn std::error::Error>>::into)
    })?;
    let settings: Settings = args.next().map_or(Ok(Settings::default()), |p| {
        toml::from_str(&std::fs::read_to_string(p)?).map_err(Into::<Box<dyn std::error::Error>>::into)
    })?;
    let home = tempfile::tempdir()?;
    let out = args.next().map_or(home.path().join("out"), PathBuf::from);
    let begun = Instant::now();
    let folder = OutputFolder::begin(&home.path().join("in"), false)?;
    scene.write(&folder)?;
    folder.commit()?;
    println!("rendered in {:.2} s", begun.elapsed().as_secs_f64());
    let grid = settings.reference_px.is_none() && settings.tiles.is_none();
    let tiles = if grid { Some(scene.tiles) } else { settings.tiles };
    let size_mm = settings.size_mm.or(Some(scene.sheet_mm()));
    let settings = Settings { tiles, size_mm, ..settings };
    let report = perform(&settings, &home.path().join("in"), &out, true, &Silent)?;
    println!("{}\n{:#?}", nacre_image::json(&report), scene.score(&out, &report)?);
    Ok(())
}
