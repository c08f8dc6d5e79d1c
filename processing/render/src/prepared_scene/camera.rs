//! The camera and its rays.

use crate::scene::{self, REMEDY};
use crate::shape::ray::Ray;
use crate::vector::{V3, across, number, place, turned};
use nacre_base::{Error, Result};
use std::f64::consts::TAU;

/// Maximum number of pixels of a picture.
const MOST_PIXELS: usize = 64 << 20;

/// The camera.
pub(crate) struct Camera {
    pub at: V3,
    /// Right, up and forward.
    pub frame: [V3; 3],
    pub size: [usize; 2],
    /// Half the height of the picture at distance 1.
    pub half: f64,
    pub lens: f64,
    focus: f64,
}

impl Camera {
    pub(super) fn new(of: &scene::Camera, angle: f64) -> Result<Self> {
        let [width, height] = [of.width, of.height];
        if width == 0 || height == 0 || width.max(height) > 65_535 || width * height > MOST_PIXELS {
            let problem = format!("has {width} × {height} pixels");
            return Err(Error::input("camera", problem, "give 1 to 64 Mpixel, at most 65535 along a side"));
        }
        let at = place("camera.position", of.position)?;
        let towards = place("camera.target", of.target)? - at;
        if towards.norm() < 1e-9 {
            return Err(Error::input("camera.target", "is where the camera is", REMEDY));
        }
        let forward = towards.normalize();
        let up = across("camera.up", of.up, forward)?;
        let frame = [forward.cross(&up), up, forward].map(|v| turned(v, angle));
        let fov = number("camera.fov_deg", of.fov_deg, [1e-3, 170.0])?.to_radians();
        let lens = 0.5 * number("camera.aperture_mm", of.aperture_mm, [0.0, 1e6])?;
        let focus = of.focus_mm.map(|f| number("camera.focus_mm", f, [1e-6, 1e9])).transpose()?;
        let focus = focus.unwrap_or(towards.norm());
        Ok(Self { at: turned(at, angle), frame, size: [width, height], half: (0.5 * fov).tan(), lens, focus })
    }

    /// The ray through a position of the picture, in pixels from its upper left corner, and through a point of the
    /// lens.
    pub(super) fn ray(&self, [x, y]: [f64; 2], u: [f64; 2]) -> Ray {
        let [w, h] = self.size.map(|n| n as f64);
        let right = (2.0 * x - w) / h * self.half;
        let up = (1.0 - 2.0 * y / h) * self.half;
        let along = self.frame[2] + self.frame[0] * right + self.frame[1] * up;
        if self.lens == 0.0 {
            return Ray { from: self.at, along: along.normalize() };
        }
        let (radius, phi) = (self.lens * u[0].sqrt(), TAU * u[1]);
        let from = self.at + self.frame[0] * (radius * phi.cos()) + self.frame[1] * (radius * phi.sin());
        Ray { from, along: (self.at + along * self.focus - from).normalize() }
    }
}
