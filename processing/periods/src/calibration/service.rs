//! Calibration as a job: photographs of a board, or of a light in mirrors, to a `geometry.json`, pictures of what was found, and a report in a
//! new folder.

use super::band::Band;
use super::boards::Calibrated;
use super::corners::Board;
use super::job::{CameraFrom, Request, SampleFrom, calibrate_geometry};
use super::light::Known;
use super::mirrors::{LightOptions, Seen};
use super::overlay::overlay;
use super::report::Report;
use nacre_base::estimate::Work;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::OutputFolder;
use nacre_optics::geometry::{Geometry, text};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How far corners are off that are picked on a page that shows where the pointer is, in px.
const CORNER_SIGMA_PX: f64 = 0.5;

/// What is known of the photographs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Inner corners of the board along a row and a column.
    pub board: [usize; 2],
    /// Size of a square in mm.
    pub square_mm: f64,
    /// Corners of the sample (upper left, upper right, lower right, lower left) in pixels; default: it lies where the first board does.
    pub sample_corners_px: Option<[[f64; 2]; 4]>,
    /// Width and height of the sample in mm, which go with its corners.
    pub sample_mm: Option<[f64; 2]>,
    /// An earlier geometry.json, of which all is kept that is not measured again; then there are no photographs of a board.
    pub geometry: Option<Box<Geometry>>,
    /// What is known of the light.
    #[serde(flatten)]
    pub light: LightOptions,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            board: [9, 6],
            square_mm: 25.0,
            sample_corners_px: None,
            sample_mm: None,
            geometry: None,
            light: LightOptions::default(),
        }
    }
}

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Calibration {
    /// `calibrate`.
    pub method: &'static str,
    /// Where everything is.
    pub geometry: Geometry,
    /// How good it is.
    #[serde(flatten)]
    pub report: Report,
    /// Where the light was seen in mirrors.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub highlights: Vec<Seen>,
    /// The band of light, where spectra told it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band: Option<Band>,
}

/// What a calibration by the photographs of a folder needs.
pub fn work(folder: &Path, photographs: bool) -> Work {
    /// A chessboard in a photograph of 12 Mpixel.
    const EACH: [f64; 2] = [0.6, 400e6];
    let count = if photographs { nacre_image::photographs(folder).map_or(0, |all| all.len()) } else { 0 };
    let seconds = 0.05 + EACH[0] * count as f64;
    Work { operation: "calibrate".into(), seconds, memory_bytes: EACH[1] as u64, disk_bytes: 1 << 20 }
}

impl Options {
    fn request(&self, folder: &Path) -> Result<Request> {
        let [columns, rows] = self.board;
        let board = Board { columns, rows, square_mm: self.square_mm };
        board.check()?;
        let sample = match (self.sample_corners_px, self.sample_mm) {
            (Some(corners), Some(size)) => SampleFrom::Corners(corners, size, CORNER_SIGMA_PX),
            (None, None) => SampleFrom::Default,
            _ => {
                let remedy = "give sample_corners_px and sample_mm together";
                return Err(Error::input("sample", "has corners without a size, or a size without corners", remedy));
            }
        };
        Ok(Request {
            camera: match &self.geometry {
                Some(geometry) => CameraFrom::Known(geometry.clone()),
                None => CameraFrom::Boards(folder.to_path_buf(), board),
            },
            sample,
            panel: None,
            highlights: vec![],
            known: Known { sigma_px: 1.0, height_mm: None },
            wavelength_nm: self.light.said_nm(),
        })
    }

    /// Refuses what makes no sense.
    ///
    /// # Errors
    /// `Input`, which names the option.
    pub fn check(&self) -> Result<()> {
        self.light.check()?;
        match &self.geometry {
            Some(geometry) => {
                geometry.check()?;
                if geometry.relative && !self.light.highlights.is_empty() {
                    let remedy = "calibrate the camera with photographs of a board first";
                    return Err(Error::input("geometry", "is relative: no light can be placed in it", remedy));
                }
                if self.light.is_empty() && self.sample_corners_px.is_none() {
                    let remedy = "give highlights, a wavelength or spectra, or the sample's corners";
                    return Err(Error::input("options", "leave the geometry as it is", remedy));
                }
            }
            None if !self.light.highlights.is_empty() => {
                let remedy = "calibrate the camera first, and give its geometry.json as geometry";
                return Err(Error::input("highlights", "have no camera", remedy));
            }
            None => {}
        }
        self.request(Path::new("")).map(drop)
    }

    /// Whether there is nothing to be looked at in photographs.
    pub fn needs_no_photographs(&self) -> bool {
        self.geometry.is_some() && self.light.highlights.iter().all(|m| m.file.is_none())
    }
}

/// Calibrates a camera with the photographs in `input`, or goes on from a calibrated one, and writes `geometry.json`, `report.json` and each photograph with what was found in it
/// into the new folder `out`.
///
/// # Errors
/// `Input` for photographs that show no board and options that make no sense; `Output`; `Cancelled`.
pub fn calibrate_folder(
    input: &Path,
    out: &Path,
    options: &Options,
    overwrite: bool,
    progress: &dyn Progress,
) -> Result<Calibration> {
    options.check()?;
    let mut request = options.request(input)?;
    let folder = OutputFolder::begin(out, overwrite)?;
    let mut seen = vec![];
    if !options.light.highlights.is_empty() {
        progress.stage("looking for the light", 0);
        let camera_px = options.geometry.as_ref().and_then(|g| g.image_px);
        (seen, request.highlights, request.known) = options.light.look(input, camera_px)?;
    }
    let mut found = calibrate_geometry(&request, progress)?;
    let band = options.light.band()?;
    if let Some(band) = band {
        found.geometry.wavelength_nm = Some(band.mean_nm);
        found.geometry.sigma.wavelength_nm = Some(band.sigma_nm);
    }
    folder.write("geometry.json", text(&found.geometry).as_bytes())?;
    if let Some((boards, board)) = &found.boards {
        write_overlays(&folder, boards, board)?;
    }
    let calibration =
        Calibration { method: "calibrate", geometry: found.geometry, report: found.report, highlights: seen, band };
    folder.write_json("report.json", &calibration)?;
    progress.check()?;
    folder.commit()?;
    Ok(calibration)
}

/// Draws each photograph of the board with what was found in it, and answers with the files' names.
///
/// # Errors
/// `Input` for a photograph that cannot be read again; `Output`.
pub fn write_overlays(folder: &OutputFolder, boards: &Calibrated, board: &Board) -> Result<Vec<String>> {
    let mut names = vec![];
    for photograph in &boards.used {
        let canvas = overlay(photograph, &boards.camera, board)?;
        let name = format!("{}.png", photograph.path.file_stem().unwrap_or_default().to_string_lossy());
        canvas.save_png(&folder.path(&name))?;
        names.push(name);
    }
    Ok(names)
}
