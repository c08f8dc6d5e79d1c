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

Lengths are in mm, in sample coordinates: origin at the centre of the sample, x right, y up, z along the outward normal.
`nacre calibrate board` draws a board to show on the panel.")]
pub struct Geometry {
    /// Folder of chessboard photographs, or a geometry.json to extend. With --relative: the photograph of the sample.
    input: PathBuf,
    /// Geometry (JSON).
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    /// Folder for check pictures: detected corners drawn into each chessboard photograph.
    #[arg(long, value_name = "DIR")]
    check: Option<PathBuf>,
    /// Inner corners of the board along a row and a column.
    #[arg(long, value_name = "9x6", default_value = "9x6", value_parser = shape)]
    board: [usize; 2],
    /// Side of a board square in mm.
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
    /// Replace existing files.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

/// Pose of the sample.
#[derive(clap::Args)]
struct Sample {
    /// Photograph of the board lying on the sample.
    #[arg(long, value_name = "PHOTO", conflicts_with = "sample_corners")]
    sample_photo: Option<PathBuf>,
    /// Thickness of the board on the sample in mm.
    #[arg(long, value_name = "MM", default_value_t = 0.0, requires = "sample_photo", allow_negative_numbers = true)]
    board_thickness_mm: f64,
    /// Pixel coordinates of the sample's corners: upper left, upper right, lower right, lower left.
    #[arg(long, value_name = "X,Y,…", requires = "sample_mm", value_parser = corners, allow_hyphen_values = true)]
    sample_corners: Option<[f64; 8]>,
    /// Width and height of the sample in mm.
    #[arg(long, value_name = "W,H", requires = "sample_corners", value_parser = pair, allow_hyphen_values = true)]
    sample_mm: Option<[f64; 2]>,
    /// Standard deviation of --sample-corners in pixels.
    #[arg(long, value_name = "PX", default_value_t = 1.0, allow_negative_numbers = true)]
    corner_sigma_px: f64,
}

/// Pose of the panel.
#[derive(clap::Args)]
struct PanelArgs {
    /// Panel width and height in pixels.
    #[arg(long, value_name = "W,H", requires = "panel_pixel_mm", value_parser = |t: &str| numbers::<u32, 2>(t, "width and height: 1920,1080"))]
    panel_px: Option<[u32; 2]>,
    /// Pixel pitch of the panel in mm, or horizontal and vertical pitch.
    #[arg(long, value_name = "P[,Q]", requires = "panel_px", value_parser = one_or_two, allow_hyphen_values = true)]
    panel_pixel_mm: Option<[f64; 2]>,
    /// Centre of the panel in mm, measured by hand (sample coordinates).
    #[arg(long, value_name = "X,Y,Z", requires = "panel_px", conflicts_with = "panel_photo", value_parser = triple, allow_hyphen_values = true)]
    panel_at: Option<[f64; 3]>,
    /// Rotation of the panel about x, y, z of the sample in degrees. 0,0,0 faces straight down.
    #[arg(long, value_name = "RX,RY,RZ", default_value = "0,0,0", value_parser = triple, allow_hyphen_values = true)]
    panel_turn: [f64; 3],
    /// Standard deviations of --panel-at (mm) and --panel-turn (degrees).
    #[arg(long, value_name = "MM,DEG", default_value = "3,1", value_parser = pair, allow_hyphen_values = true)]
    panel_sigma: [f64; 2],
    /// Photograph of the panel's mirror image, with a chessboard in the middle of the panel and a mirror on the sample.
    #[arg(long, value_name = "PHOTO", requires_all = ["panel_px", "panel_square_px"])]
    panel_photo: Option<PathBuf>,
    /// Inner corners of the board on the panel, along a row and a column.
    #[arg(long, value_name = "9x6", default_value = "9x6", value_parser = shape)]
    panel_board: [usize; 2],
    /// Side of a square of that board in panel pixels.
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    panel_square_px: Option<f64>,
    /// The photograph shows the panel directly, without a mirror.
    #[arg(long)]
    panel_direct: bool,
    /// Height of the mirror above the sample in mm.
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true)]
    mirror_mm: f64,
}

/// Position of the light, and its wavelength.
#[derive(clap::Args)]
struct Light {
    /// Pixel of the light's mirror image, or a photograph that shows it. Append the mirror's height (mm) and its tilt
    /// about x and y (degrees). Repeatable.
    #[arg(long, value_name = "X,Y|PHOTO[,Z[,TX,TY]]", value_parser = highlight::parse, allow_hyphen_values = true)]
    highlight: Vec<highlight::Given>,
    /// Standard deviation of highlight positions in pixels.
    #[arg(long, value_name = "PX", default_value_t = 0.5, allow_negative_numbers = true)]
    highlight_sigma_px: f64,
    /// Height of the light above the sample and its standard deviation, in mm.
    #[arg(long, value_name = "H,SIGMA", value_parser = pair, allow_hyphen_values = true, conflicts_with = "relative")]
    light_height_mm: Option<[f64; 2]>,
    /// Lamp spectrum: E, A, D65, FL1 to FL12, LED-B1, LED-B3, or a CSV file (wavelength_nm,power).
    #[arg(long, value_name = "NAME|FILE.csv")]
    lamp: Option<String>,
    /// Filter transmission (CSV).
    #[arg(long, value_name = "FILE.csv")]
    filter: Option<PathBuf>,
    /// Spectral response of the camera channel (CSV).
    #[arg(long, value_name = "FILE.csv")]
    response: Option<PathBuf>,
    /// Wavelength and its standard deviation in nm.
    #[arg(long, value_name = "NM[,SIGMA]", conflicts_with_all = ["lamp", "filter", "response"], value_parser = wavelength, allow_hyphen_values = true)]
    wavelength: Option<[f64; 2]>,
}

/// Relative geometry, without a calibration.
#[derive(clap::Args)]
struct RulerArgs {
    /// Derive a relative geometry from one known length and two distances. Assumes the optical axis in the middle of
    /// the picture; periods will be relative.
    #[arg(long, requires_all = ["known_mm", "known_px", "camera_mm", "light_mm", "highlight"])]
    relative: bool,
    /// Known length on the sample in mm.
    #[arg(long, value_name = "L", requires = "relative", allow_negative_numbers = true)]
    known_mm: Option<f64>,
    /// Pixel coordinates of both ends of the known length.
    #[arg(long, value_name = "X1,Y1,X2,Y2", requires = "relative", value_parser = |t: &str| numbers::<f64, 4>(t, "two places: 10,20,300,20"), allow_hyphen_values = true)]
    known_px: Option<[f64; 4]>,
    /// Distance from the sample to the camera in mm.
    #[arg(long, value_name = "D", requires = "relative", allow_negative_numbers = true)]
    camera_mm: Option<f64>,
    /// Distance from the sample to the light in mm.
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

/// Defaults to a standard deviation of 0.5 nm, the accuracy of a filter's data sheet.
fn wavelength(text: &str) -> Result<[f64; 2], String> {
    pair(text).or_else(|_| numbers(text, "nm, or nm and how far off: 530,2").map(|[nm]: [f64; 1]| [nm, 0.5]))
}

/// JSON output of the command.
#[derive(Serialize)]
struct Printed<'a> {
    geometry: &'a geometry::Geometry,
    #[serde(flatten)]
    report: &'a nacre_periods::calibration::Report,
    band: Option<Band>,
    files: Vec<PathBuf>,
}

impl Geometry {
    /// Measures the geometry and writes it.
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
        // clap guarantees that all four are given.
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

    /// Draws the detected corners into each photograph of the board.
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
    /// Spectral band of lamp, filter and response, if any of them is given.
    fn band(&self) -> Result<Option<Band>, Failure> {
        let mut spectra = vec![];
        for path in [&self.filter, &self.response].into_iter().flatten() {
            spectra.push(Spectrum::read(path)?);
        }
        let lamp = self.lamp.as_deref().map(Illuminant::of).transpose()?.map(|light| light.spectrum);
        Ok(band_of(lamp, spectra)?)
    }
}

/// Summary for the terminal.
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
