//! The operation `camera`: photon transfer of a camera from photographs of even light and of darkness.

use crate::report::{Report, Spatial};
use crate::response::Response;
use crate::series::{Series, largest};
use crate::spatial::{bad, local, mean, scatter};
use crate::transfer::{DarkLine, Level, Transfer, level, transfer};
use nacre_base::estimate::Work;
use nacre_base::operation::Operation;
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{CALIBRATION_FILE, Calibration, CameraCalibration, NoiseModel};
use nacre_image::{Attribute, budget, write_exr, write_png8};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Signal at which differences of the response are judged, as a share of saturation (EMVA 1288).
const HALF: f64 = 0.5;

/// Largest deviation from proportionality that needs no warning.
const LINEAR: f64 = 0.01;

/// Mean deviation of file values from proportionality above which the files have a tone curve: sensors stay below.
const ENCODED: f64 = 0.05;

/// Variance of darkness in DN² below which the quantisation hides the read noise (EMVA 1288).
const QUANTISED: f64 = 0.24;

/// Chi-square per degree of freedom above which the photon transfer is not a straight line.
const BENT: f64 = 4.0;

/// Measure gain, noise, full well and bad pixels of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "CameraOptions", extend(
    "x-input" = "Folder of photographs of even light: each exposure twice or more",
    "x-examples" = "\
Examples:
  nacre calibrate camera flats --darks darks --out camera

Photograph an evenly lit white surface out of focus, from short exposures to overexposed ones, each
twice or more, then the same exposures with the lens covered. Gain, lens and light stay as they are.
Exposures come from a frames.json, or from Exif tags. Instead of --darks, frames of a frames.json
may name their dark photographs (\"dark\").

Writes report.json, calibration.json, noise.json (\"noise\", \"black\" and \"white\" of a frames.json),
dark.exr (mean of darkness) and bad-pixels.png. Definitions are those of EMVA Standard 1288."
))]
pub struct Options {
    /// Folder of photographs of darkness, each exposure twice or more (default: the `dark` of each frame).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-file" = true, "x-placeholder" = "DIR"))]
    pub darks: Option<PathBuf>,
    /// Channel of colour photographs: 0 red, 1 green, 2 blue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true), range(min = 0, max = 2))]
    pub channel: Option<usize>,
}

impl Options {
    /// Both series, of photographs of one camera.
    fn series(&self, input: &Path) -> Result<[Series; 2]> {
        let lit = Series::list(input)?;
        let dark = self.darks.as_deref().map_or_else(|| Series::darks_of(input), Series::list)?;
        let alike = |s: &Series| (s.info.width, s.info.height, s.info.channels, s.info.depth, s.gain.to_bits());
        if alike(&lit) != alike(&dark) {
            let problem = "has dark photographs of another size, depth or gain than the flats";
            return Err(Error::file(&dark.folder, problem, "take both with the same camera and settings"));
        }
        Ok([lit, dark])
    }

    fn channel_of(&self, series: &Series) -> Result<usize> {
        let channel = self.channel.unwrap_or(if series.info.channels == 1 { 0 } else { 1 });
        if channel < series.info.channels {
            return Ok(channel);
        }
        let problem = format!("is {channel}, the photographs have {} channels", series.info.channels);
        Err(Error::input("channel", problem, "leave it out for grey photographs"))
    }
}

impl Operation for Options {
    const NAME: &'static str = "camera";
    const TITLE: &'static str = "Noise of a camera, from photographs of even light and of darkness";
    type Report = Report;

    fn check(&self, input: &Path) -> Result<Work> {
        let [lit, dark] = self.series(input)?;
        self.channel_of(&lit)?;
        let (info, count) = (lit.info, (lit.count() + dark.count()) as u64);
        let pixels = (info.width * info.height) as u64;
        let work = Work {
            operation: Self::NAME.into(),
            seconds: 0.05 + 4e-8 * (pixels * info.channels as u64 * (count + 4)) as f64,
            memory_bytes: 2 * budget::decoded(info) + 40 * pixels,
            disk_bytes: 5 * pixels,
            ..Work::default()
        };
        budget::check(&lit.groups[0].files[0], info, work.memory_bytes)?;
        Ok(work)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let begun = Instant::now();
        let [lit, dark] = self.series(input)?;
        let channel = self.channel_of(&lit)?;
        let Noise { found, response, bright, black } = noise(&lit, &dark, channel, progress)?;
        let swing = found.saturation_dn - found.black_dn;
        let near_half = |l: &&Level| ((l.mean_dn - found.black_dn) / swing - HALF).abs();
        // There is a level, or there would be no transfer.
        let half = bright.iter().min_by(|a, b| near_half(a).total_cmp(&near_half(b))).unwrap_or(&bright[0]);
        let longest = &dark.groups[dark.groups.len() - 1];
        let flat = lit.nearest(half.exposure_s);
        progress.stage("comparing pixels", (longest.files.len() + flat.files.len()) as u64);
        let (dark_mean, flat_mean) = (mean(longest, channel, progress)?, mean(flat, channel, progress)?);
        let light = |dn: f32| response.linearised(dn.into()) as f32;
        let signal: Vec<f32> = flat_mean.iter().zip(&dark_mean).map(|(f, d)| light(*f) - light(*d)).collect();
        let width = lit.info.width;
        let (dark_local, signal_local) = (local(&dark_mean, width), local(&signal, width));
        let signal_dn = half.mean_dn - found.black_dn;
        let bad = bad(&dark_local, &signal_local, signal_dn as f32);
        let temporal = |level: &Level, count: usize| level.variance_dn2 / count as f64;
        let of_darkness = temporal(&black[black.len() - 1], longest.files.len());
        let of_signal = temporal(half, flat.files.len()) + of_darkness;
        let spatial = Spatial {
            dsnu_e: scatter(&dark_local, &bad, of_darkness) / found.gain_dn_e.value,
            prnu: scatter(&signal_local, &bad, of_signal) / signal_dn,
            bad_pixels: bad.iter().filter(|b| **b).count(),
        };
        let white = response.white_dn;
        let noise = NoiseModel {
            // A frames.json states the electrons at gain 1.
            full_scale_e: (response.linearised(white) - found.black_dn) / found.gain_dn_e.value * lit.gain,
            read_noise_e: found.read_noise_e.value,
        };
        let mut warnings: Vec<String> = lit.warnings.iter().chain(&dark.warnings).cloned().collect();
        warnings.extend(doubts(&found, &response, &black));
        let response = (!response.is_linear()).then_some(response);
        let report = Report {
            method: "camera",
            warnings,
            transfer: found,
            response,
            spatial,
            noise,
            lit: bright,
            dark: black,
            seconds: begun.elapsed().as_secs_f64(),
        };
        let size = [width, lit.info.height];
        let row = |_: usize, y: usize, row: &mut [f32]| row.copy_from_slice(&dark_mean[y * width..][..width]);
        let units = [("units", Attribute::Text("DN".into()))];
        write_exr(&out.path("dark.exr"), size[0], size[1], &["mean"], &units, &row)?;
        let mask: Vec<u8> = bad.iter().map(|b| if *b { 255 } else { 0 }).collect();
        write_png8(&out.path("bad-pixels.png"), size[0], size[1], 1, &mask)?;
        out.write("noise.json", report.for_frames(white).as_bytes())?;
        let black = report.transfer.black_dn;
        let response = response.map(|r| r.coefficients);
        let camera = CameraCalibration { source: None, noise, black, white, gain: lit.gain, response };
        out.write_json(CALIBRATION_FILE, &Calibration { camera: Some(camera), ..Calibration::default() })?;
        Ok(report)
    }
}

/// Noise and response of a camera, and the levels they stem from.
struct Noise {
    found: Transfer,
    response: Response,
    bright: Vec<Level>,
    black: Vec<Level>,
}

/// Photon transfer of a series. For a nonlinear camera, it is measured again on corrected values.
fn noise(lit: &Series, dark: &Series, channel: usize, progress: &dyn Progress) -> Result<Noise> {
    progress.stage("measuring noise", (lit.count() + dark.count()) as u64);
    let levels = |series: &Series, response: &Response| {
        series.groups.iter().map(|g| level(g, channel, response, progress)).collect::<Result<Vec<Level>>>()
    };
    let unsaturated = |found: Option<Transfer>| {
        let problem = "has no photograph that is brighter than darkness and not saturated";
        let remedy = "add shorter exposures, from 5 to 70 % of white";
        found.ok_or_else(|| Error::file(&lit.folder, problem, remedy))
    };
    let straight = Response::linear(0.0, lit.white.unwrap_or_else(|| largest(lit.info.depth)));
    let (mut bright, black) = (levels(lit, &straight)?, levels(dark, &straight)?);
    let mut found = unsaturated(transfer(&bright, &black))?;
    // Without a statement of white, it is where the series saturates.
    let stated = lit.white.or(found.full_well_e.map(|_| found.saturation_dn));
    let darkness = DarkLine::of(&black);
    let ends = [darkness.offset, stated.unwrap_or(straight.white_dn)];
    let response = Response::measure(&bright, &|l| darkness.at(l), ends);
    if !response.is_linear() {
        progress.stage("measuring noise of corrected values", lit.count() as u64);
        bright = levels(lit, &response)?;
        found = unsaturated(transfer(&bright, &black))?;
    }
    Ok(Noise { found, response, bright, black })
}

/// Reasons to doubt the results.
fn doubts(found: &Transfer, response: &Response, dark: &[Level]) -> Vec<String> {
    let mut doubts = vec![];
    if found.full_well_e.is_none() {
        doubts.push("no photograph is saturated: the full well is not measured; add longer exposures".into());
    }
    if let Some(share) = found.linearity_error.filter(|share| *share > LINEAR) {
        let percent = 100.0 * share;
        doubts.push(format!(
            "the response deviates from proportionality by {percent:.1} % on average: give linear files (RAW, or no gamma)"
        ));
    }
    if response.deviation > ENCODED {
        doubts.push("values are far from proportional to light: the files have a tone curve; give linear files".into());
    }
    if found.chi_square > BENT {
        doubts.push(format!(
            "the variance is no straight line over the mean (chi-square {:.1}): the files are processed, or the light flickers",
            found.chi_square
        ));
    }
    if dark.first().is_some_and(|d| d.variance_dn2 < QUANTISED) {
        doubts.push("the steps of the file hide the read noise: its value is an upper bound; raise the gain".into());
    }
    doubts
}
