//! Scenes, as written by users (TOML).

mod files;
mod hints;
mod material;

pub(crate) use files::inside;
pub use material::{Base, Blend, Bright, Color, Coverage, Diffraction, Material, Relief, Value};

use crate::prepared_scene;
use nacre_base::text::{from_toml, read_text};
use nacre_base::{Error, Result, Version};
use nacre_optics::color::Observer;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Maximum size of a scene file in bytes.
pub(crate) const MAX_BYTES: u64 = 4 << 20;

/// Remedy for an invalid scene.
pub(crate) const REMEDY: &str = "correct the scene; `nacre schema scene` describes it";

/// A scene: a camera, shapes, lights and materials. Lengths are in mm unless a name states otherwise. x points to the
/// right, y up, z towards the viewer of a sample in the x-y plane. File paths are relative to the scene's folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<1>,
    /// The camera.
    pub camera: Camera,
    /// Visible shapes.
    #[serde(default)]
    pub shape: Vec<Shape>,
    /// Lights.
    #[serde(default)]
    pub light: Vec<Light>,
    /// Materials by name.
    #[serde(default)]
    pub material: BTreeMap<String, Material>,
    /// Rotation of the shapes, the lights or the camera about the z axis.
    #[serde(default)]
    pub turn: Turn,
    /// Observer.
    #[serde(default)]
    pub observer: Observer,
    /// Factor from linear radiance to the PNG; default: chosen from the picture.
    #[serde(default)]
    pub exposure: Option<f64>,
    /// Unstated defaults that determine the picture, one line each.
    #[serde(skip)]
    pub hints: Vec<String>,
}

/// Rotations about the z axis, anticlockwise seen from +z, in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Turn {
    /// Rotation of the shapes.
    pub sample_deg: f64,
    /// Rotation of the lights.
    pub light_deg: f64,
    /// Rotation of the camera.
    pub view_deg: f64,
}

/// A camera without distortion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position.
    pub position: [f64; 3],
    /// Point at the centre of the picture.
    pub target: [f64; 3],
    /// Direction that points up in the picture.
    #[serde(default = "y")]
    pub up: [f64; 3],
    /// Vertical angle of view in degrees.
    pub fov_deg: f64,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Diameter of the lens in mm; 0 for unlimited depth of field.
    #[serde(default)]
    pub aperture_mm: f64,
    /// Focus distance in mm; default: the distance of the target.
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

/// A shape of one material. Texture coordinates (u, v) run from 0 to 1: u to the right and v up in its maps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A rectangle.
    Plane {
        /// Centre.
        #[serde(default)]
        center: [f64; 3],
        /// Normal of the front side.
        #[serde(default = "z")]
        normal: [f64; 3],
        /// Direction of v.
        #[serde(default = "y")]
        up: [f64; 3],
        /// Size along u and v.
        size: [f64; 2],
        /// Name of the material.
        material: String,
    },
    /// A disc with a hole; (u, v) are those of the circumscribed square.
    Disc {
        /// Centre.
        #[serde(default)]
        center: [f64; 3],
        /// Normal of the front side.
        #[serde(default = "z")]
        normal: [f64; 3],
        /// Direction of v.
        #[serde(default = "y")]
        up: [f64; 3],
        /// Radius of the hole.
        #[serde(default)]
        inner: f64,
        /// Outer radius.
        outer: f64,
        /// Name of the material.
        material: String,
    },
    /// A sphere: u is the longitude, v runs from pole to pole.
    Sphere {
        /// Centre.
        #[serde(default)]
        center: [f64; 3],
        /// Radius.
        radius: f64,
        /// Direction from one pole to the other.
        #[serde(default = "y")]
        axis: [f64; 3],
        /// Direction of u = 0.
        #[serde(default = "x")]
        start: [f64; 3],
        /// Name of the material.
        material: String,
    },
    /// An open cylinder, or a rolled sheet: u around, v along the axis.
    Cylinder {
        /// Centre.
        #[serde(default)]
        center: [f64; 3],
        /// Its axis.
        #[serde(default = "y")]
        axis: [f64; 3],
        /// Direction of angle 0.
        #[serde(default = "x")]
        start: [f64; 3],
        /// Radius.
        radius: f64,
        /// Length along the axis.
        length: f64,
        /// Angles in degrees at u = 0 and u = 1.
        #[serde(default = "whole")]
        arc_deg: [f64; 2],
        /// Name of the material.
        material: String,
    },
    /// Triangles from a file: OBJ, PLY or glTF (.gltf, .glb).
    Mesh {
        /// File of the mesh.
        file: PathBuf,
        /// Position of its origin.
        #[serde(default)]
        position: [f64; 3],
        /// Rotations about x, then y, then z, in degrees.
        #[serde(default)]
        rotation_deg: [f64; 3],
        /// Length of its unit in mm.
        #[serde(default = "one")]
        scale: f64,
        /// Name of the material.
        material: String,
    },
}

impl Shape {
    /// Name of the material.
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
    /// A line at a wavelength in nm, with a full width at half maximum of 2 nm.
    LineNm(f64),
    /// E, A, A-inverse, D65, FL1 to FL12, LED-B1, LED-B3, or a CSV file with rows `wavelength_nm,power`.
    Named(String),
}

impl Default for Spectrum {
    fn default() -> Self {
        Self::Named("D65".into())
    }
}

/// A light. Strengths are photometric: `Y` of the light's own colour.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Light {
    /// A small light at a finite distance.
    Point {
        /// Position.
        position: [f64; 3],
        /// Illuminance of a surface that faces it, at the distance of the origin.
        #[serde(default = "one")]
        illuminance: f64,
        /// Size: standard deviation of a round Gaussian; a disc of radius r corresponds to r/2.
        #[serde(default)]
        sigma_mm: f64,
        /// Spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// A distant light.
    Directional {
        /// Direction from the scene towards the light.
        direction: [f64; 3],
        /// Illuminance of a surface that faces it.
        #[serde(default = "one")]
        illuminance: f64,
        /// Angular size: standard deviation of a round Gaussian; 0.13° for the sun.
        #[serde(default)]
        sigma_deg: f64,
        /// Spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// A beam with a Gaussian profile.
    Spot {
        /// Position.
        position: [f64; 3],
        /// Target of the beam's axis.
        target: [f64; 3],
        /// Standard deviation of the beam in degrees.
        beam_deg: f64,
        /// Illuminance of a surface that faces it, on the axis at the target.
        #[serde(default = "one")]
        illuminance: f64,
        /// Size, as for a point light.
        #[serde(default)]
        sigma_mm: f64,
        /// Spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// A rectangle that emits from its front side.
    Rectangle {
        /// Centre.
        center: [f64; 3],
        /// Normal of the front side.
        normal: [f64; 3],
        /// Direction of its height.
        #[serde(default = "y")]
        up: [f64; 3],
        /// Width and height.
        size: [f64; 2],
        /// Luminance.
        #[serde(default = "one")]
        luminance: f64,
        /// Spectrum.
        #[serde(default)]
        spectrum: Spectrum,
    },
    /// Environment light: a lat-long picture (EXR, HDR) or a colour. Its zenith is `up`, by default +y.
    Environment {
        /// Picture file.
        #[serde(default)]
        file: Option<PathBuf>,
        /// Layer of an OpenEXR file that contains several pictures.
        #[serde(default)]
        layer: Option<String>,
        /// Linear sRGB colour, without a picture.
        #[serde(default)]
        color: Option<[f32; 3]>,
        /// Factor on its radiance.
        #[serde(default = "one")]
        luminance: f64,
        /// Direction of its zenith. Default: +y, up in the picture; [0, 0, 1] is above a sample in the plane z = 0.
        #[serde(default = "y")]
        up: [f64; 3],
        /// Rotation about the zenith in degrees.
        #[serde(default)]
        turn_deg: f64,
        /// Whether it is visible to the camera.
        #[serde(default)]
        visible: bool,
    },
}

impl Scene {
    /// Reads a scene.
    ///
    /// # Errors
    /// `Input` for an invalid scene; the message names unknown keys.
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_text(path, MAX_BYTES, REMEDY)?;
        Self::parse(&text).map_err(|problem| Error::file(path, problem, REMEDY))
    }

    /// Parses a scene, and checks it and the names of its files, which must lie in the folder.
    ///
    /// # Errors
    /// `Input`, which names key or file.
    pub fn beside(text: &str, folder: &Path) -> Result<Self> {
        let scene = Self::parse(text).map_err(|problem| Error::input("scene", problem, REMEDY))?;
        prepared_scene::check(&scene)?;
        scene.check_files(folder)?;
        Ok(scene)
    }

    /// Parses a scene.
    ///
    /// # Errors
    /// A description of the error.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        let scene: Self = from_toml(text)?;
        Ok(Self { hints: hints::hints(text), ..scene })
    }
}
