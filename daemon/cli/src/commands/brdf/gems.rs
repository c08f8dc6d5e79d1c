//! `nacre brdf gems`.

use crate::commands::values::numbers;
use crate::console::Console;
use nacre_base::vacant;
use nacre_brdf::Views;
use nacre_brdf::gems::{gems_map, write_gems};
use nacre_capture::Failure;
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `nacre brdf gems`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf gems --period-um 1.6 --out shader.exr
  nacre brdf surface sinusoid --period-um 1.6 --depth-um 0.1 --out s.exr && nacre brdf map s.exr --light 30,0 --out map.exr
  nacre brdf gems --period-um 1.6 --light 30,0 --out shader.exr         same grating, GPU Gems shader

The shader uses only the period: all orders are equal, and depth, profile and material have no effect. Writes FILE.exr
(linear R G B over viewing directions, as `nacre brdf map` does) and FILE.png.")]
pub struct Gems {
    /// Period of the grating in µm (0.1 to 100).
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    period_um: f64,
    /// Direction of the grating vector in degrees, anticlockwise from the right.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    direction_deg: f64,
    /// Direction of incident light in degrees: angle from the normal, azimuth anticlockwise from the right.
    #[arg(long, default_value = "0,0", value_name = "THETA,PHI", value_parser = |t: &str| numbers::<f64, 2>(t, "THETA,PHI, two angles"), allow_hyphen_values = true)]
    light: [f64; 2],
    /// Width and height of the map in pixels.
    #[arg(long, default_value_t = 512)]
    size: usize,
    /// Map (EXR); a picture (PNG) is written beside it.
    #[arg(long, value_name = "FILE.exr")]
    out: PathBuf,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

#[derive(Serialize)]
struct Report {
    product: &'static str,
    period_um: f64,
    direction_deg: f64,
    light_deg: [f64; 2],
    size: usize,
    files: Vec<PathBuf>,
}

impl Gems {
    /// Computes and writes the map.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let files = vec![self.out.clone(), self.out.with_extension("png")];
        vacant(&files, self.force)?;
        let views = Views::all(self.size);
        let map = gems_map(self.period_um, self.direction_deg, self.light, views)?;
        write_gems(&files[0], &files[1], &map, views)?;
        let text = format!("wrote     {}\nwrote     {}", files[0].display(), files[1].display());
        let Self { period_um, direction_deg, light, size, .. } = *self;
        console.result(&text, &Report { product: "gems", period_um, direction_deg, light_deg: light, size, files });
        Ok(())
    }
}
