//! The whole job: a bracket to one photograph, its variance and a report in a new folder.

use super::align::{Aligner, Shifts, add_moved};
use super::coding::{Coding, Curve};
use super::input::bracket;
use super::merge::{Exposed, Sums};
use super::outcome::Outcome;
use super::output::Merged;
use super::recover::{recover, response};
use super::report::{Report, Seconds};
use super::response::Response;
use super::sample::Sample;
use crate::frames::{Frame, LoadedFrames, Transfer};
use crate::image::{Depth, OutputFolder, Raster, read};
use crate::polarimetry::Align;
use crate::progress::Progress;
use crate::{Error, Result};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Exposures that are decoded and merged at a time.
const BATCH: usize = 4;

/// Decoded exposures up to so many bytes are kept for when they are needed again.
const KEPT: usize = 256 << 20;

/// What the user may choose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// How the photographs' values grow with light.
    pub response: ResponseChoice,
    /// Whether exposures that lie shifted against each other are moved back.
    pub align: Align,
    /// Replace results that are already there.
    #[serde(skip)]
    pub overwrite: bool,
}

/// How values grow with light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ResponseChoice {
    /// As the photographs' `transfer` says; photographs without a `frames.json` are recovered from where they have 8 bits, and
    /// taken for linear otherwise.
    #[default]
    Stated,
    /// In proportion.
    Linear,
    /// By a curve that is recovered from the bracket.
    Recover,
    /// By the curve of an earlier recovery.
    #[serde(skip)]
    File(PathBuf),
}

impl std::str::FromStr for ResponseChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        Ok(match text {
            "linear" => Self::Linear,
            "recover" => Self::Recover,
            file => Self::File(file.into()),
        })
    }
}

/// Merges `input` (a session folder, a `frames.json` with one view in several exposures, or a folder of photographs that say
/// their times) into the new folder `out`.
///
/// Memory: two floats per sample (pixel and channel), four decoded photographs, and at most 256 MB of photographs that are
/// needed again, whatever their number.
///
/// # Errors
/// `Input` for anything about the photographs, before anything is written; `Output` when writing fails, after which nothing
/// is left behind; `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, options: &Options, progress: &dyn Progress) -> Result<Report> {
    let begun = Instant::now();
    let bracket = Bracket::new(bracket(input)?);
    let folder = OutputFolder::begin(out, options.overwrite)?;
    let looked = look(&bracket, options, progress)?;
    let look_s = begun.elapsed().as_secs_f64();
    let merged = merge(&bracket, looked, progress)?;
    let merge_s = begun.elapsed().as_secs_f64() - look_s;
    progress.stage("writing", 1);
    let info = bracket.frames.info;
    let maps = Merged { sums: &merged.sums, width: info.width, height: info.height, factor: merged.factor() };
    let mut report = merged.report(&bracket.frames, maps.names(), maps.numbers());
    maps.write(&folder)?;
    progress.check()?;
    if let Curve::Measured(response) = &merged.coding.curve {
        // Plain data always serialises.
        folder.write("response.json", serde_json::to_string(response).unwrap_or_default().as_bytes())?;
    }
    let total = begun.elapsed().as_secs_f64();
    report.seconds = Seconds { look: look_s, merge: merge_s, write: total - look_s - merge_s, total };
    folder.write("report.json", report.json().as_bytes())?;
    folder.commit()?;
    progress.step();
    Ok(report)
}

/// What is merged.
struct Bracket {
    frames: LoadedFrames,
    /// Channels of the files.
    channels: Vec<usize>,
}

impl Bracket {
    fn new(frames: LoadedFrames) -> Self {
        let channels = match frames.set.channel {
            Some(channel) => vec![channel.index()],
            None => (0..frames.info.channels).collect(),
        };
        Self { frames, channels }
    }

    /// Decodes an exposure.
    fn raster(&self, name: &Path) -> Result<Raster> {
        let (path, info) = (self.frames.file(name), self.frames.info);
        let raster = read(&path)?;
        if (raster.width, raster.height, raster.channels) == (info.width, info.height, info.channels) {
            return Ok(raster);
        }
        Err(Error::file(&path, "has changed while it was read", "try again once nobody writes to it"))
    }

    fn dark<'a>(&'a self, frame: &'a Frame) -> Option<&'a PathBuf> {
        frame.dark.as_ref().or(self.frames.set.dark.as_ref())
    }

    /// Light of every merged sample of a photograph.
    fn plane(&self, coding: &Coding, name: &Path) -> Result<Vec<f32>> {
        use crate::image::Samples as S;
        let raster = self.raster(name)?;
        let n = self.channels.len();
        let value = |i: usize| -> f64 {
            let at = i / n * raster.channels + self.channels[i % n];
            match &raster.samples {
                S::U8(v) => v[at].into(),
                S::U16(v) => v[at].into(),
                S::F32(v) => v[at].into(),
            }
        };
        let light = |i: usize| coding.light(self.channels[i % n], value(i)) as f32;
        Ok((0..raster.width * raster.height * n).into_par_iter().map(light).collect())
    }
}

/// What is known before anything is merged.
struct Looked {
    coding: Coding,
    response: String,
    response_sigma: Option<f64>,
    seen: Option<f64>,
    shifts: Option<Shifts>,
    sample: Sample,
    /// Decoded exposures that were kept, by their position.
    kept: Vec<Option<Raster>>,
}

fn look(bracket: &Bracket, options: &Options, progress: &dyn Progress) -> Result<Looked> {
    let frames = &bracket.frames;
    let (set, info, count) = (&frames.set, frames.info, frames.set.frames.len());
    let stated = |transfer| Coding::new(frames, Curve::Stated(transfer));
    let coding = match &options.response {
        ResponseChoice::Linear => Some((stated(Transfer::Linear), "linear".to_owned())),
        ResponseChoice::File(path) => {
            Some((Coding::new(frames, Curve::Measured(Response::read(path)?)), path.display().to_string()))
        }
        ResponseChoice::Stated if set.transfer != Transfer::Recover => {
            Some((stated(set.transfer), name_of(set.transfer)))
        }
        _ => None,
    };
    if coding.is_none() && info.depth == Depth::F32 {
        let problem = "floating-point values have no code to recover a response for";
        return Err(Error::file(&frames.path, problem, "use --response linear"));
    }
    let mut sample = Sample::new(info.width, info.height, &bracket.channels, count);
    let mut kept: Vec<Option<Raster>> = (0..count).map(|_| None).collect();
    let aligns = options.align == Align::Auto && count > 1;
    if coding.is_some() && !aligns {
        let (coding, response) = coding.unwrap_or_else(|| (stated(Transfer::Linear), String::new()));
        return Ok(Looked { coding, response, response_sigma: None, seen: None, shifts: None, sample, kept });
    }
    progress.stage("looking at the exposures", count as u64);
    let bytes = info.width * info.height * info.channels * if info.depth == Depth::U8 { 1 } else { 2 };
    for (k, frame) in set.frames.iter().enumerate() {
        progress.check()?;
        let raster = bracket.raster(&frame.file)?;
        sample.put(k, &raster);
        kept[k] = ((k + 1) * bytes <= KEPT).then_some(raster);
        progress.step();
    }
    let mut looked = match coding {
        Some((coding, response)) => {
            Looked { coding, response, response_sigma: None, seen: None, shifts: None, sample, kept }
        }
        None => recovered(bracket, sample, kept)?,
    };
    if aligns {
        looked.shifts = Some(shifts(bracket, &looked, progress)?);
    }
    Ok(looked)
}

fn name_of(transfer: Transfer) -> String {
    match transfer {
        Transfer::Linear => "linear".into(),
        Transfer::Srgb => "sRGB".into(),
        Transfer::Gamma(g) => format!("gamma {g}"),
        Transfer::Recover => "recovered".into(),
    }
}

fn recovered(bracket: &Bracket, sample: Sample, kept: Vec<Option<Raster>>) -> Result<Looked> {
    let frames = &bracket.frames;
    let linear = Coding::new(frames, Curve::Stated(Transfer::Linear));
    let scales: Vec<f64> = frames.set.frames.iter().map(Frame::scale).collect();
    let one = |position: usize| {
        let values = sample.of_channel(position);
        let positions = |v: &Vec<f32>| v.iter().map(|v| linear.position(f64::from(*v))).collect();
        recover(&values.iter().map(positions).collect::<Vec<Vec<f64>>>(), &scales)
    };
    let channels: std::result::Result<Vec<_>, String> = (0..bracket.channels.len()).into_par_iter().map(one).collect();
    let remedy = "give more exposures, an evenly lit scene with all shades, or say the response with --response";
    let channels = channels.map_err(|problem| Error::file(&frames.path, problem, remedy))?;
    let sigma = channels.iter().map(|c| c.sigma).fold(0.0, f64::max);
    let seen = channels.iter().map(|c| c.seen).fold(1.0, f64::min);
    Ok(Looked {
        coding: Coding::new(frames, Curve::Measured(response(&channels))),
        response: "recovered".into(),
        response_sigma: Some(sigma),
        seen: Some(seen),
        shifts: None,
        sample,
        kept,
    })
}

/// How the exposures lie over each other. The one in the middle decides where to look.
fn shifts(bracket: &Bracket, looked: &Looked, progress: &dyn Progress) -> Result<Shifts> {
    let (frames, info) = (&bracket.frames.set.frames, bracket.frames.info);
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by(|a, b| frames[*a].scale().total_cmp(&frames[*b].scale()));
    let middle = order[order.len() / 2];
    order.retain(|k| *k != middle);
    order.insert(0, middle);
    let mut aligner = Aligner::new(info.width, info.height);
    progress.stage("registering", frames.len() as u64);
    for k in &order {
        progress.check()?;
        let raster = match &looked.kept[*k] {
            Some(raster) => raster.clone(),
            None => bracket.raster(&frames[*k].file)?,
        };
        aligner.add(&looked.coding, &Exposed { frame: &frames[*k], raster, dark: vec![] }, &bracket.channels);
        progress.step();
    }
    let mut shifts = aligner.shifts();
    let found = shifts.shifts_px.clone();
    found.iter().zip(&order).for_each(|(shift, k)| shifts.shifts_px[*k] = *shift);
    Ok(shifts)
}

fn merge(bracket: &Bracket, looked: Looked, progress: &dyn Progress) -> Result<Outcome> {
    let Looked { coding, response, response_sigma, seen, shifts, mut sample, mut kept } = looked;
    let (frames, info) = (&bracket.frames.set.frames, bracket.frames.info);
    let mut sums = Sums::new(info.width * info.height, &bracket.channels);
    let moved = shifts.as_ref().filter(|s| s.corrected).map(|s| s.shifts_px.clone());
    let sampled = sample.values.iter().any(|v| !v.is_empty());
    progress.stage("merging", frames.len() as u64);
    // Longest first.
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by(|a, b| frames[*a].scale().total_cmp(&frames[*b].scale()));
    let mut dark: Option<(PathBuf, Vec<f32>)> = None;
    for batch in order.chunks(BATCH) {
        progress.check()?;
        let rasters: Vec<(usize, Option<Raster>)> = batch.iter().map(|k| (*k, kept[*k].take())).collect();
        let decode = |(k, raster): (usize, Option<Raster>)| -> Result<Raster> {
            raster.map_or_else(|| bracket.raster(&frames[k].file), Ok)
        };
        let decoded: Result<Vec<Raster>> = rasters.into_par_iter().map(decode).collect();
        let mut exposures = Vec::with_capacity(BATCH);
        for (raster, k) in decoded?.into_iter().zip(batch) {
            let frame = &frames[*k];
            if !sampled {
                sample.put(*k, &raster);
            }
            let dark = match bracket.dark(frame) {
                None => vec![],
                Some(name) => {
                    let known = dark.take().filter(|(known, _)| known == name);
                    let plane = known.map_or_else(|| bracket.plane(&coding, name), |(_, plane)| Ok(plane))?;
                    let scaled = plane.iter().map(|v| v * frame.scale() as f32).collect();
                    dark = Some((name.clone(), plane));
                    scaled
                }
            };
            exposures.push(Exposed { frame, raster, dark });
        }
        match &moved {
            Some(moved) => exposures.iter().zip(batch).for_each(|(exposed, k)| {
                add_moved(&mut sums, &coding, exposed, &bracket.channels, moved[*k]);
            }),
            None => sums.add(&coding, &exposures),
        }
        batch.iter().for_each(|_| progress.step());
    }
    if let Some(flat) = &bracket.frames.set.flat {
        let light = bracket.plane(&coding, flat)?;
        if !sums.divide(&light) {
            let path = bracket.frames.file(flat);
            return Err(Error::file(&path, "is black", "give a photograph of an evenly lit white surface"));
        }
    }
    // Exposures that were moved do not lie where the sample was taken.
    let agreement = moved.is_none().then(|| sample.agreement(&coding, frames));
    let noise_given = bracket.frames.set.noise.is_some();
    Ok(Outcome { coding, sums, response, response_sigma, seen, shifts, agreement, noise_given })
}
