//! Camera calibration from photographs of a chessboard.

use super::corners::{Board, View, find};
use super::fit::{Fit, Observation, fit};
use super::sample::CameraCovariance;
use super::start;
use nacre_base::estimate::Work;
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_image::Gray;
use nacre_image::homography;
use nacre_image::{info, photographs};
use nacre_optics::geometry::{Camera, Pose};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Minimum number of photographs in different poses.
pub const FEWEST: usize = 3;

/// Maximum number of photographs.
const MOST: usize = 1000;

/// Ratio of a photograph's residual to the median residual above which a warning is issued.
const ODD: f64 = 2.5;

/// Maximum relative uncertainty of the focal lengths.
const VAGUE: f64 = 0.05;

/// A calibrated camera, its photographs and its accuracy.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// Intrinsic parameters and distortion.
    pub camera: Camera,
    /// Width and height of the photographs.
    pub image_px: [usize; 2],
    /// Photographs in the fit.
    pub used: Vec<Photograph>,
    /// Rejected photographs, and the reasons.
    pub unused: Vec<(PathBuf, String)>,
    /// Root mean square reprojection error in px.
    pub rms_px: f64,
    /// Covariance of fx, fy, cx, cy, k1, k2, p1, p2, k3.
    pub covariance: CameraCovariance,
    /// Standard deviations of fx, fy, cx, cy, k1, k2, p1, p2, k3.
    pub sigma: [f64; 9],
    /// Limitations of the result.
    pub warnings: Vec<String>,
}

/// A photograph of the board.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Path of the file.
    pub path: PathBuf,
    /// Corners in pixels, row by row.
    pub corners: Vec<[f64; 2]>,
    /// From board to camera coordinates.
    pub pose: Pose,
    /// Standard deviations of the pose: rotation about the camera's axes in rad, translation in mm.
    pub pose_sigma: [f64; 6],
    /// Root mean square reprojection error in px.
    pub rms_px: f64,
}

/// Predicted time, memory and disk space of the board detection. Memory is an estimate, since it grows with the number
/// of corner-like features.
pub(super) fn work(photographs: usize, [width, height]: [usize; 2]) -> Work {
    /// Seconds and bytes per pixel.
    const EACH: [f64; 2] = [0.05e-6, 34.0];
    let pixels = (width * height) as f64;
    let seconds = 0.05 + EACH[0] * pixels * photographs as f64;
    Work {
        operation: "calibrate".into(),
        seconds,
        memory_bytes: (EACH[1] * pixels) as u64,
        disk_bytes: 1 << 20,
        ..Work::default()
    }
}

/// Calibrates the camera from a folder of photographs.
///
/// The board may lie anywhere. Together, the photographs should cover the field of view, with the board tilted by 20°
/// to 45°. Method: Zhang 2000, with the lens model of [`Camera`]. Standard deviations are the larger of those of the
/// fit and those from the scatter between photographs.
///
/// # Errors
/// `Input` for a folder without photographs, for fewer than three usable ones (with reasons by file name), and for
/// photographs that do not determine the camera; `Cancelled`.
pub fn calibrate(folder: &Path, board: &Board, progress: &dyn Progress) -> Result<Calibrated> {
    board.check()?;
    let files: Vec<PathBuf> = photographs(folder)?.into_iter().map(|name| folder.join(name)).collect();
    if files.len() > MOST {
        let problem = format!("holds {} photographs", files.len());
        return Err(Error::file(folder, problem, format!("give at most {MOST}; 10 to 30 are enough")));
    }
    let Some(first) = files.first() else {
        return Err(Error::file(folder, "holds no photograph", "give a folder with photographs of a chessboard"));
    };
    let size = info(first).map(|i| [i.width, i.height])?;
    progress.expect(&work(files.len(), size))?;
    progress.stage("looking for the board", files.len() as u64);
    // At most two in parallel, since each needs several copies of its photograph.
    let detected: Vec<(PathBuf, DetectedCorners)> = files
        .par_iter()
        .map(|path| {
            progress.check()?;
            let found = detect_corners(path, board, size, first);
            progress.step();
            Ok((path.clone(), found))
        })
        .collect::<Result<_>>()?;
    let mut good = vec![];
    let mut unused = vec![];
    for (path, found) in detected {
        match found {
            Ok(corners) => good.push((path, corners)),
            Err(why) => unused.push((path, why)),
        }
    }
    of_corners(good, unused, board, size, progress).map_err(|e| match e {
        Error::Input { subject, problem, remedy } if subject == "photographs" => Error::file(folder, problem, remedy),
        other => other,
    })
}

/// Corners, or the reason why there are none.
type DetectedCorners = std::result::Result<Vec<[f64; 2]>, String>;

fn detect_corners(path: &Path, board: &Board, size: [usize; 2], first: &Path) -> DetectedCorners {
    let why = |e: Error| match e {
        Error::Input { problem, .. } => problem,
        other => other.to_string(),
    };
    let found = info(path).map_err(why)?;
    if [found.width, found.height] != size {
        return Err(format!("is {found}, unlike {}", first.display()));
    }
    find(&Gray::read(path).map_err(why)?, board, View::Direct)
}

/// Calibrates the camera from known corners.
///
/// # Errors
/// As [`calibrate`].
pub fn of_corners(
    good: Vec<(PathBuf, Vec<[f64; 2]>)>,
    unused: Vec<(PathBuf, String)>,
    board: &Board,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Calibrated> {
    if good.len() < FEWEST {
        let why = |(path, why): &(PathBuf, String)| format!("{} {why}", name(path));
        let reasons: Vec<String> = unused.iter().take(6).map(why).collect();
        let more = if unused.len() > 6 { format!(", and {} more", unused.len() - 6) } else { String::new() };
        let problem = format!(
            "{} of {} show a board of {} × {} inner corners ({}{more})",
            good.len(),
            good.len() + unused.len(),
            board.columns,
            board.rows,
            reasons.join("; ")
        );
        let remedy = format!("give at least {FEWEST} (better 10 to 30), and check --board");
        return Err(Error::input("photographs", problem, remedy));
    }
    progress.stage("fitting the camera", 0);
    let places = board.places();
    let vague = || Error::input("photographs", "do not tell the camera", "tilt the board in several directions");
    let homographies: Vec<_> =
        good.iter().map(|(_, c)| homography(&places, c)).collect::<Option<_>>().ok_or_else(vague)?;
    let camera = start::camera(&homographies, size).ok_or_else(vague)?;
    let observations: Vec<Observation> = good
        .iter()
        .map(|(_, c)| Some(Observation { pixels: c.clone(), pose: start::board_pose(&camera, &places, c)? }))
        .collect::<Option<_>>()
        .ok_or_else(vague)?;
    let found = fit(camera, &observations, &places, progress)?;
    let sigma: [f64; 9] = std::array::from_fn(|k| found.covariance[(k, k)].sqrt());
    let [fx, fy] = found.camera.focal_px;
    if !(sigma[0] < VAGUE * fx && sigma[1] < VAGUE * fy) {
        let problem = format!("tell focal lengths of {fx:.0} ± {:.0} and {fy:.0} ± {:.0} px only", sigma[0], sigma[1]);
        let remedy = "give more of them, with the board tilted by 20° to 45° in several directions";
        return Err(Error::input("photographs", problem, remedy));
    }
    let warnings = warnings(&found, &good, size);
    let used = good
        .into_iter()
        .zip(found.poses.iter().zip(found.pose_sigma.iter().zip(&found.each_px)))
        .map(|((path, corners), (pose, (sigma, rms)))| Photograph {
            path,
            corners,
            pose: *pose,
            pose_sigma: *sigma,
            rms_px: *rms,
        })
        .collect();
    let rms_px = found.rms_px;
    Ok(Calibrated {
        camera: found.camera,
        covariance: found.covariance,
        image_px: size,
        used,
        unused,
        rms_px,
        sigma,
        warnings,
    })
}

/// File name without its folder.
pub(super) fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

fn warnings(found: &Fit, good: &[(PathBuf, Vec<[f64; 2]>)], size: [usize; 2]) -> Vec<String> {
    let mut all = vec![];
    let median = median(found.each_px.clone()).unwrap_or(f64::INFINITY);
    for ((path, _), rms) in good.iter().zip(&found.each_px) {
        if *rms > ODD * median {
            all.push(format!("{} fits worse than the others: {rms:.2} px RMS, they {median:.2}", name(path)));
        }
    }
    let center = found.camera.center_px;
    let off = |p: [f64; 2]| (p[0] - center[0]).hypot(p[1] - center[1]);
    let [right, bottom] = size.map(|n| n as f64 - 1.0);
    let rim = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
    let farthest = rim.into_iter().map(off).fold(0.0, f64::max);
    let reached = good.iter().flat_map(|(_, c)| c.iter().map(|p| off(*p))).fold(0.0, f64::max);
    if reached < 0.75 * farthest {
        let part = 100.0 * reached / farthest;
        all.push(format!("corners reach {part:.0} % of the way to the picture's corners: beyond, the lens is a guess"));
    }
    if rim.into_iter().any(|p| found.camera.ray(p).is_none()) {
        all.push("the lens model folds back before the picture's corners: nothing can be measured there".into());
    }
    if good.len() < 8 {
        all.push(format!("only {} photographs: 10 to 30 make the camera surer", good.len()));
    }
    all
}
