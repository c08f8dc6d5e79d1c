//! `nacre brdf map`.

use crate::commands::Estimating;
use crate::commands::flags::Flags;
use crate::console::Console;
use nacre_base::operation::{Operation, Summary};
use nacre_base::progress::Progress;
use nacre_base::vacant;
use nacre_brdf::Options;
use nacre_brdf::output::{write_figure, write_map, write_picture};
use nacre_capture::Failure;
use std::path::PathBuf;

/// Arguments of `nacre brdf map`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf surface blazed --period-um 2.5 --depth-um 0.3 --out blazed.exr
  nacre brdf map blazed.exr --out map.exr
  nacre brdf map snake.png --pixel-um 0.08 --range-um 0.43 --light-deg 30,90 --illuminant D65 --out snake.exr
  nacre brdf map blazed.exr --zoom 20 --center 0.22,0 --out order.exr          the first order alone
  nacre brdf map afm.txt --level --reflectance silicon --max-error 0.001 --out silicon.exr

Writes FILE.exr, FILE.png (picture), FILE.figure.svg and FILE.figure.png (picture and luminance with angles, axes and
a colour bar) and FILE.json (surface, method and accuracy). The EXR holds X Y Z over viewing directions
(x, y) = sin θ (cos φ, sin φ), y up, with NaN below the surface.")]
pub struct Map {
    /// Height field. Accepts a grey image (bright is high), an EXR map, text, or an AFM or profilometer file. Images:
    /// PNG, TIFF, JPEG, BMP. Instruments: Gwyddion, Igor, X3P, Nanoscope, SDF, Nanosurf, Surfer, BCR. Text: rows of
    /// heights, points x y z, or a profile.
    height: PathBuf,
    /// Map (EXR); a picture (PNG) and a report (JSON) are written beside it.
    #[arg(long, value_name = "FILE.exr")]
    out: PathBuf,
    #[command(flatten)]
    options: Flags<Options>,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

impl Map {
    /// Computes and writes the map.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let options = self.options.options()?;
        let [picture, json] = ["png", "json"].map(|e| self.out.with_extension(e));
        let figure = ["figure.svg", "figure.png"].map(|e| self.out.with_extension(e));
        let written = [self.out.clone(), picture.clone(), json.clone()].into_iter().chain(figure.clone());
        vacant(&written.collect::<Vec<_>>(), self.force)?;
        console.expect(&options.check(&self.height)?)?;
        let (map, mut report) = options.map(&self.height, console)?;
        write_map(&self.out, &map, &options.settings)?;
        write_picture(&picture, &map)?;
        write_figure([&figure[0], &figure[1]], &map, &options.settings)?;
        report.files = [self.out.clone(), picture, json.clone()].into_iter().chain(figure).collect();
        report.write(&json)?;
        console.result(&report.summary(), &report);
        options.missed(&report).map_or(Ok(()), |why| Err(Failure::Bound(why)))
    }
}
