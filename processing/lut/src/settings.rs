//! What the user may choose.

use super::geometry::Placement;
use nacre_base::{Error, Result};
use nacre_frames::{Channel, Transfer};
use nacre_optics::color::Observer;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Limits of a table's side.
pub const SIZES: std::ops::RangeInclusive<usize> = 16..=8192;

/// How a table is made of a photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Wavelength of the photograph in nm, or three for the red, green and blue channel of a photograph in white light (default: that
    /// of `frames.json`).
    pub wavelength_nm: Option<Wavelength>,
    /// Half vector per pixel of the photograph, for a camera and a flash that are far away (default: the geometry of `frames.json`).
    pub scale: Option<f64>,
    /// Where camera and flash stood, in place of `scale`: undoes cosine, inverse square, near field and G.
    pub geometry: Option<Placement>,
    /// Place of the zero order in pixels from the left and the top (default: found).
    pub center: Option<[f64; 2]>,
    /// Entries of a row and a column.
    pub size: usize,
    /// Largest component of the half vector, up to 2 (default: as far as nearly all wavelengths were measured).
    pub extent: Option<f64>,
    /// Odd power of the warp: entries lie at `extent · aⁿ`, `a` even between −1 and 1.
    pub warp: i32,
    /// Light: a name or a CSV file.
    pub illuminant: String,
    /// Observer.
    pub observer: Observer,
    /// Power of λm/λ: 4 is exact for shallow gratings to first order, 2 is what the paper prints; deep gratings have none.
    pub exponent: f64,
    /// Error that is asked for: root mean square at the rim, of the table's own there.
    pub max_error: f64,
    /// How entries are added up.
    pub method: MethodChoice,
    /// Channel of a colour photograph (default: that of the wavelength).
    pub channel: Option<Channel>,
    /// How the photograph's values grow with light (default: linear; must be said for 8 bits).
    pub transfer: Option<Transfer>,
    /// A photograph of the light's mirror image, for light that is no point. Over REST an upload stands for its files.
    #[serde(skip)]
    pub light: Option<LightPhotograph>,
    /// Replace results that are already there.
    #[serde(skip)]
    pub overwrite: bool,
}

/// A photograph of a light's mirror image.
#[derive(Clone, Debug, PartialEq)]
pub struct LightPhotograph {
    /// Its file, or a folder of merged exposures or of exposures, which are merged first.
    pub path: PathBuf,
    /// Half vector per pixel of it (default: that of the pattern's photograph).
    pub scale: Option<f64>,
    /// Its pixel that is put where the zero order is (default: the middle of its light).
    pub center: Option<[f64; 2]>,
    /// How its values grow with light (default: as those of the pattern's photograph).
    pub transfer: Option<Transfer>,
}

/// Wavelengths of a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Wavelength {
    /// Of one narrow band, in nm.
    Band(f64),
    /// That the red, green and blue channel stand for, in nm.
    Channels([f64; 3]),
}

/// How entries are added up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MethodChoice {
    /// The cheapest that is exact enough.
    #[default]
    Auto,
    /// Rays with this spacing in pixels.
    Rays(f64),
    /// Each entry by itself, with samples this many pixels apart.
    Single(f64),
    /// Wavelengths this many nm apart, as the paper has it.
    Fixed(f64),
}

impl std::str::FromStr for MethodChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let (name, number) = text.split_once('=').unwrap_or((text, ""));
        let number = |otherwise: f64| {
            let given = if number.is_empty() { Ok(otherwise) } else { number.parse() };
            given.map_err(|_| format!("{number:?} is no number"))
        };
        match name {
            "auto" => Ok(Self::Auto),
            "rays" => Ok(Self::Rays(number(1.0)?)),
            "single" => Ok(Self::Single(number(0.5)?)),
            "fixed" => Ok(Self::Fixed(number(5.0)?)),
            _ => Err(format!("{text:?} is none of auto, rays[=PX], single[=PX], fixed[=NM]")),
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            wavelength_nm: None,
            scale: None,
            geometry: None,
            center: None,
            size: 1024,
            extent: None,
            warp: 1,
            illuminant: "E".into(),
            observer: Observer::default(),
            exponent: 4.0,
            max_error: 0.01,
            method: MethodChoice::Auto,
            channel: None,
            transfer: None,
            light: None,
            overwrite: false,
        }
    }
}

impl Settings {
    /// Refuses what makes no sense.
    ///
    /// # Errors
    /// `Input`, which names the setting.
    pub fn check(&self) -> Result<()> {
        let within = |what: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(Error::input(what, format!("is {value}"), format!("give {low} to {high}")))
        };
        match self.wavelength_nm {
            None => {}
            Some(Wavelength::Band(nm)) => within("wavelength", nm, 200.0, 2000.0)?,
            Some(Wavelength::Channels(all)) => {
                all.iter().try_for_each(|nm| within("wavelength", *nm, 200.0, 2000.0))?;
                if all[0] <= all[1] || all[1] <= all[2] {
                    let remedy = "give those of red, green and blue, such as 610,540,460";
                    return Err(Error::input("wavelength", format!("{all:?} do not fall"), remedy));
                }
                if self.channel.is_some() {
                    return Err(Error::input("channel", "does not go with three wavelengths", "give one of the two"));
                }
            }
        }
        match (self.scale, &self.geometry) {
            (Some(scale), None) => within("scale", scale, 1e-7, 1.0)?,
            (None, Some(geometry)) => geometry.check()?,
            (None, None) => {}
            (Some(_), Some(_)) => {
                return Err(Error::input("scale", "does not go with a geometry", "give one of the two"));
            }
        }
        if !SIZES.contains(&self.size) {
            return Err(Error::input("size", format!("is {}", self.size), "give 16 to 8192"));
        }
        self.extent.map_or(Ok(()), |extent| within("extent", extent, 1e-3, 2.0))?;
        if !(1..=9).contains(&self.warp) || self.warp % 2 == 0 {
            return Err(Error::input("warp", format!("is {}", self.warp), "give 1, 3, 5, 7 or 9"));
        }
        within("exponent", self.exponent, -10.0, 10.0)?;
        within("max-error", self.max_error, 1e-4, 1.0)?;
        self.transfer.map_or(Ok(()), Transfer::check_known)?;
        if let Some(light) = &self.light {
            if self.warp != 1 {
                return Err(Error::input("warp", "does not go with a photograph of the light", "give --warp 1"));
            }
            light.scale.map_or(Ok(()), |scale| within("scale of the light", scale, 1e-7, 1.0))?;
            light.transfer.map_or(Ok(()), Transfer::check_known)?;
        }
        match self.method {
            MethodChoice::Auto => Ok(()),
            MethodChoice::Rays(px) | MethodChoice::Single(px) => within("method", px, 0.1, 16.0),
            MethodChoice::Fixed(nm) => within("method", nm, 0.05, 50.0),
        }
    }

    /// Wavelengths of the photograph.
    ///
    /// # Errors
    /// `Input` when nobody has said them.
    pub(super) fn bands(&self) -> Result<Wavelength> {
        let remedy = "give --wavelength NM of the filter, or those of red, green and blue";
        self.wavelength_nm.ok_or_else(|| Error::input("wavelength", "is not known", remedy))
    }
}
