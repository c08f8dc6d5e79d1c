//! Scenes as users write them (TOML).

mod files;
mod hints;
mod material;

pub(crate) use files::inside;
pub use material::{Base, Blend, Bright, Color, Coverage, Diffraction, Material, Relief, Value};

use nacre_base::text::{from_toml, read_text};
use nacre_base::{Error, Result, Version};
use nacre_optics::color::Observer;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest scene file, in bytes.
const MAX_BYTES: u64 = 4 << 20;

/// What to do about a scene that cannot be used.
pub(crate) const REMEDY: &str = "correct the scene; `nacre schema scene` describes it";

/// A scene: a camera, shapes, lights and materials. Lengths are mm unless a name says otherwise, x to the right, y up, z towards the viewer of a
/// sample that lies in its plane; files are sought beside the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<1>,
    /// Who looks.
    pub camera: Camera,
    /// What is seen.
    #[serde(default)]
    pub shape: Vec<Shape>,
    /// What shines.
    #[serde(default)]
    pub light: Vec<Light>,
    /// What shapes are made of, by name.
    #[serde(default)]
    pub material: BTreeMap<String, Material>,
    /// Turns everything but the camera and the lights, about the origin, or everything.
    #[serde(default)]
    pub turn: Turn,
    /// Observer.
    #[serde(default)]
    pub observer: Observer,
    /// Brightness of the PNG: linear light is multiplied with it; chosen from the picture if it is not given.
    #[serde(default)]
    pub exposure: Option<f64>,
    /// Defaults that decide the picture and that its text does not state, a line for each.
    #[serde(skip)]
    pub hints: Vec<String>,
}

/// Turns about the z axis, anticlockwise seen from +z, in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Turn {
    /// Shapes.
    pub sample_deg: f64,
    /// Lights.
    pub light_deg: f64,
    /// The camera.
    pub view_deg: f64,
}

/// A camera without distortion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Where it is.
    pub position: [f64; 3],
    /// What it looks at.
    pub target: [f64; 3],
    /// What is up in the picture.
    #[serde(default = "y")]
    pub up: [f64; 3],
    /// Angle of view from bottom to top, in degrees.
    pub fov_deg: f64,
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Diameter of the lens: 0 is sharp everywhere.
    #[serde(default)]
    pub aperture_mm: f64,
    /// Distance that is sharp; that of the target if it is not given.
    #[serde(default)]
    pub focus_mm: Option<f64>,
}

fn y() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

fn z() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn x() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

fn one() -> f64 {
    1.0
}

fn whole() -> [f64; 2] {
    [0.0, 360.0]
}

/// A shape of one material. Coordinates (u, v) run from 0 to 1 over it: u to the right and v up in its maps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A rectangle.
    Plane {
        /// Its middle.
        #[serde(default)]
        center: [f64; 3],
        /// Its front.
        #[serde(default = "z")]
        normal: [f64; 3],
        /// The direction of v.
        #[serde(default = "y")]
        up: [f64; 3],
        /// Along u and v.
        size: [f64; 2],
        /// Its material.
        material: String,
    },
    /// A disc with a hole; (u, v) are those of the square around it.
    Disc {
        /// Its middle.
        #[serde(default)]
        center: [f64; 3],
        /// Its front.
        #[serde(default = "z")]
        normal: [f64; 3],
        /// The direction of v.
        #[serde(default = "y")]
        up: [f64; 3],
        /// Radius of the hole.
        #[serde(default)]
        inner: f64,
        /// Radius.
        outer: f64,
        /// Its material.
        material: String,
    },
    /// A sphere: u around, v from pole to pole.
    Sphere {
        /// Its middle.
        #[serde(default)]
        center: [f64; 3],
        /// Radius.
        radius: f64,
        /// From one pole to the other.
        #[serde(default = "y")]
        axis: [f64; 3],
        /// Where u is 0.
        #[serde(default = "x")]
        start: [f64; 3],
        /// Its material.
        material: String,
    },
    /// A cylinder without ends, or a rolled sheet: u around, v along the axis.
    Cylinder {
        /// Its middle.
        #[serde(default)]
        center: [f64; 3],
        /// Its axis.
        #[serde(default = "y")]
        axis: [f64; 3],
        /// Where angles are 0.
        #[serde(default = "x")]
        start: [f64; 3],
        /// Radius.
        radius: f64,
        /// Along the axis.
        length: f64,
        /// First and last angle in degrees, where u is 0 and 1.
        #[serde(default = "whole")]
        arc_deg: [f64; 2],
        /// Its material.
        material: String,
    },
    /// Triangles from a file: OBJ, PLY or glTF (.gltf, .glb).
    Mesh {
        /// The file.
        file: PathBuf,
        /// Where its origin goes.
        #[serde(default)]
        position: [f64; 3],
        /// Turns about x, then y, then z, in degrees.
        #[serde(default)]
        rotation_deg: [f64; 3],
        /// Size of its unit.
        #[serde(default = "one")]
        scale: f64,
        /// Its material.
        material: String,
    },
}

impl Shape {
    /// Name of its material.
    pub fn material(&self) -> &str {
        match self {
            Self::Plane { material, .. }
            | Self::Disc { material, .. }
            | Self::Sphere { material, .. }
            | Self::Cylinder { material, .. }
            | Self::Mesh { material, .. } => material,
        }
    }
}

/// Spectrum of a light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Spectrum {
    /// A line at a wavelength in nm, 2 nm wide at half its height.
    LineNm(f64),
    /// E, A, A-inverse, D65, FL1 to FL12, LED-B1, LED-B3, or a CSV file with rows `wavelength_nm,power`.
    Named(String),
}

impl Default for Spectrum {
    fn default() -> Self {
        Self::Named("D65".into())
    }
}

/// A light. Strengths are luminances: `Y` of the light's own colour.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Light {
    /// A small light at a finite distance.
    Point {
        /// Where it is.
        position: [f64; 3],
        /// Illuminance of what faces it at the distance of the origin.
        #[serde(default = "one")]
        illuminance: f64,
        /// Its size: the standard deviation of a round Gaussian; a disc of radius r has r/2.
        #[serde(default)]
        sigma_mm: f64,
        /// Its spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// A light that is far away.
    Directional {
        /// From the scene towards it.
        direction: [f64; 3],
        /// Illuminance of what faces it.
        #[serde(default = "one")]
        illuminance: f64,
        /// Its size: the standard deviation of a round Gaussian; the sun's is 0.13.
        #[serde(default)]
        sigma_deg: f64,
        /// Its spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// A beam whose light falls off from its middle as a Gaussian.
    Spot {
        /// Where it is.
        position: [f64; 3],
        /// What its middle falls on.
        target: [f64; 3],
        /// Standard deviation of the beam in degrees.
        beam_deg: f64,
        /// Illuminance of what faces it in the middle of the beam at the target.
        #[serde(default = "one")]
        illuminance: f64,
        /// Its size, as that of a point light.
        #[serde(default)]
        sigma_mm: f64,
        /// Its spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// A rectangle that shines to its front.
    Rectangle {
        /// Its middle.
        center: [f64; 3],
        /// Its front.
        normal: [f64; 3],
        /// The direction of its height.
        #[serde(default = "y")]
        up: [f64; 3],
        /// Width and height.
        size: [f64; 2],
        /// Luminance.
        #[serde(default = "one")]
        luminance: f64,
        /// Its spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// Light from everywhere: a lat-long picture (EXR, HDR) or a colour; its zenith is `up`, +y unless given.
    Environment {
        /// The picture.
        #[serde(default)]
        file: Option<PathBuf>,
        /// Layer of an OpenEXR file that has several pictures.
        #[serde(default)]
        layer: Option<String>,
        /// Linear sRGB, without a picture.
        #[serde(default)]
        color: Option<[f32; 3]>,
        /// Multiplies it.
        #[serde(default = "one")]
        luminance: f64,
        /// Direction of its zenith: +y, up in the picture; above a sample that lies in z = 0 it is [0, 0, 1].
        #[serde(default = "y")]
        up: [f64; 3],
        /// Turns it about the zenith, in degrees.
        #[serde(default)]
        turn_deg: f64,
        /// Whether the camera sees it.
        #[serde(default)]
        visible: bool,
    },
}

impl Scene {
    /// Reads a scene.
    ///
    /// # Errors
    /// `Input` for what is none; unknown keys are named.
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_text(path, MAX_BYTES, REMEDY)?;
        Self::parse(&text).map_err(|problem| Error::file(path, problem, REMEDY))
    }

    /// Of a text.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        let scene: Self = from_toml(text)?;
        Ok(Self { hints: hints::hints(text), ..scene })
    }
}
