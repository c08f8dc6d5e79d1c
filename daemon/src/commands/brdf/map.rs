//! `nacre brdf map`.

use super::common::{Material, Optics, Report, Seen, Surface, direction};
use crate::Failure;
use crate::console::Console;
use nacre_processing::surface::output::{albedo, needed_size, vacant, write_map, write_picture};
use nacre_processing::surface::{Settings, Window, map};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `nacre brdf map`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf surface blazed --period-um 2.5 --depth-um 0.3 --out blazed.exr
  nacre brdf map blazed.exr --out map.exr
  nacre brdf map snake.png --pixel-um 0.08 --range-um 0.43 --light 30,90 --illuminant D65 --out snake.exr
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
}

/// What a map's report adds.
#[derive(Serialize)]
struct More {
    size: usize,
    /// Light in all directions, over what falls in, in X, Y, Z.
    albedo: [f64; 3],
    densities: f64,
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
            ..self.material.add(self.optics.settings(self.light))
        };
        let (_, window) = settings.check()?;
        let (field, quality) = self.surface.read(settings.coherence_um, console)?;
        let map = map(&field, &quality, &settings, self.size, console)?;
        write_map(&self.out, &map, &settings)?;
        write_picture(&picture, &map)?;
        let more = More { size: self.size, albedo: albedo(&map), densities: map.densities };
        let mut warnings = quality.warnings.clone();
        warnings.extend(self.narrow(window, &more));
        let report = Report {
            product: "map",
            warnings,
            input: self.surface.path().into(),
            quality: &quality,
            settings: &settings,
            choice: &map.choice,
            error_estimate: map.error_estimate,
            seconds: begun.elapsed().as_secs_f64(),
            files: vec![self.out.clone(), picture, json.clone()],
            more,
        };
        report.write(&json)?;
        let [x, y, z] = report.more.albedo;
        console.result(&report.summary(&format!("light     X {x:.3} Y {y:.3} Z {z:.3} of what falls in")), &report);
        self.optics.judge(map.error_estimate)
    }

    /// What the pixels of the map cannot show.
    fn narrow(&self, window: Window, more: &More) -> Vec<String> {
        let needed = needed_size(window.sigma);
        let mut all = vec![];
        if self.size < needed {
            all.push(format!(
                "lobes are narrower than the map's pixels, which hold the light of their middles only: --size {needed} shows all"
            ));
        }
        if self.size >= needed && more.albedo[1] > 1.02 {
            all.push(format!(
                "scalar theory reflects {:.2} times the light here: its gain overestimates grazing directions",
                more.albedo[1]
            ));
        }
        all
    }
}
