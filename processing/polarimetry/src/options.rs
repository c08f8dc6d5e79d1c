//! Options of a reconstruction.

use crate::fit::views::brackets;
use crate::{Align, Demosaic, Model, Oblique, PeriodMethod, Smoothing};
use nacre_base::{Error, Result};
use nacre_frames::{Illumination, LoadedFrames};
use nacre_image::Palette;

/// What the user may choose.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The model; [`Options::model_for`] says which one is the default.
    pub model: Option<Model>,
    /// Whether photographs are moved back onto each other; [`Options::align_for`] says which is the default.
    pub align: Option<Align>,
    /// Whether oblique incidence is taken out.
    pub oblique: Oblique,
    /// How images behind each polarizer of a sensor are made.
    pub demosaic: Demosaic,
    /// Added to every orientation, to fix the gauge (degrees).
    pub offset_deg: f64,
    /// How orientations are smoothed in pictures.
    pub smooth: Smoothing,
    /// Smooth the map itself as well.
    pub smooth_maps: bool,
    /// Also write `smoothed.exr`, the smoothed orientations at full size.
    pub smoothed_exr: bool,
    /// Makes a map of periods, too.
    pub period: Option<PeriodMethod>,
    /// Colours of angles in pictures.
    pub palette: Palette,
    /// Leave the scale bar out of pictures. They have one where `pixel_um` of the geometry is known.
    pub no_scale_bar: bool,
    /// Replace results that are already there.
    pub overwrite: bool,
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
