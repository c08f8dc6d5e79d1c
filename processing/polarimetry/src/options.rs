//! Options of a reconstruction.

use crate::fit::views::brackets;
use crate::{Align, Demosaic, Metal, Model, Oblique, PeriodMethod, Report, Running, Smoothing};
use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, exceeds};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{Illumination, LoadedFrames, load};
use nacre_image::Palette;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Reconstruct orientation, angle and degree of polarization from photographs behind a rotating analyser or a
/// polarization sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend(
    "x-input" = "Session folder, frames.json, or a folder holding one (`nacre import` makes one for your photographs)",
    "x-examples" = "\
Examples:
  nacre reconstruct polarization session --out result
  nacre reconstruct polarization series/frames.json --out result --force --json
  nacre reconstruct polarization series --out result --model auto
  nacre reconstruct polarization sensor --out result --demosaic edge-aware
  nacre reconstruct polarization session --out result --offset-deg 12.5 --smooth strong
  nacre reconstruct polarization session --out result --contrast-period 1.2:3 --depth-um 0.1
  nacre reconstruct polarization session --out result --relative-period 0.7:2

The model plain writes stokes.exr (S0 S1 S2 sigma_S0), aolp.exr (aolp dolp sigma sigma_dolp mask
correlation), aolp.png, dolp.png, sigma.png and report.json. Models of gratings write
orientation.exr (orientation sigma mask correlation) and orientation.png (smoothed) in place of
aolp.png; with periods also period.exr (period sigma mask) and period.png. Orientations are
relative: one unknown offset, common to all pixels, remains, unless the photographs name a
calibration of orientations (`nacre calibrate orientation`)."
))]
#[schemars(rename = "PolarizationOptions")]
pub struct Options {
    /// Model: plain, or how the fitted phase becomes the orientation of a grating (default: auto for capture sessions,
    /// plain for other photographs).
    ///
    /// plain: Stokes parameters, angle and degree of linear polarization. auto: the simplest grating model that
    /// explains the data. sinusoid: the phase is the orientation. prenormalized: the phase about the mean of all
    /// pixels. circle: the phase about the centre of the circle on which they lie. curve: the closest point on the
    /// curve of the fitted film.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<Model>,
    /// Registration: auto corrects shifts between photographs if that reduces the error, off never does (default: auto
    /// for grating models, off for plain).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub align: Option<Align>,
    /// Correction of oblique incidence: auto applies it if the camera geometry is known and improves the fit; off
    /// includes the effect in σ.
    #[schemars(extend("x-advanced" = true))]
    pub oblique: Oblique,
    /// Full-size maps of a monochrome polarization sensor: interpolation of the image behind each polarizer (model
    /// plain).
    ///
    /// none: one map pixel per 2×2 super-pixel, the fastest and least noisy. bilinear: means of the nearest pixels.
    /// edge-aware: Newton polynomials of the difference between polarizers, along edges (Li et al. 2019).
    #[schemars(extend("x-advanced" = true))]
    pub demosaic: Demosaic,
    /// Offset added to every orientation, in degrees (default: that of the photographs' calibration, or 0).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub offset_deg: Option<f64>,
    /// Smoothing of orientations in pictures: none, light (10 rounds of a bilateral filter), strong (50) or a number of
    /// rounds.
    #[schemars(extend("x-advanced" = true))]
    pub smooth: Smoothing,
    /// Also smooth orientation.exr and its σ.
    #[schemars(extend("x-advanced" = true))]
    pub smooth_maps: bool,
    /// Also write smoothed.exr: the smoothed orientations at full size.
    #[schemars(extend("x-advanced" = true))]
    pub smoothed_exr: bool,
    /// Heuristic periods from the brightness, scaled to MIN:MAX µm.
    ///
    /// Method of the 2018 paper (section 5.4). Only the order of the periods is meaningful, and uneven light or
    /// reflectance appears as a change of period.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "MIN:MAX", "x-advanced" = true))]
    pub relative_period: Option<[f64; 2]>,
    /// Periods from the degree of polarization, known to lie within MIN:MAX µm, for an assumed surface (needs its
    /// depth).
    ///
    /// Off by 11 to 18 % for every 10 % of error in depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "MIN:MAX", "x-advanced" = true))]
    pub contrast_period: Option<[f64; 2]>,
    /// Assumed peak-to-peak depth of the grating in µm, for contrast_period.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub depth_um: Option<f64>,
    /// Assumed metal, for contrast_period: aluminium (default), silver, gold, chromium (near 560 nm), or its refractive
    /// index N,K.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "METAL|N,K", "x-advanced" = true))]
    pub metal: Option<Metal>,
    /// Assumed refractive index above the metal, for contrast_period (default: 1).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub index_above: Option<f64>,
    /// Wavelength in nm, for contrast_period (default: that of the photographs).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub wavelength_nm: Option<f64>,
    /// Largest acceptable error of a typical orientation in degrees, all known terms included.
    ///
    /// The results are written in any case; the exit code is 1 when the estimate is larger or cannot be made.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub max_error: Option<f64>,
    /// Colour map of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    #[schemars(extend("x-advanced" = true))]
    pub palette: Palette,
    /// Leave the scale bar out of pictures. They have one where the pixel size on the sample is known.
    #[schemars(extend("x-advanced" = true))]
    pub no_scale_bar: bool,
}

impl Operation for Options {
    const NAME: &'static str = "polarization";
    const TITLE: &'static str =
        "Orientation of gratings from photographs behind a turning analyser, or from a polarization sensor";
    type Report = Report;

    fn check(&self, input: &Path) -> Result<Work> {
        let frames = load(input)?;
        self.check(&frames)?;
        self.work(&frames)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let mut running = Running::new(load(input)?, self.demosaic)?;
        running.add_all(progress)?;
        running.finish(out, self, progress)
    }

    fn missed(&self, report: &Report) -> Option<String> {
        let remedy = "add analyser angles, expose longer, or heed the warnings";
        exceeds(self.max_error, report.error_estimate_deg, ["the estimated error", "°", remedy])
    }
}

impl Options {
    /// The model to use. Default: [`Model::Auto`] if the sample was lit by a circularly polarized display, as grating
    /// models assume, and [`Model::Plain`] under other light. Sessions of older versions do not state their light; it
    /// was the circularly polarized display.
    pub fn model_for(&self, frames: &LoadedFrames) -> Model {
        let circular = match frames.set.illumination {
            Illumination::CircularPanel => true,
            Illumination::Unknown => frames.from_session,
            Illumination::LinearPanel | Illumination::Other => false,
        };
        self.model.unwrap_or(if circular { Model::Auto } else { Model::Plain })
    }

    /// Whether photographs are registered. Default: under grating models. Plain polarimetry leaves the photographs
    /// unchanged and reports shifts.
    pub fn align_for(&self, frames: &LoadedFrames) -> Align {
        self.align.unwrap_or(if self.model_for(frames) == Model::Plain { Align::Off } else { Align::Auto })
    }

    /// Offset of orientations in degrees, as requested or calibrated.
    pub(crate) fn offset_for(&self, frames: &LoadedFrames) -> f64 {
        let calibrated = frames.set.calibration.as_ref().and_then(|c| c.orientation.as_ref());
        self.offset_deg.or(calibrated.map(|o| o.offset_deg)).unwrap_or(0.0)
    }

    /// Checks the options before any processing; returns the method of periods, with the photographs' wavelength.
    ///
    /// # Errors
    /// `Input` for invalid numbers, and if the wavelength is unknown.
    pub fn check(&self, frames: &LoadedFrames) -> Result<Option<PeriodMethod>> {
        if let Some(offset) = self.offset_deg.filter(|o| !o.is_finite()) {
            return Err(Error::input("--offset-deg", format!("{offset} is no angle"), "give finite degrees"));
        }
        if (self.smooth_maps || self.smoothed_exr) && self.smooth == Smoothing::NONE {
            let problem = "a smoothed map was asked for, but the smoothing is none";
            return Err(Error::input("--smooth", problem, "choose light, strong or a number of rounds"));
        }
        if self.model_for(frames) == Model::Plain {
            self.check_plain()?;
        }
        if self.demosaic != Demosaic::None {
            self.check_demosaic(frames)?;
        }
        self.period_method()?.map(|p| p.completed(frames.set.wavelength_nm)).transpose()
    }

    /// The requested method of periods.
    fn period_method(&self) -> Result<Option<PeriodMethod>> {
        let assumed = [
            ("--depth-um", self.depth_um.is_some()),
            ("--metal", self.metal.is_some()),
            ("--index-above", self.index_above.is_some()),
            ("--wavelength-nm", self.wavelength_nm.is_some()),
        ];
        let refuse = |name: &str, problem: &str, remedy: &str| Err(Error::input(name, problem, remedy));
        match (self.relative_period, self.contrast_period) {
            (Some(_), Some(_)) => {
                refuse("--relative-period", "does not go with --contrast-period", "give one of the two")
            }
            (None, Some(range_um)) => {
                let remedy = "add the peak-to-peak depth of the grating";
                let missing = || Error::input("--depth-um", "is needed by --contrast-period", remedy);
                Ok(Some(PeriodMethod::Contrast {
                    range_um,
                    depth_um: self.depth_um.ok_or_else(missing)?,
                    metal: self.metal.unwrap_or_default(),
                    index_above: self.index_above.unwrap_or(1.0),
                    wavelength_nm: self.wavelength_nm,
                }))
            }
            (relative, None) => match assumed.iter().find(|(_, given)| *given) {
                Some((name, _)) => refuse(name, "belongs to --contrast-period", "add that, or leave it out"),
                None => Ok(relative.map(|range_um| PeriodMethod::Brightness { range_um })),
            },
        }
    }

    /// Sets a method of periods, as stated by requests and jobs of earlier versions.
    #[must_use]
    pub fn with_period(self, method: &PeriodMethod) -> Self {
        match method.clone() {
            PeriodMethod::Brightness { range_um } => Self { relative_period: Some(range_um), ..self },
            PeriodMethod::Contrast { range_um, depth_um, metal, index_above, wavelength_nm } => Self {
                contrast_period: Some(range_um),
                depth_um: Some(depth_um),
                metal: Some(metal),
                index_above: Some(index_above),
                wavelength_nm,
                ..self
            },
        }
    }

    /// Refuses interpolation of photographs other than raw frames of a monochrome sensor, and models that require
    /// independent pixels.
    fn check_demosaic(&self, frames: &LoadedFrames) -> Result<()> {
        let colour = frames.set.filters().is_some_and(|f| f.colour.is_some());
        let (problem, remedy) = if frames.set.layout.is_none() {
            ("interpolates raw frames of polarization sensors, and these photographs are none", "leave it out")
        } else if colour {
            ("interpolates frames of monochrome sensors, and this one has colour filters", "leave it out")
        } else if brackets(&frames.set.frames).iter().any(|b| b.len() > 1) {
            ("cannot merge exposures", "leave it out, or give the frames of one exposure")
        } else if self.model_for(frames) != Model::Plain {
            (
                "shares noise between pixels, which models of gratings count as independent",
                "leave it out, or add --model plain",
            )
        } else {
            return Ok(());
        };
        Err(Error::input("--demosaic", problem, remedy))
    }

    /// Refuses options without effect in plain polarimetry.
    fn check_plain(&self) -> Result<()> {
        let of_gratings = [
            ("--offset-deg", self.offset_deg.is_some_and(|o| o != 0.0)),
            ("--oblique", self.oblique != Oblique::Off),
            ("--smooth-maps", self.smooth_maps),
            ("--smoothed-exr", self.smoothed_exr),
            ("--contrast-period", self.contrast_period.is_some()),
            ("--relative-period", self.relative_period.is_some()),
        ];
        match of_gratings.into_iter().find(|(_, given)| *given) {
            Some((option, _)) => {
                let problem = "belongs to models of gratings, and the model is plain";
                Err(Error::input(option, problem, "leave it out, or add --model auto if this is a grating"))
            }
            None => Ok(()),
        }
    }
}
