//! Calibration as an operation: from photographs of a board, or of a light in mirrors, to a `geometry.json`, check
//! pictures and a report in a new folder.

use super::band::Band;
use super::boards::Calibrated;
use super::corners::Board;
use super::job::{CameraFrom, Request, SampleFrom, calibrate_geometry};
use super::light::Known;
use super::mirrors::{LightOptions, MirrorImage};
use super::overlay::overlay;
use super::report::Report;
use super::summary::summary;
use nacre_base::estimate::Work;
use nacre_base::operation::{Input, Operation, Summary};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_optics::geometry::{Geometry, text};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Standard deviation in px of corners picked on the page, which shows the pointer's position.
const CORNER_SIGMA_PX: f64 = 0.5;

/// Calibrate a camera, the pose of the sample and the position of the light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-input" = "A folder of photographs of a board, or of the light in a mirror; none where an earlier geometry suffices"))]
#[schemars(rename = "CalibrateOptions")]
pub struct Options {
    /// Inner corners of the board along a row and a column.
    pub board: [usize; 2],
    /// Size of a square in mm.
    pub square_mm: f64,
    /// Corners of the sample (upper left, upper right, lower right, lower left) in pixels; default: it lies where the
    /// first board does.
    #[schemars(extend("x-advanced" = true))]
    pub sample_corners_px: Option<[[f64; 2]; 4]>,
    /// Width and height of the sample in mm, which go with its corners.
    #[schemars(extend("x-advanced" = true))]
    pub sample_mm: Option<[f64; 2]>,
    /// An earlier geometry.json: values that are not measured anew are kept, and no photographs of a board are needed.
    #[schemars(extend("x-file" = true))]
    pub geometry: Option<Box<Geometry>>,
    /// Measurements of the light.
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

/// Result of a calibration.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "CalibrateReport")]
pub struct Calibration {
    /// `calibrate`.
    pub method: &'static str,
    /// Calibrated geometry.
    pub geometry: Geometry,
    /// Accuracy.
    #[serde(flatten)]
    pub report: Report,
    /// Mirror images of the light.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub highlights: Vec<MirrorImage>,
    /// Spectral band, if spectra are given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band: Option<Band>,
}

impl Summary for Calibration {
    fn summary(&self) -> String {
        summary(&self.geometry, &self.report, self.band)
    }

    fn warnings(&self) -> &[String] {
        &self.report.warnings
    }
}

/// Predicted work of a calibration from the photographs of a folder.
pub fn work(folder: &Path, photographs: bool) -> Work {
    let files = if photographs { nacre_image::photographs(folder).unwrap_or_default() } else { vec![] };
    let first = files.first().and_then(|name| nacre_image::info(&folder.join(name)).ok());
    super::boards::work(files.len(), first.map_or([0, 0], |first| [first.width, first.height]))
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
            wavelength_nm: self.light.stated_nm(),
        })
    }

    /// Validates the options.
    ///
    /// # Errors
    /// `Input`, naming the option.
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

    /// True if the options require no photographs.
    fn needs_no_photographs(&self) -> bool {
        self.geometry.is_some() && self.light.highlights.iter().all(|m| m.file.is_none())
    }
}

impl Operation for Options {
    const NAME: &'static str = "calibrate";
    const TITLE: &'static str = "Camera, sample and light, from photographs of a board and of the light in a mirror";
    const INPUT: Input = Input::FilesOrNothing;
    type Report = Calibration;

    /// Validates the options for a folder of photographs, or for no input if an earlier geometry is extended without
    /// photographs.
    fn check_options(&self) -> Result<()> {
        self.check()
    }

    fn check(&self, input: &Path) -> Result<Work> {
        self.check()?;
        let photographs = !input.as_os_str().is_empty();
        if !photographs && !self.needs_no_photographs() {
            return Err(Error::input(
                "calibration",
                "has no photographs",
                "give a folder or an upload that holds them",
            ));
        }
        Ok(work(input, photographs))
    }

    /// Writes `geometry.json` and each photograph with its detected board.
    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Calibration> {
        let mut request = self.request(input)?;
        let mut mirror_images = vec![];
        if !self.light.highlights.is_empty() {
            progress.stage("looking for the light", 0);
            let camera_px = self.geometry.as_ref().and_then(|g| g.image_px);
            (mirror_images, request.highlights, request.known) = self.light.measured_highlights(input, camera_px)?;
        }
        let mut found = calibrate_geometry(&request, progress)?;
        let band = self.light.band()?;
        if let Some(band) = band {
            found.geometry.wavelength_nm = Some(band.mean_nm);
            found.geometry.sigma.wavelength_nm = Some(band.sigma_nm);
        }
        out.write("geometry.json", text(&found.geometry).as_bytes())?;
        if let Some((boards, board)) = &found.boards {
            write_overlays(out, boards, board)?;
        }
        let report = found.report;
        Ok(Calibration { method: "calibrate", geometry: found.geometry, report, highlights: mirror_images, band })
    }
}

/// Draws each photograph of the board with its corners; returns the file names.
///
/// # Errors
/// `Input` for a photograph that can no longer be read; `Output`.
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
