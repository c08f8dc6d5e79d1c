//! Shapes and their intersections with rays.

pub(crate) mod mesh;
mod mesh_file;
pub(crate) mod ray;

use crate::scene;
use crate::vector::{V3, across, direction, number, place, turned};
use mesh::Mesh;
use nacre_base::{Error, Result};
use ray::{Hit, Ray, hit};
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Permitted sizes in a scene, in mm.
pub(crate) const SIZES: [f64; 2] = [1e-6, 1e7];

/// A prepared shape, with the index of its material.
pub(crate) struct Placed {
    pub form: Form,
    pub material: usize,
}

/// Geometry of a shape.
pub(crate) enum Form {
    /// A rectangle, or a disc within it.
    Flat {
        center: V3,
        frame: [V3; 3],
        half: [f64; 2],
        round: Option<[f64; 2]>,
    },
    Sphere {
        center: V3,
        radius: f64,
        frame: [V3; 3],
    },
    Cylinder {
        center: V3,
        frame: [V3; 3],
        radius: f64,
        half: f64,
        arc: [f64; 2],
    },
    Mesh(Box<Mesh>),
}

/// An axis and two perpendicular directions, rotated about z.
fn frame_about(axis: V3, first: V3, angle: f64) -> [V3; 3] {
    [first, axis.cross(&first), axis].map(|v| turned(v, angle))
}

impl Form {
    /// Prepares a described shape, rotated about the z axis by `angle` (rad); mesh paths are relative to the scene's
    /// folder.
    pub(crate) fn new(name: &str, shape: &scene::Shape, folder: &Path, angle: f64) -> Result<Self> {
        let key = |what: &str| format!("{name}.{what}");
        let middle = |center: &[f64; 3]| place(&key("center"), *center).map(|c| turned(c, angle));
        let length = |what: &str, value: f64| number(&key(what), value, SIZES);
        let facing = |normal: &[f64; 3], up: &[f64; 3]| -> Result<[V3; 3]> {
            let n = direction(&key("normal"), *normal)?;
            let v = across(&key("up"), *up, n)?;
            Ok([v.cross(&n), v, n].map(|d| turned(d, angle)))
        };
        match shape {
            scene::Shape::Plane { center, normal, up, size, .. } => {
                let half = [0.5 * length("size", size[0])?, 0.5 * length("size", size[1])?];
                Ok(Self::Flat { center: middle(center)?, frame: facing(normal, up)?, half, round: None })
            }
            scene::Shape::Disc { center, normal, up, inner, outer, .. } => {
                let outer = length("outer", *outer)?;
                let inner = number(&key("inner"), *inner, [0.0, outer])?;
                let frame = facing(normal, up)?;
                Ok(Self::Flat { center: middle(center)?, frame, half: [outer; 2], round: Some([inner, outer]) })
            }
            scene::Shape::Sphere { center, radius, axis, start, .. } => {
                let axis = direction(&key("axis"), *axis)?;
                let frame = frame_about(axis, across(&key("start"), *start, axis)?, angle);
                Ok(Self::Sphere { center: middle(center)?, radius: length("radius", *radius)?, frame })
            }
            scene::Shape::Cylinder { center, axis, start, radius, length: long, arc_deg, .. } => {
                let axis = direction(&key("axis"), *axis)?;
                let frame = frame_about(axis, across(&key("start"), *start, axis)?, angle);
                let span = arc_deg[1] - arc_deg[0];
                if !(span > 0.0 && span <= 360.0 && arc_deg[0].abs() <= 3600.0) {
                    let problem = format!("is {arc_deg:?}");
                    return Err(Error::input(key("arc_deg"), problem, "give two rising angles, at most 360 apart"));
                }
                Ok(Self::Cylinder {
                    center: middle(center)?,
                    frame,
                    radius: length("radius", *radius)?,
                    half: 0.5 * length("length", *long)?,
                    arc: arc_deg.map(f64::to_radians),
                })
            }
            scene::Shape::Mesh { file, position, rotation_deg, scale, .. } => {
                let at = place(&key("position"), *position)?;
                place(&key("rotation_deg"), *rotation_deg)?;
                let scale = number(&key("scale"), *scale, [1e-9, 1e9])?;
                let mut mesh = mesh_file::read(&folder.join(file))?;
                let [a, b, c] = rotation_deg.map(f64::to_radians);
                let turn = nalgebra::Rotation3::from_euler_angles(a, b, c);
                mesh.place(|v| turned(turn * v, angle), scale, turned(at, angle));
                Ok(Self::Mesh(Box::new(mesh.finished()?)))
            }
        }
    }

    /// The nearest intersection with a ray within a range of distances.
    pub(crate) fn meet(&self, ray: &Ray, [near, far]: [f64; 2]) -> Option<Hit> {
        match self {
            Self::Flat { center, frame, half, round } => flat(ray, [near, far], *center, frame, *half, *round),
            Self::Sphere { center, radius, frame } => {
                let o = ray.from - center;
                let roots = roots(1.0, o.dot(&ray.along), o.norm_squared() - radius * radius)?;
                let t = roots.into_iter().find(|t| *t > near && *t < far)?;
                let point = ray.from + ray.along * t;
                let n = (point - center) / *radius;
                let [x, y, z] = frame.map(|f| n.dot(&f));
                let u = (y.atan2(x) / TAU).rem_euclid(1.0);
                let v = 1.0 - z.clamp(-1.0, 1.0).acos() / PI;
                // Around the axis; at the poles along the start.
                let around = frame[2].cross(&n);
                let tangent = if around.norm() > 1e-9 { around.normalize() } else { frame[1] };
                Some(hit(ray, t, [tangent, n.cross(&tangent), n], [u, v]))
            }
            Self::Cylinder { center, frame, radius, half, arc } => {
                let o = ray.from - center;
                let [a, b] = [o, ray.along].map(|v| v - frame[2] * v.dot(&frame[2]));
                let square = b.norm_squared();
                if square < 1e-18 {
                    return None;
                }
                let roots = roots(square, a.dot(&b), a.norm_squared() - radius * radius)?;
                roots.into_iter().filter(|t| *t > near && *t < far).find_map(|t| {
                    let p = o + ray.along * t;
                    let [x, y, z] = frame.map(|f| p.dot(&f));
                    let turn = (y.atan2(x) - arc[0]).rem_euclid(TAU);
                    let span = arc[1] - arc[0];
                    if z.abs() > *half || turn > span {
                        return None;
                    }
                    let n = (p - frame[2] * z) / *radius;
                    let tangent = frame[2].cross(&n);
                    Some(hit(ray, t, [tangent, frame[2], n], [turn / span, 0.5 + 0.5 * z / half]))
                })
            }
            Self::Mesh(mesh) => mesh.meet(ray, [near, far]),
        }
    }
}

/// Roots of `a t² + 2 b t + c`, in increasing order.
fn roots(a: f64, b: f64, c: f64) -> Option<[f64; 2]> {
    let square = b * b - a * c;
    if square < 0.0 {
        return None;
    }
    let root = square.sqrt();
    // This form avoids cancellation.
    let q = -(b + root.copysign(b));
    let mut both = if q == 0.0 { [0.0, 0.0] } else { [q / a, c / q] };
    if both[0] > both[1] {
        both.swap(0, 1);
    }
    Some(both)
}

fn flat(
    ray: &Ray,
    [near, far]: [f64; 2],
    center: V3,
    frame: &[V3; 3],
    half: [f64; 2],
    round: Option<[f64; 2]>,
) -> Option<Hit> {
    let slope = ray.along.dot(&frame[2]);
    if slope.abs() < 1e-12 {
        return None;
    }
    let t = (center - ray.from).dot(&frame[2]) / slope;
    if !(t > near && t < far) {
        return None;
    }
    let p = ray.from + ray.along * t - center;
    let [x, y] = [p.dot(&frame[0]), p.dot(&frame[1])];
    let inside = match round {
        Some([inner, outer]) => (inner..=outer).contains(&x.hypot(y)),
        None => x.abs() <= half[0] && y.abs() <= half[1],
    };
    inside.then(|| hit(ray, t, *frame, [0.5 + 0.5 * x / half[0], 0.5 + 0.5 * y / half[1]]))
}
