//! Conversion of file values to light.

use super::{Clipping, Frame, FrameSet, LoadedFrames, Transfer};
use nacre_base::vectors::vectorised;
use nacre_base::{Error, Result};
use nacre_image::{Depth, Info, Raster, Samples, read_into};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Maximum number of dark photographs of single frames in a set; all are kept in memory.
const MAX_DARKS: usize = 16;

/// Converts the values of a set's files to light between 0 (black) and 1 (white). 8-bit and 16-bit values use a table.
pub struct Linearizer {
    transfer: Transfer,
    black: f32,
    factor: f32,
    white: f32,
    table: Vec<f32>,
    channel: usize,
    /// Subtracted from frames without an individual dark photograph.
    dark: Vec<f32>,
    /// Individual dark photographs.
    darks: Vec<(PathBuf, Vec<f32>)>,
    /// Buffers of dropped photographs for reuse, because fresh memory is slow.
    spare: Mutex<Vec<Vec<u16>>>,
    /// Clipping values of the photographs read so far.
    clipping: Mutex<Clipping>,
}

/// Number of buffers kept.
const SPARE: usize = 2;

/// One decoded photograph, accessed as rows of light.
pub struct LinearFrame<'a> {
    linearizer: &'a Linearizer,
    raster: Raster,
    scale: f32,
    /// File value at and above which a pixel is saturated.
    limit: f32,
    dark: &'a [f32],
}

impl Linearizer {
    /// For a validated set; reads its dark photographs, if any.
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

    /// Reads new dark photographs of these frames.
    ///
    /// # Errors
    /// `Input` for an unreadable file, and for more than 16 dark photographs.
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

    /// Quantisation step in units of white minus black; 0 for floating-point files.
    pub fn step(&self) -> f64 {
        if self.table.is_empty() { 0.0 } else { self.factor.into() }
    }

    /// Light of the lowest code, at which the sensor clips. `None` for floating-point files, and with a dark photograph
    /// that is subtracted after clipping.
    pub fn lowest(&self) -> Option<f64> {
        let subtracted = !self.dark.is_empty() || !self.darks.is_empty();
        self.table.first().filter(|_| !subtracted).map(|v| f64::from(*v))
    }

    /// Decodes a photograph and multiplies its light by `scale`.
    pub fn read(&self, path: &Path, scale: f64) -> Result<LinearFrame<'_>> {
        let spare = self.spare().pop().unwrap_or_default();
        let raster = read_into(path, spare)?;
        Ok(LinearFrame { linearizer: self, raster, scale: scale as f32, limit: self.white, dark: &self.dark })
    }

    /// Decodes a frame of the set: light per exposure and gain, with the applicable dark photograph subtracted.
    pub fn frame(&self, frames: &LoadedFrames, frame: &Frame) -> Result<LinearFrame<'_>> {
        let own = self.darks.iter().find(|(name, _)| Some(name) == frame.dark.as_ref());
        let mut decoded = self.read(&frames.file(&frame.file), frame.scale())?;
        self.clipping.lock().unwrap_or_else(PoisonError::into_inner).observe(&decoded.raster, self.channel);
        decoded.dark = own.map_or(&self.dark, |(_, plane)| plane);
        Ok(decoded)
    }

    /// Warning if the photographs read so far clip below white.
    pub fn clipping(&self) -> Option<String> {
        let clipping = self.clipping.lock().unwrap_or_else(PoisonError::into_inner);
        clipping.warning(self.white.into(), "in frames.json \"white\":")
    }

    fn spare(&self) -> MutexGuard<'_, Vec<Vec<u16>>> {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Releases the buffers kept for reuse.
    pub fn rest(&self) {
        self.spare().clear();
    }

    /// Light of a whole photograph, row by row. A file in floating point beside photographs in integers holds relative
    /// light, and 0 where it is not a number.
    pub fn plane(&self, path: &Path) -> Result<Vec<f32>> {
        let frame = self.read(path, 1.0)?;
        let width = frame.raster.width;
        if let (Samples::F32(v), false) = (&frame.raster.samples, self.table.is_empty()) {
            let own = v.iter().skip(self.channel).step_by(frame.raster.channels);
            return Ok(own.map(|v| if v.is_finite() { *v } else { 0.0 }).collect());
        }
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

/// True for a flat field in floating point beside photographs in integers: it holds relative light, as `nacre calibrate
/// flat` writes it.
pub(crate) fn is_relative(flat: Info, photographs: Info) -> bool {
    let same = Info { depth: photographs.depth, ..flat } == photographs;
    same && flat.depth == Depth::F32 && photographs.depth != Depth::F32
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
    /// Treats pixels within `margin` of white (in light, relative to white minus black) as saturated.
    pub fn below_white(mut self, margin: f64) -> Self {
        let l = self.linearizer;
        self.limit = l.white - (margin / l.transfer.slope(1.0)) as f32 / l.factor;
        self
    }

    /// Light of row `y`; sets `bad[x]` to 1 where the pixel is saturated or not a number.
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
                    // Stored as 0, so that sums stay finite.
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

/// The common case of 8 and 16 bits: a pixel is saturated if its value reaches white.
fn integers<T: Copy + Into<u16>>(v: &[T], step: usize, frame: &LinearFrame, light: &mut [f32], bad: &mut [u8]) {
    let (l, scale, limit) = (frame.linearizer, frame.scale, frame.limit);
    if step == 1 && l.transfer == Transfer::Linear {
        // The same values as in the table, but computed eight at a time.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kind, load, save};
    use nacre_image::{write_exr, write_png16_gray};

    #[test]
    fn a_flat_field_in_floating_point_is_relative_light() {
        let place = tempfile::tempdir().unwrap();
        let path = |name: &str| place.path().join(name);
        write_png16_gray(&path("a.png"), 2, 1, &[1064, 2064]).unwrap();
        let values = [0.5, f32::NAN];
        write_exr(&path("flat.exr"), 2, 1, &["flat"], &[], &|_, _, row: &mut [f32]| row.copy_from_slice(&values))
            .unwrap();
        let set = FrameSet {
            flat: Some("flat.exr".into()),
            black: Some(64.0),
            white: Some(4095.0),
            ..FrameSet::new(Kind::Free, vec![Frame::new("a.png")])
        };
        std::fs::write(path("frames.json"), save(&set)).unwrap();
        let frames = load(place.path()).unwrap();
        let linearizer = Linearizer::new(&frames).unwrap();
        assert_eq!(linearizer.plane(&path("flat.exr")).unwrap(), [0.5, 0.0]);
        assert!((linearizer.plane(&path("a.png")).unwrap()[0] - 1000.0 / 4031.0).abs() < 1e-6);
        // Another size is refused.
        write_exr(&path("flat.exr"), 1, 1, &["flat"], &[], &|_, _, row: &mut [f32]| row.fill(1.0)).unwrap();
        assert!(load(place.path()).unwrap_err().to_string().contains("flat.exr"));
    }
}
