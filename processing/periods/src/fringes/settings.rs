//! Options of the fringe reconstruction.

use super::answer::Demands;
use super::reconstruct::{check_input, solve_into};
use super::report::Report;
use nacre_base::estimate::Work;
use nacre_base::operation::Operation;
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_image::Palette;
use nacre_optics::geometry::Geometry;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Measure orientation and absolute period of gratings from fringes on the display.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend(
    "x-input" = "A session of kind spots with fringes, a frames.json or a folder holding one",
    "x-examples" = "\
Examples:
  nacre reconstruct spots session --out periods
  nacre reconstruct spots session --geometry geometry.json --wavelength-nm 560 --wavelength-sigma-nm 1 --out periods
  nacre reconstruct spots session --polarization maps --periods-um 1.2:3 --out periods

with a session that was taken by a plan such as:
  kind = \"spots\"
  spots = { fringes = { count = 12, phases = 4, finest_mm = 28 } }
  extras = [\"display_black\"]

Writes orientation.exr (orientation, sigma in rad, mask), period.exr (period, sigma in µm, mask), orientation.png, period.png
and report.json. Pixels whose light no single grating explains, whose orders miss the panel, or which two gratings
explain, are masked."
))]
#[schemars(rename = "FringesOptions")]
pub struct Settings {
    /// Positions of camera, sample and display (geometry.json; default: the distances of frames.json).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-file" = true))]
    pub geometry: Option<Box<Geometry>>,
    /// Effective wavelength of light, filter and camera together, in nm (default: that of the geometry or of
    /// frames.json).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-aliases" = ["wavelength"]))]
    pub wavelength_nm: Option<f64>,
    /// Standard deviation of the effective wavelength in nm; it contributes to the σ of all periods.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-aliases" = ["wavelength-sigma"]))]
    pub wavelength_sigma_nm: Option<f64>,
    /// Width and height of the display in mm (default: those of the geometry or of frames.json).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "WxH", "x-aliases" = ["panel"]))]
    pub panel_mm: Option<[f64; 2]>,
    /// Diameter of the camera's aperture in mm (default: estimated from the photographs).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true, "x-aliases" = ["aperture"]))]
    pub aperture_mm: Option<f64>,
    /// Shortest and longest period considered, in µm.
    #[schemars(extend("x-placeholder" = "MIN:MAX", "x-aliases" = ["periods"]))]
    pub periods_um: [f64; 2],
    /// Standard deviation of the mirror direction about that of a plane surface, in degrees: an uneven sample.
    #[schemars(extend("x-advanced" = true, "x-aliases" = ["mirror"]))]
    pub mirror_deg: f64,
    /// Colour map of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    #[schemars(extend("x-advanced" = true))]
    pub palette: Palette,
    /// Leave the scale bar out of pictures. They have one where the pixel size on the sample is known.
    #[schemars(extend("x-advanced" = true))]
    pub no_scale_bar: bool,
    /// Results of `reconstruct polarization` of the same sample and camera, which decide between gratings.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "DIR", "x-file" = true))]
    pub polarization: Option<PathBuf>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            geometry: None,
            wavelength_nm: None,
            wavelength_sigma_nm: None,
            panel_mm: None,
            aperture_mm: None,
            periods_um: [0.7, 4.0],
            mirror_deg: 0.2,
            palette: Palette::default(),
            no_scale_bar: false,
            polarization: None,
        }
    }
}

impl Operation for Settings {
    const NAME: &'static str = "spots";
    const TITLE: &'static str = "Orientation and absolute period of gratings from fringes on the panel";
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.check()
    }

    fn check(&self, input: &Path) -> Result<Work> {
        check_input(input, self)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        solve_into(out, input, self, progress)
    }
}

impl Settings {
    /// Validates all numbers.
    ///
    /// # Errors
    /// `Input`, naming the option.
    pub fn check(&self) -> Result<()> {
        let within = |name: &str, value: Option<f64>, low: f64, high: f64| match value {
            Some(v) if !(low..=high).contains(&v) => {
                Err(Error::input(name, format!("is {v}"), format!("give a number from {low} to {high}")))
            }
            _ => Ok(()),
        };
        within("--wavelength-nm", self.wavelength_nm, 200.0, 2000.0)?;
        within("--wavelength-sigma-nm", self.wavelength_sigma_nm, 0.0, 100.0)?;
        within("--aperture-mm", self.aperture_mm, 0.01, 200.0)?;
        within("--mirror-deg", Some(self.mirror_deg), 0.001, 5.0)?;
        for side in self.panel_mm.into_iter().flatten() {
            within("--panel-mm", Some(side), 1.0, 1e5)?;
        }
        if let Some(geometry) = &self.geometry {
            geometry.check()?;
        }
        let [short, long] = self.periods_um;
        within("--periods-um", Some(short), 0.2, 1000.0)?;
        within("--periods-um", Some(long), 0.2, 1000.0)?;
        if short >= long {
            return Err(Error::input(
                "--periods-um",
                format!("runs from {short} to {long}"),
                "give the shorter one first",
            ));
        }
        Ok(())
    }

    /// Requirements on a pixel's response.
    pub fn demands(&self) -> Demands {
        let mirror_sigma = self.mirror_deg.to_radians();
        Demands { periods_um: self.periods_um, mirror_sigma, ..Demands::default() }
    }
}
