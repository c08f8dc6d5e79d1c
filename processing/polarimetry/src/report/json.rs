//! `report.json`: processing steps, reasons, and quality of the result.

use crate::film::choose::Choice;
use crate::film::classes::{Class, Classes};
use crate::orientation::smooth::SPACE_SIGMA_PX;
use crate::report::errors::Systematic;
use crate::solve::Solved;
use crate::{
    Alignment, CircleCheck, Demosaic, Design, ErrorReport, FrameNoise, Illumination, Model, ModelReport, NoiseSource,
    ObliqueReport, Options, PeriodReport, RepeatsReport, Smoothing,
};
use nacre_frames::{Calibration, Channel, LoadedFrames};
use nacre_image::Palette;
use schemars::JsonSchema;
use serde::Serialize;

/// Result of a polarization reconstruction, as text and numbers.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "PolarizationReport")]
pub struct Report {
    /// Always `polarization`.
    pub method: &'static str,
    /// The model used.
    pub model: String,
    /// Reason for the model.
    pub model_reason: String,
    /// Warnings about the map; empty if there are none.
    pub warnings: Vec<String>,
    /// Width of the map in pixels.
    pub width: usize,
    /// Height of the map in pixels.
    pub height: usize,
    /// Origin of the maps in frames of a polarization sensor; `None` for other photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorReport>,
    /// Pixel counts and quality.
    pub pixels: Pixels,
    /// The noise model behind σ.
    pub noise: NoiseReport,
    /// Expected error of a typical orientation: the total of the terms below. `None` if the model's error is unknown,
    /// or for errors that cannot be expressed in degrees.
    pub error_estimate_deg: Option<f64>,
    /// Terms of that error.
    pub error: ErrorReport,
    /// All fitted models, simplest first; empty if too few pixels have modulation.
    pub models: Vec<ModelReport>,
    /// Classes of pixels that differ in their degree of polarization, as for gratings of several periods or depths;
    /// empty for a single class.
    pub classes: Vec<Class>,
    /// Test of the sinusoid model.
    pub circle: Option<CircleCheck>,
    /// Number of analyser positions with merged exposures.
    pub brackets: usize,
    /// Relative shifts of the photographs, one entry for each analyser position; `None` for a sensor that takes all
    /// angles at once, and for more than 24 positions.
    pub registration: Option<Alignment>,
    /// Results from views at equal angles or angles 180° apart; `None` if fewer than three angles are repeated.
    pub repeats: Option<RepeatsReport>,
    /// Smoothing of orientations, in pictures or also in the map.
    pub smoothing: SmoothingReport,
    /// Report of the period map, if requested.
    pub period: Option<PeriodReport>,
    /// Correction of oblique incidence; `None` if the camera geometry is unknown.
    pub oblique: Option<ObliqueReport>,
    /// Colour map of angles in pictures.
    pub palette: Palette,
    /// Offset added to all orientations in degrees. The method determines orientations only up to a common offset.
    pub offset_deg: f64,
    /// Expected error of a typical absolute orientation, including the calibrated offset. `None` without a calibrated
    /// offset: orientations are then relative.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absolute_error_deg: Option<f64>,
    /// Calibration of the bench that was applied.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
    /// Analyser-angle error of each position in degrees, with zero mean: estimated from residuals and corrected. `None`
    /// if a correction is not worthwhile or the errors are unobservable.
    pub analyser_errors_deg: Option<Vec<f64>>,
    /// Stated analyser angles in the order of the frames.
    pub analyser_deg: Vec<f64>,
    /// Condition number of the angle set; √2 is optimal.
    pub condition: f64,
    /// Files used, in order.
    pub frames: Vec<String>,
    /// Wall time per stage in s.
    pub seconds: Seconds,
}

/// Origin of the maps in frames of a polarization sensor.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct SensorReport {
    /// Pixels along the side of the sensor's super-pixel: 2, or 4 with colour filters.
    pub superpixel_px: usize,
    /// Sensor pixels along the side of a map pixel: that of a super-pixel, or 1 for interpolated images.
    pub map_pixel_px: usize,
    /// Colour channel used, for colour sensors; several pixels of it in a super-pixel were averaged.
    pub channel: Option<Channel>,
    /// Interpolation of the images behind each polarizer.
    pub demosaic: Demosaic,
}

impl SensorReport {
    fn new(frames: &LoadedFrames, demosaic: Demosaic) -> Option<Self> {
        let superpixel_px = frames.set.filters()?.block();
        let map_pixel_px = if demosaic == Demosaic::None { superpixel_px } else { 1 };
        Some(Self { superpixel_px, map_pixel_px, channel: frames.set.channel, demosaic })
    }
}

/// Number and quality of pixels with an orientation.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Pixels {
    /// All pixels of the map.
    pub all: usize,
    /// Pixels with an orientation.
    pub valid: usize,
    /// Masked: saturated or not finite in at least one photograph.
    pub saturated: usize,
    /// Masked: metal without a grating, as identified by the model.
    pub without_grating: usize,
    /// Masked: modulation below the noise limit.
    pub too_little_modulation: usize,
    /// Median σ of the orientation over valid pixels.
    pub sigma_median_deg: Option<f64>,
    /// 90th percentile of σ over valid pixels.
    pub sigma_p90_deg: Option<f64>,
    /// Mean normalised correlation between fit and measurement over valid pixels.
    pub correlation_mean: Option<f64>,
}

/// Smoothing of orientations.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct SmoothingReport {
    /// `none`, `light`, `strong` or a number of iterations.
    pub strength: Smoothing,
    /// Number of filter iterations.
    pub rounds: u32,
    /// Standard deviation of the spatial weight of one iteration, in pixels.
    pub space_sigma_px: f32,
    /// Whether `orientation.exr` and its σ are smoothed as well; all numbers here are then those of the smoothed map.
    pub map: bool,
    /// Whether `smoothed.exr` was written.
    pub exr: bool,
}

/// Noise of an average frame: variance = `shot` · I + `floor`, in linear units.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "PolarizationNoiseReport")]
pub struct NoiseReport {
    /// Source of the noise model.
    pub source: NoiseSource,
    /// Variance per unit of intensity.
    pub shot: f64,
    /// Variance at zero intensity.
    pub floor: f64,
}

/// Wall time in seconds.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "PolarizationSeconds")]
pub struct Seconds {
    /// Decoding the photographs and adding them to the fit, including a second pass for registration or angle
    /// correction.
    pub read_and_fit: f64,
    /// Solving, noise, orientation, checks.
    pub solve: f64,
    /// Writing maps and pictures.
    pub write: f64,
    /// Total.
    pub total: f64,
}

impl Report {
    pub(crate) fn new(
        frames: &LoadedFrames,
        (options, requested): (&Options, Model),
        design: &Design,
        (noise, source): (&[FrameNoise], NoiseSource),
        pixels: Pixels,
        solved: &Solved,
    ) -> Self {
        let (circle, choice) = (solved.circle, solved.choice.as_ref());
        let mean = |of: fn(&FrameNoise) -> f64| noise.iter().map(of).sum::<f64>() / noise.len().max(1) as f64;
        let set = &frames.set;
        let smooth = if requested == Model::Plain { Smoothing::NONE } else { options.smooth };
        let chosen = choice.map(|c| &c.candidates[c.chosen]);
        let plain = requested == Model::Plain;
        let model = chosen.map_or(if plain { Model::Plain } else { Model::Sinusoid }, |c| c.model);
        // The test of the sinusoid is irrelevant if another model is used.
        let checked = circle.iter().filter(|_| model == Model::Sinusoid && solved.classes.is_none());
        let mut warnings: Vec<String> = checked.flat_map(CircleCheck::warnings).collect();
        warnings.extend(solved.classes.iter().map(Classes::warning));
        warnings.extend(choice.iter().filter(|_| model != Model::Sinusoid).flat_map(|c| c.warnings()));
        if pixels.valid == 0 {
            warnings.push("no pixel shows enough modulation to tell an angle of polarization: the map is empty".into());
        }
        if options.smooth_maps {
            warnings.push(
                "the map itself is smoothed, as asked for: its pixels are not independent, and what σ states is their noise, not \
                 what smoothing rounds off"
                    .into(),
            );
        }
        if source == NoiseSource::Assumed {
            warnings.push("three angles leave no residual and no noise is given, so σ assumes a modest camera".into());
        }
        // Plain polarimetry has no model error.
        let of_model = if plain { Some(0.0) } else { error_of_model(solved) };
        let error = ErrorReport::new(pixels.sigma_median_deg, of_model);
        let reason = || match (plain, options.model) {
            (true, Some(_)) => "asked for",
            (true, None) => default_reason(frames.set.illumination, solved.grating_like),
            _ => "too few pixels carry an orientation to compare models",
        };
        Self {
            method: "polarization",
            model: chosen.map_or_else(|| model.word().to_owned(), |c| c.name()),
            model_reason: choice.map_or_else(|| reason().into(), |c| c.reason.clone()),
            models: choice.map(Choice::report).unwrap_or_default(),
            warnings,
            width: solved.map.width,
            height: solved.map.height,
            sensor: SensorReport::new(frames, options.demosaic),
            error_estimate_deg: error.total_deg,
            error,
            pixels,
            classes: solved.classes.as_ref().map(|c| c.classes.clone()).unwrap_or_default(),
            noise: NoiseReport { source, shot: mean(|n| n.shot), floor: mean(|n| n.floor) },
            circle,
            brackets: 0,
            registration: None,
            repeats: None,
            smoothing: SmoothingReport {
                strength: smooth,
                rounds: smooth.rounds(),
                space_sigma_px: SPACE_SIGMA_PX,
                map: options.smooth_maps,
                exr: options.smoothed_exr,
            },
            period: None,
            oblique: solved.oblique.clone(),
            palette: options.palette,
            offset_deg: options.offset_for(frames),
            absolute_error_deg: None,
            calibration: set.calibration.clone(),
            analyser_errors_deg: None,
            analyser_deg: match set.filters() {
                Some(filters) => filters.angles.repeat(set.frames.len()),
                None => set.frames.iter().filter_map(|f| f.analyser_deg).collect(),
            },
            condition: design.condition,
            frames: set.frames.iter().map(|f| f.file.display().to_string()).collect(),
            seconds: Seconds::default(),
        }
    }

    /// Adds systematic errors.
    pub(crate) fn with(&mut self, terms: Systematic) {
        self.error = std::mem::take(&mut self.error).with(terms);
        self.error_estimate_deg = self.error.total_deg;
    }

    /// Adds the error of a calibrated offset, and warns if it belongs to another model.
    pub(crate) fn with_offset(&mut self, options: &Options) {
        let calibrated = self.calibration.as_ref().and_then(|c| c.orientation.as_ref());
        let Some(offset) = calibrated.filter(|_| options.offset_deg.is_none() && self.model != Model::Plain.word())
        else {
            return;
        };
        if is_curve(&offset.model) == is_curve(&self.model) {
            self.absolute_error_deg = self.error_estimate_deg.map(|error| error.hypot(offset.sigma_deg));
        } else {
            self.warnings.push(format!(
                "the offset of orientations was calibrated with the model {}, and this is {}: absolute orientations may be \
                 wrong by a degree or more; reconstruct both with --model curve",
                offset.model, self.model
            ));
        }
    }

    /// Sets wall times in seconds: of reading and fitting, until the solution, and until everything was written.
    pub(crate) fn took(&mut self, read_and_fit: f64, solve: f64, written: f64) {
        self.seconds = Seconds { read_and_fit, solve, write: written - solve, total: read_and_fit + written };
    }
}

/// Whether a model's name is that of a curve, whose harmonics distinguish its offset from that of a circle.
fn is_curve(model: &str) -> bool {
    model.starts_with(Model::Curve.word())
}

/// Reason for plain polarimetry as the default under this light, with a suggestion of grating models if the points look
/// like a grating.
fn default_reason(light: Illumination, grating_like: bool) -> &'static str {
    match (light, grating_like) {
        (Illumination::LinearPanel, _) => {
            "the default under a linear panel: models of gratings assume circular light, which needs a quarter-wave retarder"
        }
        (_, true) => {
            "the default unless a circular panel is declared. The points (S1/S0, S2/S0) lie on a circle, as of a grating under circular light: the \
             model auto would find its orientation"
        }
        (Illumination::Unknown, _) => {
            "the default where the illumination is unknown; choose the model auto if this is a grating lit by a circular panel"
        }
        _ => "the default unless a circular panel lit the sample",
    }
}

/// Error in degrees that the model may cause; `None` if unknown.
fn error_of_model(solved: &Solved) -> Option<f64> {
    let choice = solved.choice.as_ref()?;
    if let Some(classes) = &solved.classes {
        return Some(choice.error?.to_degrees().hypot(classes.offset_deg()));
    }
    match (choice.candidates[choice.chosen].model, solved.circle) {
        // After a correction of oblique incidence there is no test on the raw points.
        (Model::Sinusoid, Some(circle)) => {
            let left = solved.oblique.as_ref().map_or(0.0, |o| o.left_deg);
            Some(circle.bias_deg.filter(|_| circle.bias_is_known())?.hypot(left))
        }
        _ => Some(choice.error?.to_degrees()),
    }
}
