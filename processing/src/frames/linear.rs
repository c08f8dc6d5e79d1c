//! From file values to light.

use super::{FrameSet, LoadedFrames, Transfer};
use crate::Result;
use crate::image::{Depth, Raster, Samples, read};
use std::path::Path;

/// Turns the values of one set's files into light between 0 (black) and 1 (white). 8 and 16 bit go through a table.
pub struct Linearizer {
    transfer: Transfer,
    black: f32,
    factor: f32,
    white: f32,
    table: Vec<f32>,
    channel: usize,
    dark: Vec<f32>,
}

/// One decoded photograph, seen as rows of light.
pub struct LinearFrame<'a> {
    linearizer: &'a Linearizer,
    raster: Raster,
    scale: f32,
}

impl Linearizer {
    /// For a checked set; reads its dark frame if it has one.
    pub fn new(frames: &LoadedFrames) -> Result<Self> {
        let set = &frames.set;
        let (black, white) = levels(set, frames.info.depth);
        let mut new = Self {
            transfer: set.transfer,
            black,
            factor: 1.0 / (white - black),
            white,
            table: Vec::new(),
            channel: set.channel.map_or(0, |c| c.index()),
            dark: Vec::new(),
        };
        new.table = match frames.info.depth {
            Depth::U8 => (0..=255).map(|v| new.light(v as f32)).collect(),
            Depth::U16 => (0..=65_535).map(|v| new.light(v as f32)).collect(),
            Depth::F32 => Vec::new(),
        };
        if let Some(dark) = &set.dark {
            new.dark = new.plane(&frames.file(dark))?;
        }
        Ok(new)
    }

    /// Distance between two codes in units of white minus black; 0 for floating point.
    pub fn step(&self) -> f64 {
        if self.table.is_empty() { 0.0 } else { self.factor.into() }
    }

    /// Decodes a photograph; its light is multiplied by `scale`.
    pub fn read(&self, path: &Path, scale: f64) -> Result<LinearFrame<'_>> {
        Ok(LinearFrame { linearizer: self, raster: read(path)?, scale: scale as f32 })
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

impl LinearFrame<'_> {
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
            Samples::U8(v) => table(&v[first..], step, l, self.scale, light, bad, |v| usize::from(*v)),
            Samples::U16(v) => table(&v[first..], step, l, self.scale, light, bad, |v| usize::from(*v)),
            Samples::F32(v) => {
                for ((out, bad), value) in light.iter_mut().zip(bad).zip(v[first..].iter().step_by(step)) {
                    // Stored as 0 to keep the sums finite.
                    let unusable = !value.is_finite() || *value >= l.white;
                    *bad |= u8::from(unusable);
                    *out = if unusable { 0.0 } else { l.light(*value) * self.scale };
                }
            }
        }
        if !l.dark.is_empty() {
            let dark = l.dark[y * r.width + start..].iter().step_by(stride);
            light.iter_mut().zip(dark).for_each(|(v, d)| *v -= d * self.scale);
        }
    }
}

/// The common case, 8 and 16 bit: a lookup, and saturation where the value reaches white.
fn table<T>(
    v: &[T],
    step: usize,
    l: &Linearizer,
    scale: f32,
    light: &mut [f32],
    bad: &mut [u8],
    index: impl Fn(&T) -> usize,
) {
    let saturated = l.white.ceil() as usize;
    for ((out, bad), value) in light.iter_mut().zip(bad).zip(v.iter().step_by(step)) {
        let value = index(value);
        *bad |= u8::from(value >= saturated);
        *out = l.table[value] * scale;
    }
}
