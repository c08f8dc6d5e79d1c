//! Three-dimensional vectors.

use crate::scene::REMEDY;
use nacre_base::{Error, Result};
use nalgebra::Vector3;

/// A position or a direction.
pub(super) type V3 = Vector3<f64>;

/// Largest coordinate of a scene, in mm.
const MOST: f64 = 1e7;

/// Checks a position of a scene.
///
/// # Errors
/// `Input` for invalid coordinates.
pub(super) fn place(subject: &str, at: [f64; 3]) -> Result<V3> {
    if at.iter().all(|c| c.abs() <= MOST) {
        return Ok(at.into());
    }
    Err(Error::input(subject, format!("is {at:?}"), format!("give three coordinates of at most {MOST} mm")))
}

/// Normalises a direction of a scene.
///
/// # Errors
/// `Input` for a zero vector.
pub(super) fn direction(subject: &str, of: [f64; 3]) -> Result<V3> {
    let v = place(subject, of)?;
    if v.norm() > 1e-9 {
        return Ok(v.normalize());
    }
    Err(Error::input(subject, format!("is {of:?}, which points nowhere"), REMEDY))
}

/// The unit vector perpendicular to `along` that is closest to `wanted`.
///
/// # Errors
/// `Input` if both are parallel.
pub(super) fn across(subject: &str, wanted: [f64; 3], along: V3) -> Result<V3> {
    let v = direction(subject, wanted)?;
    let rest = v - along * v.dot(&along);
    if rest.norm() > 1e-6 {
        return Ok(rest.normalize());
    }
    Err(Error::input(subject, format!("is {wanted:?}, along what it must be across of"), REMEDY))
}

/// Checks that a number of a scene lies within limits.
///
/// # Errors
/// `Input` otherwise.
pub(super) fn number(subject: &str, value: f64, [low, high]: [f64; 2]) -> Result<f64> {
    if (low..=high).contains(&value) {
        return Ok(value);
    }
    Err(Error::input(subject, format!("is {value}"), format!("give a number from {low} to {high}")))
}

/// Rotates about the z axis by an angle in rad, anticlockwise.
pub(super) fn turned(v: V3, angle: f64) -> V3 {
    if angle == 0.0 {
        return v;
    }
    let (sin, cos) = angle.sin_cos();
    V3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
}
