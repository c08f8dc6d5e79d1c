//! Pose of the sample, from a board lying on it or from its four corners.

use super::corners::Board;
use super::fit::{CAMERA, pose_only};
use super::start::board_pose;
use nacre_base::{Error, Result};
use nacre_optics::geometry::{Camera, Geometry, Pose};
use nalgebra::SMatrix;

/// Covariance of fx, fy, cx, cy, k1, k2, p1, p2, k3.
pub type CameraCovariance = SMatrix<f64, CAMERA, CAMERA>;

/// Lower bound of a board corner's error in px.
pub(super) const CORNER_PX: f64 = 0.05;

/// A pose with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// From sample to camera coordinates.
    pub pose: Pose,
    /// Standard deviations: rotation about the camera's axes in rad, translation in mm.
    pub sigma: [f64; 6],
    /// Root mean square reprojection error in px.
    pub rms_px: f64,
}

/// Covariance of a camera with known standard deviations only. The distortion coefficients are omitted: they are
/// strongly correlated, so that independent errors would be far too large.
pub fn camera_covariance(geometry: &Geometry) -> CameraCovariance {
    let mut all = CameraCovariance::zeros();
    let (focal, center) = (geometry.sigma.focal_px.unwrap_or_default(), geometry.sigma.center_px.unwrap_or_default());
    for k in 0..2 {
        all[(k, k)] = focal[k] * focal[k];
        all[(2 + k, 2 + k)] = center[k] * center[k];
    }
    all
}

/// Pose of a sample below a board of thickness `thickness_mm`. The origin is the board's centre; x is the board axis
/// closest to the right of the image.
///
/// # Errors
/// `Input` if the corners are inconsistent with a board.
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

/// Pose of a sample from its corners: upper left, upper right, lower right, lower left. `sigma_px` is the standard
/// deviation of detected or picked corners.
///
/// # Errors
/// `Input` for corners in another order, and for invalid sizes.
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

/// True if the side towards +z is visible.
fn facing(pose: &Pose) -> bool {
    pose.inverse().translation_mm[2] > 0.0
}

/// Rotates by multiples of 90° about the normal until x is closest to the right of the image.
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
