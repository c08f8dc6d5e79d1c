//! The full hemispherical integral without approximations: the reference for every faster method.

use super::{Environment, Table};
use rayon::prelude::*;

/// Orthonormal axes of a surface: right, up and normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// To the right in the table.
    pub tangent: [f64; 3],
    /// Upwards in the table.
    pub bitangent: [f64; 3],
    /// Surface normal.
    pub normal: [f64; 3],
}

/// Scalar product.
#[inline]
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Frame {
    /// A sample in the x-y plane, seen from +z.
    pub const FLAT: Self = Self { tangent: [1.0, 0.0, 0.0], bitangent: [0.0, 1.0, 0.0], normal: [0.0, 0.0, 1.0] };

    /// The surface that faces a direction on a sphere. The table's direction at the angle `meridian` (radians,
    /// anticlockwise from its right) lies along the meridians, towards +z.
    pub fn facing(direction: [f64; 3], meridian: f64) -> Self {
        let [x, y, z] = direction;
        let across = x.hypot(y);
        let (cos, sin) = if across > 0.0 { (x / across, y / across) } else { (1.0, 0.0) };
        let (north, east) = ([-z * cos, -z * sin, across], [-sin, cos, 0.0]);
        let (s, c) = meridian.sin_cos();
        let sum = |a: f64, b: f64| std::array::from_fn(|k| a * north[k] + b * east[k]);
        Self { tangent: sum(c, s), bitangent: sum(s, -c), normal: direction }
    }

    /// Transforms a direction from the world to this frame.
    #[inline]
    pub fn local(&self, direction: [f64; 3]) -> [f64; 3] {
        [dot(direction, self.tangent), dot(direction, self.bitangent), dot(direction, self.normal)]
    }

    /// Transforms a direction from this frame to the world.
    #[inline]
    pub fn world(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| x * self.tangent[k] + y * self.bitangent[k] + z * self.normal[k])
    }
}

/// Factor of `f_r cos θi` besides the table, `(1 + ωi·ωo)² / cos θo`, for directions in the surface's frame; 0 below
/// the surface.
#[inline]
pub fn geometry(light: [f64; 3], view: [f64; 3]) -> f64 {
    if light[2] <= 0.0 || view[2] <= 0.0 { 0.0 } else { (1.0 + dot(light, view)).powi(2) / view[2] }
}

/// An environment as point sources.
pub struct Lights {
    /// Direction, and radiance times solid angle.
    lights: Vec<([f64; 3], [f64; 3])>,
}

impl Lights {
    /// `fineness` point sources along each side of a pixel, of equal solid angle within a row.
    pub fn new(environment: &Environment, fineness: usize) -> Self {
        let fineness = fineness.max(1);
        let (width, height) = (environment.width * fineness, environment.height * fineness);
        let fine = fineness as f64;
        let solid = std::f64::consts::TAU / width as f64;
        let edge = |y: usize| (std::f64::consts::PI * y as f64 / height as f64).cos();
        let row = |y: usize| {
            let solid = solid * (edge(y) - edge(y + 1));
            // The mean height of the ring is that of its centroid, so that a constant sky illuminates a plane exactly.
            let polar = (0.5 * (edge(y) + edge(y + 1))).acos() / std::f64::consts::PI * environment.height as f64;
            (0..width).into_par_iter().map(move |x| {
                let direction = environment.direction((x as f64 + 0.5) / fine, polar);
                (direction, environment.radiance(direction).map(|v| f64::from(v) * solid))
            })
        };
        let lights = (0..height).into_par_iter().flat_map(row).filter(|(_, power)| *power != [0.0; 3]).collect();
        Self { lights }
    }

    /// Radiance reflected towards `view` (world), for `f_r cos θi` as a function of the directions of light and view in
    /// the surface's frame.
    pub fn reflected(&self, frame: &Frame, view: [f64; 3], brdf: impl Fn([f64; 3], [f64; 3]) -> [f64; 3]) -> [f64; 3] {
        let view = frame.local(view);
        let mut sum = [0.0; 3];
        if view[2] <= 0.0 {
            return sum;
        }
        for (direction, power) in &self.lights {
            let light = frame.local(*direction);
            if light[2] > 0.0 {
                let f = brdf(light, view);
                (0..3).for_each(|c| sum[c] += f[c] * power[c]);
            }
        }
        sum
    }

    /// Radiance reflected towards `view` by a lookup table.
    pub fn by_table(&self, table: &Table, frame: &Frame, view: [f64; 3]) -> [f64; 3] {
        self.reflected(frame, view, |light, view| {
            let h = [light[0] + view[0], light[1] + view[1]];
            if h.iter().any(|v| v.abs() > table.extent) {
                return [0.0; 3];
            }
            let factor = geometry(light, view);
            table.at(h).map(|v| f64::from(v) * factor)
        })
    }
}

/// Root mean square difference over all channels, relative to the mean of the reference.
pub fn normalized_error(found: &[[f32; 3]], reference: &[[f32; 3]]) -> f64 {
    let (mut square, mut sum) = (0.0, 0.0);
    for (f, r) in found.as_flattened().iter().zip(reference.as_flattened()) {
        square += (f64::from(*f) - f64::from(*r)).powi(2);
        sum += f64::from(*r);
    }
    let n = reference.len().max(1) as f64 * 3.0;
    (square / n).sqrt() / (sum / n).abs().max(f64::MIN_POSITIVE)
}
