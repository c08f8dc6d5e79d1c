//! What the user may choose.

use nacre_base::{Error, Result};
use nacre_image::Palette;
use nacre_optics::geometry::Geometry;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Periods that can be asked for, in µm.
const PERIODS_UM: [f64; 2] = [0.1, 100.0];

/// Most tiles.
const MOST_TILES: usize = 10_000;

/// How maps are made of flash photographs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Where camera and sample are (default: `geometry.json` beside `frames.json`).
    pub geometry: Option<Geometry>,
    /// Corners of the sheet in pixels, from the top left one clockwise; without a calibrated geometry (default: found in the
    /// photograph by room light).
    pub corners_px: Option<[[f64; 2]; 4]>,
    /// Width and height of the sheet in mm.
    pub size_mm: Option<[f64; 2]>,
    /// Camera above the sheet, in mm; without a calibrated geometry.
    pub camera_mm: Option<f64>,
    /// Light above the sheet, in mm, in place of what the photographs say: its highlight tells the rest.
    pub light_height_mm: Option<f64>,
    /// Tiles to the right and down, which fill the sheet (default: one, or those found with `reference_px`).
    pub tiles: Option<[usize; 2]>,
    /// A tile in the photograph by room light: left, top, width, height in pixels; the others are found by correlation.
    pub reference_px: Option<[f64; 4]>,
    /// Leave tiles where the grid has them.
    pub unregistered: bool,
    /// Wavelength in nm (default: that of `frames.json` or of the geometry).
    pub wavelength_nm: Option<f64>,
    /// Range in µm in which all periods are known to lie.
    pub period_um: Option<[f64; 2]>,
    /// How orientations are told.
    pub orientation: Orientation,
    /// One period for all, or one per pixel.
    pub period: PeriodChoice,
    /// Whether polygons share few directions.
    pub directions: Directions,
    /// Standard deviation of the light in mm, in its plane (default: that of its highlight).
    pub light_sigma_mm: Option<f64>,
    /// Take the light's places as they are said, even where highlights lie elsewhere.
    pub trust_lights: bool,
    /// Size of a pixel of the maps on the sheet, in mm (default: that of the photographs).
    pub pixel_mm: Option<f64>,
    /// Colours of angles in pictures.
    pub palette: Palette,
    /// Leave the scale bar out of pictures.
    pub no_scale_bar: bool,
    /// Replace results that are already there.
    #[serde(skip)]
    pub overwrite: bool,
}

/// How orientations are told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Orientation {
    /// From lobes fitted over half vectors.
    #[default]
    Half,
    /// From the brightest copy and its direction towards the highlight in the image, as the paper does.
    Image,
}

/// Whether polygons share few directions and periods, so that places of the same grooves tell together what none tells alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Directions {
    /// If there is evidence for it. Periods that change gradually over the sheet can look like evidence.
    Auto,
    /// They do; areas with grooves of their own are masked.
    Shared,
    /// Each place by itself.
    #[default]
    Free,
}

/// Whether pixels share one period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PeriodChoice {
    /// Whichever has more evidence.
    #[default]
    Auto,
    /// One for all.
    Sample,
    /// One each.
    Pixel,
}

impl std::str::FromStr for Orientation {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "half" => Ok(Self::Half),
            "image" => Ok(Self::Image),
            _ => Err(format!("{text:?} is none of half, image")),
        }
    }
}

impl std::str::FromStr for Directions {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "shared" => Ok(Self::Shared),
            "free" => Ok(Self::Free),
            _ => Err(format!("{text:?} is none of auto, shared, free")),
        }
    }
}

impl std::str::FromStr for PeriodChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "sample" => Ok(Self::Sample),
            "pixel" => Ok(Self::Pixel),
            _ => Err(format!("{text:?} is none of auto, sample, pixel")),
        }
    }
}

impl Settings {
    /// Refuses what makes no sense.
    ///
    /// # Errors
    /// `Input`, which names the setting.
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
                let remedy = "give either a geometry, or --corners and --camera-mm";
                return Err(Error::input("--corners, --camera-mm", "do not go with a geometry", remedy));
            }
        }
        for value in self.corners_px.iter().flatten().flatten() {
            within("--corners", Some(*value), -1e5, 1e5)?;
        }
        for value in self.size_mm.iter().flatten() {
            within("--size-mm", Some(*value), 0.1, 1e5)?;
        }
        within("--camera-mm", self.camera_mm, 1.0, 1e6)?;
        within("--light-height-mm", self.light_height_mm, 1.0, 1e6)?;
        within("--wavelength", self.wavelength_nm, 200.0, 2000.0)?;
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
            && !(1..=MOST_TILES).contains(&columns.saturating_mul(rows))
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
