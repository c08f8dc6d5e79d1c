//! Options of the lookup-table reconstruction.

use super::geometry::Placement;
use super::input::check_input;
use super::reconstruct::table_into;
use super::report::Report;
use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, exceeds};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{Channel, Transfer};
use nacre_optics::color::{NAMES, Observer};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Range of a table's width and height in entries.
pub const SIZES: std::ops::RangeInclusive<usize> = 16..=8192;

/// Make a lookup table of a diffraction pattern from one photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend(
    "x-input" = "Photograph (EXR, PNG, TIFF), results of `reconstruct hdr`, or a session of exposures, which are merged first",
    "x-examples" = EXAMPLES
))]
#[schemars(rename = "LutOptions")]
pub struct Settings {
    /// Wavelength of the photograph in nm, or three for its red, green and blue channel (default: that of frames.json).
    #[schemars(extend("x-placeholder" = "NM[,NM,NM]", "x-aliases" = ["wavelength"]))]
    pub wavelength_nm: Option<Wavelength>,
    /// Half vector per pixel, for a distant camera and flash: twice the pixel size on the surface over their distance.
    #[schemars(extend("x-placeholder" = "H_PER_PIXEL"))]
    pub scale: Option<f64>,
    /// Positions of camera and flash (TOML or geometry.json), in place of scale; default: those of frames.json.
    ///
    /// Corrects for cosine, inverse square, near field and G.
    #[schemars(extend("x-file" = true))]
    pub geometry: Option<Placement>,
    /// Pixel of the zero order from the left and the top, or auto: the brightest lobe.
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "auto|X,Y", "x-unset" = "auto"))]
    pub center: Option<[f64; 2]>,
    /// Entries of a row and a column, 16 to 8192.
    #[schemars(range(min = 16, max = 8192))]
    pub size: usize,
    /// Largest component of the half vector, up to 2 (default: the range measured at nearly all wavelengths).
    #[schemars(extend("x-advanced" = true))]
    pub extent: Option<f64>,
    /// Odd power n of the warp, which gathers entries in the middle: they lie at extent·aⁿ.
    #[schemars(range(min = 1, max = 9))]
    #[schemars(extend("x-advanced" = true))]
    pub warp: i32,
    /// Spectrum of the light that the table is for: a name or a CSV file.
    #[schemars(extend("x-placeholder" = "NAME|FILE.csv", "x-file" = true, "examples" = NAMES))]
    pub illuminant: String,
    /// Standard observer of the CIE: 1931 (2°) or 1964 (10°).
    #[schemars(extend("x-advanced" = true))]
    pub observer: Observer,
    /// Power of λm/λ: 4 is exact for shallow gratings to first order, 2 is the paper's. No power is exact for deep
    /// gratings.
    #[schemars(range(min = -10, max = 10))]
    #[schemars(extend("x-advanced" = true))]
    pub exponent: f64,
    /// Largest acceptable error at the rim: root mean square over that of the table there.
    ///
    /// The table is written in any case; the exit code is 1 when the error is larger.
    #[schemars(extend("x-placeholder" = "REL"), range(min = 1e-4, max = 1.0))]
    pub max_error: f64,
    /// Summation: auto is the cheapest of rays and single that meets the error; fixed steps of wavelength are the
    /// paper's.
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "auto|rays[=PX]|single[=PX]|fixed[=NM]"))]
    pub method: MethodChoice,
    /// Channel of a colour photograph (default: that of the wavelength).
    #[schemars(extend("x-advanced" = true))]
    pub channel: Option<Channel>,
    /// Transfer function of the photograph (required for 8-bit files; default: linear).
    #[schemars(extend("x-placeholder" = "linear|srgb|gamma=NUMBER|polynomial=A,B,C"))]
    pub transfer: Option<Transfer>,
    /// Photograph of the light's mirror image, for an extended light; the table is convolved with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<LightPhotograph>,
}

/// Command lines of the help.
const EXAMPLES: &str = "\
Examples:
  nacre reconstruct lut hdr/ --wavelength-nm 680 --scale 0.002 --out table
  nacre reconstruct lut hdr.exr --wavelength-nm 680 --geometry bench.toml --illuminant D65 --out table
  nacre reconstruct lut hdr.exr --wavelength-nm 680 --geometry geometry.json --out table    as nacre calibrate geometry made it
  nacre reconstruct lut session --out table --illuminant FL2 --observer 1964 --max-error 0.002
  nacre reconstruct lut photo.exr --wavelength-nm 610,540,460 --scale 0.002 --out table     white light, by channel
  nacre reconstruct lut hdr.exr --wavelength-nm 680 --scale 0.002 --light mirror.exr --out table    an extended light

with bench.toml:
  camera_mm = 1000          # above the surface; it looks straight down
  flash_mm = 1000           # above the surface
  baseline_mm = [60, 0]     # from the camera to the flash, right and up in the photograph
  pixel_um = 1000           # size of a pixel on the surface

Lights: E, A, A-inverse, D65, FL1 to FL12, LED-B1, LED-B3, or a CSV file with rows \"wavelength_nm,power\".

Writes lut.exr (X Y Z coverage over half vectors ωi + ωo from -E to E, x to the right and y up; Y is 1 for a
photograph that is 1 everywhere and the exponent 0; coverage is the part of each entry that was measured),
lut.png, figure.svg, figure.png, coverage.png, profile.csv (means over rings) and report.json.";

/// Photograph of a light's mirror image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightPhotograph {
    /// Photograph of the mirror image of an extended light, or a folder of exposures of it.
    #[schemars(extend("x-placeholder" = "PHOTO", "x-file" = true))]
    pub path: PathBuf,
    /// Half vector per pixel of that photograph (default: that of the pattern's).
    #[serde(default)]
    #[schemars(extend("x-placeholder" = "H_PER_PIXEL"))]
    pub scale: Option<f64>,
    /// Pixel of that photograph at the zero order, or auto: the centroid of the light.
    #[serde(default)]
    #[schemars(extend("x-placeholder" = "auto|X,Y", "x-unset" = "auto"))]
    pub center: Option<[f64; 2]>,
    /// Transfer function of that photograph (default: that of the pattern's photograph).
    #[serde(default)]
    #[schemars(extend("x-placeholder" = "linear|srgb|gamma=NUMBER|polynomial=A,B,C"))]
    pub transfer: Option<Transfer>,
}

/// Wavelengths of a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Wavelength {
    /// One narrow band, in nm.
    Band(f64),
    /// Wavelengths in nm that represent the red, green and blue channel.
    Channels([f64; 3]),
}

/// Summation method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MethodChoice {
    /// Cheapest method that meets the error.
    #[default]
    Auto,
    /// Rays with this spacing in pixels.
    #[schemars(extend("x-bare" = 1.0))]
    Rays(f64),
    /// Entry by entry, with samples this many pixels apart.
    #[schemars(extend("x-bare" = 0.5))]
    Single(f64),
    /// Entry by entry, with wavelengths this many nm apart, as in the paper.
    #[schemars(extend("x-bare" = 5.0))]
    Fixed(f64),
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
        }
    }
}

impl Operation for Settings {
    const NAME: &'static str = "lut";
    const TITLE: &'static str =
        "Lookup table of a diffraction pattern under any light, from one photograph in narrow-band light";
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.check()
    }

    fn check(&self, input: &Path) -> Result<Work> {
        check_input(input, self)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        table_into(out, input, self, progress)
    }

    fn missed(&self, report: &Report) -> Option<String> {
        let labels = ["the error at the rim, over the table's own,", "", "report.json lists its parts"];
        exceeds(Some(self.max_error), report.error_estimate, labels)
    }
}

impl Settings {
    /// Validates the options.
    ///
    /// # Errors
    /// `Input`, naming the option.
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
    /// `Input` if none is given.
    pub(super) fn bands(&self) -> Result<Wavelength> {
        let remedy = "give --wavelength-nm NM of the filter, or those of red, green and blue";
        self.wavelength_nm.ok_or_else(|| Error::input("wavelength", "is not known", remedy))
    }
}
