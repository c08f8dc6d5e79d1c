//! Geometry of camera, sample, panel and light in mm: half vectors of pixels, and periods from half vectors.
//!
//! Sample coordinates: origin in the middle of the sample, x right and y up as seen by the camera, z out of the
//! surface. The surface is the plane z = 0. A camera that looks straight down from 500 mm has the pose
//! `R = diag(1, -1, -1)`, `t = (0, 0, 500)`. Panel coordinates: origin in the middle of the panel, x right and y up for
//! a viewer of its upright lit side, z out of the lit side.
//!
//! For a surface point p, the camera at c and the light at l, `ωo = (c - p)/|c - p|` and `ωi = (l - p)/|l - p|`. A
//! grating of orientation θ and period a sends its order n to the camera if the tangential part of `ωi + ωo` is
//! `n λ/a (cos θ, sin θ)`. This is the 2018 paper's Eq. 3 with the half vector in place of the direction towards the
//! highlight.

mod camera;
mod file;
mod pose;
#[cfg(test)]
mod tests;

pub use camera::Camera;
pub use file::{beside, load, parse, save, text};
pub use pose::Pose;

use nacre_base::{Error, Result, Version};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Positions of camera, sample, panel and light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<1>,
    /// Camera model.
    pub camera: Camera,
    /// Transform from sample to camera coordinates.
    pub sample: Pose,
    /// Panel, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel: Option<Panel>,
    /// Position of the light (a flash) in sample coordinates, in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_mm: Option<[f64; 3]>,
    /// Effective wavelength of the band of light source, filter and camera, in nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Width and height in pixels of the photographs to which this geometry applies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image_px: Option<[u32; 2]>,
    /// Whether lengths are known up to a common factor only, with an assumed distortion-free camera. Periods are
    /// relative then.
    #[serde(default)]
    pub relative: bool,
    /// Standard deviations.
    #[serde(default)]
    pub sigma: Uncertainty,
}

/// Flat display.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Panel {
    /// Transform from panel to sample coordinates.
    pub pose: Pose,
    /// Width and height of a pixel, in mm.
    pub pixel_mm: [f64; 2],
    /// Number of pixels per row and per column.
    pub size_px: [u32; 2],
}

/// Standard deviations; an absent value is unknown, not zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Uncertainty {
    /// Focal lengths, in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<[f64; 2]>,
    /// Principal point, in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_px: Option<[f64; 2]>,
    /// Distortion coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<[f64; 5]>,
    /// Rotation of the sample about the axes of the camera, in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_turn_deg: Option<[f64; 3]>,
    /// Position of the sample in camera coordinates, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_mm: Option<[f64; 3]>,
    /// Rotation of the panel about the axes of the sample, in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub panel_turn_deg: Option<[f64; 3]>,
    /// Centre of the panel in sample coordinates, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub panel_mm: Option<[f64; 3]>,
    /// Position of the light in sample coordinates, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_mm: Option<[f64; 3]>,
    /// Wavelength, in nm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
}

impl Geometry {
    /// Geometry of a camera over a sample; everything else is unknown.
    pub fn new(camera: Camera, sample: Pose) -> Self {
        Self {
            version: Version,
            camera,
            sample,
            panel: None,
            light_mm: None,
            wavelength_nm: None,
            image_px: None,
            relative: false,
            sigma: Uncertainty::default(),
        }
    }

    /// Intersection of a pixel's ray with the surface (z = 0), in sample coordinates; `None` if the ray misses the
    /// plane.
    pub fn point(&self, pixel: [f64; 2]) -> Option<[f64; 3]> {
        let back = self.sample.inverse();
        let (from, along) = (back.translation_mm, back.turn(self.camera.ray(pixel)?));
        let steps = -from[2] / along[2];
        (steps > 0.0 && steps.is_finite()).then(|| [from[0] + steps * along[0], from[1] + steps * along[1], 0.0])
    }

    /// Pixel of a point in sample coordinates; `None` if the camera cannot see it.
    pub fn pixel(&self, place: [f64; 3]) -> Option<[f64; 2]> {
        self.camera.project(self.sample.apply(place))
    }

    /// Position of the camera in sample coordinates, in mm.
    pub fn viewer(&self) -> [f64; 3] {
        self.sample.inverse().translation_mm
    }

    /// Tangential part of `ωi + ωo` at a surface point for a light position, both in sample coordinates. A grating
    /// whose order n reaches the camera has `n λ/a` along its grating vector.
    pub fn half(&self, place: [f64; 3], light: [f64; 3]) -> [f64; 2] {
        let towards = |far: [f64; 3]| {
            let d = [0, 1, 2].map(|k| far[k] - place[k]);
            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            [d[0] / length, d[1] / length]
        };
        let (o, i) = (towards(self.viewer()), towards(light));
        [o[0] + i[0], o[1] + i[1]]
    }

    /// Checks lengths, rotations, camera and panel, and that panel and light are above the surface.
    ///
    /// # Errors
    /// `Input`, naming the value.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
        self.camera.check()?;
        self.sample.check("sample")?;
        // A minimum of 0.01 mm keeps divisions away from zero.
        let above = |what: &str, place: [f64; 3]| match place[2] {
            z if z >= 0.01 => Ok(()),
            z => bad(what, format!("is {z:.3} mm above the sample"), "sample coordinates have z out of the surface"),
        };
        above("camera", self.viewer())?;
        if let Some(panel) = &self.panel {
            panel.check()?;
            above("panel", panel.pose.translation_mm)?;
        }
        if let Some(light) = self.light_mm {
            if !light.iter().all(|x| x.abs() <= 1e6) {
                return bad("light_mm", format!("is {light:?}"), "give at most 1000000 mm");
            }
            above("light_mm", light)?;
        }
        match self.wavelength_nm {
            Some(nm) if !(200.0..=2000.0).contains(&nm) => {
                return bad("wavelength_nm", format!("is {nm}"), "give 200 to 2000");
            }
            _ => {}
        }
        match self.image_px {
            Some(size) if !size.iter().all(|n| (1..=65535).contains(n)) => {
                bad("image_px", format!("is {size:?}"), "give the width and the height of the photographs")
            }
            _ => self.sigma.check(),
        }
    }
}

impl Panel {
    /// Position of a panel pixel in sample coordinates, in mm. Pixels are (column, row), with centres at integers and
    /// row 0 on top.
    pub fn at(&self, pixel: [f64; 2]) -> [f64; 3] {
        let [x, y] = [0, 1].map(|k| (pixel[k] - 0.5 * (f64::from(self.size_px[k]) - 1.0)) * self.pixel_mm[k]);
        self.pose.apply([x, -y, 0.0])
    }

    /// Checks pixel sizes, resolution and pose.
    ///
    /// # Errors
    /// `Input`, naming the value.
    pub fn check(&self) -> Result<()> {
        self.pose.check("panel.pose")?;
        if !self.pixel_mm.iter().all(|p| (1e-4..=100.0).contains(p)) {
            let problem = format!("is {:?}", self.pixel_mm);
            return Err(Error::input("panel.pixel_mm", problem, "give 0.0001 to 100 mm twice"));
        }
        if !self.size_px.iter().all(|n| (1..=65535).contains(n)) {
            return Err(Error::input("panel.size_px", format!("is {:?}", self.size_px), "give 1 to 65535 twice"));
        }
        Ok(())
    }
}

impl Uncertainty {
    fn check(&self) -> Result<()> {
        let all: [(&str, Option<&[f64]>); 9] = [
            ("focal_px", self.focal_px.as_ref().map(|s| s.as_slice())),
            ("center_px", self.center_px.as_ref().map(|s| s.as_slice())),
            ("distortion", self.distortion.as_ref().map(|s| s.as_slice())),
            ("sample_turn_deg", self.sample_turn_deg.as_ref().map(|s| s.as_slice())),
            ("sample_mm", self.sample_mm.as_ref().map(|s| s.as_slice())),
            ("panel_turn_deg", self.panel_turn_deg.as_ref().map(|s| s.as_slice())),
            ("panel_mm", self.panel_mm.as_ref().map(|s| s.as_slice())),
            ("light_mm", self.light_mm.as_ref().map(|s| s.as_slice())),
            ("wavelength_nm", self.wavelength_nm.as_ref().map(std::slice::from_ref)),
        ];
        for (name, values) in all {
            if let Some(value) = values.into_iter().flatten().find(|v| !(0.0..=1e6).contains(*v)) {
                return Err(Error::input(format!("sigma.{name}"), format!("is {value}"), "give 0 to 1000000"));
            }
        }
        Ok(())
    }
}
