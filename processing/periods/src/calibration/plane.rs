//! Poses of planes, from homographies.

use nacre_optics::geometry::{Camera, Pose};
use nalgebra::Matrix3;

/// Pose of the plane z = 0 in front of a camera, from its homography in units of the focal length, without distortion.
pub(super) fn pose(h: &Matrix3<f64>) -> Option<Pose> {
    let (a, b) = (h.column(0), h.column(1));
    let scale = 1.0 / (a.norm() * b.norm()).sqrt();
    // The sign places the plane in front of the camera.
    let scale = if h[(2, 2)] < 0.0 { -scale } else { scale };
    let (a, b, t) = (a * scale, b * scale, h.column(2) * scale);
    let rough = Matrix3::from_columns(&[a, b, a.cross(&b)]);
    let svd = rough.svd(true, true);
    let turn = svd.u? * svd.v_t?;
    (scale.is_finite() && turn.determinant() > 0.0).then(|| Pose::of(turn, t.into()))
}

/// Directions of pixels in units of the focal length, without distortion; `None` where the distortion model has no
/// inverse.
pub(super) fn straightened(camera: &Camera, pixels: &[[f64; 2]]) -> Option<Vec<[f64; 2]>> {
    pixels.iter().map(|p| camera.ray(*p).map(|r| [r[0] / r[2], r[1] / r[2]])).collect()
}
