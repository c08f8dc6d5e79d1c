//! `nacre map compare`.

use crate::commands::values::PictureArgs;
use crate::console::Console;
use nacre_base::operation::lines;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::{OutputFolder, Palette};
use nacre_maps::{Agreement, Compared, Maps, compare, side_by_side};
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre map compare`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre map compare flash spots polarization --out compared
  nacre map compare truth result --unaligned --out compared

Maps are resampled to the pixel size of the first (pixel_um of the files), registered to it, and compared where both are
defined. Writes compared.png (all maps side by side on one colour scale) and report.json.")]
pub struct Compare {
    /// Folders with orientation.exr, period.exr or both, or single maps. The first is the reference.
    #[arg(required = true, num_args = 2..)]
    inputs: Vec<PathBuf>,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// Skip registration: the maps share their upper left corner.
    #[arg(long)]
    unaligned: bool,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Replace existing files in the folder.
    #[arg(long)]
    force: bool,
}

/// JSON report.
#[derive(Serialize)]
struct Report<'a> {
    inputs: &'a [PathBuf],
    aligned: bool,
    palette: Palette,
    maps: &'a [Compared],
    warnings: &'a [String],
}

impl Compare {
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        console.stage("comparing", self.inputs.len() as u64);
        let folder = OutputFolder::begin(&self.out, self.force)?;
        let mut all = vec![];
        for input in &self.inputs {
            all.push((input.display().to_string(), Maps::read(input)?));
            console.step();
            console.check()?;
        }
        let found = compare(all, !self.unaligned)?;
        console.check()?;
        let shown: Vec<(&str, &Maps)> = found.maps.iter().map(|(name, maps)| (name.as_str(), maps)).collect();
        let PictureArgs { palette, bar } = self.pictures;
        side_by_side(&shown, palette, !bar.no_scale_bar).save_png(&folder.path("compared.png"))?;
        let (maps, warnings) = (&found.compared, &found.warnings);
        let report = Report { inputs: &self.inputs, aligned: !self.unaligned, palette, maps, warnings };
        folder.write_report(&report)?;
        folder.commit()?;
        let mut text = String::new();
        for map in &found.compared {
            text += &said(map);
        }
        text += &lines(&[], &found.warnings);
        let _ = write!(text, "wrote     {}", self.out.display());
        console.result(&text, &report);
        Ok(())
    }
}

fn said(map: &Compared) -> String {
    let number = |v: Option<f64>, factor: f64, unit: &str| {
        v.map_or("unknown".to_owned(), |v| format!("{:.3}{unit}", factor * v))
    };
    let mut text = format!(
        "{}\n  known         {:.1} %, median σ {} and {} of the period\n",
        map.name,
        100.0 * map.known,
        number(map.sigma_deg, 1.0, "°"),
        number(map.sigma_period, 100.0, " %")
    );
    if map.shift_px != [0, 0] {
        let [x, y] = map.shift_px;
        let _ = writeln!(text, "  laid          {x} right, {y} down, {:.0} % alike", 100.0 * map.likeness);
    }
    let mut one = |what: &str, of: &Option<Agreement>, factor: f64, unit: &str| {
        if let Some(a) = of {
            let _ = writeln!(
                text,
                "  {what:<13} {:+.3}{unit} off, scatter {:.3}{unit}; {} of what σ says, {} beyond 5 σ ({} pixels)",
                factor * a.offset,
                factor * a.scatter,
                number(a.sigmas, 1.0, " times"),
                number(a.beyond, 100.0, " %"),
                a.pixels
            );
        }
    };
    one("orientations", &map.orientation, 1.0, "°");
    one("periods", &map.period, 100.0, " %");
    text
}
