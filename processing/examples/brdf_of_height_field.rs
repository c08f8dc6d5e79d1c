//! Computes the diffraction BRDF of a blazed grating and checks its lobes by the grating equation:
//! `cargo run --release --example brdf_of_height_field`. It writes `brdf.png`.

use nacre_processing::progress::Silent;
use nacre_processing::surface::height::{Profile, Quality, Shape, Synthetic};
use nacre_processing::surface::output::write_picture;
use nacre_processing::surface::{Settings, Views, check, map};
use std::path::Path;

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let shape = Shape::Grating(Profile::Blazed);
    let grating = Synthetic { shape, pixels: 512, pixel_um: 0.1, period_um: 2.5, depth_um: 0.3, angle: 0.0 };
    let field = grating.field()?;
    let settings = Settings { light_deg: [20.0, 0.0], ..Settings::default() };
    let quality = Quality::of(&field, settings.coherence_um);

    let lobes = check(&field, &quality, &settings, &[450.0, 550.0, 650.0], [Some(2.5), Some(0.0)], &Silent)?;
    println!("period by the first order's lobes {:.1} nm (expected {:.1} nm)", lobes.mean_nm, lobes.expected_nm);

    let brdf = map(&field, &quality, &settings, Views::all(256), &Silent)?;
    println!("largest relative error of bright lobes {:.2} %", 100.0 * brdf.error_estimate);
    write_picture(Path::new("brdf.png"), &brdf)?;
    Ok(())
}
