//! Light of a panel behind its retarder, in a metal mirror.

use nacre_frames::LoadedFrames;
use nacre_optics::polarization::{Jones, JonesVector};
use nacre_optics::rcwa::ALUMINIUM;
use num_complex::Complex;

/// Points of the region along each axis at which the incidence is averaged.
const POINTS: usize = 5;

/// Reflections that the light takes to the camera, relative to normal incidence.
pub struct Mirror(Vec<Jones>);

impl Mirror {
    /// A mirror at normal incidence.
    pub fn normal() -> Self {
        Self(vec![Jones::diagonal(1.0.into(), 1.0.into())])
    }

    /// An aluminium mirror on the sample table, at the incidence over a region; `None` if the geometry is unknown.
    pub fn of(frames: &LoadedFrames, [left, top, width, height]: [usize; 4]) -> Option<Self> {
        let geometry = frames.set.geometry?;
        let pixel_mm = geometry.pixel_um? / 1000.0;
        let middle = [0.5 * frames.info.width as f64, 0.5 * frames.info.height as f64];
        // The sample lies midway between the camera and the panel, which is to the right of the camera.
        let nadir = geometry.camera_px.unwrap_or([middle[0] - 0.5 * geometry.baseline_mm / pixel_mm, middle[1]]);
        let at =
            |start: usize, length: usize, k: usize| start as f64 + length as f64 * (k as f64 + 0.5) / POINTS as f64;
        let point = |k: usize| {
            let (x, y) = (at(left, width, k % POINTS) - nadir[0], nadir[1] - at(top, height, k / POINTS));
            let across2 = (x * x + y * y) * pixel_mm * pixel_mm;
            reflection(across2 / (across2 + geometry.distance_mm.powi(2)), y.atan2(x))
        };
        Some(Self((0..POINTS * POINTS).map(point).collect()))
    }

    /// Mean (S1/S0, S2/S0) of light that leaves the panel as this field.
    pub fn reflected(&self, field: JonesVector) -> [f64; 2] {
        let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
        for element in &self.0 {
            let light = element.apply(field).stokes();
            (s0, s1, s2) = (s0 + light.s0, s1 + light.s1, s2 + light.s2);
        }
        [s1 / s0, s2 / s0]
    }
}

/// Fresnel reflection off aluminium at an angle of incidence with squared sine `sin2`, in a plane with this azimuth
/// (rad), relative to normal incidence. The sign of p makes it agree with s at the normal.
fn reflection(sin2: f64, plane: f64) -> Jones {
    let (cos, metal) = (Complex::from((1.0 - sin2).sqrt()), ALUMINIUM);
    let inside = (Complex::from(1.0) - Complex::from(sin2) / (metal * metal)).sqrt();
    let normal = (Complex::from(1.0) - metal) / (Complex::from(1.0) + metal);
    let s = (cos - metal * inside) / (cos + metal * inside);
    let p = (inside - metal * cos) / (inside + metal * cos);
    Jones::diagonal(p / normal, s / normal).turned(plane)
}
