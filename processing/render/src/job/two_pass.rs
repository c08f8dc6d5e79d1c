//! Chooses two passes for shapes made of tables, and measures their error against samples of the whole integral.

use crate::material::SAMPLES;
use crate::material::diffraction::Diffraction;
use crate::picture::Pilot;
use crate::prepared_scene::PreparedScene;
use crate::prepared_scene::two_pass::{Curves, Fineness, Plan, Seen, TwoPass};
use crate::settings::{MOST_SAMPLES, Method, Settings};
use crate::shape::ray::Hit;
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;
use std::sync::Arc;

/// Filtered environments that are tried, from coarse to fine.
const LADDER: [Fineness; 4] = [
    Fineness { width: 128, poles: 24, tilts: 0.3 },
    Fineness { width: 256, poles: 48, tilts: 0.2 },
    Fineness { width: 512, poles: 96, tilts: 0.13 },
    Fineness { width: 1024, poles: 192, tilts: 0.09 },
];

/// Least and largest error of the table that terms are taken for.
const ERRORS: [f64; 2] = [1e-3, 0.3];

/// A finer step is worth trying while the one before made the error this many times smaller.
const WORTH: f64 = 0.9;

/// Multiplications of the passes that take the time of a sample (0.7 µs on two cores). Counted rather than timed, so that a scene always becomes
/// the same picture.
const PER_SAMPLE: f64 = 7000.0;

/// Part of the samples that the error takes which filtering, and measuring, may take at most.
const SHARE: f64 = 0.4;
const MEASURING: f64 = 0.15;

/// Samples whose time filtering may take in any case where two passes are asked for.
const FORCED: f64 = 2e7;

/// Rays along a side of the picture that say which poles are needed.
const RAYS: usize = 192;

/// Places at which the error is measured, and samples at each: enough that they leave half the error asked for, at most so many.
const PLACES: usize = 256;
const FINER: usize = 4;
const MOST_AT_PLACE: usize = 1 << 16;

/// The same where two passes are asked for, which are fast: what is left is told by a larger error.
const FEW_AT_PLACE: usize = 4096;

/// Strata of the samples at a place, and fewest groups of them.
const STRATA: usize = 16;
const FEWEST: usize = 4;

/// Standard deviations of the measurement that are added to the measured error.
const SURE: f64 = 2.0;

/// Part of the samples that two passes have to spare.
const GAIN: f64 = 0.2;

/// How a shape's table is rendered under environments.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct EnvironmentReport {
    /// Key of the shape in the scene.
    pub shape: String,
    /// `two-pass` or `samples`.
    pub method: &'static str,
    /// Reason for the method.
    pub why: String,
    /// Most terms per channel of each part of the table, over all tilts.
    pub rank: Vec<usize>,
    /// Root mean square of what the terms leave out of the table, over the table's own.
    pub table_error: f64,
    /// Columns and rows of the filtered environments.
    pub environment: [usize; 2],
    /// Filtered environments.
    pub poles: usize,
    /// Angle of view up to which places are looked up, in degrees from the normal; others are sampled.
    pub up_to_deg: f64,
    /// Part of the shape in view that is looked up.
    pub looked_up: f64,
    /// Error of the picture, root mean square over its mean luminance, measured against samples of the whole integral: terms left out, pixels of the
    /// environment, poles and views off the normal. Two standard deviations of the measurement are included.
    pub measured_error: f64,
}

/// What two passes do to a picture.
pub(crate) struct Outcome {
    pub reports: Vec<EnvironmentReport>,
    /// Error of all shapes together, as in the reports.
    pub error: f64,
}

/// Two passes of a shape that have been measured.
struct Tried {
    filtered: TwoPass,
    fineness: Fineness,
    poles: usize,
    /// Samples that it takes the time of.
    cost: f64,
    choice: Choice,
}

/// Which places are looked up.
#[derive(Clone, Copy)]
struct Choice {
    least_cosine: f64,
    looked_up: f64,
    error: f64,
    /// Samples that are left, over those without two passes.
    left: f64,
}

/// What a shape is measured by.
struct Reference {
    places: Vec<Place>,
    /// Part of the picture's rays that meet the shape, over the square of the picture's mean luminance.
    scale: f64,
}

/// A place and its luminance by samples.
struct Place {
    hit: Hit,
    seen: Seen,
    cos: f64,
    mean: f64,
    /// Variance of the mean, and standard deviation of a sample.
    variance: f64,
    deviation: f64,
}

/// Has two passes render the shapes where the method asks for them, or where they spare samples at the error asked for, which takes `passes`.
///
/// # Errors
/// `Input` where two passes are asked for and no shape can have them, or curves are refused; `Cancelled`.
pub(crate) fn two_passes(
    ready: &mut PreparedScene,
    pilot: &Pilot,
    passes: usize,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let forced = settings.method == Method::TwoPass;
    let mut outcome = Outcome { reports: vec![], error: 0.0 };
    let mut any = false;
    for shape in 0..ready.shapes.len() {
        let table = matches!(ready.materials[ready.shapes[shape].material].diffraction, Some(Diffraction::Table(_)));
        if !table || ready.skies.is_empty() || ready.flats[shape].is_some() {
            continue;
        }
        any = true;
        let seen = ready.places_of(shape, RAYS);
        if seen.is_empty() || pilot.mean <= 0.0 {
            continue;
        }
        let work = Work { ready, shape, seen: &seen, pilot, passes, settings };
        let Some((report, filtered)) = work.report(&mut outcome.error, progress)? else { continue };
        ready.two_passes[shape] = filtered.map(Arc::new);
        outcome.reports.push(report);
    }
    if forced && !any {
        let remedy = "give a shape a table (diffraction type = \"table\") and the scene an environment, or choose the method auto";
        return Err(Error::input(
            "method",
            "is two-pass, which renders tables under environments, and the scene has none",
            remedy,
        ));
    }
    Ok(outcome)
}

/// One shape.
struct Work<'a> {
    ready: &'a PreparedScene,
    shape: usize,
    seen: &'a [(usize, Hit)],
    pilot: &'a Pilot,
    passes: usize,
    settings: &'a Settings,
}

impl Work<'_> {
    fn forced(&self) -> bool {
        self.settings.method == Method::TwoPass
    }

    /// Samples that the shape takes without two passes.
    fn by_chance(&self) -> f64 {
        let [width, height] = self.ready.size();
        let part = self.seen.len() as f64 / (RAYS * RAYS) as f64;
        part * (width * height) as f64 * (self.passes * SAMPLES) as f64
    }

    /// How the shape is rendered, and what was filtered for it; adds to the picture's error. None where it is not worth a try.
    fn report(&self, error: &mut f64, progress: &dyn Progress) -> Result<Option<(EnvironmentReport, Option<TwoPass>)>> {
        let Some(count) = self.samples_at_place() else { return Ok(None) };
        let Some(Diffraction::Table(table)) = &self.ready.materials[self.ready.shapes[self.shape].material].diffraction
        else {
            return Ok(None);
        };
        let curves = Curves::of(table, self.settings.rank, self.settings.max_error.clamp(ERRORS[0], ERRORS[1]))?;
        progress.stage("measuring two passes", 1);
        let reference = self.reference(count, progress)?;
        let Some(mut best) = self.best(&curves, &reference, progress)? else {
            let problem =
                format!("is two-pass, whose filtered environments of shape[{}] would not fit into 256 MiB", self.shape);
            let refused = Error::input(
                "method",
                problem,
                "choose the method auto or samples, or a scene with fewer environments",
            );
            return if self.forced() { Err(refused) } else { Ok(None) };
        };
        let kept = self.forced() || best.choice.left + best.cost / self.by_chance() <= 1.0 - GAIN;
        let why = self.why(&best, kept);
        let Fineness { width, .. } = best.fineness;
        let report = EnvironmentReport {
            shape: format!("shape[{}]", self.shape),
            method: if kept { "two-pass" } else { "samples" },
            why,
            rank: best.filtered.ranks(),
            table_error: curves.factors.error(),
            environment: [width, width / 2],
            poles: best.poles,
            up_to_deg: best.choice.least_cosine.clamp(0.0, 1.0).acos().to_degrees(),
            looked_up: best.choice.looked_up,
            measured_error: best.choice.error,
        };
        if kept {
            *error = error.hypot(best.choice.error);
        }
        best.filtered.least_cosine = best.choice.least_cosine;
        Ok(Some((report, kept.then_some(best.filtered))))
    }

    fn why(&self, best: &Tried, kept: bool) -> String {
        let Choice { error, left, looked_up, .. } = best.choice;
        let source = match self.settings.rank {
            Some(_) => "as many terms as asked for",
            None => "as many terms as the error of the table needs",
        };
        let asked = 100.0 * self.settings.max_error;
        match (kept, self.forced()) {
            (true, true) => format!("the method was asked for; {source}"),
            (true, false) => format!(
                "{:.2} % off where {:.0} % of the shape are looked up, {asked:.2} % allowed for all; {:.0} % of the samples are left; {source}",
                100.0 * error,
                100.0 * looked_up,
                100.0 * left
            ),
            (false, _) => {
                let all = 100.0 * best.choice.error;
                format!(
                    "two passes would be {all:.2} % off with {:.0} % of the shape looked up, and spare too few samples at {asked:.2} %",
                    100.0 * looked_up
                )
            }
        }
    }

    /// Samples at each place that the error is measured with; none where that is too much for what it may spare.
    fn samples_at_place(&self) -> Option<usize> {
        let places = self.seen.len().min(PLACES);
        let wanted = FINER.saturating_mul(self.passes * SAMPLES);
        let most = if self.forced() {
            FEW_AT_PLACE
        } else {
            MOST_AT_PLACE.min((MEASURING * self.by_chance() / places as f64) as usize)
        };
        let count = wanted.min(most).min(MOST_SAMPLES) / STRATA * STRATA;
        let least = FEWEST * STRATA;
        if self.forced() { Some(count.max(least)) } else { (count >= least).then_some(count) }
    }

    /// Luminances of some places by samples.
    fn reference(&self, count: usize, progress: &dyn Progress) -> Result<Reference> {
        let every = self.seen.len().div_ceil(PLACES);
        // Of each group one by chance, so that places lie on no grid.
        let groups: Vec<&[(usize, Hit)]> = self.seen.chunks(every).collect();
        let place = |group: &&[(usize, Hit)]| {
            let first = group[0].0;
            let (index, hit) = group[(Stream::new(first, 1).next() * group.len() as f64) as usize % group.len()];
            let seen = self.ready.seen(&hit, self.shape);
            let groups = count / STRATA;
            let (mut mean, mut squares) = (0.0, 0.0);
            for n in 0..groups {
                if progress.cancelled() {
                    return None;
                }
                let one = |k: usize| {
                    let mut random = Stream::stratified(index, usize::MAX - n, k, STRATA);
                    self.ready.under_skies((&hit, self.shape), &seen, None, &mut random).unwrap_or(0.0)
                };
                let value = (0..STRATA).map(one).sum::<f64>() / STRATA as f64;
                let off = value - mean;
                mean += off / (n + 1) as f64;
                squares += off * (value - mean);
            }
            let spread = squares / (groups - 1) as f64;
            let (variance, deviation) = (spread / groups as f64, (spread * STRATA as f64).sqrt());
            Some(Place { hit, seen, cos: seen.0[2].dot(&seen.1), mean, variance, deviation })
        };
        let mut places: Vec<Place> = groups.par_iter().filter_map(place).collect();
        progress.check()?;
        progress.step();
        places.sort_by(|a, b| b.cos.total_cmp(&a.cos));
        let part = self.seen.len() as f64 / (RAYS * RAYS) as f64;
        Ok(Reference { places, scale: part / self.pilot.mean.powi(2) })
    }

    /// The best of the ladder, as far as it pays; none where not even its first step does, or nothing fits.
    fn best(&self, curves: &Curves, reference: &Reference, progress: &dyn Progress) -> Result<Option<Tried>> {
        let seen: Vec<Seen> = self.seen.iter().map(|(_, hit)| self.ready.seen(hit, self.shape)).collect();
        let mut best: Option<Tried> = None;
        let mut spent = 0.0;
        for fineness in LADDER {
            let plan = Plan::new(curves, &seen, fineness);
            let cost = plan.operations() * self.ready.skies.len() as f64 / PER_SAMPLE;
            let allowed = SHARE * self.by_chance();
            let dear = match (self.forced(), &best) {
                (true, None) => false,
                (true, Some(_)) => spent + cost > allowed.max(FORCED),
                (false, _) => spent + cost > allowed,
            };
            if plan.count() == 0 || dear || !plan.fits(self.ready.skies.len()) {
                break;
            }
            spent += cost;
            let poles = plan.count();
            let filtered = plan.filter(&self.ready.skies, progress)?;
            let choice = self.choice(reference, &filtered);
            let before = best.as_ref().map(|b| (b.choice.error, b.choice.left));
            let tried = Tried { filtered, fineness, poles, cost: spent, choice };
            let (better, worth) = match before {
                None => (true, true),
                Some((error, _)) if self.forced() => (choice.error < error, choice.error < WORTH * error),
                Some((_, left)) => (choice.left < left, choice.left < WORTH * left),
            };
            if better {
                best = Some(tried);
            }
            if !worth || self.forced() && choice.error < 0.25 * self.settings.max_error {
                break;
            }
        }
        Ok(best)
    }

    /// Which places are looked up: all if two passes are asked for; else those seen more steeply than some angle, which spares the most samples.
    fn choice(&self, reference: &Reference, filtered: &TwoPass) -> Choice {
        let count = reference.places.len() as f64;
        let square = |place: &Place| {
            let found =
                self.ready.under_skies((&place.hit, self.shape), &place.seen, Some(filtered), &mut Stream::of(0));
            // The samples' own variance is no error of the passes. Where nothing was filtered, samples are taken.
            found.map_or(0.0, |found| (found - place.mean).powi(2) - place.variance)
        };
        let squares: Vec<f64> = reference.places.par_iter().map(square).collect();
        let all: f64 = reference.places.iter().map(|p| p.deviation).sum();
        let wanted = self.settings.max_error;
        let (mut sum, mut fourth, mut deviations) = (0.0, 0.0, 0.0);
        let mut best = Choice { least_cosine: 1.0, looked_up: 0.0, error: 0.0, left: 1.0 };
        for (k, (square, place)) in squares.iter().zip(&reference.places).enumerate() {
            sum += square;
            fourth += square * square;
            deviations += place.deviation;
            let mean = sum / count;
            let spread = ((fourth / count - mean * mean).max(0.0) / count).sqrt();
            let error = (reference.scale * (mean + SURE * spread).max(0.0)).sqrt();
            let last = k + 1 == squares.len();
            let looked_up = (k + 1) as f64 / count;
            let least_cosine = if last { 0.0 } else { place.cos };
            // Samples go where noise is, in proportion to its deviation, and are to leave what two passes leave of the error.
            let rest = if all > 0.0 { (1.0 - deviations / all).max(0.0).powi(2) } else { 0.0 };
            let left = rest / (1.0 - (error / wanted).powi(2)).max(0.0);
            let choice =
                Choice { least_cosine, looked_up, error, left: if last && error < wanted { 0.0 } else { left } };
            if self.forced() && last || !self.forced() && error < wanted && choice.left < best.left {
                best = choice;
            }
        }
        best
    }
}
