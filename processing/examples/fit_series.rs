//! Fits photographs behind a turning analyser: `cargo run --release --example fit_series -- FOLDER OUT`.
//! FOLDER holds a `frames.json`, which `nacre import` writes; maps, pictures and `report.json` appear in OUT.

use nacre_processing::polarimetry::{Model, Options, reconstruct};
use nacre_processing::progress::Silent;
use std::path::PathBuf;

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut paths = std::env::args().skip(1).map(PathBuf::from);
    let (Some(photographs), Some(out)) = (paths.next(), paths.next()) else {
        return Err("give the folder of frames.json and a new folder for the results".into());
    };
    // Stokes parameters, angle and degree of linear polarization with σ. Model::Auto also fits models of gratings below
    // a film.
    let options = Options { model: Some(Model::Plain), ..Options::default() };
    let report = reconstruct(&photographs, &out, &options, &Silent)?;
    println!("{} x {} pixels", report.width, report.height);
    if let Some(noise) = report.error.noise_deg {
        println!("noise {noise:.3}° (median standard deviation)");
    }
    report.warnings.iter().for_each(|warning| println!("warning: {warning}"));
    Ok(())
}
