//! Merge of a bracket: photograph, variance and report in a new folder.

use super::align::{Aligner, add_moved};
use super::coding::{Coding, Curve};
use super::input::{BATCH, KEPT, bracket};
use super::merge::{Exposed, Sums};
use super::options::{Options, ResponseChoice};
use super::outcome::Outcome;
use super::output::Merged;
use super::recover::{recover, response};
use super::report::{Report, Seconds};
use super::response::Response;
use super::sample::{Agreement, Sample};
use crate::linear::is_relative;
use crate::{Clipping, Frame, LoadedFrames, Transfer};
use nacre_base::operation::perform;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::registration::{Align, Alignment};
use nacre_image::{Depth, OutputFolder, Raster, read};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Merges `input` (a session folder, a `frames.json` with one view in several exposures, or a folder of photographs
/// with exposure times) into the new folder `out`.
///
/// # Errors
/// `Input` for invalid photographs, before anything is written. `Output` if writing fails; the partial folder is then
/// removed. `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, options: &Options, progress: &dyn Progress) -> Result<Report> {
    perform(options, input, out, false, progress)
}

/// Merges into a folder.
///
/// Memory: two floats per sample (pixel and channel), four decoded photographs, and at most 256 MB of photographs kept
/// for reuse, independent of their number.
pub(super) fn merge_into(
    folder: &OutputFolder,
    input: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Report> {
    let begun = Instant::now();
    let bracket = Bracket::new(bracket(input, options.white)?);
    let looked = look(&bracket, options, progress)?;
    let look_s = begun.elapsed().as_secs_f64();
    let merged = merge(&bracket, looked, progress)?;
    let merge_s = begun.elapsed().as_secs_f64() - look_s;
    progress.stage("writing", 1);
    let info = bracket.frames.info;
    let maps = Merged { sums: &merged.sums, width: info.width, height: info.height };
    let mut report = merged.report(&bracket.frames, maps.names(), maps.numbers());
    maps.write(folder)?;
    progress.check()?;
    if let Curve::Measured(response) = &merged.coding.curve {
        // Serialising plain data cannot fail.
        folder.write("response.json", serde_json::to_string(response).unwrap_or_default().as_bytes())?;
    }
    let total = begun.elapsed().as_secs_f64();
    report.seconds = Seconds { look: look_s, merge: merge_s, write: total - look_s - merge_s, total };
    progress.step();
    Ok(report)
}

/// Input of the merge.
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
        let path = self.frames.file(name);
        let raster = read(&path)?;
        if raster.info() == self.frames.info || is_relative(raster.info(), self.frames.info) {
            return Ok(raster);
        }
        Err(Error::file(&path, "has changed while it was read", "try again once nobody writes to it"))
    }

    /// Light of every merged sample of a photograph. A file in floating point beside photographs in integers holds
    /// relative light.
    fn plane(&self, coding: &Coding, name: &Path) -> Result<Vec<f32>> {
        use nacre_image::Samples as S;
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
        let relative = is_relative(raster.info(), self.frames.info);
        let light = |i: usize| match value(i) {
            value if !relative => coding.light(self.channels[i % n], value) as f32,
            value if value.is_finite() => value as f32,
            _ => 0.0,
        };
        Ok((0..raster.width * raster.height * n).into_par_iter().map(light).collect())
    }
}

/// Results of the analysis before merging.
struct Looked {
    coding: Coding,
    /// Name of the response.
    response: String,
    /// Recovered response: its standard deviation, and fraction of codes observed.
    response_sigma: Option<f64>,
    seen: Option<f64>,
    shifts: Option<Alignment>,
    noise_factor: Option<f64>,
    sample: Sample,
    /// Decoded exposures kept for reuse, by index.
    kept: Vec<Option<Raster>>,
}

impl Looked {
    /// For a known response.
    fn known(coding: Coding, response: String, sample: Sample, kept: Vec<Option<Raster>>) -> Self {
        Self { coding, response, response_sigma: None, seen: None, shifts: None, noise_factor: None, sample, kept }
    }

    /// Shifts of the exposures, if they are to be resampled.
    fn moved(&self) -> Option<&Vec<[f64; 2]>> {
        self.shifts.as_ref().filter(|s| s.corrected).map(|s| &s.shifts_px)
    }
}

/// Coding and name of a response that is known without photographs.
fn known_response(frames: &LoadedFrames, choice: &ResponseChoice) -> Result<Option<(Coding, String)>> {
    let stated = |transfer| Some((Coding::new(frames, Curve::Stated(transfer)), name_of(transfer)));
    Ok(match choice {
        ResponseChoice::Linear => stated(Transfer::Linear),
        ResponseChoice::Stated if frames.set.transfer != Transfer::Recover => stated(frames.set.transfer),
        ResponseChoice::File(path) => {
            Some((Coding::new(frames, Curve::Measured(Response::read(path)?)), path.display().to_string()))
        }
        ResponseChoice::Stated | ResponseChoice::Recover if frames.info.depth == Depth::F32 => {
            let problem = "floating-point values have no code to recover a response for";
            return Err(Error::file(&frames.path, problem, "use --response linear"));
        }
        ResponseChoice::Stated | ResponseChoice::Recover => None,
    })
}

/// Estimates unknown response, shifts and noise. Photographs are read only if one of these is needed.
fn look(bracket: &Bracket, options: &Options, progress: &dyn Progress) -> Result<Looked> {
    let frames = &bracket.frames;
    let (set, info, count) = (&frames.set, frames.info, frames.set.frames.len());
    let response = known_response(frames, &options.response)?;
    let aligns = options.align == Align::Auto && count > 1;
    let calibrates = set.noise.is_none() && count > 1;
    let mut sample = Sample::new(info.width, info.height, &bracket.channels, count);
    let mut kept: Vec<Option<Raster>> = (0..count).map(|_| None).collect();
    if response.is_none() || aligns || calibrates {
        progress.stage("looking at the exposures", count as u64);
        let bytes = info.width * info.height * info.channels * info.depth.bytes();
        for (k, frame) in set.frames.iter().enumerate() {
            progress.check()?;
            let raster = bracket.raster(&frame.file)?;
            sample.put(k, &raster);
            kept[k] = ((k + 1) * bytes <= KEPT).then_some(raster);
            progress.step();
        }
    }
    let mut looked = match response {
        Some((coding, name)) => Looked::known(coding, name, sample, kept),
        None => recovered(bracket, sample, kept)?,
    };
    if aligns {
        looked.shifts = Some(shifts(bracket, &looked, progress)?);
    }
    // Resampled exposures no longer match the sampled positions.
    if calibrates && looked.moved().is_none() {
        put_darks(bracket, &looked.coding, &mut looked.sample)?;
        looked.noise_factor = looked.sample.comparison(&looked.coding, &set.frames).noise_factor();
        looked.coding.noise_factor = looked.noise_factor.unwrap_or(1.0);
    }
    Ok(looked)
}

/// Adds the dark signal at the sampled positions.
fn put_darks(bracket: &Bracket, coding: &Coding, sample: &mut Sample) -> Result<()> {
    let mut darks = Darks::default();
    for (k, frame) in bracket.frames.set.frames.iter().enumerate() {
        sample.put_dark(k, darks.of(bracket, coding, frame)?);
    }
    Ok(())
}

/// Light of dark photographs. The last one is kept, because exposures often share one.
#[derive(Default)]
struct Darks(Option<(PathBuf, Vec<f32>)>);

impl Darks {
    /// Dark light of every merged sample, relative to one exposure's value; empty without a dark photograph.
    fn of(&mut self, bracket: &Bracket, coding: &Coding, frame: &Frame) -> Result<&[f32]> {
        let Some(name) = frame.dark.as_ref().or(bracket.frames.set.dark.as_ref()) else { return Ok(&[]) };
        let plane = match self.0.take() {
            Some((known, plane)) if known == *name => plane,
            _ => bracket.plane(coding, name)?,
        };
        Ok(&self.0.insert((name.clone(), plane)).1)
    }
}

/// Indices of the exposures, longest first.
fn longest_first(frames: &[Frame]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by(|a, b| frames[*a].scale().total_cmp(&frames[*b].scale()));
    order
}

fn name_of(transfer: Transfer) -> String {
    match transfer {
        Transfer::Linear => "linear".into(),
        Transfer::Srgb => "sRGB".into(),
        Transfer::Gamma(g) => format!("gamma {g}"),
        Transfer::Polynomial(_) => "polynomial".into(),
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
    let coding = Coding::new(frames, Curve::Measured(response(&channels)));
    let known = Looked::known(coding, name_of(Transfer::Recover), sample, kept);
    Ok(Looked { response_sigma: Some(sigma), seen: Some(seen), ..known })
}

/// Registers the exposures. The middle exposure selects the windows.
fn shifts(bracket: &Bracket, looked: &Looked, progress: &dyn Progress) -> Result<Alignment> {
    let (frames, info) = (&bracket.frames.set.frames, bracket.frames.info);
    let mut order = longest_first(frames);
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

fn merge(bracket: &Bracket, mut looked: Looked, progress: &dyn Progress) -> Result<Outcome> {
    let (frames, info) = (&bracket.frames.set.frames, bracket.frames.info);
    let coding = &looked.coding;
    let mut sums = Sums::new(info.width * info.height, &bracket.channels);
    let moved = looked.moved().cloned();
    let sampled = looked.sample.values.iter().any(|v| !v.is_empty());
    let mut darks = Darks::default();
    let mut clipping: Vec<Clipping> = bracket.channels.iter().map(|_| Clipping::default()).collect();
    progress.stage("merging", frames.len() as u64);
    for batch in longest_first(frames).chunks(BATCH) {
        progress.check()?;
        let rasters: Vec<(usize, Option<Raster>)> = batch.iter().map(|k| (*k, looked.kept[*k].take())).collect();
        let decode = |(k, raster): (usize, Option<Raster>)| -> Result<Raster> {
            raster.map_or_else(|| bracket.raster(&frames[k].file), Ok)
        };
        let decoded: Result<Vec<Raster>> = rasters.into_par_iter().map(decode).collect();
        let mut exposures = Vec::with_capacity(BATCH);
        for (raster, k) in decoded?.into_iter().zip(batch) {
            let frame = &frames[*k];
            let dark = darks.of(bracket, coding, frame)?;
            bracket.channels.iter().zip(&mut clipping).for_each(|(channel, of)| of.observe(&raster, *channel));
            if !sampled {
                looked.sample.put(*k, &raster);
            }
            looked.sample.put_dark(*k, dark);
            let dark = dark.iter().map(|v| v * frame.scale() as f32).collect();
            exposures.push(Exposed { frame, raster, dark });
        }
        match &moved {
            Some(moved) => exposures.iter().zip(batch).for_each(|(exposed, k)| {
                add_moved(&mut sums, coding, exposed, &bracket.channels, moved[*k]);
            }),
            None => sums.add(coding, &exposures),
        }
        batch.iter().for_each(|_| progress.step());
    }
    if let Some(flat) = &bracket.frames.set.flat {
        let light = bracket.plane(coding, flat)?;
        if !sums.divide(&light, bracket.frames.set.flat_sigma() as f32) {
            let path = bracket.frames.file(flat);
            return Err(Error::file(&path, "is black", "give a photograph of an evenly lit white surface"));
        }
    }
    let agreement = moved.is_none().then(|| {
        let comparison = looked.sample.comparison(coding, frames);
        Agreement { chi2: comparison.agreement(1.0 / coding.noise_factor).chi2, ..comparison.agreement(1.0) }
    });
    let noise_given = bracket.frames.set.noise.is_some();
    let clipping = clipping.iter().find_map(|of| of.warning(coding.white(), "--white"));
    let Looked { coding, response, response_sigma, seen, shifts, noise_factor, .. } = looked;
    Ok(Outcome { coding, sums, response, response_sigma, seen, shifts, agreement, noise_given, noise_factor, clipping })
}
