//! `nacre brdf map`.

use super::common::{Material, Optics, Seen, Surface, direction};
use crate::commands::Estimating;
use crate::commands::values::numbers;
use crate::console::Console;
use nacre_base::operation::Summary;
use nacre_base::progress::Progress;
use nacre_base::vacant;
use nacre_brdf::output::{write_map, write_picture};
use nacre_brdf::{Report, Settings, Views, about_map, map};
use nacre_capture::Failure;
use nacre_image::budget::Operation;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `nacre brdf map`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf surface blazed --period-um 2.5 --depth-um 0.3 --out blazed.exr
  nacre brdf map blazed.exr --out map.exr
  nacre brdf map snake.png --pixel-um 0.08 --range-um 0.43 --light 30,90 --illuminant D65 --out snake.exr
  nacre brdf map blazed.exr --zoom 20 --center 0.22,0 --out order.exr          the first order alone
  nacre brdf map afm.txt --level --material silicon --max-error 0.001 --out silicon.exr

Writes FILE.exr (X Y Z over directions of view (x, y) = sin θ (cos φ, sin φ), y up, NaN below the surface), FILE.png
(a picture of it) and FILE.json (what the surface holds, how the map was computed, and how good it is).")]
pub struct Map {
    #[command(flatten)]
    surface: Surface,
    /// Angle of the light from the normal, and its azimuth anticlockwise from the right, in degrees.
    #[arg(long, default_value = "0,0", value_name = "THETA,PHI", value_parser = direction, allow_hyphen_values = true)]
    light: [f64; 2],
    /// Pixels of a row and of a column.
    #[arg(long, default_value_t = 512)]
    size: usize,
    /// Show this part of all directions only, to look at single orders: 4 for a square of a quarter of the sines.
    #[arg(long, default_value_t = 1.0, value_name = "Z", allow_negative_numbers = true)]
    zoom: f64,
    /// Middle of the map as sines, sin θ (cos φ, sin φ).
    #[arg(long, default_value = "0,0", value_name = "X,Y", value_parser = sines, allow_hyphen_values = true)]
    center: [f64; 2],
    /// Distance of wavelengths (0.01 to 100), instead of as close as each direction needs: for comparison, with its error measured.
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    wavelength_step_nm: Option<f64>,
    #[command(flatten)]
    optics: Optics,
    #[command(flatten)]
    material: Material,
    #[command(flatten)]
    seen: Seen,
    /// The map (EXR); picture and report go beside it.
    #[arg(long, value_name = "FILE.exr")]
    out: PathBuf,
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

fn sines(text: &str) -> Result<[f64; 2], String> {
    numbers(text, "X,Y, two sines")
}

impl Map {
    /// Computes and writes it.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let begun = Instant::now();
        let [picture, json] = ["png", "json"].map(|e| self.out.with_extension(e));
        vacant(&[self.out.clone(), picture.clone(), json.clone()], self.force)?;
        let settings = Settings {
            illuminant: self.seen.illuminant.clone(),
            observer: self.seen.observer,
            wavelength_step_nm: self.wavelength_step_nm,
            ..self.material.add(self.optics.settings(self.light))
        };
        let (_, window) = settings.check()?;
        let views = Views { size: self.size, center: self.center, half: 1.0 / self.zoom };
        views.check()?;
        console.expect(&Operation::Heights.check_file(self.surface.path())?)?;
        let (field, quality) = self.surface.read(settings.coherence_um, console)?;
        let map = map(&field, &quality, &settings, views, console)?;
        write_map(&self.out, &map, &settings)?;
        write_picture(&picture, &map)?;
        let (more, warnings) = about_map(&map, &quality, window);
        let report = Report {
            product: "map",
            warnings,
            input: self.surface.path().into(),
            quality: quality.clone(),
            settings: settings.clone(),
            choice: map.choice.clone(),
            error_estimate: map.error_estimate,
            seconds: begun.elapsed().as_secs_f64(),
            files: vec![self.out.clone(), picture, json.clone()],
            more,
        };
        report.write(&json)?;
        console.result(&report.summary(), &report);
        self.optics.judge(map.error_estimate)
    }
}
