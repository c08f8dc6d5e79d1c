//! `nacre synthesize`.

use crate::commands::Estimating;
use crate::commands::values::{PictureArgs, numbers};
use crate::console::Console;
use nacre_base::operation::lines;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::{OutputFolder, Palette, orientation_picture};
use nacre_lut::foil::{Distribution, Dots, Made, Shape, synthesize};
use nacre_maps::Kind;
use nacre_periods::calibration::Gray;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre synthesize`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre synthesize spiral --size 1024,1024 --pixel-um 25 --square-px 3 --out new
  nacre synthesize spiral/histogram.exr --size 800,600 --pixel-um 25 --disc-px 7.5 --seed 2 --out discs
  nacre synthesize spiral --size 800,600 --pixel-um 25 --mask star.png --out stars

Writes orientation.exr and period.exr of dots drawn from the distribution that `nacre reconstruct foil` measured, orientation.png, and
report.json with how far the map is from the distribution.")]
pub struct Args {
    /// Results of `reconstruct foil`, or the histogram.exr.
    input: PathBuf,
    /// Folder for the maps.
    #[arg(long)]
    out: PathBuf,
    /// Width and height in pixels.
    #[arg(long, value_name = "W,H", value_parser = |t: &str| numbers::<usize, 2>(t, "width and height: 1024,1024"))]
    size: [usize; 2],
    /// Size of a pixel.
    #[arg(long, value_name = "P", allow_negative_numbers = true)]
    pixel_um: f64,
    #[command(flatten)]
    shape: ShapeArgs,
    /// The same seed gives the same maps.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Replace files that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

/// Shape of the dots.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct ShapeArgs {
    /// Squares of this side, side by side.
    #[arg(long, value_name = "PX")]
    square_px: Option<usize>,
    /// Discs of this diameter, anywhere.
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    disc_px: Option<f64>,
    /// The bright half of this picture, anywhere.
    #[arg(long, value_name = "IMAGE")]
    mask: Option<PathBuf>,
}

/// JSON output of `nacre synthesize`.
#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    made: &'a Made,
    palette: Palette,
}

/// Draws and writes maps.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let path = if args.input.is_dir() { args.input.join("histogram.exr") } else { args.input.clone() };
    let from = Distribution::read(&path)?;
    let shape = match (args.shape.square_px, args.shape.disc_px, &args.shape.mask) {
        (Some(side), ..) => Shape::Square(side),
        (_, Some(diameter), _) => Shape::Disc(diameter),
        (_, _, Some(path)) => {
            let picture = Gray::read(path)?;
            let (low, high) = picture.values.iter().fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
            let lit = picture.values.iter().map(|v| low < high && *v > 0.5 * (low + high)).collect();
            Shape::Mask(picture.width, lit)
        }
        // clap has seen to it that there is one.
        _ => Shape::Square(1),
    };
    let dots = Dots { size: args.size, pixel_um: args.pixel_um, shape, seed: args.seed };
    console.expect(&dots.work())?;
    console.stage("drawing dots", 1);
    let made = synthesize(&from, &dots)?;
    console.check()?;
    let folder = OutputFolder::begin(&args.out, args.force)?;
    made.maps.write(&folder)?;
    let PictureArgs { palette, bar } = args.pictures;
    if let Some(map) = made.maps.maps.get(&Kind::Orientation) {
        let bar_um = (!bar.no_scale_bar).then_some(args.pixel_um);
        let width = made.maps.width;
        let value = |x: usize, y: usize| Some(map.value[y * width + x]);
        let picture =
            orientation_picture([width, made.maps.height], &value, "Orientation of the dots", palette, bar_um);
        picture.save_png(&folder.path("orientation.png"))?;
    }
    let report = Report { made: &made.report, palette };
    folder.write_json("report.json", &report)?;
    folder.commit()?;
    let r = &made.report;
    let mut text = format!(
        "dots      {}; {:.1} % of the map is bare\noff       {:.2} % in orientation, {:.2} % in period (total variation; {:.2} and {:.2} expected)\n",
        r.dots,
        100.0 * r.bare,
        100.0 * r.total_variation[0],
        100.0 * r.total_variation[1],
        100.0 * r.expected[0],
        100.0 * r.expected[1]
    );
    text += &lines(&[], &r.warnings);
    let _ = write!(text, "wrote     {}", args.out.display());
    console.result(&text, &report);
    Ok(())
}
