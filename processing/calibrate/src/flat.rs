//! The operation `flat`: unevenness of light and lens, from photographs of a uniform surface.

use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, Summary, lines};
use nacre_base::progress::Progress;
use nacre_base::statistics::quantile;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::{ASSUMED, CALIBRATION_FILE, Calibration, FlatCalibration, Frame, Linearizer, LoadedFrames, load};
use nacre_image::{Attribute, budget, write_exr, write_png8};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;

/// File of the flat field.
const FLAT: &str = "flat.exr";

/// Share of saturated pixels above which the photographs are refused.
const SATURATED: f64 = 0.001;

/// Noise of the flat field, as a share, above which more photographs are advised.
const NOISY: f64 = 0.005;

/// Smallest light of a pixel relative to the mean that a flat field corrects.
const DARKEST: f64 = 0.05;

/// Measure the unevenness of light and lens (flat field).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "FlatOptions", extend(
    "x-input" = "Session or frames.json of a uniform surface, photographed several times under one light",
    "x-examples" = "\
Examples:
  nacre calibrate flat paper --out flat

Photograph a uniform surface (white paper for diffuse light, a mirror for mirrored light) in place of
the sample, 16 times or more, with the lens, aperture, focus, pattern and light of the sessions. The
flat field is valid for these alone. At each angle of an analyser, photographs are averaged together.

Writes report.json, calibration.json, flat.exr (relative light, for the key \"flat\" of a frames.json)
and flat.png."
))]
pub struct Options {}

/// Report of the operation `flat`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "FlatReport")]
pub struct Report {
    /// `flat`.
    pub method: &'static str,
    /// Limitations of the result.
    pub warnings: Vec<String>,
    /// Number of photographs.
    pub photographs: usize,
    /// Light of the darkest and the brightest 1 % of the pixels, relative to the mean.
    pub range: [f64; 2],
    /// Standard deviation of a typical pixel of the flat field, as a share.
    pub sigma: f64,
    /// Share of pixels that are saturated in a photograph.
    pub saturated: f64,
    /// Seconds of processing.
    pub seconds: f64,
}

/// Sums over photographs.
struct Field {
    /// Mean light of each pixel per exposure and gain.
    light: Vec<f32>,
    /// Variance of the mean of a typical pixel.
    variance: f64,
    /// Number of saturated pixels.
    saturated: usize,
}

fn add_up(frames: &LoadedFrames, linearizer: &Linearizer, progress: &dyn Progress) -> Result<Field> {
    let (width, height) = (frames.info.width, frames.info.height);
    let all = &frames.set.frames;
    let mut sum = vec![0.0_f64; width * height];
    let mut bad = vec![0_u8; width * height];
    progress.stage("averaging photographs", all.len() as u64);
    for frame in all {
        let decoded = linearizer.frame(frames, frame)?;
        let mut row = vec![0.0; width];
        for y in 0..height {
            decoded.row(y, &mut row, &mut bad[y * width..][..width]);
            sum[y * width..][..width].iter_mut().zip(&row).for_each(|(s, v)| *s += f64::from(*v));
        }
        progress.step();
        progress.check()?;
    }
    let count = all.len() as f64;
    let light: Vec<f32> = sum.iter().map(|s| (s / count) as f32).collect();
    let typical = f64::from(quantile(&mut light.clone(), 0.5).unwrap_or(0.0)).max(0.0);
    let model = frames.set.noise.unwrap_or(ASSUMED);
    let of_frame = |f: &Frame| {
        let noise = model.frame(f.gain.unwrap_or(1.0), f.scale(), linearizer.step());
        let dark = if f.dark.is_some() || frames.set.dark.is_some() { noise.floor } else { 0.0 };
        // Noise of the subtracted dark photograph is common to all.
        ((noise.shot * typical + noise.floor) / count, dark)
    };
    let noise = all.iter().map(of_frame).fold((0.0, 0.0_f64), |(a, b), (c, d)| (a + c / count, b.max(d)));
    Ok(Field { light, variance: noise.0 + noise.1, saturated: bad.iter().filter(|b| **b > 0).count() })
}

impl Operation for Options {
    const NAME: &'static str = "flat";
    const TITLE: &'static str = "Flat field of light and lens, from photographs of a uniform surface";
    type Report = Report;

    fn check(&self, input: &Path) -> Result<Work> {
        let frames = load(input)?;
        if frames.info.channels != 1 && frames.set.channel.is_none() {
            let remedy = "state \"channel\" in frames.json";
            return Err(Error::file(&frames.path, "has colour photographs without a channel", remedy));
        }
        let (info, count) = (frames.info, frames.set.frames.len() as u64);
        let pixels = (info.width * info.height) as u64;
        let work = Work {
            operation: Self::NAME.into(),
            seconds: 0.1 + 4e-8 * (pixels * info.channels as u64 * (count + 4)) as f64,
            memory_bytes: budget::decoded(info) + 40 * pixels,
            disk_bytes: 6 * pixels,
            ..Work::default()
        };
        budget::check(&frames.file(&frames.set.frames[0].file), info, work.memory_bytes)?;
        Ok(work)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let begun = Instant::now();
        let mut frames = load(input)?;
        // A flat field of an earlier calibration is replaced, not refined.
        frames.set.flat = None;
        let linearizer = Linearizer::new(&frames)?;
        let Field { light, variance, saturated } = add_up(&frames, &linearizer, progress)?;
        let pixels = light.len() as f64;
        let saturated = saturated as f64 / pixels;
        let mean = light.iter().map(|v| f64::from(*v)).sum::<f64>() / pixels;
        if saturated > SATURATED {
            let problem = format!("has photographs with {:.1} % saturated pixels", 100.0 * saturated);
            return Err(Error::file(&frames.path, problem, "expose less"));
        }
        if mean <= 0.0 {
            return Err(Error::file(&frames.path, "has dark photographs", "expose longer, or check the light"));
        }
        let relative: Vec<f32> = light.iter().map(|v| (f64::from(*v) / mean) as f32).collect();
        let at = |share: f64| f64::from(quantile(&mut relative.clone(), share).unwrap_or(1.0));
        let report = Report {
            method: Self::NAME,
            warnings: frames.warnings.iter().cloned().chain(doubts(variance.sqrt() / mean, at(0.01))).collect(),
            photographs: frames.set.frames.len(),
            range: [at(0.01), at(0.99)],
            sigma: variance.sqrt() / mean,
            saturated,
            seconds: begun.elapsed().as_secs_f64(),
        };
        write(&frames, &relative, out)?;
        let flat = FlatCalibration { source: None, file: FLAT.into(), sigma: report.sigma };
        out.write_json(CALIBRATION_FILE, &Calibration { flat: Some(flat), ..Calibration::default() })?;
        Ok(report)
    }
}

fn doubts(sigma: f64, darkest: f64) -> Vec<String> {
    let mut doubts = vec![];
    if sigma > NOISY {
        doubts.push(format!(
            "the flat field has {:.1} % of noise per pixel, which corrected photographs take over: add photographs",
            100.0 * sigma
        ));
    }
    if darkest < DARKEST {
        doubts.push(format!(
            "the darkest pixels have {:.1} % of the mean light: the surface must fill the picture",
            100.0 * darkest
        ));
    }
    doubts
}

/// Writes the flat field as relative light, and as a picture.
fn write(frames: &LoadedFrames, relative: &[f32], out: &OutputFolder) -> Result<()> {
    let (width, height) = (frames.info.width, frames.info.height);
    let channels: Vec<&str> = if frames.info.channels == 1 { vec!["Y"] } else { vec!["R", "G", "B"] };
    let units = [("units", Attribute::Text("light relative to its mean".into()))];
    let row = |_: usize, y: usize, row: &mut [f32]| row.copy_from_slice(&relative[y * width..][..width]);
    write_exr(&out.path(FLAT), width, height, &channels, &units, &row)?;
    let highest = relative.iter().fold(f32::MIN, |a, b| a.max(*b)).max(1e-6);
    let grey: Vec<u8> = relative.iter().map(|v| (255.0 * (v / highest).clamp(0.0, 1.0)).round() as u8).collect();
    write_png8(&out.path("flat.png"), width, height, 1, &grey)?;
    Ok(())
}

impl Summary for Report {
    fn summary(&self) -> String {
        let [low, high] = self.range.map(|v| 100.0 * v);
        format!(
            "light     {low:.0} to {high:.0} % of the mean (1st and 99th percentile)\nnoise     {:.3} % per pixel, of {} \
             photographs\n{}time      {:.1} s",
            100.0 * self.sigma,
            self.photographs,
            lines(&[], &self.warnings),
            self.seconds
        )
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
