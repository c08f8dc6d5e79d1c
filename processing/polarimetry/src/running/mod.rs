//! A reconstruction in progress: photographs are added to sums as they arrive.

mod finish;
mod light;
mod moved;

use crate::angles::sample::{Sample, sampled};
use crate::fit::accumulator::Accumulator;
use crate::fit::bracket::{noise_of_bracket, read};
use crate::fit::demosaic::Demosaic;
use crate::fit::merge::Merge;
use crate::fit::views::{Photograph, View, brackets, views};
use crate::{Design, FrameNoise, NoiseSource, StokesMaps, check_memory};
use light::{Photographed, noise_of};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_frames::{Frame, Linearizer, LoadedFrames};
use nacre_image::registration::Registrar;
use std::time::Instant;

/// Maximum number of registered views: registration keeps windows of every view, and memory must stay bounded.
const REGISTERED: usize = 24;

/// A reconstruction that takes its photographs one by one, in order, as they arrive. The result is byte-identical to
/// that of [`reconstruct`](crate::reconstruct).
pub struct Running {
    pub(crate) frames: LoadedFrames,
    pub(crate) linearizer: Linearizer,
    /// Indices of the photographs merged into each view.
    pub(crate) brackets: Vec<Vec<usize>>,
    pub(crate) views: Vec<View>,
    demosaic: Demosaic,
    pub(crate) accumulator: Accumulator,
    /// A few pixels of every view.
    pub(crate) sample: Sample,
    /// Tracks the shifts of the photographs; not needed for a sensor that takes all angles at once.
    registrar: Option<Registrar>,
    /// Number of added brackets.
    added: usize,
    read_and_fit_s: f64,
}

impl Running {
    /// Starts with a set whose photographs exist, or will exist when they are read. Interpolated images require raw
    /// frames of monochrome sensors with one exposure each.
    ///
    /// # Errors
    /// `Input` if the set is of another kind, or if its angles do not determine an orientation.
    pub fn new(frames: LoadedFrames, demosaic: Demosaic) -> Result<Self> {
        let running = Self::begin(frames, demosaic)?;
        running.design()?;
        Ok(running)
    }

    /// Starts with the first photographs of a continuing series ([`Self::push`]): those at the first analyser angle.
    /// Dark photographs must exist already.
    ///
    /// # Errors
    /// `Input` if the set is of another kind, or needs more memory than available.
    pub fn open(frames: LoadedFrames) -> Result<Self> {
        Self::begin(frames, Demosaic::None)
    }

    fn begin(frames: LoadedFrames, demosaic: Demosaic) -> Result<Self> {
        check_memory(&frames, demosaic)?;
        let brackets = brackets(&frames.set.frames);
        let views = views(&frames, &brackets, demosaic)?;
        let linearizer = Linearizer::new(&frames)?;
        let (block, step) = views.first().map_or((1, 1), |v| (v.block, v.step));
        let size = [frames.info.width / step, frames.info.height / step];
        let accumulator = Accumulator::new(brackets.iter().any(|b| b.len() > 1), size[0], size[1]);
        let registered = block == 1 && views.len() <= REGISTERED;
        let registrar = registered.then(|| Registrar::new(size[0], size[1]));
        let sample = Sample::new(size[0], size[1]);
        Ok(Self {
            frames,
            linearizer,
            brackets,
            views,
            demosaic,
            accumulator,
            sample,
            registrar,
            added: 0,
            read_and_fit_s: 0.0,
        })
    }

    /// Appends photographs of the series: all those at its next analyser angle. [`Self::add`] reads them.
    ///
    /// # Errors
    /// `Input` if one of their dark photographs cannot be read.
    pub fn push(&mut self, photographs: Vec<Frame>) -> Result<()> {
        self.linearizer.learn(&self.frames, &photographs)?;
        let first = self.frames.set.frames.len();
        self.brackets.extend(brackets(&photographs).into_iter().map(|b| b.into_iter().map(|k| first + k).collect()));
        self.frames.set.frames.extend(photographs);
        self.views = views(&self.frames, &self.brackets, self.demosaic)?;
        if self.views.len() > REGISTERED {
            self.registrar = None;
        }
        Ok(())
    }

    /// Number of added photographs.
    pub fn added(&self) -> usize {
        self.brackets[..self.added].iter().map(Vec::len).sum()
    }

    /// The set so far.
    pub fn frames(&self) -> &[Frame] {
        &self.frames.set.frames
    }

    fn design(&self) -> Result<Design> {
        Design::new(&self.views.iter().map(|v| v.angle).collect::<Vec<_>>())
    }

    /// Adds the next photograph, or all exposures at the next angle, which must exist.
    ///
    /// # Errors
    /// `Input` if it cannot be read or none is left.
    pub fn add(&mut self) -> Result<()> {
        let begun = Instant::now();
        let Self { frames, linearizer, brackets, views, demosaic, accumulator, sample, registrar, added, .. } = self;
        let bracket = brackets.get(*added).map_or(&[][..], |b| b);
        let taken = Taken::new(frames, linearizer, bracket, *demosaic)?;
        fold((accumulator, sample, registrar), views, *added, &[taken]);
        self.added += 1;
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Adds the remaining photographs, two brackets at a time. Both are decoded in parallel and then added together,
    /// which halves the memory traffic of the sums. The order is fixed, so the result does not depend on timing.
    pub(crate) fn add_all(&mut self, progress: &dyn Progress) -> Result<()> {
        let (begun, all) = (Instant::now(), self.brackets.len());
        progress.stage("reading and fitting", all as u64);
        let Self { frames, linearizer, brackets, views, demosaic, accumulator, sample, registrar, added, .. } = self;
        while *added < all {
            progress.check()?;
            let first = *added;
            let take = |i: usize| Taken::new(frames, linearizer, &brackets[i], *demosaic);
            let (a, b) = rayon::join(|| take(first), || (first + 1 < all).then(|| take(first + 1)));
            let taken = [Some(a), b].into_iter().flatten().collect::<Result<Vec<_>>>()?;
            fold((&mut *accumulator, &mut *sample, &mut *registrar), views, first, &taken);
            *added += taken.len();
            taken.iter().for_each(|_| progress.step());
        }
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Noise of the maps so far.
    pub(crate) fn noise(&self, maps: &mut StokesMaps, design: &Design) -> (Vec<FrameNoise>, NoiseSource) {
        let views = &self.views[..self.accumulator.views()];
        let Self { frames, linearizer, brackets, sample, demosaic, .. } = self;
        let taken = Photographed { frames, linearizer, brackets, views, sample, demosaic: *demosaic, shifts: None };
        noise_of(&taken, maps, design)
    }
}

/// The decoded photographs of a bracket, and their merge.
struct Taken<'a> {
    photographs: Vec<Photograph<'a>>,
    merge: Merge,
}

impl<'a> Taken<'a> {
    fn new(frames: &LoadedFrames, linearizer: &'a Linearizer, bracket: &[usize], demosaic: Demosaic) -> Result<Self> {
        let photographs = read(frames, linearizer, bracket, demosaic)?;
        Ok(Self { photographs, merge: Merge::new(noise_of_bracket(frames, linearizer, bracket)) })
    }
}

/// Adds brackets from index `first` on, each of which is one view, or four views of a polarization sensor.
fn fold(
    (accumulator, sample, registrar): (&mut Accumulator, &mut Sample, &mut Option<Registrar>),
    views: &[View],
    first: usize,
    taken: &[Taken],
) {
    let of = |view: &View| view.bracket.checked_sub(first).and_then(|i| taken.get(i));
    let seen: Vec<(&View, &Taken)> = views.iter().filter_map(|v| Some((v, of(v)?))).collect();
    let angles: Vec<(f64, &Merge)> = seen.iter().map(|(view, taken)| (view.angle, &taken.merge)).collect();
    let row = |v: usize, k: usize, row: usize, light: &mut [f32], bad: &mut [u8]| {
        let (view, taken) = seen[v];
        taken.photographs[k].row(view, row, light, bad);
    };
    accumulator.add_several(&angles, row);
    for (v, (_, taken)) in seen.iter().enumerate() {
        sampled(sample, taken.photographs.len(), &taken.merge, |k, y, light, bad| row(v, k, y, light, bad));
    }
    let Some(registrar) = registrar else { return };
    for Taken { photographs, merge } in taken {
        match photographs.as_slice() {
            [one] => registrar.add(|y, left, light, bad| one.frame.strided(y, left, 1, light, bad)),
            several => registrar.add(|y, left, light, bad| {
                let mut variances = vec![0.0; light.len()];
                merge.row(|k, light, bad| several[k].frame.strided(y, left, 1, light, bad), light, &mut variances, bad);
            }),
        }
    }
}
