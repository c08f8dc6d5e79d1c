//! Materials as users write them.

use nacre_brdf::Reflectance;
use nacre_brdf::height::Profile;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

fn one() -> f64 {
    1.0
}

/// A number for all of a surface, or a grey picture over (u, v).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Value {
    /// The number.
    Number(f64),
    /// The picture.
    File(PathBuf),
}

/// Part of a surface: a number, a grey picture over (u, v), or the bright part of a photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Coverage {
    /// The number, 0 to 1.
    Number(f64),
    /// The picture.
    File(PathBuf),
    /// What a photograph of the surface under a flash shows bright.
    Bright(Bright),
}

/// The bright part of a photograph (2017 TOG paper, Fig. 20).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bright {
    /// The photograph, over (u, v).
    pub photograph: PathBuf,
    /// Brightness from which the surface diffracts: 0 to 1 of the largest code, or the value of an EXR; where bright and dark pixels differ most if it
    /// is not given.
    #[serde(default)]
    pub threshold: Option<f64>,
}

/// A linear sRGB colour for all of a surface, or a picture over (u, v): 8 and 16 bits are sRGB, EXR linear.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Color {
    /// The colour.
    Rgb([f32; 3]),
    /// The picture.
    File(PathBuf),
}

/// What a surface is made of: a base that scatters, and what diffracts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// What scatters; nothing if it is not given.
    #[serde(default)]
    pub base: Option<Base>,
    /// What diffracts; nothing if it is not given.
    #[serde(default)]
    pub diffraction: Option<Diffraction>,
    /// Part of the surface that diffracts, 0 to 1; the rest is base.
    #[serde(default = "full")]
    pub coverage: Coverage,
    /// How base and diffraction are joined.
    #[serde(default)]
    pub blend: Blend,
    /// Normals as a picture, (n + 1)/2 in u, v and up; diffraction follows them.
    #[serde(default)]
    pub normals: Option<PathBuf>,
}

fn full() -> Coverage {
    Coverage::Number(1.0)
}

/// How base and diffraction are joined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Blend {
    /// Side by side, by coverage.
    #[default]
    Mix,
    /// Diffraction on top: the base gets what the top's Fresnel reflectance lets through, in and out (2014 thesis, texture blending).
    Fresnel,
}

/// Diffuse and glossy reflection: Lambert below Cook-Torrance (GGX, Schlick's Fresnel), with the light of several reflections made up for.
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

/// Cross-section of a grating.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Relief {
    /// Its shape.
    #[serde(default = "sinusoid")]
    pub profile: Profile,
    /// From its lowest to its highest point, in µm.
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

/// What diffracts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Diffraction {
    /// A grating, the same everywhere or from maps.
    Grating {
        /// Cross-section.
        relief: Relief,
        /// Period in µm, unless a map has it.
        #[serde(default)]
        period_um: Option<f64>,
        /// Direction of the grating vector from u towards v, in degrees, unless a map has it.
        #[serde(default)]
        orientation_deg: Option<f64>,
        /// A folder with orientation.exr or period.exr, or one of them; masked pixels do not diffract.
        #[serde(default)]
        maps: Option<PathBuf>,
        /// How often the maps are repeated along u and v.
        #[serde(default = "once")]
        repeat: [f64; 2],
        /// Width of the light's coherence in µm (four standard deviations), or of a facet if that is smaller.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the smooth material.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
    },
    /// Tracks around the middle of a disc, (u, v) = (½, ½).
    Cd {
        /// Distance of tracks in µm.
        #[serde(default = "paper_spacing")]
        period_um: f64,
        /// Cross-section.
        relief: Relief,
        /// Width of the light's coherence in µm.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the smooth material.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
    },
    /// Slits that alone reflect (2017 TOG paper, Eq. 16): parallel, around the middle as `disc`, or in all directions as `radial`. Spacing, width and number
    /// are by default those of the paper's compact disc.
    Multislit {
        /// Distance of slits in µm.
        #[serde(default = "paper_spacing")]
        spacing_um: f64,
        /// Their width in µm.
        #[serde(default = "paper_width")]
        width_um: f64,
        /// How many are lit together.
        #[serde(default = "paper_count")]
        count: usize,
        /// Direction across the slits from u towards v, in degrees.
        #[serde(default)]
        orientation_deg: f64,
        /// Around the middle of (u, v).
        #[serde(default)]
        disc: bool,
        /// In all directions at every place: the slits' pattern turned around its middle (Fig. 20).
        #[serde(default)]
        radial: bool,
    },
    /// A lattice of rectangles that alone reflect, such as the subpixels of a screen.
    Lattice {
        /// Distance of rectangles along u and v, in µm.
        period_um: [f64; 2],
        /// Their width and height in µm.
        aperture_um: [f64; 2],
        /// Direction of their rows from u towards v, in degrees.
        #[serde(default)]
        orientation_deg: f64,
        /// Width of the light's coherence in µm.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the rectangles.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
    },
    /// A table over half vectors, `lut.exr` of `nacre reconstruct lut`.
    Table {
        /// The table.
        file: PathBuf,
        /// Reflectance that the table is scaled to: the largest over directions of view, of light from everywhere.
        #[serde(default = "one")]
        albedo: f64,
        /// Give back all light at every direction of view and in every channel.
        #[serde(default)]
        lossless: bool,
        /// Folder that `nacre factor` wrote of this table, whose curves `--method two-pass` and `auto` take; without it the table is factored when needed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        factors: Option<PathBuf>,
    },
    /// A measured height field (image, EXR or text, as for `nacre brdf map`).
    Heightfield {
        /// The file.
        file: PathBuf,
        /// Size of its pixels, unless the file says so.
        #[serde(default)]
        pixel_um: Option<f64>,
        /// Height of white above black, unless the file says so.
        #[serde(default)]
        range_um: Option<f64>,
        /// Channel of a file with several: its name, or its number from 1 (default: the first channel of heights).
        #[serde(default)]
        channel: Option<String>,
        /// Largest share of gaps that are filled by interpolation, above 0 and at most 0.5; none are filled by default.
        #[serde(default)]
        fill_gaps: Option<f64>,
        /// Direction of its rows from u towards v, in degrees.
        #[serde(default)]
        orientation_deg: f64,
        /// Width of the light's coherence in µm.
        #[serde(default = "coherence")]
        coherence_um: f64,
        /// Reflectance of the smooth material.
        #[serde(default = "perfect")]
        reflectance: Reflectance,
        /// Give back all light at every direction of view; else only what scalar theory has too much of is taken away.
        #[serde(default)]
        lossless: bool,
    },
}

fn once() -> [f64; 2] {
    [1.0, 1.0]
}
