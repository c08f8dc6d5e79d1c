//! Rays and where they meet surfaces.

use crate::vector::V3;

/// A ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub from: V3,
    /// Of length 1.
    pub along: V3,
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// Distance.
    pub t: f64,
    pub point: V3,
    /// The normal of the shape, for shadows.
    pub flat: V3,
    /// The frame of the surface: directions of u and v, and the normal on the side of the ray.
    pub frame: [V3; 3],
    pub uv: [f64; 2],
}

/// A hit whose normal is on the side of the ray.
pub(crate) fn hit(ray: &Ray, t: f64, [u, v, n]: [V3; 3], uv: [f64; 2]) -> Hit {
    let n = if n.dot(&ray.along) > 0.0 { -n } else { n };
    Hit { t, point: ray.from + ray.along * t, flat: n, frame: [u, v, n], uv }
}
