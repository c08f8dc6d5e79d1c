//! Weighted sums over exposures: the inner loops.
//!
//! Weights are inverse variances, which depend on the light. Weights computed from each value itself would bias the
//! mean towards low values. Instead, they use the mean of the previous exposures, starting with the longest, which is
//! the most accurate.

use super::coding::{Coding, Entry, Scatter};
use crate::Frame;
use nacre_image::{Raster, Samples};
use pulp::Arch;
use rayon::prelude::*;

/// Samples per task: with the files' values, they fit into the cache of a thread.
const RUN: usize = 1 << 12;

/// Sums per page of memory, 4 KiB.
const PAGE: usize = 4096 / size_of::<Sum>();

/// Σ weight · light and Σ weight of every sample (pixel and channel).
pub(super) struct Sums {
    /// Merged channels of the files.
    channels: Vec<usize>,
    sums: Vec<Sum>,
}

/// Sums of one sample.
type Sum = [f32; 2];

/// One decoded exposure.
pub(super) struct Exposed<'a> {
    pub frame: &'a Frame,
    pub raster: Raster,
    /// Dark signal of every sample, as light per exposure and gain; empty if none is subtracted.
    pub dark: Vec<f32>,
}

impl Sums {
    /// Empty sums.
    pub(super) fn new(pixels: usize, channels: &[usize]) -> Self {
        let mut sums = vec![[0.0; 2]; pixels * channels.len()];
        // The system allocates pages when they are first written; several threads doing so at once wait for each other.
        // On two cores, the example `merge` took 1.2 to 1.7 s of CPU time without this line, and takes 0.35 to 0.5 s
        // with it.
        sums.iter_mut().step_by(PAGE).for_each(|sum| *std::hint::black_box(sum) = [0.0; 2]);
        Self { channels: channels.to_vec(), sums }
    }

    /// Adds exposures, longest first, in a single pass over the sums.
    pub(super) fn add(&mut self, coding: &Coding, exposures: &[Exposed]) {
        if exposures.iter().all(|e| e.dark.is_empty()) {
            match exposures.first().map(|e| &e.raster.samples) {
                Some(Samples::U8(_)) => return self.by_table::<u8, 256>(coding, exposures),
                Some(Samples::U16(_)) => return self.by_table::<u16, 65_536>(coding, exposures),
                _ => {}
            }
        }
        for exposure in exposures {
            let channels = self.channels.clone();
            self.add_entries(coding.scatter(exposure.frame), entries(coding, exposure, &channels));
        }
    }

    /// Adds one entry per sample.
    pub(super) fn add_entries(&mut self, scatter: Scatter, entry: impl Fn(usize) -> Entry + Sync) {
        self.sums.par_iter_mut().enumerate().with_min_len(RUN).for_each(|(i, sum)| plus(sum, entry(i), scatter));
    }

    fn by_table<T: Code, const CODES: usize>(&mut self, coding: &Coding, exposures: &[Exposed]) {
        let table = |e: &Exposed, c: &usize| -> Option<Box<[Entry; CODES]>> {
            coding.table(*c, e.frame).into_boxed_slice().try_into().ok()
        };
        let coded = |e: &Exposed| Coded {
            tables: self.channels.iter().filter_map(|c| table(e, c)).collect(),
            scatter: coding.scatter(e.frame),
        };
        let coded: Vec<Coded<CODES>> = exposures.iter().map(coded).collect();
        let values: Vec<&[T]> = exposures.iter().filter_map(|e| T::of(&e.raster.samples)).collect();
        let stored = exposures.first().map_or(1, |e| e.raster.channels);
        let (channels, run) = (self.channels.as_slice(), RUN * self.channels.len());
        // Small tables fit into the cache together, so that sums stay in registers; large ones are processed one at a
        // time.
        let together = if CODES <= 256 { exposures.len() } else { 1 };
        self.sums.par_chunks_mut(run).enumerate().for_each(|(k, sums)| {
            let pixels = sums.len() / channels.len();
            let values: Vec<&[T]> = values.iter().map(|v| &v[k * RUN * stored..][..pixels * stored]).collect();
            for (coded, values) in coded.chunks(together).zip(values.chunks(together)) {
                Arch::new().dispatch(|| match channels {
                    [0, 1, 2] => rgb(sums, coded, values),
                    [c] => one(sums, coded, values, [*c, stored]),
                    _ => {}
                });
            }
        });
    }

    /// Flat-field correction: divides by this light relative to its mean, which has a standard deviation of `sigma` as
    /// a share. Returns false if the flat is black.
    pub(super) fn divide(&mut self, flat: &[f32], sigma: f32) -> bool {
        let mean = flat.iter().map(|v| f64::from(*v)).sum::<f64>() / flat.len().max(1) as f64;
        if mean <= 0.0 {
            return false;
        }
        self.sums.par_iter_mut().zip(flat).for_each(|([light, weight], flat)| {
            let factor = flat / mean as f32;
            let known = factor > 0.0 && *weight > 0.0;
            let value = *light / *weight / factor;
            let variance = 1.0 / (*weight * factor * factor) + (sigma * value).powi(2);
            *weight = if known { 1.0 / variance } else { 0.0 };
            *light = if known { value * *weight } else { 0.0 };
        });
        true
    }

    /// Light and its variance at a pixel; `None` where all exposures are saturated.
    pub(super) fn at(&self, pixel: usize, channel: usize) -> Option<[f32; 2]> {
        let [light, weight] = self.sums[pixel * self.channels.len() + channel];
        (weight > 0.0).then(|| [light / weight, 1.0 / weight])
    }

    /// Light and its variance of all samples, in place; NaN where all exposures are saturated.
    pub(super) fn solved(self) -> Vec<[f32; 2]> {
        let mut sums = self.sums;
        sums.par_chunks_mut(RUN).for_each(|run| {
            for sum in run {
                let [light, weight] = *sum;
                *sum = if weight > 0.0 { [light / weight, 1.0 / weight] } else { [f32::NAN; 2] };
            }
        });
        sums
    }

    /// Number of merged channels.
    pub(super) fn channels(&self) -> usize {
        self.channels.len()
    }

    /// Number of pixels.
    pub(super) fn pixels(&self) -> usize {
        self.sums.len() / self.channels.len()
    }
}

/// Contribution of each sample of an exposure, by its index in the sums.
pub(super) fn entries<'a>(
    coding: &'a Coding,
    exposure: &'a Exposed,
    channels: &'a [usize],
) -> impl Fn(usize) -> Entry + Sync + 'a {
    let (n, stored) = (channels.len(), exposure.raster.channels);
    let tables: Vec<Vec<Entry>> = channels.iter().map(|c| coding.table(*c, exposure.frame)).collect();
    let scatter = coding.scatter(exposure.frame);
    move |i| {
        let (channel, at) = (channels[i % n], i / n * stored + channels[i % n]);
        let [light, rounding] = match &exposure.raster.samples {
            Samples::U8(v) => tables[i % n][usize::from(v[at])],
            Samples::U16(v) => tables[i % n][usize::from(v[at])],
            Samples::F32(v) => coding.entry(channel, exposure.frame, v[at].into()),
        };
        exposure.dark.get(i).map_or([light, rounding], |dark| [light - dark, rounding + scatter.of_dark(*dark)])
    }
}

#[inline(always)]
fn plus(sum: &mut Sum, [light, rounding]: Entry, scatter: Scatter) {
    let weight = scatter.weight_after(*sum, [light, rounding]);
    sum[0] += weight * light;
    sum[1] += weight;
}

/// Number of samples processed together: a multiple of three channels and of the vector length.
const LANES: usize = 24;

/// Tables of one exposure.
struct Coded<const CODES: usize> {
    /// One table per merged channel.
    tables: Vec<Box<[Entry; CODES]>>,
    scatter: Scatter,
}

/// Adds exposures to [`LANES`] consecutive sums. Table lookups are sequential; the remaining arithmetic is vectorised.
#[inline(always)]
fn add_lanes<const CODES: usize>(
    sums: &mut [Sum; LANES],
    coded: &[Coded<CODES>],
    look_up: impl Fn(usize, &Coded<CODES>) -> [Entry; LANES],
) {
    let [mut product, mut weight] = [[0.0_f32; LANES]; 2];
    for i in 0..LANES {
        [product[i], weight[i]] = sums[i];
    }
    for (k, coded) in coded.iter().enumerate() {
        let entries = look_up(k, coded);
        for i in 0..LANES {
            let added = coded.scatter.weight_after([product[i], weight[i]], entries[i]);
            product[i] += added * entries[i][0];
            weight[i] += added;
        }
    }
    for i in 0..LANES {
        sums[i] = [product[i], weight[i]];
    }
}

/// Adds all three channels of a colour file.
#[inline(always)]
fn rgb<T: Code, const CODES: usize>(sums: &mut [Sum], coded: &[Coded<CODES>], values: &[&[T]]) {
    let (chunks, rest) = sums.as_chunks_mut::<LANES>();
    let count = chunks.len();
    for (n, sums) in chunks.iter_mut().enumerate() {
        add_lanes(sums, coded, |k, coded| {
            let ([r, g, b], codes) = (tables(coded), &values[k].as_chunks::<LANES>().0[n]);
            std::array::from_fn(|i| [r, g, b][i % 3][codes[i].index()])
        });
    }
    for (coded, values) in coded.iter().zip(values) {
        let all = tables(coded);
        let last = &values[count * LANES..];
        rest.iter_mut().zip(last).enumerate().for_each(|(i, (sum, v))| plus(sum, all[i % 3][v.index()], coded.scatter));
    }
}

/// Tables of three channels.
#[inline(always)]
fn tables<const CODES: usize>(coded: &Coded<CODES>) -> [&[Entry; CODES]; 3] {
    [&coded.tables[0], &coded.tables[1], &coded.tables[2]]
}

/// Adds one channel of a file with several.
#[inline(always)]
fn one<T: Code, const CODES: usize>(
    sums: &mut [Sum],
    coded: &[Coded<CODES>],
    values: &[&[T]],
    [channel, stored]: [usize; 2],
) {
    let (chunks, rest) = sums.as_chunks_mut::<LANES>();
    let count = chunks.len() * LANES;
    let entry = |coded: &Coded<CODES>, values: &[T], i: usize| coded.tables[0][values[i * stored + channel].index()];
    for (n, sums) in chunks.iter_mut().enumerate() {
        add_lanes(sums, coded, |k, coded| std::array::from_fn(|i| entry(coded, values[k], n * LANES + i)));
    }
    for (coded, values) in coded.iter().zip(values) {
        rest.iter_mut().enumerate().for_each(|(i, sum)| plus(sum, entry(coded, values, count + i), coded.scatter));
    }
}

/// Integer values of a file.
pub(super) trait Code: Copy + Sync {
    fn of(samples: &Samples) -> Option<&[Self]>;
    fn index(self) -> usize;
}

impl Code for u8 {
    fn of(samples: &Samples) -> Option<&[Self]> {
        match samples {
            Samples::U8(v) => Some(v),
            _ => None,
        }
    }

    #[inline(always)]
    fn index(self) -> usize {
        self.into()
    }
}

impl Code for u16 {
    fn of(samples: &Samples) -> Option<&[Self]> {
        match samples {
            Samples::U16(v) => Some(v),
            _ => None,
        }
    }

    #[inline(always)]
    fn index(self) -> usize {
        self.into()
    }
}
