//! Options of the flash reconstruction.

use nacre_base::{Error, Result};
use nacre_image::Palette;
use nacre_optics::geometry::Geometry;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Permitted range of periods in µm.
const PERIODS_UM: [f64; 2] = [0.1, 100.0];

/// Maximum number of tiles.
const MAX_TILES: usize = 10_000;

/// Reconstruct orientation and absolute period of gratings on a sheet of repeated tiles, from photographs under a
/// flash.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "FlashOptions", extend(
    "x-input" = "Session folder or frames.json of flash photographs",
    "x-examples" = EXAMPLES
))]
pub struct Settings {
    /// Positions of camera and sheet (geometry.json; default: the one beside the photographs).
    #[schemars(extend("x-file" = true))]
    pub geometry: Option<Geometry>,
    /// Corners of the sheet in pixels, without a calibrated geometry: top left, top right, bottom right, bottom left.
    /// auto detects them in the photograph under room light.
    #[schemars(extend("x-placeholder" = "auto|X,Y,X,Y,X,Y,X,Y", "x-unset" = "auto", "x-aliases" = ["corners"]))]
    pub corners_px: Option<[[f64; 2]; 4]>,
    /// Width and height of the sheet in mm.
    #[schemars(extend("x-placeholder" = "WxH"))]
    pub size_mm: Option<[f64; 2]>,
    /// Height of the camera above the sheet in mm, without a calibrated geometry.
    pub camera_mm: Option<f64>,
    /// Height of the light above the sheet in mm, in place of that of the photographs; its position follows from the
    /// highlight.
    pub light_height_mm: Option<f64>,
    /// Number of tiles to the right and down, which fill the sheet (default: one, or those found with reference_px).
    #[schemars(extend("x-placeholder" = "NxM"))]
    pub tiles: Option<[usize; 2]>,
    /// A tile in the photograph by room light: left, top, width and height in pixels. The others are found by
    /// correlation.
    #[schemars(extend("x-placeholder" = "X,Y,W,H"))]
    pub reference_px: Option<[f64; 4]>,
    /// Leave tiles on their grid, rather than registering each with the others.
    #[schemars(extend("x-advanced" = true))]
    pub unregistered: bool,
    /// Wavelength in nm (default: that of frames.json or of the geometry).
    #[schemars(extend("x-aliases" = ["wavelength"]))]
    pub wavelength_nm: Option<f64>,
    /// Range in µm in which all periods are known to lie; distinguishes first orders from second ones.
    #[schemars(extend("x-placeholder" = "MIN:MAX"))]
    pub period_um: Option<[f64; 2]>,
    /// Orientations: half fits lobes over half vectors, image is the direction to the highlight in the image (2018
    /// paper).
    #[schemars(extend("x-advanced" = true))]
    pub orientation: Orientation,
    /// One period for all pixels, or one each; auto is that with more evidence.
    pub period: PeriodChoice,
    /// Shared gratings: places with the same grooves are fitted together, so that one photograph can be enough. auto
    /// decides by evidence.
    ///
    /// Periods that change gradually over the sheet can look like evidence. shared masks areas with grooves of their
    /// own.
    pub directions: Directions,
    /// Standard deviation of the light in its plane, in mm (default: that of its highlight).
    #[schemars(extend("x-advanced" = true))]
    pub light_sigma_mm: Option<f64>,
    /// Trust stated positions of lights, even where their highlights contradict.
    #[schemars(extend("x-advanced" = true))]
    pub trust_lights: bool,
    /// Size of a map pixel on the sheet in mm (default: that of the photographs).
    #[schemars(extend("x-advanced" = true))]
    pub pixel_mm: Option<f64>,
    /// Colour map of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    #[schemars(extend("x-advanced" = true))]
    pub palette: Palette,
    /// Leave the scale bar out of pictures.
    #[schemars(extend("x-advanced" = true))]
    pub no_scale_bar: bool,
    /// Largest acceptable σ of a typical orientation in degrees.
    ///
    /// The results are written in any case; the exit code is 1 when it is larger.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "DEG"))]
    pub max_error: Option<f64>,
}

/// Command lines of the help.
const EXAMPLES: &str = "\
Examples:
  nacre sim photograph tiles --out photos                                       a sheet of 10 × 8 tiles under five lights
  nacre reconstruct flash photos --tiles 10x8 --size-mm 297x210 --out maps
  nacre reconstruct flash photos --reference-px 460,310,116,103 --out maps      the other tiles are found by correlation
  nacre reconstruct flash photos --tiles 10x8 --size-mm 297x210 --geometry geometry.json --period-um 1.2:2.4 --out maps
  nacre reconstruct flash photos --tiles 10x8 --size-mm 297x210 --camera-mm 500 --light-height-mm 200 --out maps
                                                                                no calibration: periods are relative

Photographs are a set of kind flash: frames.json states for each the position of the flash (light_mm: right and up of the sheet's
middle and above it), and one with \"flash\": false, by room light, shows where the tiles lie. The geometry is that of
`nacre calibrate geometry`, by default geometry.json beside frames.json. Without one, the corners of the sheet (detected by
room light, or --corners-px), its size and the camera's distance suffice, for a camera over the middle of its picture.

Writes orientation.exr (orientation, sigma in rad, mask), period.exr (period, sigma in µm, mask), orientation.png,
period.png (lines per mm), sigma.png and report.json. Pixels are masked where nothing is lit, where several gratings or
orders explain the light, and where too few copies are near a lobe.";

/// Method of orientation measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Orientation {
    /// Fit of lobes over half vectors.
    #[default]
    Half,
    /// Direction from the brightest copy to the highlight in the image (2018 paper).
    Image,
}

/// Shared directions and periods of polygons, which permit joint fits where single positions are undetermined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Directions {
    /// Shared if there is evidence. Periods that change gradually over the sheet can look like evidence.
    Auto,
    /// Shared; areas with other gratings are masked.
    Shared,
    /// Each position independently.
    #[default]
    Free,
}

/// Common or individual periods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PeriodChoice {
    /// The alternative with more evidence.
    #[default]
    Auto,
    /// One period for all pixels.
    Sample,
    /// One period per pixel.
    Pixel,
}

impl Settings {
    /// Validates the options.
    ///
    /// # Errors
    /// `Input`, naming the option.
    pub fn check(&self) -> Result<()> {
        let within = |what: &str, value: Option<f64>, low: f64, high: f64| match value {
            Some(v) if !(low..=high).contains(&v) => {
                Err(Error::input(what, format!("is {v}"), format!("give {low} to {high}")))
            }
            _ => Ok(()),
        };
        if let Some(geometry) = &self.geometry {
            geometry.check()?;
            if self.corners_px.is_some() || self.camera_mm.is_some() {
                let remedy = "give either a geometry, or --corners-px and --camera-mm";
                return Err(Error::input("--corners-px, --camera-mm", "do not go with a geometry", remedy));
            }
        }
        for value in self.corners_px.iter().flatten().flatten() {
            within("--corners-px", Some(*value), -1e5, 1e5)?;
        }
        for value in self.size_mm.iter().flatten() {
            within("--size-mm", Some(*value), 0.1, 1e5)?;
        }
        within("--camera-mm", self.camera_mm, 1.0, 1e6)?;
        within("--light-height-mm", self.light_height_mm, 1.0, 1e6)?;
        within("--wavelength-nm", self.wavelength_nm, 200.0, 2000.0)?;
        within("--light-sigma-mm", self.light_sigma_mm, 1e-3, 1e3)?;
        within("--pixel-mm", self.pixel_mm, 1e-4, 1e3)?;
        if let Some([x, y, w, h]) = self.reference_px {
            if self.tiles.is_some() {
                let remedy = "give either one tile, or how many there are";
                return Err(Error::input("--tiles", "do not go with --reference-px", remedy));
            }
            if !([x, y].iter().all(|v| (0.0..=1e5).contains(v)) && [w, h].iter().all(|v| (8.0..=1e5).contains(v))) {
                let problem = format!("is {:?}", [x, y, w, h]);
                return Err(Error::input(
                    "--reference-px",
                    problem,
                    "give left, top, width and height, 8 pixels and more",
                ));
            }
        }
        if let Some([columns, rows]) = self.tiles
            && !(1..=MAX_TILES).contains(&columns.saturating_mul(rows))
        {
            return Err(Error::input("--tiles", format!("are {columns} × {rows}"), "give 1 to 10000 in all"));
        }
        match self.period_um {
            Some([low, high]) if !(low >= PERIODS_UM[0] && high <= PERIODS_UM[1] && low < high) => {
                Err(Error::input("--period-um", format!("is {low}:{high}"), "give MIN:MAX between 0.1 and 100 µm"))
            }
            _ => Ok(()),
        }
    }
}
