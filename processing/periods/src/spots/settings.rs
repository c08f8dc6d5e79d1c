//! What a user may say.

use super::answer::Demands;
use nacre_base::{Error, Result};
use nacre_image::Palette;
use nacre_optics::geometry::Geometry;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Options of `reconstruct spots`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Where everything stands, as geometry.json says it; the distances of frames.json when it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Box<Geometry>>,
    /// Effective wavelength in nm, of light, filter and camera together; that of the geometry or of frames.json when it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Standard deviation of that in nm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_sigma_nm: Option<f64>,
    /// Width and height of the panel in mm; those of the geometry or of frames.json when they are not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub panel_mm: Option<[f64; 2]>,
    /// Diameter of the camera's aperture in mm; found from the photographs when it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aperture_mm: Option<f64>,
    /// Shortest and longest period that is looked for, in µm.
    pub periods_um: [f64; 2],
    /// How far the mirror direction may be from where the geometry puts it, one standard deviation in degrees: an uneven surface.
    pub mirror_deg: f64,
    /// Colours of angles in pictures.
    pub palette: Palette,
    /// Leave the scale bar out of pictures. They have one where `pixel_um` is known.
    pub no_scale_bar: bool,
    /// A folder of `reconstruct polarization` whose orientations help where fringes alone do not tell.
    #[serde(skip)]
    #[schemars(skip)]
    pub polarization: Option<PathBuf>,
    /// Replace results that are already there.
    #[serde(skip)]
    #[schemars(skip)]
    pub overwrite: bool,
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
            overwrite: false,
        }
    }
}

impl Settings {
    /// Checks every number.
    ///
    /// # Errors
    /// `Input`, naming the setting.
    pub fn check(&self) -> Result<()> {
        let within = |name: &str, value: Option<f64>, low: f64, high: f64| match value {
            Some(v) if !(low..=high).contains(&v) => {
                Err(Error::input(name, format!("is {v}"), format!("give a number from {low} to {high}")))
            }
            _ => Ok(()),
        };
        within("--wavelength", self.wavelength_nm, 200.0, 2000.0)?;
        within("--wavelength-sigma", self.wavelength_sigma_nm, 0.0, 100.0)?;
        within("--aperture", self.aperture_mm, 0.01, 200.0)?;
        within("--mirror", Some(self.mirror_deg), 0.001, 5.0)?;
        for side in self.panel_mm.into_iter().flatten() {
            within("--panel", Some(side), 1.0, 1e5)?;
        }
        if let Some(geometry) = &self.geometry {
            geometry.check()?;
        }
        let [short, long] = self.periods_um;
        within("--periods", Some(short), 0.2, 1000.0)?;
        within("--periods", Some(long), 0.2, 1000.0)?;
        if short >= long {
            return Err(Error::input(
                "--periods",
                format!("runs from {short} to {long}"),
                "give the shorter one first",
            ));
        }
        Ok(())
    }

    /// What a pixel's answer must be.
    pub fn demands(&self) -> Demands {
        let mirror_sigma = self.mirror_deg.to_radians();
        Demands { periods_um: self.periods_um, mirror_sigma, ..Demands::default() }
    }
}
