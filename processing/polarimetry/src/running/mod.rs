//! A reconstruction on its way: photographs are folded into sums as they come.

mod finish;
mod light;
mod moved;

use crate::angles::sample::{Sample, sampled};
use crate::fit::bracket::{noise_of_bracket, read};
use crate::fit::demosaic::Demosaic;
use crate::fit::merge::Merge;
use crate::fit::sums::Sums;
use crate::fit::views::{Photograph, View, brackets, views};
use crate::{Design, FrameNoise, NoiseSource, StokesMaps, check_memory};
use light::{Photographed, noise_of};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_frames::{Frame, Linearizer, LoadedFrames};
use nacre_image::registration::Registrar;
use std::time::Instant;

/// Registration keeps windows of every view, so longer series are not registered: memory stays bounded.
const REGISTERED: usize = 24;

/// A reconstruction that takes its photographs one by one, in order, as they arrive: the result is the same to the
/// byte as that of [`reconstruct`](crate::reconstruct).
pub struct Running {
    pub(crate) frames: LoadedFrames,
    pub(crate) linearizer: Linearizer,
    /// Numbers of the photographs that are merged into one view each.
    pub(crate) brackets: Vec<Vec<usize>>,
    pub(crate) views: Vec<View>,
    demosaic: Demosaic,
    pub(crate) sums: Sums,
    /// A few pixels of every view.
    pub(crate) sample: Sample,
    /// Watches how the photographs lie against each other; a sensor that takes all angles at once needs none.
    registrar: Option<Registrar>,
    /// Brackets taken in.
    added: usize,
    read_and_fit_s: f64,
}

impl Running {
    /// Begins with a set whose photographs are all there, or will be when they are asked for. Interpolated images are of raw frames of
    /// monochrome sensors, one exposure each.
    ///
    /// # Errors
    /// `Input` when the set is of another kind or its angles cannot tell an orientation.
    pub fn new(frames: LoadedFrames, demosaic: Demosaic) -> Result<Self> {
        let running = Self::begin(frames, demosaic)?;
        running.design()?;
        Ok(running)
    }

    /// Begins with the first photographs of a series that goes on ([`Self::push`]): those at the first analyser angle. Dark
    /// photographs must be there already.
    ///
    /// # Errors
    /// `Input` when the set is of another kind or needs more memory than there is.
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
        let sums = Sums::new(brackets.iter().any(|b| b.len() > 1), size[0], size[1]);
        let registered = block == 1 && views.len() <= REGISTERED;
        let registrar = registered.then(|| Registrar::new(size[0], size[1]));
        let sample = Sample::new(size[0], size[1]);
        Ok(Self {
            frames,
            linearizer,
            brackets,
            views,
            demosaic,
            sums,
            sample,
            registrar,
            added: 0,
            read_and_fit_s: 0.0,
        })
    }

    /// More photographs of the series: all those at its next analyser angle. They are taken in by [`Self::add`].
    ///
    /// # Errors
    /// `Input` when a dark photograph of theirs cannot be read.
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

    /// Photographs taken in so far.
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

    /// Takes in the next photograph, or all exposures at the next angle, which must be there.
    ///
    /// # Errors
    /// `Input` when it cannot be read or there is none left.
    pub fn add(&mut self) -> Result<()> {
        let begun = Instant::now();
        let Self { frames, linearizer, brackets, views, demosaic, sums, sample, registrar, added, .. } = self;
        let bracket = brackets.get(*added).map_or(&[][..], |b| b);
        let taken = Taken::new(frames, linearizer, bracket, *demosaic)?;
        fold((sums, sample, registrar), views, *added, &[taken]);
        self.added += 1;
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Takes in the rest, two brackets at a time: both are decoded at once, then folded in together, so that the sums go through
    /// the memory half as often. The order is fixed, so the result does not depend on timing.
    pub(crate) fn add_all(&mut self, progress: &dyn Progress) -> Result<()> {
        let (begun, all) = (Instant::now(), self.brackets.len());
        progress.stage("reading and fitting", all as u64);
        let Self { frames, linearizer, brackets, views, demosaic, sums, sample, registrar, added, .. } = self;
        while *added < all {
            progress.check()?;
            let first = *added;
            let take = |i: usize| Taken::new(frames, linearizer, &brackets[i], *demosaic);
            let (a, b) = rayon::join(|| take(first), || (first + 1 < all).then(|| take(first + 1)));
            let taken = [Some(a), b].into_iter().flatten().collect::<Result<Vec<_>>>()?;
            fold((&mut *sums, &mut *sample, &mut *registrar), views, first, &taken);
            *added += taken.len();
            taken.iter().for_each(|_| progress.step());
        }
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Noise of the maps so far.
    pub(crate) fn noise(&self, maps: &mut StokesMaps, design: &Design) -> (Vec<FrameNoise>, NoiseSource) {
        let views = &self.views[..self.sums.views()];
        let Self { frames, linearizer, brackets, sample, demosaic, .. } = self;
        let taken = Photographed { frames, linearizer, brackets, views, sample, demosaic: *demosaic, shifts: None };
        noise_of(&taken, maps, design)
    }
}

/// The decoded photographs of a bracket, and how they are merged.
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

/// Adds brackets from number `first` on, each of which is one view, or four of a polarization sensor.
fn fold(
    (sums, sample, registrar): (&mut Sums, &mut Sample, &mut Option<Registrar>),
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
    sums.add_several(&angles, row);
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
