//! Pose of the panel: measured by hand, or from a displayed board, seen in a mirror on the sample or directly.

use super::corners::{Board, View};
use super::fit::{nudged, pose_only};
use super::sample::{CORNER_PX, CameraCovariance, Placed};
use super::start::board_pose;
use nacre_base::{Error, Result};
use nacre_optics::geometry::{Camera, Panel, Pose};
use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};

/// Pose of a panel, with standard deviations of rotation (degrees) and centre (mm) along the sample's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPanel {
    /// Panel.
    pub panel: Panel,
    /// Standard deviations of the rotation in degrees.
    pub turn_deg: [f64; 3],
    /// Standard deviations of the centre in mm.
    pub mm: [f64; 3],
    /// Root mean square reprojection error in px; `None` for manual measurements.
    pub rms_px: Option<f64>,
}

/// Pixels of a panel: size in mm, and number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixels {
    /// Width and height of a pixel in mm.
    pub pixel_mm: [f64; 2],
    /// Number of pixels per row and column.
    pub size_px: [u32; 2],
}

/// Panel with its centre at `at_mm` in sample coordinates. Without rotation, its lit side faces straight down and its
/// top points towards y. `turn_deg` rotates it about x, then y, then z of the sample.
pub fn by_hand(
    pixels: Pixels,
    at_mm: [f64; 3],
    turn_deg: [f64; 3],
    sigma_mm: f64,
    sigma_deg: f64,
) -> Result<PlacedPanel> {
    for (what, value, most) in [("panel sigma mm", sigma_mm, 1e4), ("panel sigma deg", sigma_deg, 90.0)] {
        if !(0.0..=most).contains(&value) {
            return Err(Error::input(what, format!("is {value}"), format!("give 0 to {most}")));
        }
    }
    if !turn_deg.iter().all(|t| t.abs() <= 360.0) {
        return Err(Error::input("panel turn", format!("is {turn_deg:?}"), "give three angles within ±360°"));
    }
    let turn = |axis: Vector3<f64>, k: usize| Rotation3::from_scaled_axis(axis * turn_deg[k].to_radians());
    let down = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, -1.0));
    let all = turn(Vector3::z(), 2) * turn(Vector3::y(), 1) * turn(Vector3::x(), 0);
    let pose = Pose::of(all.matrix() * down, at_mm);
    let panel = Panel { pose, pixel_mm: pixels.pixel_mm, size_px: pixels.size_px };
    panel.check()?;
    Ok(PlacedPanel { panel, turn_deg: [sigma_deg; 3], mm: [sigma_mm; 3], rms_px: None })
}

/// Photograph of a board on the panel.
pub struct Shown<'a> {
    /// Corners of the board, as returned by [`find`](super::find) for the same view.
    pub corners: &'a [[f64; 2]],
    /// Board in the centre of the panel; squares in panel pixels, not mm.
    pub board: Board,
    /// Direct or mirrored view.
    pub view: View,
    /// Height of the mirror above the sample, in mm.
    pub mirror_mm: f64,
}

/// Panel pose from a photograph of a displayed board, with known camera and sample.
///
/// The camera determines the pose of the panel's mirror image; reflection at the mirror yields the panel itself. An
/// error of the mirror's tilt counts twice.
///
/// # Errors
/// `Input` if the corners are inconsistent with such a panel.
pub fn from_photograph(
    camera: &Camera,
    covariance: &CameraCovariance,
    sample: &Placed,
    pixels: Pixels,
    shown: &Shown<'_>,
) -> Result<PlacedPanel> {
    let bad = |problem: &str| Error::input("panel", problem, "check the board, its square and which view it is");
    let unit = Board { square_mm: 1.0, ..shown.board };
    let scale = pixels.pixel_mm.map(|p| p * shown.board.square_mm);
    let places: Vec<[f64; 2]> = unit.places().iter().map(|p| [p[0] * scale[0], p[1] * scale[1]]).collect();
    let start = board_pose(camera, &places, shown.corners).ok_or_else(|| bad("cannot be where its board is seen"))?;
    let (seen, all, rms_px) = pose_only(camera, start, shown.corners, &places, CORNER_PX, covariance)
        .ok_or_else(|| bad("cannot be where its board is seen"))?;
    let place = |sample: &Pose, seen: &Pose| unmirrored(&seen.then(&sample.inverse()), shown);
    let pose = place(&sample.pose, &seen);
    let panel = Panel { pose, pixel_mm: pixels.pixel_mm, size_px: pixels.size_px };
    panel.check()?;
    let viewer = sample.pose.inverse().translation_mm;
    let eye = match shown.view {
        View::Direct => viewer,
        View::Mirrored => [viewer[0], viewer[1], 2.0 * shown.mirror_mm - viewer[2]],
    };
    if pose.inverse().apply(eye)[2] <= 0.0 {
        return Err(bad("would be seen from behind"));
    }
    if shown.view == View::Mirrored && pose.translation_mm[2] <= shown.mirror_mm {
        return Err(bad("would lie below the mirror"));
    }
    // Propagates each component of the two poses' uncertainty separately.
    let (mut turn, mut shift) = ([0.0; 3], [0.0; 3]);
    let mut add = |moved: Pose| {
        let by = Pose::of(moved.matrix() * pose.matrix().transpose(), [0.0; 3]).rotation_vector();
        for k in 0..3 {
            turn[k] += by[k].to_degrees().powi(2);
            shift[k] += (moved.translation_mm[k] - pose.translation_mm[k]).powi(2);
        }
    };
    let eigen = all.symmetric_eigen();
    for k in 0..6 {
        let own = eigen.eigenvectors.column(k) * eigen.eigenvalues[k].max(0.0).sqrt();
        add(place(&sample.pose, &nudged(&seen, &own)));
        let mut other = Vector6::zeros();
        other[k] = sample.sigma[k];
        add(place(&nudged(&sample.pose, &other), &seen));
    }
    Ok(PlacedPanel { panel, turn_deg: turn.map(f64::sqrt), mm: shift.map(f64::sqrt), rms_px: Some(rms_px) })
}

/// Pose of the panel in sample coordinates, from that of its image.
fn unmirrored(seen: &Pose, shown: &Shown<'_>) -> Pose {
    if shown.view == View::Direct {
        return *seen;
    }
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    let matrix = seen.matrix();
    let (x, y) = (mirror * matrix.column(0), mirror * matrix.column(1));
    let t = seen.translation_mm;
    Pose::of(Matrix3::from_columns(&[x, y, x.cross(&y)]), [t[0], t[1], 2.0 * shown.mirror_mm - t[2]])
}
