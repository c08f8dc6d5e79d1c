//! Rays and their intersections with surfaces.

use crate::vector::V3;

/// A ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub from: V3,
    /// Unit vector.
    pub along: V3,
}

/// Intersection of a ray with a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// Distance.
    pub t: f64,
    pub point: V3,
    /// The geometric normal of the shape, for shadows.
    pub flat: V3,
    /// The frame of the surface: directions of u and v, and the normal towards the ray.
    pub frame: [V3; 3],
    pub uv: [f64; 2],
}

/// An intersection with the normal oriented towards the ray.
pub(crate) fn hit(ray: &Ray, t: f64, [u, v, n]: [V3; 3], uv: [f64; 2]) -> Hit {
    let n = if n.dot(&ray.along) > 0.0 { -n } else { n };
    Hit { t, point: ray.from + ray.along * t, flat: n, frame: [u, v, n], uv }
}
