//! `nacre calibrate geometry`: computes a `geometry.json` from photographs and manual measurements.

use super::boards::{self, Calibrated, calibrate, name};
use super::corners::{Board, View, find};
use super::light::{Highlight, Known, from_highlights};
use super::panel::{Pixels, PlacedPanel, Shown, by_hand, from_photograph};
use super::relative::{Ruler, relative};
use super::report::{PhotographReport, Report};
use super::sample::{CameraCovariance, Placed, camera_covariance, from_board, from_corners};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::Gray;
use nacre_optics::geometry::{Geometry, load};
use std::path::{Path, PathBuf};

/// Source of the camera parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraFrom {
    /// Folder of photographs of a board.
    Boards(PathBuf, Board),
    /// An earlier geometry.json; values that are not measured anew are kept.
    File(PathBuf),
    /// The contents of an earlier geometry.json.
    Known(Box<Geometry>),
    /// Relative geometry without a calibration (2018 paper, section 4.4).
    Ruler(Ruler),
}

/// Source of the sample's pose.
#[derive(Clone, Debug, PartialEq)]
pub enum SampleFrom {
    /// The earlier geometry, or the board in the first photograph.
    Default,
    /// Photograph of a board lying on the sample, and the board's thickness in mm.
    Board(PathBuf, Board, f64),
    /// Pixel positions of the sample's corners (upper left, upper right, lower right, lower left), its size in mm, and
    /// the standard deviation of the corners in px.
    Corners([[f64; 2]; 4], [f64; 2], f64),
}

/// Source of the panel's pose.
#[derive(Clone, Debug, PartialEq)]
pub enum PanelFrom {
    /// Centre in mm, rotation in degrees, standard deviations of both.
    Hand([f64; 3], [f64; 3], [f64; 2]),
    /// Photograph of the panel with a board in its centre (squares in panel pixels), direct or mirrored view, and the
    /// mirror's height in mm.
    Photograph(PathBuf, Board, View, f64),
}

/// Input of a geometry calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Source of the camera.
    pub camera: CameraFrom,
    /// Source of the sample's pose.
    pub sample: SampleFrom,
    /// The panel, if requested.
    pub panel: Option<(Pixels, PanelFrom)>,
    /// Highlights of the light; empty if the light is not requested.
    pub highlights: Vec<Highlight>,
    /// Other measurements of the light.
    pub known: Known,
    /// Wavelength and its standard deviation in nm, if known.
    pub wavelength_nm: Option<[f64; 2]>,
}

/// Result of a geometry calibration.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Contents of `geometry.json`.
    pub geometry: Geometry,
    /// Accuracy.
    pub report: Report,
    /// Photographs of the board, if any.
    pub boards: Option<(Calibrated, Board)>,
}

/// Computes the geometry.
///
/// # Errors
/// `Input` for invalid files and numbers; `Cancelled`.
pub fn calibrate_geometry(request: &Request, progress: &dyn Progress) -> Result<Outcome> {
    let mut report = Report::default();
    if !matches!(request.camera, CameraFrom::Boards(..)) {
        progress.expect(&boards::work(0, [0, 0]))?;
    }
    let (mut geometry, mut sample, covariance, boards) = camera(request, &mut report, progress)?;
    let relative = matches!(request.camera, CameraFrom::Ruler(_));
    if relative && (request.sample != SampleFrom::Default || request.panel.is_some()) {
        let remedy = "calibrate the camera with photographs of a board, or leave sample and panel out";
        return Err(Error::input("relative geometry", "has no calibrated camera", remedy));
    }
    progress.stage("placing sample, panel and light", 0);
    if let Some(placed) = placed(request, &geometry, &covariance, &mut report)? {
        // Positions in the coordinates of another sample are no longer valid.
        if geometry.panel.take().is_some() | geometry.light_mm.take().is_some() {
            report.warnings.push("the sample was placed anew: panel and light of the earlier file are left out".into());
        }
        (geometry.sigma.panel_mm, geometry.sigma.panel_turn_deg, geometry.sigma.light_mm) = (None, None, None);
        sample = placed;
    }
    geometry.sample = sample.pose;
    if !relative {
        let s = sample.sigma;
        geometry.sigma.sample_turn_deg = Some([s[0], s[1], s[2]].map(f64::to_degrees));
        geometry.sigma.sample_mm = Some([s[3], s[4], s[5]]);
    }
    if let Some((pixels, from)) = &request.panel {
        let placed = panel(*pixels, from, &geometry, &covariance, &sample)?;
        report.panel_rms_px = placed.rms_px;
        geometry.sigma.panel_mm = Some(placed.mm);
        geometry.sigma.panel_turn_deg = Some(placed.turn_deg);
        geometry.panel = Some(placed.panel);
    }
    if !relative && (!request.highlights.is_empty() || request.known.height_mm.is_some()) {
        let light = from_highlights(&geometry.camera, &sample, &request.highlights, &request.known)?;
        if let Some(chi2) = light.chi2.filter(|c| *c > 9.0) {
            let times = chi2.sqrt();
            report
                .warnings
                .push(format!("highlights lie {times:.1} times as far off as they may: σ is larger by as much"));
        }
        report.light_chi2 = light.chi2;
        geometry.light_mm = Some(light.mm);
        geometry.sigma.light_mm = Some(light.sigma_mm);
    }
    if let Some([nm, sigma]) = request.wavelength_nm {
        geometry.wavelength_nm = Some(nm);
        geometry.sigma.wavelength_nm = Some(sigma);
    }
    geometry.check()?;
    Ok(Outcome { geometry, report, boards })
}

type Start = (Geometry, Placed, CameraCovariance, Option<(Calibrated, Board)>);

/// The camera, and the pose of the sample known with it.
fn camera(request: &Request, report: &mut Report, progress: &dyn Progress) -> Result<Start> {
    let known = |geometry: Geometry| {
        let turn = geometry.sigma.sample_turn_deg.unwrap_or_default().map(f64::to_radians);
        let mm = geometry.sigma.sample_mm.unwrap_or_default();
        let sigma = [turn[0], turn[1], turn[2], mm[0], mm[1], mm[2]];
        let covariance = camera_covariance(&geometry);
        (geometry.clone(), Placed { pose: geometry.sample, sigma, rms_px: 0.0 }, covariance, None)
    };
    match &request.camera {
        CameraFrom::File(path) => {
            let geometry = load(path)?;
            if geometry.relative && request.panel.is_some() {
                return Err(Error::file(path, "is relative", "calibrate the camera with photographs of a board"));
            }
            Ok(known(geometry))
        }
        CameraFrom::Known(geometry) => {
            geometry.check()?;
            Ok(known(Geometry::clone(geometry)))
        }
        CameraFrom::Ruler(ruler) => {
            report.warnings.push("not calibrated: periods that follow are relative".into());
            Ok(known(relative(ruler)?))
        }
        CameraFrom::Boards(folder, board) => {
            let found = calibrate(folder, board, progress)?;
            report.of_camera(&found);
            let first = found.used.first().ok_or_else(|| Error::file(folder, "shows no board", "give photographs"))?;
            let placed = from_board(&found.camera, &found.covariance, board, &first.corners, 0.0)?;
            if request.sample == SampleFrom::Default {
                let words = format!("the sample's place is taken for that of the board in {}", name(&first.path));
                report.warnings.push(words + ": say --sample-photo or --sample-corners");
            }
            let mut geometry = Geometry::new(found.camera, placed.pose);
            geometry.image_px = Some(found.image_px.map(|n| n as u32));
            let s = found.sigma;
            geometry.sigma.focal_px = Some([s[0], s[1]]);
            geometry.sigma.center_px = Some([s[2], s[3]]);
            geometry.sigma.distortion = Some([s[4], s[5], s[6], s[7], s[8]]);
            let covariance = found.covariance;
            Ok((geometry, placed, covariance, Some((found, *board))))
        }
    }
}

/// New pose of the sample.
fn placed(
    request: &Request,
    geometry: &Geometry,
    covariance: &CameraCovariance,
    report: &mut Report,
) -> Result<Option<Placed>> {
    let placed = match &request.sample {
        SampleFrom::Default => return Ok(None),
        SampleFrom::Board(path, board, thickness) => {
            board.check()?;
            let corners = detect_corners(path, geometry, board, View::Direct)?;
            from_board(&geometry.camera, covariance, board, &corners, *thickness)?
        }
        SampleFrom::Corners(corners, size, sigma) => {
            let placed = from_corners(&geometry.camera, covariance, corners, *size, *sigma)?;
            if placed.rms_px > 2.0 * sigma {
                let words = format!("the sample's corners are {:.1} px off a rectangle of that size", placed.rms_px);
                report.warnings.push(words + ": check the size and the corners");
            }
            placed
        }
    };
    report.sample_rms_px = Some(placed.rms_px);
    Ok(Some(placed))
}

/// Corners of a board in a photograph by the camera.
fn detect_corners(path: &Path, geometry: &Geometry, board: &Board, view: View) -> Result<Vec<[f64; 2]>> {
    let image = Gray::read(path)?;
    let size = [image.width as u32, image.height as u32];
    if let Some(known) = geometry.image_px.filter(|known| *known != size) {
        let problem = format!(
            "is {} x {} pixels, and the camera was calibrated at {} x {}",
            size[0], size[1], known[0], known[1]
        );
        return Err(Error::file(path, problem, "take both with the same camera, neither cropped nor scaled"));
    }
    find(&image, board, view).map_err(|why| Error::file(path, why, "check the photograph and the board's corners"))
}

fn panel(
    pixels: Pixels,
    from: &PanelFrom,
    geometry: &Geometry,
    covariance: &CameraCovariance,
    sample: &Placed,
) -> Result<PlacedPanel> {
    match from {
        PanelFrom::Hand(at, turn, [mm, deg]) => by_hand(pixels, *at, *turn, *mm, *deg),
        PanelFrom::Photograph(path, board, view, mirror_mm) => {
            board.check()?;
            if !mirror_mm.is_finite() || mirror_mm.abs() > 1e4 {
                return Err(Error::input("mirror", format!("is {mirror_mm} mm high"), "give at most 10000 mm"));
            }
            if !board.has_a_top() {
                let problem = format!("of {} × {} corners has no top", board.columns, board.rows);
                return Err(Error::input(
                    "panel board",
                    problem,
                    "show one with an odd and an even number, such as 9x6",
                ));
            }
            let corners = detect_corners(path, geometry, board, *view)?;
            let shown = Shown { corners: &corners, board: *board, view: *view, mirror_mm: *mirror_mm };
            from_photograph(&geometry.camera, covariance, sample, pixels, &shown)
        }
    }
}

impl Report {
    fn of_camera(&mut self, found: &Calibrated) {
        self.rms_px = Some(found.rms_px);
        self.photographs = found
            .used
            .iter()
            .map(|p| PhotographReport { file: name(&p.path), rms_px: Some(p.rms_px), unused_because: None })
            .chain(found.unused.iter().map(|(path, why)| PhotographReport {
                file: name(path),
                rms_px: None,
                unused_because: Some(why.clone()),
            }))
            .collect();
        self.photographs.sort_by(|a, b| a.file.cmp(&b.file));
        self.warnings.extend(found.warnings.iter().cloned());
    }
}
