//! `nacre calibrate geometry`.

use super::{highlight, shape};
use crate::commands::Estimating;
use crate::commands::values::numbers;
use crate::console::Console;
use nacre_base::{Error, vacant};
use nacre_capture::Failure;
use nacre_image::{OutputFolder, info};
use nacre_optics::color::{Illuminant, Spectrum};
use nacre_optics::geometry;
use nacre_periods::calibration::{
    Band, Board, CameraFrom, Highlight, Known, Outcome, PanelFrom, Pixels, Request, Ruler, SampleFrom, View, band_of,
    calibrate_geometry, write_overlays,
};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `nacre calibrate geometry`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre calibrate geometry boards/ --board 9x6 --square-mm 25 --sample-photo lying.jpg --check check --out geometry.json
  nacre calibrate geometry geometry.json --sample-corners 210,150,840,160,835,700,205,690 --sample-mm 70,60 --out tile.json
  nacre calibrate geometry tile.json --panel-px 1920,1080 --panel-pixel-mm 0.2745 --panel-photo mirror.png \\
      --panel-board 9x6 --panel-square-px 120 --out panel.json
  nacre calibrate geometry panel.json --highlight mirror.png --highlight raised.png,50 --lamp A --filter green.csv --out flash.json
  nacre calibrate geometry photo.jpg --relative --known-mm 297 --known-px 100,520,1180,524 --camera-mm 500 --light-mm 200 \\
      --highlight 640,500 --out relative.json

Lengths are mm in coordinates of the sample: origin in its middle, x right, y up, z out of the surface. `nacre calibrate board`
makes a board to show on the panel.")]
pub struct Geometry {
    /// A folder of photographs of a chessboard; a geometry.json to go on from; with --relative the photograph itself.
    input: PathBuf,
    /// The geometry (JSON).
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    /// Folder for pictures of what was found in the photographs of the board.
    #[arg(long, value_name = "DIR")]
    check: Option<PathBuf>,
    /// Inner corners of the board along a row and a column.
    #[arg(long, value_name = "9x6", default_value = "9x6", value_parser = shape)]
    board: [usize; 2],
    /// Side of its squares.
    #[arg(long, value_name = "MM", default_value_t = 25.0, allow_negative_numbers = true)]
    square_mm: f64,
    #[command(flatten)]
    sample: Sample,
    #[command(flatten)]
    panel: PanelArgs,
    #[command(flatten)]
    light: Light,
    #[command(flatten)]
    ruler: RulerArgs,
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

/// Where the sample is.
#[derive(clap::Args)]
struct Sample {
    /// Photograph of the board lying on the sample.
    #[arg(long, value_name = "PHOTO", conflicts_with = "sample_corners")]
    sample_photo: Option<PathBuf>,
    /// Thickness of that board.
    #[arg(long, value_name = "MM", default_value_t = 0.0, requires = "sample_photo", allow_negative_numbers = true)]
    board_thickness_mm: f64,
    /// Its corners in pixels: upper left, upper right, lower right, lower left.
    #[arg(long, value_name = "X,Y,…", requires = "sample_mm", value_parser = corners, allow_hyphen_values = true)]
    sample_corners: Option<[f64; 8]>,
    /// Its width and height.
    #[arg(long, value_name = "W,H", requires = "sample_corners", value_parser = pair, allow_hyphen_values = true)]
    sample_mm: Option<[f64; 2]>,
    /// How far these corners may be off.
    #[arg(long, value_name = "PX", default_value_t = 1.0, allow_negative_numbers = true)]
    corner_sigma_px: f64,
}

/// Where the panel is.
#[derive(clap::Args)]
struct PanelArgs {
    /// Pixels of the panel along a row and a column.
    #[arg(long, value_name = "W,H", requires = "panel_pixel_mm", value_parser = |t: &str| numbers::<u32, 2>(t, "width and height: 1920,1080"))]
    panel_px: Option<[u32; 2]>,
    /// Size of a pixel, or its width and height.
    #[arg(long, value_name = "P[,Q]", requires = "panel_px", value_parser = one_or_two, allow_hyphen_values = true)]
    panel_pixel_mm: Option<[f64; 2]>,
    /// Its middle, measured by hand.
    #[arg(long, value_name = "X,Y,Z", requires = "panel_px", conflicts_with = "panel_photo", value_parser = triple, allow_hyphen_values = true)]
    panel_at: Option<[f64; 3]>,
    /// Its turn about x, y, z of the sample, in degrees; unturned it looks straight down.
    #[arg(long, value_name = "RX,RY,RZ", default_value = "0,0,0", value_parser = triple, allow_hyphen_values = true)]
    panel_turn: [f64; 3],
    /// How far both may be off, in mm and degrees.
    #[arg(long, value_name = "MM,DEG", default_value = "3,1", value_parser = pair, allow_hyphen_values = true)]
    panel_sigma: [f64; 2],
    /// Photograph of the panel, which shows a board in its middle, in a mirror on the sample.
    #[arg(long, value_name = "PHOTO", requires_all = ["panel_px", "panel_square_px"])]
    panel_photo: Option<PathBuf>,
    /// Inner corners of the board that it shows.
    #[arg(long, value_name = "9x6", default_value = "9x6", value_parser = shape)]
    panel_board: [usize; 2],
    /// Side of its squares in panel pixels.
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    panel_square_px: Option<f64>,
    /// The camera sees the panel itself, not its mirror image.
    #[arg(long)]
    panel_direct: bool,
    /// Height of the mirror above the sample.
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true)]
    mirror_mm: f64,
}

/// Where the light is, and its wavelength.
#[derive(clap::Args)]
struct Light {
    /// Where the light's mirror image is seen, in pixels, or a photograph in which it is found; the mirror's height (mm) and tilt about x
    /// and y (degrees). May be given several times.
    #[arg(long, value_name = "X,Y|PHOTO[,Z[,TX,TY]]", value_parser = highlight::parse, allow_hyphen_values = true)]
    highlight: Vec<highlight::Given>,
    /// How far highlights may be off.
    #[arg(long, value_name = "PX", default_value_t = 0.5, allow_negative_numbers = true)]
    highlight_sigma_px: f64,
    /// Height of the light above the sample, and how far it may be off.
    #[arg(long, value_name = "H,SIGMA", value_parser = pair, allow_hyphen_values = true, conflicts_with = "relative")]
    light_height_mm: Option<[f64; 2]>,
    /// Spectrum of the lamp: E, A, D65, FL1 to FL12, LED-B1, LED-B3, or a CSV file (wavelength_nm,power).
    #[arg(long, value_name = "NAME|FILE.csv")]
    lamp: Option<String>,
    /// Transmission of the filter (CSV).
    #[arg(long, value_name = "FILE.csv")]
    filter: Option<PathBuf>,
    /// Response of the camera's channel (CSV).
    #[arg(long, value_name = "FILE.csv")]
    response: Option<PathBuf>,
    /// The wavelength itself in nm, and how far it may be off.
    #[arg(long, value_name = "NM[,SIGMA]", conflicts_with_all = ["lamp", "filter", "response"], value_parser = wavelength, allow_hyphen_values = true)]
    wavelength: Option<[f64; 2]>,
}

/// The way without a calibration.
#[derive(clap::Args)]
struct RulerArgs {
    /// No calibration: one known length on the sample, two distances, the middle of the picture. Periods will be relative.
    #[arg(long, requires_all = ["known_mm", "known_px", "camera_mm", "light_mm", "highlight"])]
    relative: bool,
    /// A known length on the sample.
    #[arg(long, value_name = "L", requires = "relative", allow_negative_numbers = true)]
    known_mm: Option<f64>,
    /// Its two ends in pixels.
    #[arg(long, value_name = "X1,Y1,X2,Y2", requires = "relative", value_parser = |t: &str| numbers::<f64, 4>(t, "two places: 10,20,300,20"), allow_hyphen_values = true)]
    known_px: Option<[f64; 4]>,
    /// From the sample to the camera.
    #[arg(long, value_name = "D", requires = "relative", allow_negative_numbers = true)]
    camera_mm: Option<f64>,
    /// From the sample to the light.
    #[arg(long, value_name = "H", requires = "relative", allow_negative_numbers = true)]
    light_mm: Option<f64>,
}

fn corners(text: &str) -> Result<[f64; 8], String> {
    numbers(text, "four corners: X,Y of upper left, upper right, lower right, lower left")
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers(text, "two numbers: 70,60")
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    numbers(text, "three numbers: 0,100,400")
}

fn one_or_two(text: &str) -> Result<[f64; 2], String> {
    pair(text).or_else(|_| numbers(text, "one number or two: 0.2745").map(|[p]: [f64; 1]| [p, p]))
}

/// Half a nanometre is what a filter's data sheet is good for.
fn wavelength(text: &str) -> Result<[f64; 2], String> {
    pair(text).or_else(|_| numbers(text, "nm, or nm and how far off: 530,2").map(|[nm]: [f64; 1]| [nm, 0.5]))
}

/// What is printed as JSON.
#[derive(Serialize)]
struct Printed<'a> {
    geometry: &'a geometry::Geometry,
    #[serde(flatten)]
    report: &'a nacre_periods::calibration::Report,
    band: Option<Band>,
    files: Vec<PathBuf>,
}

impl Geometry {
    /// Measures and writes it.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        vacant(std::slice::from_ref(&self.out), self.force)?;
        let (request, band) = self.request()?;
        let mut found = calibrate_geometry(&request, console)?;
        if let Some(band) = band {
            found.geometry.wavelength_nm = Some(band.mean_nm);
            found.geometry.sigma.wavelength_nm = Some(band.sigma_nm);
        }
        let mut files = vec![self.out.clone()];
        if let Some(folder) = &self.check {
            files.extend(self.pictures(folder, &found)?);
        }
        geometry::save(&found.geometry, &self.out)?;
        let printed = Printed { geometry: &found.geometry, report: &found.report, band, files };
        console.result(&summary(&printed), &printed);
        Ok(())
    }

    fn request(&self) -> Result<(Request, Option<Band>), Failure> {
        let [columns, rows] = self.board;
        let board = Board { columns, rows, square_mm: self.square_mm };
        let (highlights, sigma_px) = highlight::found(&self.light.highlight, self.light.highlight_sigma_px)?;
        let camera = if self.ruler.relative {
            CameraFrom::Ruler(self.ruler(&highlights)?)
        } else if self.input.is_dir() {
            CameraFrom::Boards(self.input.clone(), board)
        } else {
            CameraFrom::File(self.input.clone())
        };
        let s = &self.sample;
        let sample = match (&s.sample_photo, s.sample_corners, s.sample_mm) {
            (Some(photo), ..) => SampleFrom::Board(photo.clone(), board, s.board_thickness_mm),
            (None, Some([a, b, c, d, e, f, g, h]), Some(size)) => {
                SampleFrom::Corners([[a, b], [c, d], [e, f], [g, h]], size, s.corner_sigma_px)
            }
            _ => SampleFrom::Default,
        };
        let known = Known { sigma_px, height_mm: self.light.light_height_mm };
        let band = self.light.band()?;
        let wavelength_nm = self.light.wavelength;
        let request = Request { camera, sample, panel: self.panel()?, highlights, known, wavelength_nm };
        Ok((request, band))
    }

    fn panel(&self) -> Result<Option<(Pixels, PanelFrom)>, Failure> {
        let p = &self.panel;
        let Some((size_px, pixel_mm)) = p.panel_px.zip(p.panel_pixel_mm) else { return Ok(None) };
        let from = match (p.panel_at, &p.panel_photo, p.panel_square_px) {
            (Some(at), ..) => PanelFrom::Hand(at, p.panel_turn, p.panel_sigma),
            (None, Some(photo), Some(square)) => {
                let [columns, rows] = p.panel_board;
                let view = if p.panel_direct { View::Direct } else { View::Mirrored };
                PanelFrom::Photograph(photo.clone(), Board { columns, rows, square_mm: square }, view, p.mirror_mm)
            }
            _ => {
                let remedy = "give --panel-at X,Y,Z, or --panel-photo with --panel-square-px";
                return Err(Error::input("panel", "has no place", remedy).into());
            }
        };
        Ok(Some((Pixels { pixel_mm, size_px }, from)))
    }

    fn ruler(&self, highlights: &[Highlight]) -> Result<Ruler, Failure> {
        let r = &self.ruler;
        let found = info(&self.input)?;
        let [highlight] = highlights else {
            return Err(Error::input("highlight", "is given several times", "give one with --relative").into());
        };
        // clap has seen to it that all are there.
        let [a, b, c, d] = r.known_px.unwrap_or_default();
        Ok(Ruler {
            image_px: [found.width, found.height],
            places_px: [[a, b], [c, d]],
            apart_mm: r.known_mm.unwrap_or_default(),
            camera_mm: r.camera_mm.unwrap_or_default(),
            light_mm: r.light_mm.unwrap_or_default(),
            highlight_px: highlight.pixel,
        })
    }

    /// Draws each photograph of the board with what was found in it.
    fn pictures(&self, folder: &Path, found: &Outcome) -> Result<Vec<PathBuf>, Failure> {
        let Some((boards, board)) = &found.boards else {
            let remedy = "leave --check out, or give a folder of photographs";
            return Err(Error::input("check", "goes with photographs of a board", remedy).into());
        };
        let out = OutputFolder::begin(folder, self.force)?;
        let names = write_overlays(&out, boards, board)?;
        out.commit()?;
        Ok(names.into_iter().map(|name| folder.join(name)).collect())
    }
}

impl Light {
    /// The band of lamp, filter and response, if any is given.
    fn band(&self) -> Result<Option<Band>, Failure> {
        let mut spectra = vec![];
        for path in [&self.filter, &self.response].into_iter().flatten() {
            spectra.push(Spectrum::read(path)?);
        }
        let lamp = self.lamp.as_deref().map(Illuminant::of).transpose()?.map(|light| light.spectrum);
        Ok(band_of(lamp, spectra)?)
    }
}

/// A few lines for a person.
fn summary(printed: &Printed<'_>) -> String {
    let mut text = nacre_periods::calibration::summary(printed.geometry, printed.report, printed.band);
    for file in printed.files.iter().take(3) {
        let _ = write!(text, "\nwrote     {}", file.display());
    }
    if printed.files.len() > 3 {
        let _ = write!(text, "\nwrote     {} more", printed.files.len() - 3);
    }
    text
}
