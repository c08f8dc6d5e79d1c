//! From file values to light.

use super::{Clipping, Frame, FrameSet, LoadedFrames, Transfer};
use nacre_base::vectors::vectorised;
use nacre_base::{Error, Result};
use nacre_image::{Depth, Raster, Samples, read_into};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Most dark photographs that belong to single frames of a set; they are all kept.
const MAX_DARKS: usize = 16;

/// Turns the values of one set's files into light between 0 (black) and 1 (white). 8 and 16 bit go through a table.
pub struct Linearizer {
    transfer: Transfer,
    black: f32,
    factor: f32,
    white: f32,
    table: Vec<f32>,
    channel: usize,
    /// Subtracted from frames that name no dark photograph of their own.
    dark: Vec<f32>,
    /// Those that frames name.
    darks: Vec<(PathBuf, Vec<f32>)>,
    /// Memory of photographs that are gone, for the next ones: memory that is new to the program takes time.
    spare: Mutex<Vec<Vec<u16>>>,
    /// Values at which the photographs read so far clip.
    clipping: Mutex<Clipping>,
}

/// Photographs whose memory is kept.
const SPARE: usize = 2;

/// One decoded photograph, seen as rows of light.
pub struct LinearFrame<'a> {
    linearizer: &'a Linearizer,
    raster: Raster,
    scale: f32,
    /// File value from which a pixel counts as saturated.
    limit: f32,
    dark: &'a [f32],
}

impl Linearizer {
    /// For a checked set; reads its dark photographs if it has any.
    pub fn new(frames: &LoadedFrames) -> Result<Self> {
        let set = &frames.set;
        let (black, white) = levels(set, frames.info.depth);
        let mut new = Self {
            transfer: set.transfer,
            black,
            factor: 1.0 / (white - black),
            white,
            table: Vec::new(),
            channel: set.file_channel(),
            dark: Vec::new(),
            darks: Vec::new(),
            spare: Mutex::default(),
            clipping: Mutex::default(),
        };
        new.table = match frames.info.depth {
            Depth::U8 => (0..=255).map(|v| new.light(v as f32)).collect(),
            Depth::U16 => (0..=65_535).map(|v| new.light(v as f32)).collect(),
            Depth::F32 => Vec::new(),
        };
        if let Some(dark) = &set.dark {
            new.dark = new.plane(&frames.file(dark))?;
        }
        new.learn(frames, &set.frames)?;
        Ok(new)
    }

    /// Reads dark photographs that these frames name and that are not known yet.
    ///
    /// # Errors
    /// `Input` when one cannot be read, or for more than 16 in all.
    pub fn learn(&mut self, frames: &LoadedFrames, new: &[Frame]) -> Result<()> {
        for dark in new.iter().filter_map(|f| f.dark.as_ref()) {
            if self.darks.iter().any(|(name, _)| name == dark) {
                continue;
            }
            if self.darks.len() == MAX_DARKS {
                let problem = format!("names more than {MAX_DARKS} dark photographs");
                return Err(Error::file(&frames.path, problem, "use one for all frames of the same exposure"));
            }
            let common = std::mem::take(&mut self.dark);
            let plane = self.plane(&frames.file(dark));
            self.dark = common;
            self.darks.push((dark.clone(), plane?));
        }
        Ok(())
    }

    /// Distance between two codes in units of white minus black; 0 for floating point.
    pub fn step(&self) -> f64 {
        if self.table.is_empty() { 0.0 } else { self.factor.into() }
    }

    /// Light of the lowest code, where the sensor cuts off; none for floating point, and where a dark photograph is subtracted from
    /// what was cut off.
    pub fn lowest(&self) -> Option<f64> {
        let subtracted = !self.dark.is_empty() || !self.darks.is_empty();
        self.table.first().filter(|_| !subtracted).map(|v| f64::from(*v))
    }

    /// Decodes a photograph; its light is multiplied by `scale`.
    pub fn read(&self, path: &Path, scale: f64) -> Result<LinearFrame<'_>> {
        let spare = self.spare().pop().unwrap_or_default();
        let raster = read_into(path, spare)?;
        Ok(LinearFrame { linearizer: self, raster, scale: scale as f32, limit: self.white, dark: &self.dark })
    }

    /// Decodes a frame of the set: light per exposure and gain, less the dark photograph that belongs to it.
    pub fn frame(&self, frames: &LoadedFrames, frame: &Frame) -> Result<LinearFrame<'_>> {
        let own = self.darks.iter().find(|(name, _)| Some(name) == frame.dark.as_ref());
        let mut decoded = self.read(&frames.file(&frame.file), frame.scale())?;
        self.clipping.lock().unwrap_or_else(PoisonError::into_inner).observe(&decoded.raster, self.channel);
        decoded.dark = own.map_or(&self.dark, |(_, plane)| plane);
        Ok(decoded)
    }

    /// A warning where the photographs read so far clip below white.
    pub fn clipping(&self) -> Option<String> {
        let clipping = self.clipping.lock().unwrap_or_else(PoisonError::into_inner);
        clipping.warning(self.white.into(), "in frames.json \"white\":")
    }

    fn spare(&self) -> MutexGuard<'_, Vec<Vec<u16>>> {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives back memory that is kept for more photographs.
    pub fn rest(&self) {
        self.spare().clear();
    }

    /// All light of one photograph, row by row.
    pub fn plane(&self, path: &Path) -> Result<Vec<f32>> {
        let frame = self.read(path, 1.0)?;
        let width = frame.raster.width;
        let (mut light, mut bad) = (vec![0.0; width * frame.raster.height], vec![0; width]);
        for (y, row) in light.chunks_mut(width).enumerate() {
            frame.row(y, row, &mut bad);
        }
        Ok(light)
    }

    fn light(&self, value: f32) -> f32 {
        self.transfer.decode((value - self.black) * self.factor)
    }
}

fn levels(set: &FrameSet, depth: Depth) -> (f32, f32) {
    (set.black.unwrap_or(0.0) as f32, set.white.map_or(depth.full_scale(), |w| w as f32))
}

impl Drop for LinearFrame<'_> {
    fn drop(&mut self) {
        let mut spare = self.linearizer.spare();
        if let Samples::U16(samples) = &mut self.raster.samples
            && spare.len() < SPARE
        {
            spare.push(std::mem::take(samples));
        }
    }
}

impl LinearFrame<'_> {
    /// Counts pixels as saturated that are nearer to white than `margin` (of white minus black, in light).
    pub fn below_white(mut self, margin: f64) -> Self {
        let l = self.linearizer;
        self.limit = l.white - (margin / l.transfer.slope(1.0)) as f32 / l.factor;
        self
    }

    /// Light of row `y`; `bad[x]` is set to 1 where the pixel is saturated or not a number.
    pub fn row(&self, y: usize, light: &mut [f32], bad: &mut [u8]) {
        self.strided(y, 0, 1, light, bad);
    }

    /// Light of pixels `start, start + stride, …` of row `y`.
    pub fn strided(&self, y: usize, start: usize, stride: usize, light: &mut [f32], bad: &mut [u8]) {
        let (l, r) = (self.linearizer, &self.raster);
        let first = (y * r.width + start) * r.channels + l.channel;
        let step = stride * r.channels;
        match &r.samples {
            Samples::U8(v) => integers(&v[first..], step, self, light, bad),
            Samples::U16(v) => integers(&v[first..], step, self, light, bad),
            Samples::F32(v) => {
                for ((out, bad), value) in light.iter_mut().zip(bad).zip(v[first..].iter().step_by(step)) {
                    // Stored as 0 to keep the sums finite.
                    let unusable = !value.is_finite() || *value >= self.limit;
                    *bad |= u8::from(unusable);
                    *out = if unusable { 0.0 } else { l.light(*value) * self.scale };
                }
            }
        }
        if !self.dark.is_empty() {
            let dark = self.dark[y * r.width + start..].iter().step_by(stride);
            light.iter_mut().zip(dark).for_each(|(v, d)| *v -= d * self.scale);
        }
    }
}

/// The common case, 8 and 16 bit: a pixel is saturated where its value reaches white.
fn integers<T: Copy + Into<u16>>(v: &[T], step: usize, frame: &LinearFrame, light: &mut [f32], bad: &mut [u8]) {
    let (l, scale, limit) = (frame.linearizer, frame.scale, frame.limit);
    if step == 1 && l.transfer == Transfer::Linear {
        // The table's own numbers, but calculated eight at a time.
        let (black, factor) = (l.black, l.factor);
        vectorised(
            #[inline(always)]
            || {
                for ((out, bad), value) in light.iter_mut().zip(bad.iter_mut()).zip(v) {
                    let value = f32::from((*value).into());
                    *bad |= u8::from(value >= limit);
                    *out = (value - black) * factor * scale;
                }
            },
        );
        return;
    }
    let saturated = limit.ceil() as usize;
    for ((out, bad), value) in light.iter_mut().zip(bad).zip(v.iter().step_by(step)) {
        let value = usize::from((*value).into());
        *bad |= u8::from(value >= saturated);
        *out = l.table[value] * scale;
    }
}
