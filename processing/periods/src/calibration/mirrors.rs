//! Options about the light: its mirror images in photographs, and its spectrum.

use super::band::{Band, band_of};
use super::highlight::find_highlight;
use super::light::{Highlight, Known};
use nacre_base::{Error, Result};
use nacre_image::info;
use nacre_optics::color::{Illuminant, NAMES, Spectrum};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Standard deviation in px of a position picked on the page.
const PICKED_PX: f64 = 0.5;

/// Accuracy in nm of a filter's data sheet.
const DATA_SHEET_NM: f64 = 0.5;

/// Maximum number of mirrors.
const MOST: usize = 100;

/// Mirror image of the light: a photograph in which it is detected, or its position.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mirror {
    /// Photograph in which the mirror image is the only bright object.
    #[serde(default)]
    pub file: Option<String>,
    /// Position in pixels, from the left and the top.
    #[serde(default)]
    pub pixel: Option<[f64; 2]>,
    /// Height of the mirror above the sample, in mm.
    #[serde(default)]
    pub height_mm: f64,
    /// Rotation of the mirror about x and about y of the sample, in degrees.
    #[serde(default)]
    pub tilt_deg: [f64; 2],
}

/// Measurements of the light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LightOptions {
    /// Mirror images of the light.
    #[schemars(extend("x-advanced" = true))]
    pub highlights: Vec<Mirror>,
    /// Height of the light above the sample and its standard deviation, in mm, if measured otherwise.
    #[schemars(extend("x-advanced" = true))]
    pub light_height_mm: Option<[f64; 2]>,
    /// Wavelength in nm, if known.
    pub wavelength_nm: Option<f64>,
    /// Standard deviation of the wavelength in nm (default: 0.5).
    #[schemars(extend("x-advanced" = true))]
    pub wavelength_sigma_nm: Option<f64>,
    /// Spectrum of the lamp by name, with filter and response in place of the wavelength: E, A, D65, FL1 to FL12,
    /// LED-B1, LED-B3.
    #[schemars(extend("x-advanced" = true))]
    pub lamp: Option<String>,
    /// Transmission of the filter: pairs of wavelength in nm and transmittance.
    #[schemars(extend("x-advanced" = true))]
    pub filter: Option<Vec<[f64; 2]>>,
    /// Spectral response of the camera channel: pairs of wavelength in nm and response.
    #[schemars(extend("x-advanced" = true))]
    pub response: Option<Vec<[f64; 2]>>,
}

/// Position of a mirror image.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MirrorImage {
    /// Photograph, if the mirror image was detected in one.
    pub file: Option<String>,
    /// Pixels from the left and the top.
    pub pixel: [f64; 2],
    /// Standard deviation in px.
    pub sigma_px: f64,
    /// Height of the mirror in mm.
    pub height_mm: f64,
}

fn bad<T>(subject: &str, problem: impl std::fmt::Display, remedy: &str) -> Result<T> {
    Err(Error::input(subject, problem, remedy))
}

impl Mirror {
    fn check(&self) -> Result<()> {
        match (&self.file, self.pixel) {
            (Some(file), None) if !file.contains(['/', '\\']) && !file.starts_with('.') => Ok(()),
            (Some(file), None) => {
                bad("highlights", format!("{file:?} is no photograph of the upload"), "give its name")
            }
            (None, Some(_)) => Ok(()),
            _ => bad("highlights", "have neither or both of file and pixel", "give one of them for each mirror"),
        }
    }

    /// Position in a photograph of the folder, whose size must match the camera's.
    fn mirror_image(&self, folder: &Path, camera_px: Option<[u32; 2]>) -> Result<MirrorImage> {
        let (pixel, sigma_px) = match (&self.file, self.pixel) {
            (Some(file), _) => {
                let path = folder.join(file);
                let found = info(&path)?;
                let size = [found.width as u32, found.height as u32];
                if let Some(known) = camera_px.filter(|known| *known != size) {
                    let [[w, h], [a, b]] = [size, known];
                    let problem = format!("is {w} x {h} pixels, and the camera was calibrated at {a} x {b}");
                    return Err(Error::file(
                        &path,
                        problem,
                        "take both with the same camera, neither cropped nor scaled",
                    ));
                }
                let found = find_highlight(&path)?;
                (found.pixel, found.sigma_px)
            }
            (None, pixel) => (pixel.unwrap_or_default(), PICKED_PX),
        };
        Ok(MirrorImage { file: self.file.clone(), pixel, sigma_px, height_mm: self.height_mm })
    }
}

impl LightOptions {
    /// True if the options request no measurement of the light.
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Validates the options without reading photographs.
    pub(super) fn check(&self) -> Result<()> {
        if self.highlights.len() > MOST {
            return bad("highlights", format!("are {}", self.highlights.len()), "give at most 100 mirrors");
        }
        self.highlights.iter().try_for_each(Mirror::check)?;
        match (self.highlights.len(), self.light_height_mm) {
            (0, Some(_)) => {
                return bad("light_height_mm", "goes with no highlight", "give a photograph of the light in a mirror");
            }
            (1, None) => {
                let remedy = "give another in a mirror at another height, or light_height_mm";
                return bad("highlights", "are fewer than two", remedy);
            }
            _ => {}
        }
        if let Some(nm) = self.wavelength_nm.filter(|nm| !(200.0..=2000.0).contains(nm)) {
            return bad("wavelength_nm", format!("is {nm}"), "give 200 to 2000 nm");
        }
        if let Some(nm) = self.wavelength_sigma_nm.filter(|nm| !(0.0..=200.0).contains(nm)) {
            return bad("wavelength_sigma_nm", format!("is {nm}"), "give 0 to 200 nm");
        }
        let spectra = self.lamp.is_some() || self.filter.is_some() || self.response.is_some();
        if self.wavelength_nm.is_some() && spectra {
            return bad("wavelength_nm", "is given together with spectra", "leave one of them out");
        }
        self.band().map(drop)
    }

    /// Spectral band of lamp, filter and camera, if any is given.
    pub(super) fn band(&self) -> Result<Option<Band>> {
        let lamp = match &self.lamp {
            // Named illuminants only: a job must not read arbitrary files of this machine.
            Some(name) => match Illuminant::named(name) {
                Some(light) => Some(light.spectrum),
                None => return bad("lamp", format!("is {name:.40}"), &format!("give one of {}", NAMES.join(", "))),
            },
            None => None,
        };
        let mut others = vec![];
        for (name, points) in [("filter", &self.filter), ("response", &self.response)] {
            let Some(points) = points else { continue };
            let remedy = "give pairs of wavelength in nm and value, in rising order";
            others.push(Spectrum::new(points.clone()).map_err(|why| Error::input(name, why, remedy))?);
        }
        band_of(lamp, others)
    }

    /// Given wavelength and standard deviation in nm.
    pub(super) fn stated_nm(&self) -> Option<[f64; 2]> {
        self.wavelength_nm.map(|nm| [nm, self.wavelength_sigma_nm.unwrap_or(DATA_SHEET_NM)])
    }

    /// Positions of the mirror images, and further measurements.
    pub(super) fn measured_highlights(
        &self,
        folder: &Path,
        camera_px: Option<[u32; 2]>,
    ) -> Result<(Vec<MirrorImage>, Vec<Highlight>, Known)> {
        let mirror_images: Vec<MirrorImage> =
            self.highlights.iter().map(|m| m.mirror_image(folder, camera_px)).collect::<Result<_>>()?;
        let places = mirror_images.iter().zip(&self.highlights);
        let highlights =
            places.map(|(s, m)| Highlight { pixel: s.pixel, height_mm: m.height_mm, tilt_deg: m.tilt_deg }).collect();
        let sigma_px = mirror_images.iter().fold(PICKED_PX, |most, s| most.max(s.sigma_px));
        if !sigma_px.is_finite() {
            return bad("highlights", "are not sharp enough to be placed", "give their places in pixels");
        }
        Ok((mirror_images, highlights, Known { sigma_px, height_mm: self.light_height_mm }))
    }
}
