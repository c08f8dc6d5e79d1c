//! Options of a reconstruction.

use crate::fit::views::brackets;
use crate::{Align, Demosaic, Model, Oblique, PeriodMethod, Report, Running, Smoothing};
use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, exceeds};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{Illumination, LoadedFrames, load};
use nacre_image::Palette;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Reconstruct orientation, angle and degree of polarization from photographs behind a rotating analyser or a polarization sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-input" = "Session folder, frames.json, or a folder holding one (`nacre import` makes one for your photographs)"))]
#[schemars(rename = "PolarizationOptions")]
pub struct Options {
    /// Model: plain, or how the fitted phase becomes the orientation of a grating (default: auto for capture sessions, plain for other
    /// photographs).
    ///
    /// plain: Stokes parameters, angle and degree of linear polarization. auto: the simplest grating model that explains the data. sinusoid:
    /// the phase is the orientation. prenormalized: the phase about the mean of all pixels. circle: the phase about the centre of the circle
    /// on which they lie. curve: the closest point on the curve of the fitted film.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<Model>,
    /// auto corrects shifts between photographs where that reduces the error; off leaves them (default: auto for models of gratings, off for
    /// plain).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub align: Option<Align>,
    /// auto corrects for oblique incidence where the camera geometry is known and the photographs fit better with it; off leaves it, and σ
    /// includes it.
    pub oblique: Oblique,
    /// Full-size maps of a monochrome polarization sensor: interpolation of the image behind each polarizer (model plain).
    ///
    /// none: one map pixel per 2×2 super-pixel, the fastest and least noisy. bilinear: means of the nearest pixels. edge-aware: Newton
    /// polynomials of the difference between polarizers, along edges (Li et al. 2019).
    pub demosaic: Demosaic,
    /// Offset added to every orientation, in degrees.
    pub offset_deg: f64,
    /// Smoothing of orientations in pictures: none, light (10 rounds of a bilateral filter), strong (50) or a number of rounds.
    pub smooth: Smoothing,
    /// Also smooth orientation.exr and its σ.
    pub smooth_maps: bool,
    /// Also write smoothed.exr: the smoothed orientations at full size.
    pub smoothed_exr: bool,
    /// Also make a map of periods, from the brightness (heuristic) or from the degree of polarization for an assumed surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<PeriodMethod>,
    /// Largest acceptable error of a typical orientation in degrees, all known terms included. The results are written in any case, but the
    /// exit code is 1 when the estimate is larger or cannot be made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_error: Option<f64>,
    /// Colour map of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    pub palette: Palette,
    /// Leave the scale bar out of pictures. They have one where the pixel size on the sample is known.
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
    /// The model asked for. By default [`Model::Auto`] where the sample was lit by a circular panel, which models of gratings assume, and
    /// [`Model::Plain`] under other light. Sessions of older versions do not state their light: it was the circular panel.
    pub fn model_for(&self, frames: &LoadedFrames) -> Model {
        let circular = match frames.set.illumination {
            Illumination::CircularPanel => true,
            Illumination::Unknown => frames.from_session,
            Illumination::LinearPanel | Illumination::Other => false,
        };
        self.model.unwrap_or(if circular { Model::Auto } else { Model::Plain })
    }

    /// Whether photographs are moved back. By default under models of gratings; plain polarimetry leaves the photographs as they are, and says where
    /// they are shifted.
    pub fn align_for(&self, frames: &LoadedFrames) -> Align {
        self.align.unwrap_or(if self.model_for(frames) == Model::Plain { Align::Off } else { Align::Auto })
    }

    /// Refuses what makes no sense, before anything is done; returns how periods are told, with the photographs' wavelength.
    ///
    /// # Errors
    /// `Input`, for numbers that make no sense and for a wavelength that nothing says.
    pub fn check(&self, frames: &LoadedFrames) -> Result<Option<PeriodMethod>> {
        if !self.offset_deg.is_finite() {
            return Err(Error::input(
                "--offset-deg",
                format!("{} is no angle", self.offset_deg),
                "give finite degrees",
            ));
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
        self.period.as_ref().map(|p| p.completed(frames.set.wavelength_nm)).transpose()
    }

    /// Refuses interpolated images of what is no raw frame of a monochrome sensor, and models that need independent pixels.
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

    /// Refuses options that plain polarimetry has no use for.
    fn check_plain(&self) -> Result<()> {
        let of_gratings = [
            ("--offset-deg", self.offset_deg != 0.0),
            ("--oblique", self.oblique != Oblique::Off),
            ("--smooth-maps", self.smooth_maps),
            ("--smoothed-exr", self.smoothed_exr),
            ("--contrast-period", matches!(self.period, Some(PeriodMethod::Contrast { .. }))),
            ("--relative-period", matches!(self.period, Some(PeriodMethod::Brightness { .. }))),
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
