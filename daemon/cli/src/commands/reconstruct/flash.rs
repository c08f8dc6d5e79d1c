//! `nacre reconstruct flash`.

use crate::commands::Estimating;
use crate::commands::said::{lines, meets};
use crate::commands::values::{PictureArgs, numbers};
use crate::console::Console;
use nacre_capture::Failure;
use nacre_optics::geometry;
use nacre_periods::flash::{self, Directions, Orientation, PeriodChoice, Report, Settings};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre reconstruct flash`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim photograph tiles --out photos                                       a sheet of 10 × 8 tiles under five lights
  nacre reconstruct flash photos --tiles 10x8 --size-mm 297x210 --out maps
  nacre reconstruct flash photos --reference-px 460,310,116,103 --out maps      the other tiles are found by correlation
  nacre reconstruct flash photos --tiles 10x8 --size-mm 297x210 --geometry geometry.json --period-um 1.2:2.4 --out maps
  nacre reconstruct flash photos --tiles 10x8 --size-mm 297x210 --camera-mm 500 --light-height-mm 200 --out maps
                                                                                no calibration: periods are relative

Photographs are a set of kind flash: frames.json says for each where the flash was (light_mm: right and up of the sheet's
middle and above it), and one with \"flash\": false, by room light, shows where the tiles lie. The geometry is that of
`nacre calibrate geometry`, by default geometry.json beside frames.json. Without one, the corners of the sheet (found by
room light, or --corners), its size and the camera's distance do, for a camera over the middle of its picture.

Writes orientation.exr (orientation, sigma in rad, mask), period.exr (period, sigma in µm, mask), orientation.png,
period.png (lines per mm), sigma.png and report.json. Pixels are masked where nothing is lit, where several gratings or
orders explain the light, and where too few copies are near a lobe.")]
pub struct Flash {
    /// Session folder or frames.json of flash photographs.
    input: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// Where camera and sample were (JSON; default: geometry.json beside the photographs).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["corners", "camera_mm"])]
    geometry: Option<PathBuf>,
    /// Corners of the sheet in pixels: top left, top right, bottom right, bottom left, or auto.
    #[arg(long, value_name = "auto|X,Y,X,Y,X,Y,X,Y", default_value = "auto", value_parser = corners)]
    corners: Corners,
    /// Width and height of the sheet in mm.
    #[arg(long, value_name = "WxH", value_parser = pair::<f64>)]
    size_mm: Option<[f64; 2]>,
    /// Camera above the sheet in mm; without a geometry.
    #[arg(long, value_name = "MM")]
    camera_mm: Option<f64>,
    /// Light above the sheet in mm, in place of what the photographs say: its highlight tells the rest.
    #[arg(long, value_name = "MM")]
    light_height_mm: Option<f64>,
    /// Tiles to the right and down, which fill the sheet.
    #[arg(long, value_name = "NxM", value_parser = pair::<usize>, conflicts_with = "reference_px")]
    tiles: Option<[usize; 2]>,
    /// A tile in the photograph by room light; the others are found by correlation.
    #[arg(long, value_name = "X,Y,W,H", value_parser = reference)]
    reference_px: Option<[f64; 4]>,
    /// Leave tiles where the grid has them, rather than moving each to where it looks most like the others.
    #[arg(long)]
    unregistered: bool,
    /// Wavelength (default: that of frames.json or of the geometry).
    #[arg(long, value_name = "NM")]
    wavelength: Option<f64>,
    /// Range in which all periods are known to lie; tells first orders from second ones.
    #[arg(long, value_name = "MIN:MAX", value_parser = range)]
    period_um: Option<[f64; 2]>,
    /// How orientations are told: half fits lobes over half vectors, image is the paper's direction towards the highlight.
    #[arg(long, default_value = "half", value_name = "half|image")]
    orientation: Orientation,
    /// One period for all pixels, or one each; auto is whichever has more evidence.
    #[arg(long, default_value = "auto", value_name = "auto|sample|pixel")]
    period: PeriodChoice,
    /// Whether polygons share few directions and periods: places with the same grooves are then fitted together, and one
    /// photograph can be enough; auto decides by evidence, which periods that change gradually can look like.
    #[arg(long, default_value = "free", value_name = "auto|shared|free")]
    directions: Directions,
    /// Standard deviation of the light in its plane (default: that of its highlight).
    #[arg(long, value_name = "MM")]
    light_sigma_mm: Option<f64>,
    /// Take lights to be where they are said to be, even where their highlights lie elsewhere.
    #[arg(long)]
    trust_lights: bool,
    /// Size of a pixel of the maps on the sheet (default: that of the photographs).
    #[arg(long, value_name = "MM")]
    pixel_mm: Option<f64>,
    /// Largest acceptable σ of a typical orientation; the results are written in any case, but the exit code is 1 when it
    /// is larger.
    #[arg(long, value_name = "DEG")]
    max_error: Option<f64>,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Replace results that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

/// Corners of the sheet; none for those that are found.
type Corners = Option<[[f64; 2]; 4]>;

fn corners(text: &str) -> Result<Corners, String> {
    if text == "auto" {
        return Ok(None);
    }
    let all: [f64; 8] = numbers(text, "auto, or eight numbers of pixels")?;
    Ok(Some(std::array::from_fn(|k| [all[2 * k], all[2 * k + 1]])))
}

fn pair<T: std::str::FromStr>(text: &str) -> Result<[T; 2], String> {
    numbers(&text.replace(['x', '×'], ","), "two numbers, such as 10x8")
}

fn reference(text: &str) -> Result<[f64; 4], String> {
    numbers(text, "four numbers of pixels: left, top, width, height")
}

fn range(text: &str) -> Result<[f64; 2], String> {
    numbers(&text.replace(':', ","), "two numbers of µm: MIN:MAX")
}

impl Flash {
    /// Makes the maps.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let settings = Settings {
            geometry: self.geometry.as_deref().map(geometry::load).transpose()?,
            corners_px: self.corners,
            size_mm: self.size_mm,
            camera_mm: self.camera_mm,
            light_height_mm: self.light_height_mm,
            tiles: self.tiles,
            reference_px: self.reference_px,
            unregistered: self.unregistered,
            wavelength_nm: self.wavelength,
            period_um: self.period_um,
            orientation: self.orientation,
            period: self.period,
            directions: self.directions,
            light_sigma_mm: self.light_sigma_mm,
            trust_lights: self.trust_lights,
            pixel_mm: self.pixel_mm,
            palette: self.pictures.palette,
            no_scale_bar: self.pictures.bar.no_scale_bar,
            overwrite: self.force,
        };
        let report = flash::reconstruct(&self.input, &self.out, &settings, console)?;
        let mut text = summary(&report);
        let _ = write!(text, "\nresults   {}", self.out.display());
        console.result(&text, &report);
        meets(self.max_error, report.sigma_deg, ["σ of a typical orientation", "°", "more lights help"])
    }
}

/// The report in a few lines.
fn summary(report: &Report) -> String {
    let mut text = format!("map       {} × {} pixels of {:.0} µm\n", report.width, report.height, report.pixel_um);
    let registered = report.registration.map_or("on a grid".into(), |r| {
        format!("moved by up to {:.2} pixels, known to {:.3}, {} left out", r.most_px, r.sigma_px, r.left_out)
    });
    let _ = writeln!(text, "tiles     {}, {registered}", report.tiles);
    let _ = writeln!(
        text,
        "lights    {}, σ {:.2} mm: lobes of σ {:.3} on half vectors {:.3} apart",
        report.lights_mm.len(),
        report.light_sigma_mm,
        report.lobe,
        report.spacing
    );
    let relative = if report.relative { " (relative)" } else { "" };
    let period = &report.period;
    let um = match (period.um, period.sigma_um, period.range_um) {
        (Some(um), Some(sigma), _) => format!("{um:.4} ± {sigma:.4} µm{relative}"),
        (_, _, Some([low, high])) => format!("{low:.3} to {high:.3} µm{relative}"),
        _ => "unknown".into(),
    };
    let _ = writeln!(text, "period    {um}: {}", period.why);
    let shared = &report.directions;
    let _ = match shared.degrees.len() {
        0 => writeln!(text, "directions free: {}", shared.why),
        n => writeln!(text, "directions {n} shared: {}", shared.why),
    };
    let percent = |v: Option<f64>| v.map_or("unknown".into(), |v| format!("{:.2} %", 100.0 * v));
    let degrees = report.sigma_deg.map_or("unknown".into(), |v| format!("{v:.3}°"));
    let _ =
        writeln!(text, "quality   σ of a typical orientation {degrees}, of a period {}", percent(report.period_sigma));
    let m = &report.masked;
    let share = |v: f64| 100.0 * v;
    let _ = writeln!(
        text,
        "masked    {:.1} %: dark {:.1}, several gratings {:.1}, ambiguous {:.1}, uncertain {:.1}, unexplained {:.1}, unseen {:.1}",
        share(m.all),
        share(m.dark),
        share(m.several),
        share(m.ambiguous),
        share(m.uncertain),
        share(m.unexplained),
        share(m.unseen)
    );
    text += &lines(&report.assumptions, &report.warnings);
    let s = &report.seconds;
    let _ =
        write!(text, "time      {:.2} s: reading {:.2}, fitting {:.2}, writing {:.2}", s.total, s.read, s.fit, s.write);
    text
}
