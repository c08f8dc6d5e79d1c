//! Intermediate evaluation of a running capture from sampled pixels. Capture stops showing fringes once few pixels
//! remain undecided.

use super::answer::{Demands, Verdict};
use super::input::Bench;
use super::optics::Optics;
use super::reconstruct::demands;
use super::scan::{aperture, scan};
use super::settings::Settings;
use super::signals::{Sampled, Signals, carriers, sampled_size};
use super::solve::MAX_CARRIERS;
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_frames::{Frame, Linearizer, LoadedFrames};

/// Approximate number of sampled pixels: one of them is 0.1 %.
const PIXELS: usize = 1000;

/// Sampled photographs of fringes, added as they arrive. Memory: a thousand pixels per frame.
pub struct Survey {
    frames: LoadedFrames,
    bench: Bench,
    settings: Settings,
    linearizer: Linearizer,
    every: usize,
    samples: Vec<Sampled>,
    aperture_mm: Option<f64>,
}

/// Intermediate result over pixels with first orders on the panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecisionCounts {
    /// Sampled pixels explained by one or several gratings.
    pub carrying: usize,
    /// Those of them that are ambiguous, or whose period is less accurate than required.
    pub undecided: usize,
}

impl DecisionCounts {
    /// Fraction of undecided pixels; `None` if no pixel has a grating.
    pub fn share(&self) -> Option<f64> {
        (self.carrying > 0).then(|| self.undecided as f64 / self.carrying as f64)
    }
}

impl Survey {
    /// Starts with the description of frames to come; no frame of `frames` is read.
    ///
    /// # Errors
    /// `Input` for a geometry or options that do not determine periods.
    pub fn begin(mut frames: LoadedFrames, settings: &Settings) -> Result<Self> {
        settings.check()?;
        frames.set.frames.clear();
        let bench = Bench::new(&frames, settings)?;
        let linearizer = Linearizer::new(&frames)?;
        let pixels = frames.info.width * frames.info.height;
        let every = ((pixels as f64 / PIXELS as f64).sqrt().floor() as usize).max(1);
        Ok(Self {
            frames,
            bench,
            settings: settings.clone(),
            linearizer,
            every,
            samples: vec![],
            aperture_mm: settings.aperture_mm,
        })
    }

    /// Number of frames added so far.
    pub fn added(&self) -> usize {
        self.samples.len()
    }

    /// Adds the next frame.
    ///
    /// # Errors
    /// `Input` if it cannot be read.
    pub fn push(&mut self, frame: Frame) -> Result<()> {
        self.linearizer.learn(&self.frames, std::slice::from_ref(&frame))?;
        let decoded = self.linearizer.frame(&self.frames, &frame)?;
        let size = [self.frames.info.width, self.frames.info.height];
        self.samples.push(Sampled::of(&decoded, size, self.every));
        self.frames.set.frames.push(frame);
        Ok(())
    }

    /// Evaluates the first `frames` frames for a required relative σ of the period. The aperture is estimated in the
    /// first call, so that calls in the same order give the same results.
    ///
    /// # Errors
    /// `Input` if these frames are no complete scan.
    pub fn decided(&mut self, frames: usize, period_sigma: f64) -> Result<DecisionCounts> {
        let mut first = self.frames.clone();
        first.set.frames.truncate(frames);
        let shown = carriers(&first, MAX_CARRIERS)?;
        let size = sampled_size([first.info.width, first.info.height], self.every);
        let signals = Signals::of_samples(&first, &self.linearizer, &shown, &self.samples, size);
        let [offset, every] = [self.every / 2, self.every].map(|n| n as f64);
        let geometry = &self.bench.geometry;
        let points = |x: usize, y: usize| geometry.point([offset + every * x as f64, offset + every * y as f64]);
        let demands: Demands = demands(&self.settings, &shown, &signals);
        let aperture_mm = match self.aperture_mm {
            Some(known) => known,
            None => *self.aperture_mm.insert(aperture(&signals, &self.bench.optics, &points, demands)),
        };
        let optics = Optics { aperture_mm, ..self.bench.optics.clone() };
        let found = scan(&signals, &optics, &points, demands, &Silent)?;
        let mut decided = DecisionCounts { carrying: 0, undecided: 0 };
        for (verdict, grating) in found.verdicts.iter().zip(&found.gratings) {
            let is_sure = grating.is_some_and(|g| g.period_sigma_um <= period_sigma * g.period_um);
            match verdict {
                Verdict::Resolved => decided.undecided += usize::from(!is_sure),
                Verdict::Ambiguous => decided.undecided += 1,
                _ => continue,
            }
            decided.carrying += 1;
        }
        Ok(decided)
    }
}
