//! Selects two-pass rendering for shapes with lookup tables, and measures its error against samples of the full
//! integral.

use crate::material::SAMPLES;
use crate::material::diffraction::Diffraction;
use crate::picture::Pilot;
use crate::prepared_scene::PreparedScene;
use crate::prepared_scene::two_pass::{Curves, Fineness, Plan, Seen, TwoPass};
use crate::settings::{MAX_SAMPLES, Method, Settings};
use crate::shape::ray::Hit;
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;
use std::sync::Arc;

/// Tested resolutions of filtered environments, from coarse to fine.
const LADDER: [Fineness; 4] = [
    Fineness { width: 128, poles: 24, tilts: 0.3 },
    Fineness { width: 256, poles: 48, tilts: 0.2 },
    Fineness { width: 512, poles: 96, tilts: 0.13 },
    Fineness { width: 1024, poles: 192, tilts: 0.09 },
];

/// Smallest and largest table error from which the number of terms follows.
const ERRORS: [f64; 2] = [1e-3, 0.3];

/// A finer resolution is tested while the previous one reduced the error to less than this fraction.
const WORTH: f64 = 0.9;

/// Multiplications of the passes per Monte Carlo sample (0.7 µs on two cores). A fixed ratio instead of a measurement,
/// so that a scene always gives the same picture.
const PER_SAMPLE: f64 = 7000.0;

/// Largest cost of filtering, and of the measurement, relative to the samples that the target error requires.
const SHARE: f64 = 0.4;
const MEASURING: f64 = 0.15;

/// Cost of filtering, in samples, that is always permitted if two passes are requested.
const FORCED: f64 = 2e7;

/// Rays along a side of the picture that determine the necessary poles.
const RAYS: usize = 192;

/// Number of points at which the error is measured, and the largest number of samples at each, chosen to leave half the
/// target error.
const PLACES: usize = 256;
const FINER: usize = 4;
const MAX_AT_PLACE: usize = 1 << 16;

/// Largest number of samples at each point if two passes are requested, which are fast; the larger noise is added to
/// the reported error.
const FEW_AT_PLACE: usize = 4096;

/// Strata of the samples at a point, and smallest number of groups.
const STRATA: usize = 16;
const FEWEST: usize = 4;

/// Standard deviations of the measurement that are added to the measured error.
const SURE: f64 = 2.0;

/// Smallest saving of samples for which two passes are selected.
const GAIN: f64 = 0.2;

/// Method of rendering a shape's table under environments.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct EnvironmentReport {
    /// Key of the shape in the scene.
    pub shape: String,
    /// `two-pass` or `samples`.
    pub method: &'static str,
    /// Reason for the method.
    pub why: String,
    /// Largest number of terms per channel of each part of the table, over all tilts.
    pub rank: Vec<usize>,
    /// Root mean square residual of the table after these terms, relative to the table's root mean square.
    pub table_error: f64,
    /// Width and height of the filtered environments in pixels.
    pub environment: [usize; 2],
    /// Number of filtered environments.
    pub poles: usize,
    /// Largest angle of view, in degrees from the normal, at which the filtered environments are used; beyond it
    /// samples are used.
    pub up_to_deg: f64,
    /// Fraction of the visible shape that uses the filtered environments.
    pub looked_up: f64,
    /// Measured root mean square error of the picture against samples of the full integral, relative to its mean
    /// luminance. It includes truncation, the resolution of the environment, poles and views off the normal, plus two
    /// standard deviations of the measurement.
    pub measured_error: f64,
}

/// Effect of two passes on a picture.
pub(crate) struct Outcome {
    pub reports: Vec<EnvironmentReport>,
    /// Error of all shapes together, as in the reports.
    pub error: f64,
}

/// Two passes of a shape whose error has been measured.
struct Tried {
    filtered: TwoPass,
    fineness: Fineness,
    poles: usize,
    /// Cost in samples.
    cost: f64,
    choice: Choice,
}

/// The points that use the filtered environments.
#[derive(Clone, Copy)]
struct Choice {
    least_cosine: f64,
    looked_up: f64,
    error: f64,
    /// Fraction of samples that remain.
    left: f64,
}

/// Reference luminances of a shape.
struct Reference {
    places: Vec<Place>,
    /// Fraction of the picture's rays that hit the shape, divided by the square of the picture's mean luminance.
    scale: f64,
}

/// A point and its luminance by samples.
struct Place {
    hit: Hit,
    seen: Seen,
    cos: f64,
    mean: f64,
    /// Variance of the mean, and standard deviation of a sample.
    variance: f64,
    deviation: f64,
}

/// Assigns two passes to shapes if the method requires them, or if they save samples at the target error, which takes
/// `passes`.
///
/// # Errors
/// `Input` if two passes are requested and no shape supports them, or if curves are invalid; `Cancelled`.
pub(crate) fn two_passes(
    prepared: &mut PreparedScene,
    pilot: &Pilot,
    passes: usize,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let forced = settings.method == Method::TwoPass;
    let mut outcome = Outcome { reports: vec![], error: 0.0 };
    let mut any = false;
    for shape in 0..prepared.shapes.len() {
        let table =
            matches!(prepared.materials[prepared.shapes[shape].material].diffraction, Some(Diffraction::Table(_)));
        if !table || prepared.skies.is_empty() || prepared.flats[shape].is_some() {
            continue;
        }
        any = true;
        let seen = prepared.places_of(shape, RAYS);
        if seen.is_empty() || pilot.mean <= 0.0 {
            continue;
        }
        let work = Work { prepared, shape, seen: &seen, pilot, passes, settings };
        let Some((report, filtered)) = work.report(&mut outcome.error, progress)? else { continue };
        prepared.two_passes[shape] = filtered.map(Arc::new);
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
    prepared: &'a PreparedScene,
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

    /// Number of samples of the shape without two passes.
    fn monte_carlo_samples(&self) -> f64 {
        let [width, height] = self.prepared.size();
        let part = self.seen.len() as f64 / (RAYS * RAYS) as f64;
        part * (width * height) as f64 * (self.passes * SAMPLES) as f64
    }

    /// Selects the method of the shape and filters its environments; adds to the picture's error. `None` if two passes
    /// are not worth a test.
    fn report(&self, error: &mut f64, progress: &dyn Progress) -> Result<Option<(EnvironmentReport, Option<TwoPass>)>> {
        let Some(count) = self.samples_at_place() else { return Ok(None) };
        let Some(Diffraction::Table(table)) =
            &self.prepared.materials[self.prepared.shapes[self.shape].material].diffraction
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
        let kept = self.forced() || best.choice.left + best.cost / self.monte_carlo_samples() <= 1.0 - GAIN;
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

    /// Samples per point for the error measurement; `None` if they cost more than two passes may save.
    fn samples_at_place(&self) -> Option<usize> {
        let places = self.seen.len().min(PLACES);
        let wanted = FINER.saturating_mul(self.passes * SAMPLES);
        let most = if self.forced() {
            FEW_AT_PLACE
        } else {
            MAX_AT_PLACE.min((MEASURING * self.monte_carlo_samples() / places as f64) as usize)
        };
        let count = wanted.min(most).min(MAX_SAMPLES) / STRATA * STRATA;
        let least = FEWEST * STRATA;
        if self.forced() { Some(count.max(least)) } else { (count >= least).then_some(count) }
    }

    /// Luminances of some points by samples.
    fn reference(&self, count: usize, progress: &dyn Progress) -> Result<Reference> {
        let every = self.seen.len().div_ceil(PLACES);
        // A random point of each group, to avoid a regular grid.
        let groups: Vec<&[(usize, Hit)]> = self.seen.chunks(every).collect();
        let place = |group: &&[(usize, Hit)]| {
            let first = group[0].0;
            let (index, hit) = group[(Stream::new(first, 1).next() * group.len() as f64) as usize % group.len()];
            let seen = self.prepared.seen(&hit, self.shape);
            let groups = count / STRATA;
            let (mut mean, mut squares) = (0.0, 0.0);
            for n in 0..groups {
                if progress.cancelled() {
                    return None;
                }
                let one = |k: usize| {
                    let mut random = Stream::stratified(index, usize::MAX - n, k, STRATA);
                    self.prepared.under_skies((&hit, self.shape), &seen, None, &mut random).unwrap_or(0.0)
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

    /// The best resolution of the ladder within the cost limit; `None` if even the first step exceeds it, or does not
    /// fit into memory.
    fn best(&self, curves: &Curves, reference: &Reference, progress: &dyn Progress) -> Result<Option<Tried>> {
        let seen: Vec<Seen> = self.seen.iter().map(|(_, hit)| self.prepared.seen(hit, self.shape)).collect();
        let mut best: Option<Tried> = None;
        let mut spent = 0.0;
        for fineness in LADDER {
            let plan = Plan::new(curves, &seen, fineness);
            let cost = plan.operations() * self.prepared.skies.len() as f64 / PER_SAMPLE;
            let allowed = SHARE * self.monte_carlo_samples();
            let dear = match (self.forced(), &best) {
                (true, None) => false,
                (true, Some(_)) => spent + cost > allowed.max(FORCED),
                (false, _) => spent + cost > allowed,
            };
            if plan.count() == 0 || dear || !plan.fits(self.prepared.skies.len()) {
                break;
            }
            spent += cost;
            let poles = plan.count();
            let filtered = plan.filter(&self.prepared.skies, progress)?;
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

    /// Selects the points that use the filtered environments: all if two passes are requested. Otherwise those within
    /// the angle of view that saves the most samples.
    fn choice(&self, reference: &Reference, filtered: &TwoPass) -> Choice {
        let count = reference.places.len() as f64;
        let square = |place: &Place| {
            let found =
                self.prepared.under_skies((&place.hit, self.shape), &place.seen, Some(filtered), &mut Stream::of(0));
            // The variance of the samples is not an error of the passes and is subtracted. Points without a filtered
            // environment use samples.
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
            // Samples are distributed in proportion to the standard deviation, and must leave the remainder of the
            // target error after two passes.
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
