//! `nacre reconstruct lut`.

use crate::commands::Estimating;
use crate::commands::said::{lines, meets};
use crate::commands::toml_file;
use crate::commands::values::{ChannelName, numbers, transfer};
use crate::console::Console;
use nacre_capture::Failure;
use nacre_frames::{Channel, Transfer};
use nacre_lut::{Arrangement, LightPhotograph, MethodChoice, Placement, Report, Settings, Wavelength};
use nacre_optics::color::Observer;
use nacre_optics::geometry;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `nacre reconstruct lut`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre reconstruct lut hdr/ --wavelength 680 --scale 0.002 --out table
  nacre reconstruct lut hdr.exr --wavelength 680 --geometry bench.toml --illuminant D65 --out table
  nacre reconstruct lut hdr.exr --wavelength 680 --geometry geometry.json --out table    as nacre calibrate geometry made it
  nacre reconstruct lut session --out table --illuminant FL2 --observer 1964 --max-error 0.002
  nacre reconstruct lut photo.exr --wavelength 610,540,460 --scale 0.002 --out table     white light, by channel
  nacre reconstruct lut hdr.exr --wavelength 680 --scale 0.002 --light mirror.exr --out table            a light that is no point

with bench.toml:
  camera_mm = 1000          # above the surface; it looks straight down
  flash_mm = 1000           # above the surface
  baseline_mm = [60, 0]     # from the camera to the flash, right and up in the photograph
  pixel_um = 1000           # size of a pixel on the surface

Lights: E, A, A-inverse, D65, FL1 to FL12, LED-B1, LED-B3, or a CSV file with rows \"wavelength_nm,power\".

Writes lut.exr (X Y Z coverage over half vectors ωi + ωo from -E to E, x to the right and y up; Y is 1 for a
photograph that is 1 everywhere and the exponent 0; coverage is the part of each entry that was measured),
lut.png, coverage.png, profile.csv (means over rings) and report.json.")]
pub struct Lut {
    /// Photograph (EXR, PNG, TIFF), results of `reconstruct hdr`, or a session of exposures, which are merged first.
    input: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// Wavelength of the photograph, or three for its red, green and blue channel (default: that of frames.json).
    #[arg(long, value_name = "NM[,NM,NM]", value_parser = wavelength)]
    wavelength: Option<Wavelength>,
    /// Half vector per pixel, for a camera and a flash that are far away: twice the pixel size on the surface over their distance.
    #[arg(long, value_name = "H_PER_PIXEL", conflicts_with = "geometry")]
    scale: Option<f64>,
    /// Where camera and flash stood (TOML): undoes cosine, inverse square, near field and G (default: that of frames.json).
    #[arg(long, value_name = "FILE")]
    geometry: Option<PathBuf>,
    /// Place of the zero order in pixels from the left and the top, or auto: the brightest lobe.
    #[arg(long, value_name = "auto|X,Y", default_value = "auto", value_parser = center)]
    center: Center,
    /// Entries of a row and a column, 16 to 8192.
    #[arg(long, default_value_t = 1024)]
    size: usize,
    /// Largest component of the half vector, up to 2 (default: as far as nearly all wavelengths were measured).
    #[arg(long)]
    extent: Option<f64>,
    /// Odd power that gathers entries in the middle: they lie at E·aⁿ.
    #[arg(long, default_value_t = 1, value_name = "N")]
    warp: i32,
    /// Light that the table is for.
    #[arg(long, default_value = "E", value_name = "NAME|FILE.csv")]
    illuminant: String,
    /// Observer: 1931 (2°) or 1964 (10°).
    #[arg(long, default_value = "1931")]
    observer: Observer,
    /// Power of λm/λ: 4 is exact for shallow gratings, 2 is what the paper prints; deep gratings follow none.
    #[arg(long, default_value_t = 4.0, allow_negative_numbers = true)]
    exponent: f64,
    /// Error asked for: root mean square at the rim over the table's own there; the exit code is 1 when it is larger.
    #[arg(long, default_value_t = 0.01, value_name = "REL")]
    max_error: f64,
    /// How entries are added up: auto is the cheapest of rays and single that meets the error; fixed is the paper's way.
    #[arg(long, default_value = "auto", value_name = "auto|rays[=PX]|single[=PX]|fixed[=NM]")]
    method: MethodChoice,
    /// Channel of a colour photograph (default: that of the wavelength).
    #[arg(long, value_enum)]
    channel: Option<ChannelName>,
    /// How values of a photograph grow with light; must be said for 8 bits.
    #[arg(long, value_name = "linear|srgb|gamma=NUMBER", value_parser = transfer)]
    transfer: Option<Transfer>,
    /// Photograph of the mirror image of a light that is no point, or exposures of it; the table is spread with it.
    #[arg(long, value_name = "PHOTO")]
    light: Option<PathBuf>,
    /// Half vector per pixel of that (default: that of the pattern's photograph).
    #[arg(long, value_name = "H_PER_PIXEL", requires = "light")]
    light_scale: Option<f64>,
    /// Its pixel that is put where the zero order is (default: the middle of its light).
    #[arg(long, value_name = "auto|X,Y", requires = "light", default_value = "auto", value_parser = center)]
    light_center: Center,
    /// How its values grow with light (default: as those of the pattern's photograph).
    #[arg(long, value_name = "linear|srgb|gamma=NUMBER", requires = "light", value_parser = transfer)]
    light_transfer: Option<Transfer>,
    /// Replace results that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

/// Where the zero order is; none for where it is found.
type Center = Option<[f64; 2]>;

fn wavelength(text: &str) -> Result<Wavelength, String> {
    let wanted = "one number of nm, or three";
    let one = numbers(text, wanted).map(|[nm]: [f64; 1]| Wavelength::Band(nm));
    one.or_else(|_| numbers(text, wanted).map(Wavelength::Channels))
}

fn center(text: &str) -> Result<Center, String> {
    if text == "auto" { Ok(None) } else { numbers(text, "auto, or two numbers of pixels: X,Y").map(Some) }
}

/// A geometry.json, or an arrangement measured by hand.
fn placement(path: &Path, remedy: &str) -> Result<Placement, Failure> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
        return Ok(Placement::Calibrated(Box::new(geometry::load(path)?)));
    }
    Ok(Placement::Arranged(toml_file::<Arrangement>(path, remedy)?))
}

impl Lut {
    /// Makes the table.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let remedy = "correct it; `nacre reconstruct lut --help` shows one";
        let geometry = self.geometry.as_deref().map(|path| placement(path, remedy)).transpose()?;
        let settings = Settings {
            wavelength_nm: self.wavelength,
            scale: self.scale,
            geometry,
            center: self.center,
            size: self.size,
            extent: self.extent,
            warp: self.warp,
            illuminant: self.illuminant.clone(),
            observer: self.observer,
            exponent: self.exponent,
            max_error: self.max_error,
            method: self.method,
            channel: self.channel.map(Channel::from),
            transfer: self.transfer,
            light: self.light.as_ref().map(|path| LightPhotograph {
                path: path.clone(),
                scale: self.light_scale,
                center: self.light_center,
                transfer: self.light_transfer,
            }),
            overwrite: self.force,
        };
        let report = nacre_lut::reconstruct(&self.input, &self.out, &settings, console)?;
        let mut text = summary(&report);
        let _ = write!(text, "\nresults   {}", self.out.display());
        console.result(&text, &report);
        let said = ["the error at the rim, over the table's own,", "", "report.json says what it is made of"];
        meets(Some(self.max_error), report.error_estimate, said)
    }
}

/// The report in a few lines.
fn summary(report: &Report) -> String {
    let size = report.width;
    let mut text = format!("table     {size} × {size} half vectors from -{0} to {0}", report.extent);
    let _ = writeln!(text, "{}", if report.warp > 1 { format!(", warped by {}", report.warp) } else { String::new() });
    let nm = match report.wavelength_nm {
        Wavelength::Band(nm) => format!("{nm} nm"),
        Wavelength::Channels([r, g, b]) => format!("{r}, {g} and {b} nm"),
    };
    let observer = match report.observer {
        Observer::Cie1931 => "1931",
        Observer::Cie1964 => "1964",
    };
    let _ = writeln!(text, "light     {nm} photographed, {} seen by CIE {observer}", report.illuminant);
    let [x, y] = report.center;
    let sigma = report.center_sigma_px.map_or("unknown".into(), |s| format!("{s:.2}"));
    let _ = writeln!(text, "centre    {x:.2}, {y:.2} (± {sigma} pixels), {:.6} half vectors per pixel", report.scale);
    if let Some(l) = &report.light {
        let _ = writeln!(
            text,
            "shape     {} pixels of light, {:.4} half vectors from their middle (RMS)",
            l.pixels, l.spread
        );
    }
    let c = &report.choice;
    let step = c.spacing_px.map(|s| format!("{s} pixels")).or(c.step_nm.map(|s| format!("{s} nm"))).unwrap_or_default();
    let _ = writeln!(text, "method    {} in steps of {step}: {}", c.method, c.why);
    let percent = |v: Option<f64>| v.map_or("unknown".into(), |v| format!("{:.2} %", 100.0 * v));
    let _ = writeln!(
        text,
        "quality   error at the rim {} (adding up, measured: {}; expected: zero order's place {}, between pixels {})",
        percent(report.error_estimate),
        percent(report.sum_error),
        percent(report.center_error),
        percent(report.sampling_error)
    );
    let coverage = &report.coverage;
    let _ = writeln!(
        text,
        "coverage  {:.1} % of the entries whole, {:.1} % not at all",
        100.0 * coverage.full,
        100.0 * coverage.none
    );
    text += &lines(&report.assumptions, &report.warnings);
    let s = &report.seconds;
    let _ =
        write!(text, "time      {:.2} s: reading {:.2}, table {:.2}, writing {:.2}", s.total, s.read, s.table, s.write);
    text
}
