//! Where the sample is: from a board that lies on it, or from its four corners.

use super::corners::Board;
use super::fit::{CAMERA, pose_only};
use super::start::board_pose;
use nacre_base::{Error, Result};
use nacre_optics::geometry::{Camera, Geometry, Pose};
use nalgebra::SMatrix;

/// Covariance of a camera's numbers: fx, fy, cx, cy, k1, k2, p1, p2, k3.
pub type CameraCovariance = SMatrix<f64, CAMERA, CAMERA>;

/// What the corner of a board is off by at the least, in px.
pub(super) const CORNER_PX: f64 = 0.05;

/// A pose and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// To camera coordinates.
    pub pose: Pose,
    /// Standard deviations: turn about the camera's axes in rad, shift in mm.
    pub sigma: [f64; 6],
    /// Root mean square distance from corner to model, in px.
    pub rms_px: f64,
}

/// Covariance of a camera that came with standard deviations only. The lens's numbers trade against each other, so that taken alone
/// they would say far too much: they are left out.
pub fn camera_covariance(geometry: &Geometry) -> CameraCovariance {
    let mut all = CameraCovariance::zeros();
    let (focal, center) = (geometry.sigma.focal_px.unwrap_or_default(), geometry.sigma.center_px.unwrap_or_default());
    for k in 0..2 {
        all[(k, k)] = focal[k] * focal[k];
        all[(2 + k, 2 + k)] = center[k] * center[k];
    }
    all
}

/// Pose of a sample on which a board lies, `thickness_mm` high: origin in the board's middle, x along that of its axes that is nearest to
/// image right.
///
/// # Errors
/// `Input` when the corners are no view of a board.
pub fn from_board(
    camera: &Camera,
    covariance: &CameraCovariance,
    board: &Board,
    corners: &[[f64; 2]],
    thickness_mm: f64,
) -> Result<Placed> {
    if !(0.0..=1000.0).contains(&thickness_mm) {
        return Err(Error::input("board thickness", format!("is {thickness_mm}"), "give 0 to 1000 mm"));
    }
    let places = board.places();
    let bad = || Error::input("board", "cannot be where its corners are seen", "check the photograph and the camera");
    let start = board_pose(camera, &places, corners).ok_or_else(bad)?;
    let (pose, all, rms_px) = pose_only(camera, start, corners, &places, CORNER_PX, covariance).ok_or_else(bad)?;
    let under = Pose { translation_mm: [0.0, 0.0, -thickness_mm], ..Pose::IDENTITY };
    let placed = Placed { pose: under.then(&upright(&pose)), sigma: sigmas(&all), rms_px };
    facing(&placed.pose).then_some(placed).ok_or_else(bad)
}

/// Pose of a sample from where its corners are seen: upper left, upper right, lower right, lower left. `sigma_px`: how far they may be
/// off, as they were found or clicked.
///
/// # Errors
/// `Input` for corners in another order, and sizes that make no sense.
pub fn from_corners(
    camera: &Camera,
    covariance: &CameraCovariance,
    corners: &[[f64; 2]; 4],
    size_mm: [f64; 2],
    sigma_px: f64,
) -> Result<Placed> {
    if !size_mm.iter().all(|s| (0.01..=1e5).contains(s)) {
        return Err(Error::input("sample size", format!("is {size_mm:?}"), "give width and height, 0.01 to 100000 mm"));
    }
    if !(1e-3..=1e3).contains(&sigma_px) {
        return Err(Error::input("corner sigma", format!("is {sigma_px}"), "give 0.001 to 1000 px"));
    }
    let order = || {
        let remedy = "give X,Y of the upper left, upper right, lower right and lower left corner, in pixels";
        Error::input("sample corners", "do not go clockwise around a sample", remedy)
    };
    let clockwise = (0..4).all(|k| {
        let [a, b, c] = [0, 1, 2].map(|j| corners[(k + j) % 4]);
        (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) > 1.0
    });
    if !clockwise {
        return Err(order());
    }
    let [w, h] = size_mm.map(|s| 0.5 * s);
    let places = [[-w, h], [w, h], [w, -h], [-w, -h]];
    let start = board_pose(camera, &places, corners).ok_or_else(order)?;
    let (pose, all, rms_px) = pose_only(camera, start, corners, &places, sigma_px, covariance).ok_or_else(order)?;
    facing(&pose).then(|| Placed { pose, sigma: sigmas(&all), rms_px }).ok_or_else(order)
}

/// Whether the side that z points out of is the one that is seen.
fn facing(pose: &Pose) -> bool {
    pose.inverse().translation_mm[2] > 0.0
}

/// Turned by quarters about its normal until x is nearest to image right.
fn upright(pose: &Pose) -> Pose {
    let turned = |quarters: u32| {
        let angle = f64::from(quarters) * std::f64::consts::FRAC_PI_2;
        Pose::from_rotation_vector([0.0, 0.0, angle], [0.0; 3]).then(pose)
    };
    let right = |p: &Pose| p.rotation[0][0];
    (0..4).map(turned).max_by(|a, b| right(a).total_cmp(&right(b))).unwrap_or(*pose)
}

pub(super) fn sigmas(covariance: &nalgebra::Matrix6<f64>) -> [f64; 6] {
    std::array::from_fn(|k| covariance[(k, k)].max(0.0).sqrt())
}
