//! The operation `retarder`: azimuth and retardance of the panel's quarter-wave film, from the polarization of its
//! light.
//!
//! Light of azimuth p through a retarder of azimuth φ and retardance δ has
//! `s1 + i s2 = e^{2iφ} (cos 2β + i sin 2β cos δ)` with β = p - φ. An analyser measures s1 and s2, from which φ and δ
//! follow if p is known: from the panel without its film, or as stated.

use crate::analyser::{near_zero, work_of};
use crate::chart::{Curve, turn_chart};
use crate::malus::{Fit, fit};
use crate::mirror::Mirror;
use crate::transfer::Measured;
use crate::turn::{Light, Turn, measure, region_of, turning};
use nacre_base::estimate::Work;
use nacre_base::operation::{MISSING, Operation, SCHEMA, Summary, lines};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{CALIBRATION_FILE, Calibration, LoadedFrames, RetarderCalibration};
use nacre_optics::polarization::{Jones, JonesVector, angle_difference};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Step of numerical derivatives in rad.
const STEP: f64 = 1e-5;

/// Largest number of Newton steps.
const ITERATIONS: usize = 50;

/// Largest deviation from 90° of a retardance that needs no warning, in degrees.
const QUARTER_DEG: f64 = 20.0;

/// Smallest contrast of the panel without film: a panel emits linear polarization.
const LINEAR: f64 = 0.8;

/// Measure azimuth and retardance of the panel's retarder.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "RetarderOptions", extend(
    "x-input" = "Session over the turn of the analyser, with a mirror on the sample table and the panel lit",
    "x-examples" = "\
Examples:
  nacre calibrate retarder with-film --bare without-film --out retarder
  nacre calibrate retarder with-film --panel-deg 0 --panel-sigma-deg 0.5 --out retarder

Lay a front-surface mirror on the sample table, light the panel and capture a turn of the analyser;
then remove the film from the panel and capture another one. If the film cannot be removed, state
the direction of the panel's polarization instead. Calibrate the analyser first: its zero, sense and
extinction are taken from the calibration that the sessions name.

Writes report.json, calibration.json and retarder.png."
))]
pub struct Options {
    /// Series of the panel without its retarder.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-file" = true, "x-placeholder" = "DIR"))]
    pub bare: Option<PathBuf>,
    /// Direction of the panel's linear polarization in degrees, if there is no series without retarder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub panel_deg: Option<f64>,
    /// Standard deviation of that direction in degrees.
    pub panel_sigma_deg: f64,
    /// Direction of the retarder's axis in degrees, within 40° (default: 45° from the panel's polarization). The
    /// perpendicular axis gives the other handedness, which an analyser cannot distinguish.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub azimuth_deg: Option<f64>,
    /// Region of even light: left, top, width, height in pixels (default: the middle half of each side).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-placeholder" = "LEFT,TOP,WIDTH,HEIGHT", "x-advanced" = true))]
    pub region: Option<[usize; 4]>,
}

/// Report of the operation `retarder`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "RetarderReport")]
pub struct Report {
    /// `retarder`.
    pub method: &'static str,
    /// Limitations of the result.
    pub warnings: Vec<String>,
    /// Direction of the panel's linear polarization in degrees.
    pub panel_deg: Measured,
    /// Direction of the retarder's axis in degrees.
    pub azimuth_deg: Measured,
    /// Retardance in degrees at the wavelength of the photographs.
    pub retardance_deg: Measured,
    /// Wavelength in nm, if the photographs state it.
    pub wavelength_nm: Option<f64>,
    /// S1/S0 and S2/S0 behind the retarder.
    pub stokes: [Measured; 2],
    /// Contrast of the panel without retarder; none if its direction is stated.
    pub panel_contrast: Option<f64>,
    /// Region: left, top, width, height in pixels.
    pub region: [usize; 4],
    /// Seconds of processing.
    pub seconds: f64,
}

/// Direction of the panel's polarization, and its contrast.
struct Panel {
    /// Direction in rad.
    angle: f64,
    /// Standard deviation in rad, without that of the analyser's zero.
    sigma: f64,
    contrast: Option<f64>,
    series: Option<(Turn, Fit)>,
}

/// Azimuth and retardance in rad.
type Film = [f64; 2];

impl Options {
    fn given(&self) -> Result<()> {
        match (&self.bare, self.panel_deg) {
            (None, None) => Err(Error::input("bare", MISSING, "give the series without retarder, or panel_deg")),
            (Some(_), Some(_)) => Err(Error::input("panel_deg", "is measured by bare", "give one of the two")),
            _ => Ok(()),
        }
    }

    fn panel(&self, progress: &dyn Progress, warnings: &mut Vec<String>) -> Result<Panel> {
        let Some(bare) = &self.bare else {
            let angle = self.panel_deg.ok_or_else(|| Error::input("panel_deg", MISSING, SCHEMA))?.to_radians();
            return Ok(Panel { angle, sigma: self.panel_sigma_deg.to_radians(), contrast: None, series: None });
        };
        let frames = turning(bare)?;
        let turn = measure(&frames, region_of(self.region, frames.info)?, progress)?;
        warnings.extend(turn.warnings.iter().cloned());
        let mirror = mirror(&frames, turn.region, warnings);
        let lights = by_axis(&turn.lights);
        let found = fit(&lights, false).ok_or_else(|| undetermined(&frames))?;
        let contrast = found.contrast().value / frames.set.analyser_contrast();
        if contrast < LINEAR {
            let problem =
                format!("shows light of {:.0} % polarization, so the retarder was not removed", 100.0 * contrast);
            return Err(Error::file(&frames.path, problem, "remove the film, or state panel_deg instead of bare"));
        }
        let Measured { value: measured, sigma } = found.parallel();
        let mut angle = measured;
        for _ in 0..ITERATIONS {
            let [s1, s2] = mirror.reflected(JonesVector::linear(angle));
            angle += angle_difference(measured, 0.5 * s2.atan2(s1));
        }
        Ok(Panel { angle, sigma, contrast: Some(contrast), series: Some((Turn { lights, ..turn }, found)) })
    }

    /// Nominal azimuth of the retarder in rad.
    fn nominal(&self, panel: f64) -> f64 {
        self.azimuth_deg.map_or(panel + FRAC_PI_4, f64::to_radians)
    }
}

/// The mirror of a series; at normal incidence, with a warning, if the geometry is unknown.
fn mirror(frames: &LoadedFrames, region: [usize; 4], warnings: &mut Vec<String>) -> Mirror {
    Mirror::of(frames, region).unwrap_or_else(|| {
        warnings.push(
            "the geometry of the bench is unknown: the mirror is taken as perpendicular to the view, an error of about \
             0.1° at 5° of incidence"
                .into(),
        );
        Mirror::normal()
    })
}

/// The lights with their transmission axes in place of the stage's angles.
fn by_axis(lights: &[Light]) -> Vec<Light> {
    lights.iter().map(|l| Light { stage_deg: l.axis.to_degrees(), ..*l }).collect()
}

fn undetermined(frames: &LoadedFrames) -> Error {
    let remedy = "give angles over half a turn or more, 15° apart or less";
    Error::file(&frames.path, "has angles that do not determine Malus' law", remedy)
}

/// Light behind the retarder, as reflected.
fn behind(mirror: &Mirror, panel: f64, [azimuth, retardance]: Film) -> [f64; 2] {
    mirror.reflected(Jones::retarder(azimuth, retardance).apply(JonesVector::linear(panel)))
}

/// Film whose light has the given Stokes parameters, by Newton's method from the closed form at normal incidence.
fn film(mirror: &Mirror, panel: f64, stokes: [f64; 2], nominal: f64) -> Option<Film> {
    let mut film = closed_form(panel, stokes, nominal);
    for _ in 0..ITERATIONS {
        let now = behind(mirror, panel, film);
        let residual = [stokes[0] - now[0], stokes[1] - now[1]];
        let [[a, b], [c, d]] = jacobian(|film| behind(mirror, panel, film), film);
        let determinant = a * d - b * c;
        if determinant.abs() < 1e-9 {
            return None;
        }
        let step =
            [(d * residual[0] - b * residual[1]) / determinant, (a * residual[1] - c * residual[0]) / determinant];
        // Limited, so that noise near a turning point does not lead far away.
        film = [film[0] + step[0].clamp(-0.1, 0.1), film[1] + step[1].clamp(-0.1, 0.1)];
        if step.iter().all(|s| s.abs() < 1e-10) {
            return Some(film);
        }
    }
    None
}

/// `Re((s - e^{2ip}) e^{-2iφ}) = 0` gives φ modulo 90°, and the imaginary part of `s e^{-2iφ}` is `sin 2β cos δ`.
fn closed_form(panel: f64, [s1, s2]: [f64; 2], nominal: f64) -> Film {
    let (sin, cos) = (2.0 * panel).sin_cos();
    let quarter = 0.5 * ((s2 - sin).atan2(s1 - cos) + FRAC_PI_2);
    let azimuth = nominal + (quarter - nominal + FRAC_PI_4).rem_euclid(FRAC_PI_2) - FRAC_PI_4;
    let (sin, cos) = (2.0 * azimuth).sin_cos();
    let along = (2.0 * (panel - azimuth)).sin();
    let cosine = if along == 0.0 { 0.0 } else { (s2 * cos - s1 * sin) / along };
    [azimuth, cosine.clamp(-0.99, 0.99).acos()]
}

/// Derivatives of two values by two variables: rows are values.
fn jacobian(values: impl Fn(Film) -> [f64; 2], at: Film) -> [[f64; 2]; 2] {
    let column = |k: usize| {
        let [mut low, mut high] = [at, at];
        low[k] -= STEP;
        high[k] += STEP;
        let (low, high) = (values(low), values(high));
        [(high[0] - low[0]) / (2.0 * STEP), (high[1] - low[1]) / (2.0 * STEP)]
    };
    let (first, second) = (column(0), column(1));
    [[first[0], second[0]], [first[1], second[1]]]
}

impl Operation for Options {
    const NAME: &'static str = "retarder";
    const TITLE: &'static str = "Azimuth and retardance of the panel's film, from the polarization of its light";
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.given()?;
        for (key, value) in [("panel_deg", self.panel_deg), ("azimuth_deg", self.azimuth_deg)] {
            if let Some(value) = value.filter(|v| !(-360.0..=360.0).contains(v)) {
                return Err(Error::input(key, format!("is {value}"), "give degrees from -360 to 360"));
            }
        }
        if !(0.0..=45.0).contains(&self.panel_sigma_deg) {
            let problem = format!("is {}", self.panel_sigma_deg);
            return Err(Error::input("panel_sigma_deg", problem, "give degrees from 0 to 45"));
        }
        Ok(())
    }

    fn check(&self, input: &Path) -> Result<Work> {
        self.check_options()?;
        let mut work = work_of(Self::NAME, input, self.region)?;
        if let Some(bare) = &self.bare {
            work.seconds += work_of(Self::NAME, bare, self.region)?.seconds;
        }
        Ok(work)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let begun = Instant::now();
        let mut warnings = vec![];
        let panel = self.panel(progress, &mut warnings)?;
        let frames = turning(input)?;
        let turn = measure(&frames, region_of(self.region, frames.info)?, progress)?;
        warnings.extend(turn.warnings.iter().cloned());
        let lights = by_axis(&turn.lights);
        let found = fit(&lights, false).ok_or_else(|| undetermined(&frames))?;
        let contrast = frames.set.analyser_contrast() * panel.contrast.unwrap_or(1.0);
        let stokes = [1, 2]
            .map(|k| found.parameter(k))
            .map(|m| Measured { value: m.value / contrast, sigma: m.sigma / contrast });
        let mirror = mirror(&frames, turn.region, &mut warnings);
        let solve = |panel: f64, stokes: [f64; 2]| film(&mirror, panel, stokes, self.nominal(panel));
        let values = stokes.map(|m| m.value);
        let solved = solve(panel.angle, values).ok_or_else(|| {
            let remedy = "lay a plain mirror on the sample table, and check panel_deg and azimuth_deg";
            Error::file(&frames.path, "shows light that no retarder before this panel makes", remedy)
        })?;
        let sigmas = uncertainty(&solve, &panel, values, stokes.map(|m| m.sigma), solved, zero_sigma(&frames));
        let azimuth_deg = Measured { value: near_zero(solved[0].to_degrees()), sigma: sigmas[0].to_degrees() };
        let over_band = of_band(&frames) * solved[1];
        let retardance_deg = Measured { value: solved[1].to_degrees(), sigma: sigmas[1].hypot(over_band).to_degrees() };
        warnings.extend(doubts(&frames, self, turn.has_dark, retardance_deg.value));
        let panel_deg = Measured {
            value: near_zero(panel.angle.to_degrees()),
            sigma: panel.sigma.hypot(zero_sigma(&frames)).to_degrees(),
        };
        let calibration = RetarderCalibration {
            source: None,
            panel_deg: panel_deg.value,
            azimuth_deg: azimuth_deg.value,
            azimuth_sigma_deg: azimuth_deg.sigma,
            retardance_deg: retardance_deg.value,
            retardance_sigma_deg: retardance_deg.sigma,
        };
        let calibration = Calibration { retarder: Some(calibration), ..Calibration::default() };
        out.write_json(CALIBRATION_FILE, &calibration)?;
        let mut curves = vec![Curve { label: "with retarder", lights: &lights, fit: &found }];
        curves.extend(panel.series.iter().map(|(t, f)| Curve { label: "without", lights: &t.lights, fit: f }));
        out.write("retarder.png", &turn_chart("Light of the panel behind the analyser", &curves)?)?;
        Ok(Report {
            method: Self::NAME,
            warnings,
            panel_deg,
            azimuth_deg,
            retardance_deg,
            wavelength_nm: frames.set.wavelength_nm,
            stokes,
            panel_contrast: panel.contrast,
            region: turn.region,
            seconds: begun.elapsed().as_secs_f64(),
        })
    }
}

/// Standard deviation of the analyser's zero in rad.
fn zero_sigma(frames: &LoadedFrames) -> f64 {
    let analyser = frames.set.calibration.as_ref().and_then(|c| c.analyser.as_ref());
    analyser.map_or(0.0, |a| a.zero_sigma_deg.to_radians())
}

/// Difference between the mean retardance over the filter's band and that at its centre, as a share. Retardance is
/// proportional to 1/λ, whose mean is larger by the relative variance of λ.
fn of_band(frames: &LoadedFrames) -> f64 {
    let (Some(center), Some(width)) = (frames.set.wavelength_nm, frames.set.band_nm) else { return 0.0 };
    (width / (8.0 * 2f64.ln()).sqrt() / center).powi(2)
}

/// Standard deviations of azimuth and retardance: of the light, of the panel's direction, and of the analyser's zero,
/// which turns everything alike.
fn uncertainty(
    solve: &dyn Fn(f64, [f64; 2]) -> Option<Film>,
    panel: &Panel,
    stokes: [f64; 2],
    sigmas: [f64; 2],
    film: Film,
    zero: f64,
) -> Film {
    let effect = |changed: Option<Film>, step: f64, sigma: f64| {
        changed.map_or([0.0; 2], |f| [0, 1].map(|k| (f[k] - film[k]) / step * sigma))
    };
    // Finite steps of one standard deviation also hold near a turning point.
    let terms = [0, 1].map(|k| {
        let step = sigmas[k].max(STEP);
        let mut changed = stokes;
        changed[k] += step;
        effect(solve(panel.angle, changed), step, sigmas[k])
    });
    let step = panel.sigma.max(STEP);
    let of_panel = effect(solve(panel.angle + step, stokes), step, panel.sigma);
    let all = terms.into_iter().chain([of_panel, [zero, 0.0]]);
    all.fold([0.0; 2], |sum: Film, term| [0, 1].map(|k| sum[k].hypot(term[k])))
}

fn doubts(frames: &LoadedFrames, options: &Options, has_dark: bool, retardance_deg: f64) -> Vec<String> {
    let mut doubts = vec![];
    if !has_dark {
        doubts.push("ambient light was not photographed, and counts as light of the panel".into());
    }
    if frames.set.calibration.as_ref().is_none_or(|c| c.analyser.is_none()) {
        doubts.push("the analyser is not calibrated: directions contain the error of its zero".into());
    }
    if options.bare.is_none() && options.panel_sigma_deg == 0.0 {
        doubts.push("the direction of the panel's polarization is taken as exact: state --panel-sigma-deg".into());
    }
    if (retardance_deg - 90.0).abs() > QUARTER_DEG {
        doubts.push(format!("{retardance_deg:.1}° is far from the 90° of a quarter-wave film at this wavelength"));
    }
    doubts
}

impl Summary for Report {
    fn summary(&self) -> String {
        let with = |m: &Measured| format!("{:.3}° ± {:.3}°", m.value, m.sigma);
        let mut text = String::new();
        let mut add = |label: &str, value: String| text.push_str(&format!("{label:<10}{value}\n"));
        let at = self.wavelength_nm.map_or(String::new(), |nm| format!(" at {nm} nm"));
        add("retards", format!("{}{at}", with(&self.retardance_deg)));
        add("azimuth", with(&self.azimuth_deg));
        add("panel", with(&self.panel_deg));
        let [s1, s2] = &self.stokes;
        add("light", format!("S1/S0 {:.4} ± {:.4}, S2/S0 {:.4} ± {:.4}", s1.value, s1.sigma, s2.value, s2.sigma));
        text.push_str(&lines(&[], &self.warnings));
        text.push_str(&format!("time      {:.1} s", self.seconds));
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn films_follow_from_their_light() {
        for (panel, azimuth, retardance) in
            [(0.0, 45.0, 90.0), (12.0, 50.0, 84.0), (-30.0, 17.0, 101.0), (0.0, 43.0, 90.0)]
        {
            let [panel, azimuth, retardance] = [panel, azimuth, retardance].map(f64::to_radians);
            let mirror = Mirror::normal();
            let stokes = behind(&mirror, panel, [azimuth, retardance]);
            let found = film(&mirror, panel, stokes, panel + FRAC_PI_4).unwrap();
            assert!((found[0] - azimuth).abs() < 1e-9 && (found[1] - retardance).abs() < 1e-9, "{found:?}");
        }
    }
}
