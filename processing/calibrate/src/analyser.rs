//! The operation `analyser`: zero, sense, extinction and eccentricity of the analyser and its stage, from photographs
//! of a reference polarizer.

use crate::chart::{Curve, turn_chart};
use crate::malus::{Fit, fit};
use crate::transfer::Measured;
use crate::turn::{Turn, measure, region_of, turning};
use crate::wedge::{Wedge, wedge};
use nacre_base::estimate::Work;
use nacre_base::operation::{MISSING, Operation, SCHEMA, Summary, lines};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{AnalyserCalibration, CALIBRATION_FILE, Calibration, LoadedFrames};
use nacre_image::budget;
use nacre_optics::polarization::angle_difference;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Smallest difference in degrees between the two possible axes of a flipped reference. Near 0°, 45° and 90° an axis
/// is close to its mirror image.
const APART_DEG: f64 = 10.0;

/// Standard deviations by which the light of crossed polarizers must exceed zero.
const SIGNIFICANT: f64 = 3.0;

/// Standard deviation of the angles in degrees above which the stage needs attention.
const LOOSE_DEG: f64 = 0.2;

/// Measure zero, sense, extinction ratio and eccentricity of the analyser.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "AnalyserOptions", extend(
    "x-input" = "Session over the full turn of the analyser, with a linear polarizer on the sample table",
    "x-examples" = "\
Examples:
  nacre calibrate analyser front --flipped back --axis-deg 20 --out analyser
  nacre calibrate analyser brewster --axis-deg 0 --axis-sigma-deg 0.2 --out analyser

Lay a linear polarizer on a mirror, with its axis about 20° from the horizontal, and capture a full
turn of the analyser. Then turn the polarizer over about a vertical line of the image and capture
another turn: the axis is then at the mirrored angle, so both zero and axis follow. Without the
second series, the axis must be known: that of a polarizer with an engraved axis, or horizontal for
the reflection of a vertical plane of incidence at Brewster's angle.

Extinction needs angles within 2° of the crossed direction. Writes report.json, calibration.json and
analyser.png."
))]
pub struct Options {
    /// Axis of the reference polarizer in degrees, anticlockwise from the right of the image; with flipped, within 20°.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis_deg: Option<f64>,
    /// Standard deviation of the axis in degrees, without flipped.
    #[schemars(extend("x-advanced" = true))]
    pub axis_sigma_deg: f64,
    /// Second series, with the polarizer turned over about a vertical line of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-file" = true, "x-placeholder" = "DIR"))]
    pub flipped: Option<PathBuf>,
    /// The analyser turns clockwise, as seen by the camera (without flipped, which determines it).
    #[schemars(extend("x-advanced" = true))]
    pub clockwise: bool,
    /// Region of even light: left, top, width, height in pixels (default: the middle half of each side).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "LEFT,TOP,WIDTH,HEIGHT", "x-advanced" = true))]
    pub region: Option<[usize; 4]>,
}

/// Report of the operation `analyser`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "AnalyserReport")]
pub struct Report {
    /// `analyser`.
    pub method: &'static str,
    /// Limitations of the result.
    pub warnings: Vec<String>,
    /// Transmission axis at the stage's zero in degrees, anticlockwise from the right of the image.
    pub zero_deg: Measured,
    /// Sense of rotation as seen by the camera: 1 for anticlockwise, -1 for clockwise.
    pub sense: i8,
    /// Axis of the reference polarizer in degrees.
    pub axis_deg: Measured,
    /// Transmission through parallel over crossed polarizers; none if the light of crossed ones is within the noise, or
    /// if ambient light was not photographed.
    pub extinction_ratio: Option<Measured>,
    /// Lower bound of that ratio (3 standard deviations).
    pub extinction_at_least: f64,
    /// Periodic error of the stage's scale; none unless the angles cover a turn.
    pub eccentricity: Option<Eccentricity>,
    /// Standard deviation of the angles about their scale in degrees.
    pub angle_sigma_deg: f64,
    /// Standard deviation of the light, as a share.
    pub light_sigma: f64,
    /// Image shift of a wedged analyser; none if the photographs show too little structure.
    pub wedge: Option<Wedge>,
    /// Region: left, top, width, height in pixels.
    pub region: [usize; 4],
    /// Number of angles of each series.
    pub angles: Vec<usize>,
    /// Seconds of processing.
    pub seconds: f64,
}

/// Periodic error `amplitude · sin(ψ - at)` of the stage's angle ψ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Eccentricity {
    /// Amplitude in degrees.
    pub amplitude_deg: f64,
    /// Angle of the stage at which the error is zero and increases, in degrees.
    pub at_deg: f64,
    /// Standard deviation of the cosine and sine coefficients in degrees.
    pub sigma_deg: f64,
}

/// Results of one series.
struct Measurement {
    frames: LoadedFrames,
    turn: Turn,
    fit: Fit,
}

impl Measurement {
    fn of(input: &Path, region: Option<[usize; 4]>, progress: &dyn Progress) -> Result<Self> {
        let mut frames = turning(input)?;
        // The present calibration is the result of this one.
        frames.set.calibration = None;
        let turn = measure(&frames, region_of(region, frames.info)?, progress)?;
        let fit = fit(&turn.lights, true).ok_or_else(|| {
            let remedy = "give angles over the full turn of the stage, 15° apart or less";
            Error::file(&frames.path, "has angles that do not determine Malus' law", remedy)
        })?;
        Ok(Self { frames, turn, fit })
    }

    /// Angle β of the stage at which analyser and reference are parallel, in degrees.
    fn parallel_deg(&self) -> Measured {
        degrees(self.fit.parallel())
    }
}

/// Zero, sense and axis of the reference.
struct Zero {
    zero_deg: Measured,
    sense: i8,
    axis_deg: Measured,
}

impl Options {
    fn axis(&self) -> Result<f64> {
        let axis = self.axis_deg.ok_or_else(|| Error::input("axis_deg", MISSING, SCHEMA))?;
        if axis.is_finite() && axis.abs() <= 360.0 {
            return Ok(axis);
        }
        Err(Error::input("axis_deg", format!("is {axis}"), "give degrees from -360 to 360"))
    }

    /// From one series and the known axis: `β = sense · (axis - zero)`.
    fn known(&self, parallel: Measured) -> Result<Zero> {
        let axis = self.axis()?;
        let sense = if self.clockwise { -1 } else { 1 };
        let zero_deg = Measured {
            value: near_zero(axis - f64::from(sense) * parallel.value),
            sigma: parallel.sigma.hypot(self.axis_sigma_deg),
        };
        Ok(Zero { zero_deg, sense, axis_deg: Measured { value: axis, sigma: self.axis_sigma_deg } })
    }

    /// From both series: the axis is `±(β₁ - β₂)/2` modulo 90°, of which that near the stated one is right.
    fn flipped(&self, [front, back]: [Measured; 2]) -> Result<Zero> {
        let stated = self.axis()?;
        // Angle errors of a stage that depend on its target are common to both series: they cancel in the difference,
        // but not in the sum.
        let [of_sum, of_difference] = [0.5 * (front.sigma + back.sigma), 0.5 * front.sigma.hypot(back.sigma)];
        let half = 0.5 * (front.value - back.value);
        let candidates = [(1, half), (1, half + 90.0), (-1, -half), (-1, -half + 90.0)];
        let mut all = candidates.map(|(sense, axis)| (near_zero(axis - stated).abs(), sense, axis));
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [(nearest, sense, axis), (second, ..), ..] = all;
        if second - nearest < APART_DEG {
            let problem = format!("is {stated}, but the polarizer's axis may be at {axis:.0}° or its mirror image");
            let remedy = "turn the polarizer so that its axis is about 20° from the horizontal, and repeat both series";
            return Err(Error::input("axis_deg", problem, remedy));
        }
        let zero_deg = Measured { value: near_zero(axis - f64::from(sense) * front.value), sigma: of_sum };
        let axis_deg = Measured { value: stated + near_zero(axis - stated), sigma: of_difference };
        Ok(Zero { zero_deg, sense, axis_deg })
    }
}

/// An angle in degrees, from rad.
pub(crate) fn degrees(rad: Measured) -> Measured {
    Measured { value: rad.value.to_degrees(), sigma: rad.sigma.to_degrees() }
}

/// The equivalent direction from -90° to 90°.
pub(crate) fn near_zero(degrees: f64) -> f64 {
    angle_difference(degrees.to_radians(), 0.0).to_degrees()
}

impl Operation for Options {
    const NAME: &'static str = "analyser";
    const TITLE: &'static str = "Zero and extinction of the analyser, from photographs of a reference polarizer";
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.axis()?;
        if !(0.0..=45.0).contains(&self.axis_sigma_deg) {
            return Err(Error::input(
                "axis_sigma_deg",
                format!("is {}", self.axis_sigma_deg),
                "give degrees from 0 to 45",
            ));
        }
        if self.flipped.is_some() && self.clockwise {
            let remedy = "leave it out, or leave out flipped";
            return Err(Error::input("clockwise", "is determined by the flipped series", remedy));
        }
        Ok(())
    }

    fn check(&self, input: &Path) -> Result<Work> {
        self.check_options()?;
        let mut work = work_of(Self::NAME, input, self.region)?;
        if let Some(flipped) = &self.flipped {
            work.seconds += work_of(Self::NAME, flipped, self.region)?.seconds;
        }
        Ok(work)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let begun = Instant::now();
        let front = Measurement::of(input, self.region, progress)?;
        let back = self.flipped.as_ref().map(|f| Measurement::of(f, self.region, progress)).transpose()?;
        let all: Vec<&Measurement> = [&front].into_iter().chain(&back).collect();
        let zero = match &back {
            Some(back) => self.flipped([front.parallel_deg(), back.parallel_deg()])?,
            None => self.known(front.parallel_deg())?,
        };
        let (ratio, at_least) = extinction(&all);
        let eccentricity = eccentricity(&all);
        let wedge = wedge(&front.frames, &front.turn, f64::from(zero.sense), zero.zero_deg.value, progress)?;
        let mut warnings: Vec<String> = all.iter().flat_map(|m| m.turn.warnings.iter().cloned()).collect();
        let angle_sigma_deg = all.iter().map(|m| m.fit.angle_sigma.to_degrees()).fold(0.0, f64::max);
        let has_dark = all.iter().all(|m| m.turn.has_dark);
        warnings.extend(self.doubts(&ratio, has_dark, &eccentricity, angle_sigma_deg));
        let calibration = AnalyserCalibration {
            source: None,
            zero_deg: zero.zero_deg.value,
            zero_sigma_deg: zero.zero_deg.sigma,
            sense: zero.sense,
            eccentricity_deg: all_coefficients(&all).map_or([0.0; 2], |c| c.map(|m| m.value.to_degrees())),
            extinction_ratio: ratio.map(|r| r.value),
        };
        let calibration = Calibration { analyser: Some(calibration), ..Calibration::default() };
        out.write_json(CALIBRATION_FILE, &calibration)?;
        let label = |k: usize| if k == 0 { "reference" } else { "turned over" };
        let curves: Vec<Curve> = all
            .iter()
            .enumerate()
            .map(|(k, m)| Curve { label: label(k), lights: &m.turn.lights, fit: &m.fit })
            .collect();
        out.write("analyser.png", &turn_chart("Light behind the analyser", &curves)?)?;
        Ok(Report {
            method: Self::NAME,
            warnings,
            zero_deg: zero.zero_deg,
            sense: zero.sense,
            axis_deg: zero.axis_deg,
            extinction_ratio: ratio,
            extinction_at_least: at_least,
            eccentricity,
            angle_sigma_deg,
            light_sigma: all.iter().map(|m| m.fit.light_sigma).fold(0.0, f64::max),
            wedge,
            region: front.turn.region,
            angles: all.iter().map(|m| m.turn.lights.len()).collect(),
            seconds: begun.elapsed().as_secs_f64(),
        })
    }
}

/// Time and memory of measuring a series.
pub(crate) fn work_of(operation: &'static str, input: &Path, region: Option<[usize; 4]>) -> Result<Work> {
    let frames = turning(input)?;
    region_of(region, frames.info)?;
    let (info, count) = (frames.info, frames.set.frames.len() as u64);
    let pixels = (info.width * info.height) as u64;
    let work = Work {
        operation: operation.into(),
        seconds: 0.1 + 4e-8 * (pixels * info.channels as u64 * 3 * count) as f64,
        memory_bytes: 2 * budget::decoded(info) + 24 * pixels,
        disk_bytes: 1 << 18,
        ..Work::default()
    };
    budget::check(&frames.file(&frames.set.frames[0].file), info, work.memory_bytes)?;
    Ok(work)
}

/// Mean of a quantity of the series, weighted by precision.
fn combined(all: impl Iterator<Item = Measured>) -> Option<Measured> {
    let (mut weights, mut sum) = (0.0, 0.0);
    for m in all {
        let weight = m.sigma.powi(-2).min(f64::MAX.sqrt());
        weights += weight;
        sum += weight * m.value;
    }
    (weights > 0.0).then(|| Measured { value: sum / weights, sigma: weights.powf(-0.5) })
}

/// Extinction ratio (2 - e)/e, and its lower bound.
fn extinction(all: &[&Measurement]) -> (Option<Measured>, f64) {
    let of = |m: &&Measurement| {
        let (contrast, dark) = (m.fit.contrast(), m.turn.dark_sigma / m.fit.parameters[0]);
        Measured { value: 1.0 - contrast.value, sigma: contrast.sigma.hypot(dark) }
    };
    let Some(e) = combined(all.iter().map(of)) else { return (None, 1.0) };
    let ratio = |e: f64| (2.0 - e) / e;
    let at_least = ratio(e.value.max(0.0) + SIGNIFICANT * e.sigma);
    // Ambient light is as bright behind crossed polarizers, so that the ratio is larger than it seems.
    let resolved = e.value > SIGNIFICANT * e.sigma && all.iter().all(|m| m.turn.has_dark);
    (resolved.then(|| Measured { value: ratio(e.value), sigma: 2.0 * e.sigma / e.value.powi(2) }), at_least)
}

/// Coefficients of cosine and sine in rad, if every series determines them. Errors of the stage that depend on its
/// target are common to all series, so that their mean is no better than one.
fn all_coefficients(all: &[&Measurement]) -> Option<[Measured; 2]> {
    let count = all.len() as f64;
    let coefficient = |k: usize| {
        let each = all.iter().map(|m| m.fit.parameter(k));
        each.fold(Measured { value: 0.0, sigma: 0.0 }, |sum, m| Measured {
            value: sum.value + m.value / count,
            sigma: sum.sigma + m.sigma / count,
        })
    };
    all.iter().all(|m| m.fit.eccentric).then(|| [coefficient(3), coefficient(4)])
}

fn eccentricity(all: &[&Measurement]) -> Option<Eccentricity> {
    let [c, s] = all_coefficients(all)?;
    // c cos ψ + s sin ψ = amplitude · sin(ψ - at).
    Some(Eccentricity {
        amplitude_deg: c.value.hypot(s.value).to_degrees(),
        at_deg: (-c.value).atan2(s.value).to_degrees(),
        sigma_deg: c.sigma.max(s.sigma).to_degrees(),
    })
}

impl Options {
    fn doubts(
        &self,
        ratio: &Option<Measured>,
        has_dark: bool,
        eccentricity: &Option<Eccentricity>,
        angle_sigma: f64,
    ) -> Vec<String> {
        let mut doubts = vec![];
        if self.flipped.is_none() {
            let sense = if self.clockwise { "clockwise" } else { "anticlockwise" };
            doubts.push(format!("the sense of rotation ({sense}) is taken as stated: give --flipped to measure it"));
            if self.axis_sigma_deg == 0.0 {
                doubts.push("the axis of the polarizer is taken as exact: state --axis-sigma-deg".into());
            }
        }
        if !has_dark {
            doubts.push(
                "ambient light was not photographed: the extinction ratio is a lower bound; add a dark photograph, with \
                 the panel black"
                    .into(),
            );
        } else if ratio.is_none() {
            doubts.push(
                "the light of crossed polarizers is within the noise: the extinction ratio is a lower bound; add angles \
                 within 2° of the crossed direction, or longer exposures"
                    .into(),
            );
        }
        if eccentricity.is_none() {
            doubts.push("the angles cover less than a turn: the eccentricity of the scale is not measured".into());
        }
        if angle_sigma > LOOSE_DEG {
            doubts.push(format!(
                "the stage's angles scatter by {angle_sigma:.2}°: tighten the analyser in its mount, and approach all \
                 angles from one side"
            ));
        }
        doubts
    }
}

impl Summary for Report {
    fn summary(&self) -> String {
        let mut text = String::new();
        let mut add = |label: &str, value: String| text.push_str(&format!("{label:<10}{value}\n"));
        add("zero", format!("{:.3}° ± {:.3}°", self.zero_deg.value, self.zero_deg.sigma));
        add("sense", if self.sense > 0 { "anticlockwise" } else { "clockwise" }.into());
        add("axis", format!("{:.3}° ± {:.3}° (reference)", self.axis_deg.value, self.axis_deg.sigma));
        add(
            "extinct.",
            match &self.extinction_ratio {
                Some(ratio) => format!("{:.0} ± {:.0}", ratio.value, ratio.sigma),
                None => format!("at least {:.0}", self.extinction_at_least),
            },
        );
        if let Some(e) = &self.eccentricity {
            add("scale", format!("eccentric by {:.3}° ± {:.3}°", e.amplitude_deg, e.sigma_deg));
        }
        add("angles", format!("scatter by {:.4}°", self.angle_sigma_deg));
        if let Some(w) = &self.wedge {
            add("wedge", format!("shifts the image by {:.2} ± {:.2} pixels", w.shift_px, w.sigma_px));
        }
        text.push_str(&lines(&[], &self.warnings));
        text.push_str(&format!("time      {:.1} s", self.seconds));
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
