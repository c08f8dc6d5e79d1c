//! Materials, as written by users.

use nacre_brdf::Reflectance;
use nacre_brdf::height::Profile;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

fn one() -> f64 {
    1.0
}

/// A constant, or a grey picture over (u, v).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Value {
    /// Constant value.
    Number(f64),
    /// Grey picture.
    File(PathBuf),
}

/// Covered part of a surface: a number, a grey picture over (u, v), or the bright part of a photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Coverage {
    /// Constant coverage, 0 to 1.
    Number(f64),
    /// Grey picture.
    File(PathBuf),
    /// Bright part of a photograph of the surface under a flash.
    Bright(Bright),
}

/// The bright part of a photograph (2017 TOG paper, Fig. 20).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bright {
    /// The photograph, over (u, v).
    pub photograph: PathBuf,
    /// Brightness from which the surface diffracts: 0 to 1 relative to the largest code, or the value of an EXR.
    /// Default: the value that best separates bright and dark pixels.
    #[serde(default)]
    pub threshold: Option<f64>,
}

/// A constant linear sRGB colour, or a picture over (u, v): 8 and 16 bits are sRGB, EXR is linear.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Color {
    /// The colour.
    Rgb([f32; 3]),
    /// The picture.
    File(PathBuf),
}

/// Material of a surface: a scattering base and a diffracting layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Scattering base; default: none.
    #[serde(default)]
    pub base: Option<Base>,
    /// Diffracting layer; default: none.
    #[serde(default)]
    pub diffraction: Option<Diffraction>,
    /// Fraction of the surface that diffracts, 0 to 1; the rest is base.
    #[serde(default = "full")]
    pub coverage: Coverage,
    /// Combination of base and diffraction.
    #[serde(default)]
    pub blend: Blend,
    /// Normal map, (n + 1)/2 in u, v and up; diffraction follows the normals.
    #[serde(default)]
    pub normals: Option<PathBuf>,
}

fn full() -> Coverage {
    Coverage::Number(1.0)
}

/// Combination of base and diffraction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Blend {
    /// Side by side, by coverage.
    #[default]
    Mix,
    /// Diffraction on top: the base receives the light transmitted by the top's Fresnel reflectance, in and out (2014
    /// thesis, texture blending).
    Fresnel,
}

/// Diffuse and glossy reflection: Lambert below Cook-Torrance (GGX, Schlick's Fresnel), with compensation for multiple
/// reflections.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Base {
    /// Diffuse reflectance.
    pub albedo: Color,
    /// GGX roughness α, 0.02 to 1.
    pub roughness: Value,
    /// Reflectance of the glossy part at normal incidence (linear sRGB).
    pub specular: [f32; 3],
}

impl Default for Base {
    fn default() -> Self {
        Self { albedo: Color::Rgb([0.5; 3]), roughness: Value::Number(0.3), specular: [0.04; 3] }
    }
}

/// Profile of a grating.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Relief {
    /// Shape of the profile.
    #[serde(default = "sinusoid")]
    pub profile: Profile,
    /// Peak-to-peak depth in µm.
    pub depth_um: f64,
}

fn sinusoid() -> Profile {
    Profile::Sinusoid
}

fn coherence() -> f64 {
    65.0
}

fn perfect() -> Reflectance {
    Reflectance::Perfect
}

fn paper_spacing() -> f64 {
    nacre_brdf::Slits::DISC.spacing_um
}

fn paper_width() -> f64 {
    nacre_brdf::Slits::DISC.width_um
}

fn paper_count() -> usize {
    nacre_brdf::Slits::DISC.count
}

/// A diffracting layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Diffraction {
    /// A grating, uniform or from maps.
    Grating {
        /// Profile.
        relief: Relief,
        /// Period in µm, unless a map contains it.
        #[serde(default)]
        period_um: Option<f64>,
        /// Direction of the grating vector from u towards v, in degrees, unless a map contains it.
        #[serde(default)]
        orientation_deg: Option<f64>,
        /// A folder with orientation.exr or period.exr, or one of these files; masked pixels do not diffract.
        #[serde(default)]
        maps: Option<PathBuf>,
        /// Number of repetitions of the maps along u and v.
        #[serde(default = "once")]
        repeat: [f64; 2],
        /// Coherence width of the light in µm (four standard deviations), or the size of a facet if that is smaller.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the smooth material.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
    },
    /// Tracks around the centre of a disc, (u, v) = (½, ½).
    Cd {
        /// Track pitch in µm.
        #[serde(default = "paper_spacing")]
        period_um: f64,
        /// Profile.
        relief: Relief,
        /// Coherence width of the light in µm.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the smooth material.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
    },
    /// Reflecting slits (2017 TOG paper, Eq. 16): parallel, around the centre with `disc`, or in all directions with
    /// `radial`. Default spacing, width and number are those of the paper's compact disc.
    Multislit {
        /// Slit spacing in µm.
        #[serde(default = "paper_spacing")]
        spacing_um: f64,
        /// Slit width in µm.
        #[serde(default = "paper_width")]
        width_um: f64,
        /// Number of coherently lit slits.
        #[serde(default = "paper_count")]
        count: usize,
        /// Direction across the slits from u towards v, in degrees.
        #[serde(default)]
        orientation_deg: f64,
        /// Slits around the centre of (u, v).
        #[serde(default)]
        disc: bool,
        /// Slits in all directions at every point: the diffraction pattern rotated about its centre (Fig. 20).
        #[serde(default)]
        radial: bool,
    },
    /// A lattice of reflecting rectangles, such as the subpixels of a screen.
    Lattice {
        /// Spacing of the rectangles along u and v, in µm.
        period_um: [f64; 2],
        /// Width and height of the rectangles in µm.
        aperture_um: [f64; 2],
        /// Direction of the rows from u towards v, in degrees.
        #[serde(default)]
        orientation_deg: f64,
        /// Coherence width of the light in µm.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the rectangles.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
    },
    /// A lookup table over half vectors, `lut.exr` of `nacre reconstruct lut`.
    Table {
        /// File of the table.
        file: PathBuf,
        /// Albedo to which the table is scaled: the largest reflectance over directions of view, under a constant
        /// environment.
        #[serde(default = "one")]
        albedo: f64,
        /// Reflect all light at every direction of view and in every channel.
        #[serde(default)]
        lossless: bool,
        /// Folder written by `nacre factor` for this table, used by `--method two-pass` and `auto`; without it the
        /// table is factorised when needed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        factors: Option<PathBuf>,
    },
    /// A measured height field (image, EXR or text, as for `nacre brdf map`).
    Heightfield {
        /// File of the heights.
        file: PathBuf,
        /// Pixel size in µm, unless the file contains it.
        #[serde(default)]
        pixel_um: Option<f64>,
        /// Height of white above black in µm, unless the file contains it.
        #[serde(default)]
        range_um: Option<f64>,
        /// Channel of a file with several: its name, or its number from 1 (default: the first height channel).
        #[serde(default)]
        channel: Option<String>,
        /// Largest fraction of gaps that may be filled by interpolation, above 0 and at most 0.5; default: none.
        #[serde(default)]
        fill_gaps: Option<f64>,
        /// Direction of the rows from u towards v, in degrees.
        #[serde(default)]
        orientation_deg: f64,
        /// Coherence width of the light in µm.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the smooth material.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
        /// Reflect all light at every direction of view; otherwise only the excess of scalar theory is removed.
        #[serde(default)]
        lossless: bool,
    },
}

fn once() -> [f64; 2] {
    [1.0, 1.0]
}
