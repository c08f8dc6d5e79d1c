//! The operation `stack`: photographs in, maps and a report out.

use super::combine::{self, Pixel};
use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, Summary, lines};
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use nacre_base::{Error, OutputFolder, Result};
use nacre_image::{
    Attribute, Depth, Info, Raster, Samples, Spool, budget, info, photographs, read, write_exr, write_png8,
};
use nacre_optics::color::srgb_code;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Number of rows combined together.
const ROWS: usize = 16;

/// Fraction of the values above white in the picture.
const BRIGHTER: f64 = 0.001;

/// Combine photographs of one view into their mean, median and standard deviation, without outliers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "StackOptions", extend(
    "x-input" = "Folder of photographs of one view, all of one size and exposure",
    "x-examples" = "\
Examples:
  nacre reconstruct stack darks/ --out dark                       read noise and hot pixels of a camera
  nacre reconstruct stack series/ --out mean --clip-sigma 3
  nacre reconstruct stack series/ --out mean --clip-sigma off

Writes mean.exr, median.exr, sigma.exr (standard deviation of one photograph), kept.exr (number of values that
were kept), mean.png and report.json, in the units of the files: no transfer function is applied."
))]
pub struct Options {
    /// Outliers: values further from the median of their pixel than this many robust standard deviations, or off.
    ///
    /// The standard deviation is computed from the median absolute deviation. It is at least the median over pixels of
    /// similar brightness in the same row. Series of fewer than four photographs have no outliers.
    #[schemars(extend("x-placeholder" = "off|N", "x-unset" = "off"), range(min = 1, max = 100))]
    pub clip_sigma: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self { clip_sigma: Some(4.0) }
    }
}

/// Report of a stack.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "StackReport")]
pub struct Report {
    /// Always `stack`.
    pub method: &'static str,
    /// Limitations of the result.
    pub warnings: Vec<String>,
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Channels of the photographs.
    pub channels: usize,
    /// Number of photographs.
    pub photographs: usize,
    /// Fraction of rejected values.
    pub rejected: f64,
    /// Median standard deviation of one photograph, in file units.
    pub sigma: Option<f64>,
    /// Measured standard error of a typical mean, in file units.
    pub error_estimate: Option<f64>,
    /// Computation time in seconds.
    pub seconds: f64,
}

impl Operation for Options {
    const NAME: &'static str = "stack";
    const TITLE: &'static str = "Mean, median and noise of a series of photographs, without outliers";
    type Report = Report;

    fn check(&self, input: &Path) -> Result<Work> {
        if let Some(sigma) = self.clip_sigma.filter(|sigma| !(1.0..=100.0).contains(sigma)) {
            return Err(Error::input("clip_sigma", format!("is {sigma}"), "give 1 to 100 standard deviations, or off"));
        }
        let files = photographs(input)?;
        if files.len() < 2 {
            return Err(Error::file(input, "holds one photograph", "give a folder with several of one view"));
        }
        let first = input.join(&files[0]);
        let header = info(&first)?;
        let samples = (header.width * header.height * header.channels) as u64;
        let work = Work {
            operation: Self::NAME.into(),
            seconds: 0.05 + 4e-8 * (samples * files.len() as u64) as f64,
            // Results take 20 bytes per pixel; the mean is sorted and encoded for the picture.
            memory_bytes: budget::decoded(header) + 28 * samples,
            disk_bytes: 16 * samples,
            ..Work::default()
        };
        budget::check(&first, header, work.memory_bytes)?;
        Ok(work)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let begun = Instant::now();
        let files: Vec<PathBuf> = photographs(input)?.iter().map(|name| input.join(name)).collect();
        let first = info(&files[0])?;
        let spool = spooled(&files, first, progress)?;
        let pixels = self.combined(&spool, first, progress)?;
        progress.stage("writing", 1);
        write(out, &pixels, first)?;
        let share = |of: fn(&Pixel) -> u32| pixels.iter().map(|p| f64::from(of(p))).sum::<f64>();
        let each = |of: fn(&Pixel) -> f64| median(pixels.iter().map(of).filter(|v| v.is_finite()).collect::<Vec<_>>());
        progress.step();
        Ok(Report {
            method: Self::NAME,
            warnings: warnings(&pixels),
            width: first.width,
            height: first.height,
            channels: first.channels,
            photographs: spool.count(),
            rejected: 1.0 - share(|p| p.kept) / share(|p| p.given).max(1.0),
            sigma: each(|p| p.sigma.into()),
            error_estimate: each(|p| f64::from(p.sigma) / f64::from(p.kept).sqrt()),
            seconds: begun.elapsed().as_secs_f64(),
        })
    }
}

impl Options {
    /// All pixels and channels, in the order of the photographs.
    fn combined(&self, spool: &Spool, first: Info, progress: &dyn Progress) -> Result<Vec<Pixel>> {
        let step = if first.depth == Depth::F32 { 0.0 } else { 1.0 };
        progress.stage("combining", first.height.div_ceil(ROWS) as u64);
        let mut pixels = Vec::with_capacity(first.width * first.height * first.channels);
        for begin in (0..first.height).step_by(ROWS) {
            progress.check()?;
            let of_row = |y: usize| Ok(combine::row(&spool.row(y)?, self.clip_sigma, step));
            let rows = (begin..(begin + ROWS).min(first.height)).into_par_iter().map(of_row);
            pixels.extend(rows.collect::<Result<Vec<_>>>()?.into_iter().flatten());
            progress.step();
        }
        Ok(pixels)
    }
}

/// All values of a photograph.
fn numbers(raster: &Raster) -> Box<dyn Iterator<Item = f32> + '_> {
    match &raster.samples {
        Samples::U8(v) => Box::new(v.iter().map(|v| f32::from(*v))),
        Samples::U16(v) => Box::new(v.iter().map(|v| f32::from(*v))),
        Samples::F32(v) => Box::new(v.iter().copied()),
    }
}

/// Reads all photographs, which must agree in size and depth.
fn spooled(files: &[PathBuf], first: Info, progress: &dyn Progress) -> Result<Spool> {
    progress.stage("reading", files.len() as u64);
    let mut spool = Spool::new(first.width * first.channels);
    for file in files {
        progress.check()?;
        let raster = read(file)?;
        if raster.info() != first {
            let problem = format!("is {}, and the first photograph {first}", raster.info());
            return Err(Error::file(file, problem, "give photographs of one size, depth and number of channels"));
        }
        spool.add(numbers(&raster))?;
        progress.step();
    }
    Ok(spool)
}

/// A map: file name, unit, and value of a pixel.
type Map = (&'static str, &'static str, fn(&Pixel) -> f32);

/// Writes the maps and the picture.
fn write(out: &OutputFolder, pixels: &[Pixel], Info { width, height, channels, .. }: Info) -> Result<()> {
    let names: &[&str] = if channels == 3 { &["R", "G", "B"] } else { &["Y"] };
    let maps: [Map; 4] = [
        ("mean.exr", "values of the files", |p| p.mean),
        ("median.exr", "values of the files", |p| p.median),
        ("sigma.exr", "standard deviation of one photograph, in values of the files", |p| p.sigma),
        ("kept.exr", "number of values that were kept", |p| p.kept as f32),
    ];
    for (name, units, value) in maps {
        let attributes = [("units", Attribute::Text(units.into()))];
        write_exr(&out.path(name), width, height, names, &attributes, &|c, y, row| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = value(&pixels[(y * width + x) * channels + c]));
        })?;
    }
    let mut means: Vec<f32> = pixels.iter().map(|p| p.mean).filter(|v| v.is_finite()).collect();
    means.sort_unstable_by(f32::total_cmp);
    let white = means.get(((1.0 - BRIGHTER) * means.len() as f64) as usize).copied().filter(|v| *v > 0.0);
    let code = |p: &Pixel| srgb_code(p.mean / white.unwrap_or(1.0));
    write_png8(&out.path("mean.png"), width, height, channels, &pixels.iter().map(code).collect::<Vec<_>>())
}

fn warnings(pixels: &[Pixel]) -> Vec<String> {
    let unknown = pixels.iter().filter(|p| p.given == 0).count();
    let none = (unknown > 0).then(|| format!("{unknown} values are NaN or infinite in all photographs"));
    none.into_iter().collect()
}

impl Summary for Report {
    fn summary(&self) -> String {
        let number = |v: Option<f64>| v.map_or("unknown".into(), |v| format!("{v:.4}"));
        let mut text = format!(
            "stack     {} photographs, {} × {} pixels, {} channel{}\n",
            self.photographs,
            self.width,
            self.height,
            self.channels,
            if self.channels == 1 { "" } else { "s" }
        );
        let _ = writeln!(text, "outliers  {:.3} % of the values rejected", 100.0 * self.rejected);
        let _ = writeln!(
            text,
            "noise     σ {} of one photograph, {} of a mean (medians, in values of the files)",
            number(self.sigma),
            number(self.error_estimate)
        );
        let _ = write!(text, "{}time      {:.2} s", lines(&[], &self.warnings), self.seconds);
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
