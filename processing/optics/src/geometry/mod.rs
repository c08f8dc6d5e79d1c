//! Where camera, sample, panel and light are, in mm: what turns pixels into half vectors, and half vectors into periods.
//!
//! Sample coordinates: origin in the middle of the sample, x right and y up as the camera sees it, z out of the surface, which is the
//! plane z = 0. A camera that looks straight down from 500 mm has the pose `R = diag(1, -1, -1)`, `t = (0, 0, 500)`. Panel
//! coordinates: origin in the middle of the panel, x right and y up as one sees its lit side upright, z out of the lit side.
//!
//! For a place p, the camera at c and the light at l, `ωo = (c - p)/|c - p|`, `ωi = (l - p)/|l - p|`; a grating of orientation θ and
//! period a lights up in its order n where the tangent part of `ωi + ωo` is `n λ/a (cos θ, sin θ)` (2018 paper, Eq. 3, with the
//! half vector in place of the direction towards the highlight).

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

/// Where everything is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<1>,
    /// The camera.
    pub camera: Camera,
    /// From sample to camera coordinates.
    pub sample: Pose,
    /// The panel, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel: Option<Panel>,
    /// The light (a flash), in sample coordinates, in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_mm: Option<[f64; 3]>,
    /// Wavelength that the band of light, filter and camera together stands for, in nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Width and height of the photographs that this holds for, in pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image_px: Option<[u32; 2]>,
    /// Whether lengths are known only up to a common factor and a camera without a lens was taken for granted: periods that follow are
    /// relative.
    #[serde(default)]
    pub relative: bool,
    /// How far all this may be off.
    #[serde(default)]
    pub sigma: Uncertainty,
}

/// A flat display.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Panel {
    /// From panel to sample coordinates.
    pub pose: Pose,
    /// Width and height of a pixel, in mm.
    pub pixel_mm: [f64; 2],
    /// Pixels per row and per column.
    pub size_px: [u32; 2],
}

/// Standard deviations; what is none is not known (it is not zero).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Uncertainty {
    /// Of the focal lengths, in px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<[f64; 2]>,
    /// Of the place of the optical axis, in px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_px: Option<[f64; 2]>,
    /// Of the lens's coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<[f64; 5]>,
    /// Of the sample's turn about the axes of the camera, in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_turn_deg: Option<[f64; 3]>,
    /// Of the sample's place in camera coordinates, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_mm: Option<[f64; 3]>,
    /// Of the panel's turn about the axes of the sample, in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub panel_turn_deg: Option<[f64; 3]>,
    /// Of the panel's middle in sample coordinates, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub panel_mm: Option<[f64; 3]>,
    /// Of the light's place in sample coordinates, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_mm: Option<[f64; 3]>,
    /// Of the wavelength, in nm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
}

impl Geometry {
    /// A camera over a sample, and nothing else known.
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

    /// Place on the sample, in sample coordinates (z = 0), that a pixel shows; none when it looks past the sample's plane.
    pub fn point(&self, pixel: [f64; 2]) -> Option<[f64; 3]> {
        let back = self.sample.inverse();
        let (from, along) = (back.translation_mm, back.turn(self.camera.ray(pixel)?));
        let steps = -from[2] / along[2];
        (steps > 0.0 && steps.is_finite()).then(|| [from[0] + steps * along[0], from[1] + steps * along[1], 0.0])
    }

    /// Pixel that shows a place in sample coordinates; none when the camera cannot see it.
    pub fn pixel(&self, place: [f64; 3]) -> Option<[f64; 2]> {
        self.camera.project(self.sample.apply(place))
    }

    /// The camera, in sample coordinates, in mm.
    pub fn viewer(&self) -> [f64; 3] {
        self.sample.inverse().translation_mm
    }

    /// Tangent part of `ωi + ωo` at a place, for a light at another (both in sample coordinates): `n λ/a` along the grating vector of
    /// what lights up there.
    pub fn half(&self, place: [f64; 3], light: [f64; 3]) -> [f64; 2] {
        let towards = |far: [f64; 3]| {
            let d = [0, 1, 2].map(|k| far[k] - place[k]);
            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            [d[0] / length, d[1] / length]
        };
        let (o, i) = (towards(self.viewer()), towards(light));
        [o[0] + i[0], o[1] + i[1]]
    }

    /// Refuses what cannot be: lengths out of range, no rotation, camera, panel or light below the surface.
    ///
    /// # Errors
    /// `Input`, which names the number.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
        self.camera.check()?;
        self.sample.check("sample")?;
        // A hundredth of a millimetre, so that no division below comes near zero.
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
    /// Place of a pixel (column, row; centres at integers, row 0 on top) in sample coordinates, in mm.
    pub fn at(&self, pixel: [f64; 2]) -> [f64; 3] {
        let [x, y] = [0, 1].map(|k| (pixel[k] - 0.5 * (f64::from(self.size_px[k]) - 1.0)) * self.pixel_mm[k]);
        self.pose.apply([x, -y, 0.0])
    }

    /// Refuses what is no panel.
    ///
    /// # Errors
    /// `Input`, which names the number.
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
