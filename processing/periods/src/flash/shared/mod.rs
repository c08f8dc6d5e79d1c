//! Few gratings that many polygons share, as on sheets whose polygons have one of a few directions.
//!
//! Under one light, most positions have a single copy near a lobe, which determines only a ring of grating vectors.
//! Positions with the same grating determine the vector together. [`vote`] finds vectors common to many positions, and
//! [`refine`] fits them to all of these. [`judge`] assigns gratings to pixels, and [`evidence`] fits every area's
//! individual grating. Shared gratings are accepted only if areas confirm them and several areas have the same grating.
//! Otherwise, the individual result of each pixel remains.

mod evidence;
mod judge;
mod refine;
mod vote;

use super::fit::{DiffractedCopies, Found, Grating, MaskReason};
use super::period_selection::groups;
use super::reconstruct::{Fitted, Job};
use super::regularisation::interior;
use super::report::{DirectionsReport, PeriodReport};
use super::settings::{Directions, Settings};
use super::solve::{Copy, Prior, Solution};
use evidence::{Area, AreaTest, SHAPE, area_tests, areas, gradual_change_sigmas};
use judge::{best, near};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use rayon::prelude::*;
use refine::{WHOLE, refined};
use std::f64::consts::PI;
use vote::{Level, vote};

/// Maximum numbers of positions in the search for gratings, of their copies, and of positions that vote.
const PLACES: usize = 1500;
const COPIES: usize = 150_000;
const VOTERS: usize = 360;

/// Maximum number of copies in the fits of areas' individual gratings.
const MOST_KEPT: usize = 300_000;

/// Quantile of the positions' light that represents the peak.
const BRIGHT: f64 = 0.97;

/// Minimum size of an accepted area in pixels.
const SMALLEST: usize = 10;

/// Share of areas that must confirm the shared gratings, and share of the lit places that must have one. An area with
/// the grating fails to confirm it once in a thousand times. Simulated sheets that share eight gratings have 1.0 and
/// 0.52 to 0.67; one whose period changes from 1.5 to 1.8 µm has 0.87 and 0.41.
const CONFIRMED: f64 = 0.95;
const EXPLAINED: f64 = 0.47;

/// Significance, in standard deviations, at which halves of areas differ in the same sense.
const GRADUAL: f64 = 4.5;

/// Minimum ratio of areas to gratings for shared gratings, and minimum number of areas of one grating: a single area
/// confirms its own fit.
const PER_GRATING: f64 = 1.5;
const SHARING: usize = 2;

/// Distance of copies over half vectors, in lobe widths, above which they count as sparse and a warning is issued.
const SPARSE: f64 = 2.2;

/// Minimum uncertainty of shared directions relative to the lobe's width, from non-Gaussian lobes. Few lights observe
/// lobes from one side only: the uncertainty of directions is then [`SHAPE`] over the number of lights, and that of
/// lengths is [`SHAPE`].
const FLOOR: f64 = 0.02;

/// Accepts shared gratings if there is evidence; otherwise keeps the individual ones.
///
/// # Errors
/// Copies that cannot be read back; `Cancelled`.
pub(super) fn refit(job: &Job, mut free: Fitted, settings: &Settings, progress: &dyn Progress) -> Result<Fitted> {
    let refused = |why: &str| DirectionsReport { choice: Directions::Free, why: why.into(), ..Default::default() };
    if settings.directions == Directions::Free {
        free.directions = refused("as asked for");
        return Ok(free);
    }
    progress.stage("looking for shared gratings", 2 * job.tiling.height as u64);
    let found = Sheet::of(job, &free, progress)?;
    match found.and_then(|sheet| sheet.judged(settings)) {
        Ok(sheet) => Ok(sheet.merged(free, job, settings)),
        Err(why) => {
            free.directions = refused(why);
            // With few copies near lobes, two gratings at one position resemble a third one.
            if why == NOTHING && sparse(job, &free) {
                let none = |f: &mut Found| {
                    *f = if let Found::Grating(_) = f { Found::Masked(MaskReason::Unexplained) } else { *f }
                };
                free.found.iter_mut().for_each(none);
            }
            Ok(free)
        }
    }
}

/// Reason why there are no shared gratings.
const NOTHING: &str = "no grating explains more than a few places";

/// True if a position's copies are so sparse that many positions are lit by a single copy.
fn sparse(job: &Job, free: &Fitted) -> bool {
    let middle = job.tiling.place(0, job.tiling.width / 2, job.tiling.height / 2);
    job.spacing(middle) > SPARSE * free.lobe.at(&job.view.half(middle, job.lights[0])).width()
}

/// Shared gratings, their pixels, and the areas that these form.
struct Sheet {
    gratings: Vec<Solution>,
    of: Vec<std::result::Result<usize, MaskReason>>,
    areas: Vec<Area>,
    area_tests: Vec<AreaTest>,
    /// Width of the map in pixels.
    columns: usize,
    /// Typical width of a lobe.
    width: f64,
    report: DirectionsReport,
}

/// Initial assignment of a position.
struct Place {
    copies: Vec<Copy>,
    lit: bool,
}

/// Grating of a pixel; for interior pixels, the copies near its lobes; whether the pixel is lit.
type Judged = (std::result::Result<usize, MaskReason>, Option<Vec<Copy>>, bool);

impl Sheet {
    /// Searches for shared gratings.
    ///
    /// The inner error is the reason why there are none.
    fn of(job: &Job, free: &Fitted, progress: &dyn Progress) -> Result<std::result::Result<Self, &'static str>> {
        let prior = Prior { shared: None, ..free.prior };
        let (places, unit) = places(job, free)?;
        let lit: Vec<Vec<Copy>> = places.into_iter().filter(|p| p.lit).map(|p| p.copies).collect();
        let Some((level, width)) = level(&lit) else { return Ok(Err("no place is lit")) };
        let voters: Vec<Vec<Copy>> = lit.iter().step_by(lit.len() / VOTERS + 1).cloned().collect();
        let Some(vectors) = vote(&voters, &prior, width, level) else {
            return Ok(Err("lobes are too narrow: nearly all places fall between them"));
        };
        let gratings = refined(&lit, &vectors, &prior, level, width);
        if gratings.is_empty() {
            return Ok(Err(NOTHING));
        }
        let size = [job.tiling.width, job.tiling.height];
        let thin = size[0] * size[1] * 6 / MOST_KEPT + 1;
        let pixel = |x: usize, observed: &[_]| -> Judged {
            let diffracted = match DiffractedCopies::of(observed, &free.lobe) {
                Ok(diffracted) if diffracted.is_dark() => return (Err(MaskReason::Dark), None, false),
                Ok(diffracted) => diffracted,
                Err(why) => return (Err(why), None, false),
            };
            let copies = diffracted.normalised(unit);
            let Some(best) = best(&copies, &gratings) else { return (Err(MaskReason::Unexplained), None, true) };
            if let Some(why) = best.mask_reason() {
                return (Err(why), None, true);
            }
            let whole = WHOLE.contains(&best.amount) && x.is_multiple_of(thin);
            let kept = whole.then(|| near(&copies, &gratings[best.grating]));
            (Ok(best.grating), kept, true)
        };
        let judged = job.rows(progress, &pixel)?;
        let lit = judged.iter().filter(|j| j.2).count();
        let of: Vec<std::result::Result<usize, MaskReason>> = judged.iter().map(|j| j.0).collect();
        let kept: Vec<Option<Vec<Copy>>> = judged.into_iter().map(|j| j.1).collect();
        let areas = areas(&of.iter().map(|o| o.ok()).collect::<Vec<_>>(), size[0]);
        let area_tests = area_tests(&areas, &gratings, &kept, size, &prior, width);
        let explained = of.iter().filter(|o| o.is_ok()).count() as f64 / lit.max(1) as f64;
        let report = DirectionsReport { choice: Directions::Shared, explained, ..DirectionsReport::default() };
        Ok(Ok(Self { gratings, of, areas, area_tests, columns: size[0], width, report }))
    }

    /// True if an area is large enough and its individual grating agrees with the shared one.
    fn confirmed(&self, k: usize) -> bool {
        self.areas[k].pixels.len() >= SMALLEST
            && self.area_tests[k].own.is_some()
            && self.area_tests[k].other == [false; 2]
    }

    /// Confirmed areas whose grating also occurs in other areas.
    fn sharing(&self) -> Vec<usize> {
        let confirmed: Vec<usize> = (0..self.areas.len()).filter(|k| self.confirmed(*k)).collect();
        let mut count = vec![0; self.gratings.len()];
        confirmed.iter().for_each(|k| count[self.areas[*k].grating] += 1);
        confirmed.into_iter().filter(|k| count[self.areas[*k].grating] >= SHARING).collect()
    }

    /// Ratio of the scatter of the areas' individual gratings about the shared ones to its expectation.
    fn freedom(&self) -> f64 {
        let mut of: Vec<usize> = self.sharing().iter().map(|k| self.areas[*k].grating).collect();
        let areas = of.len() as f64;
        of.sort_unstable();
        of.dedup();
        if of.is_empty() { 1.0 } else { (areas / (areas - of.len() as f64)).sqrt() }
    }

    /// Accepts the gratings if areas confirm them.
    ///
    /// The error is the reason for rejection.
    fn judged(mut self, settings: &Settings) -> std::result::Result<Self, &'static str> {
        let tested: Vec<usize> = (0..self.areas.len()).filter(|k| self.area_tests[*k].own.is_some()).collect();
        let weight = |all: &[usize]| all.iter().map(|k| self.areas[*k].pixels.len()).sum::<usize>() as f64;
        let confirmed: Vec<usize> = tested.iter().copied().filter(|k| self.confirmed(*k)).collect();
        let agree = weight(&confirmed) / weight(&tested).max(1.0);
        let mut with: Vec<usize> = confirmed.iter().map(|k| self.areas[*k].grating).collect();
        with.sort_unstable();
        with.dedup();
        let sharing = self.sharing();
        let turns = sharing.iter().flat_map(|k| {
            let area_tests = &self.area_tests[*k];
            let halves = area_tests.halves.iter().flatten().map(|t| 0.5 * t[0]);
            area_tests.own.iter().map(|o| o[0]).chain(halves)
        });
        let squares: Vec<f64> = turns.map(|t| t * t).collect();
        let scatter = self.freedom() * (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        let count = with.len();
        let report = &mut self.report;
        (report.areas, report.agree, report.scatter_deg) = (tested.len(), agree, scatter.to_degrees());
        if sharing.is_empty() {
            return Err("no area confirms a grating that it shares with others");
        }
        if settings.directions == Directions::Auto {
            if agree < CONFIRMED {
                return Err("areas have gratings of their own");
            }
            if gradual_change_sigmas(&self.areas, &self.area_tests, self.columns) > GRADUAL {
                return Err("gratings change gradually over the tile");
            }
            if report.explained < EXPLAINED {
                return Err("few of the lit places have one of the gratings that areas share");
            }
            if (confirmed.len() as f64) < PER_GRATING * count as f64 {
                return Err("nearly every area has a grating of its own");
            }
        }
        report.why = match settings.directions {
            Directions::Auto => format!("{} areas have {count} gratings between them", confirmed.len()),
            _ => "as asked for".into(),
        };
        Ok(self)
    }

    /// Assigns confirmed shared gratings to their pixels; other pixels keep their individual ones where nothing else is
    /// near.
    fn merged(mut self, mut free: Fitted, job: &Job, settings: &Settings) -> Fitted {
        let sharing = self.sharing();
        let mut used: Vec<usize> = sharing.iter().map(|k| self.areas[*k].grating).collect();
        used.sort_unstable();
        used.dedup();
        let all = self.gratings(&used, &sharing, job, settings, &mut free);
        let um = |g: &Grating| job.wavelength_nm / 1000.0 / g.length;
        self.report.degrees = all.iter().map(|g| g.orientation.to_degrees()).collect();
        self.report.um = all.iter().map(um).collect();
        let interior = interior(&free.found, job.tiling.width);
        let own = |i: usize| match &free.found[i] {
            Found::Grating(_) if interior[i] => free.found[i],
            Found::Masked(why) => Found::Masked(self.of[i].err().unwrap_or(*why)),
            Found::Grating(_) => Found::Masked(MaskReason::Ambiguous),
        };
        let mut found: Vec<Found> = (0..free.found.len()).map(own).collect();
        for k in sharing {
            let at = used.binary_search(&self.areas[k].grating).unwrap_or(0);
            let pixels = self.areas[k].wide(self.columns);
            pixels.into_iter().for_each(|i| found[i] = Found::Grating(all[at]));
        }
        Fitted { found, directions: self.report, ..free }
    }

    /// Orientations and lengths of the shared gratings, and the report on their periods.
    fn gratings(
        &self,
        used: &[usize],
        sharing: &[usize],
        job: &Job,
        settings: &Settings,
        free: &mut Fitted,
    ) -> Vec<Grating> {
        let lengths: Vec<f64> = used.iter().map(|k| size(self.gratings[*k].vector)).collect();
        let scatter = {
            let own = sharing.iter().filter_map(|k| self.area_tests[*k].own).map(|o| o[1]);
            let halves = sharing.iter().flat_map(|k| self.area_tests[*k].halves).flatten().map(|h| 0.5 * h[1]);
            let squares: Vec<f64> = own.chain(halves).map(|v| v * v).collect();
            self.freedom() * (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
        };
        let sigmas: Vec<f64> = lengths.iter().map(|l| (scatter * l).hypot(SHAPE * self.width)).collect();
        let pixels = self.of.iter().filter(|o| o.is_ok()).count();
        let groups = groups(&lengths, &sigmas, settings.period, job.view.uneven, pixels);
        free.prior.shared = groups.shared;
        free.period = PeriodReport { pixels, ..groups.report };
        let turn = self.report.scatter_deg.to_radians();
        let shape = self.width * FLOOR.max(SHAPE / job.lights.len() as f64);
        let grating = |(n, k): (usize, &usize)| {
            let [x, y] = self.gratings[*k].vector;
            let [length, length_sigma] = groups.lengths[n];
            Grating {
                orientation: y.atan2(x).rem_euclid(PI),
                length,
                orientation_sigma: turn.hypot(shape / lengths[n]),
                length_sigma,
            }
        };
        used.iter().enumerate().map(grating).collect()
    }
}

fn size(v: [f64; 2]) -> f64 {
    v[0].hypot(v[1])
}

/// Positions sampled over the whole tile, with light relative to a common unit, and that unit.
fn places(job: &Job, free: &Fitted) -> Result<(Vec<Place>, f64)> {
    let pixels = job.tiling.width * job.tiling.height;
    let each = job.tiling.origins.len() * job.lights.len();
    let wanted = PLACES.min(COPIES / each.max(1)).max(50);
    let step = (pixels as f64 / wanted as f64).sqrt().max(1.0);
    let at = |n: usize| (0..((n as f64 / step).ceil() as usize)).map(move |k| (k as f64 * step) as usize);
    let columns: Vec<usize> = at(job.tiling.width).collect();
    let rows: Vec<usize> = at(job.tiling.height).filter(|y| *y < job.tiling.height).collect();
    let of_row = |y: &usize| {
        let all = job.row(*y, &mut |x, observed| {
            columns.binary_search(&x).ok().and_then(|_| DiffractedCopies::of(observed, &free.lobe).ok())
        })?;
        Ok(all.into_iter().flatten().collect::<Vec<_>>())
    };
    let diffracted: Result<Vec<Vec<DiffractedCopies>>> = rows.par_iter().map(of_row).collect();
    let diffracted: Vec<DiffractedCopies> = diffracted?.into_iter().flatten().collect();
    let mut bright: Vec<f64> = diffracted.iter().filter(|o| !o.is_dark()).map(|o| o.brightest).collect();
    let unit = quantile(&mut bright, BRIGHT).unwrap_or(1.0);
    Ok((diffracted.iter().map(|o| Place { copies: o.normalised(unit), lit: !o.is_dark() }).collect(), unit))
}

fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get((values.len() as f64 * share) as usize).or(values.last()).copied()
}

/// Peak light, stray light and typical lobe width; `None` if nothing is lit.
fn level(lit: &[Vec<Copy>]) -> Option<(Level, f64)> {
    let brightest = |p: &Vec<Copy>| p.iter().copied().max_by(|a, b| a.light.total_cmp(&b.light));
    let tops: Vec<Copy> = lit.iter().filter_map(brightest).collect();
    let mut peaks: Vec<f64> = tops.iter().map(|c| c.light / c.shape.peak).collect();
    let mut widths: Vec<f64> = tops.iter().map(|c| c.shape.width()).collect();
    let mut strays: Vec<f64> =
        lit.iter().filter_map(|p| median(&mut p.iter().map(|c| c.light).collect::<Vec<_>>())).collect();
    let stray = median(&mut strays)?;
    Some((Level { first: quantile(&mut peaks, BRIGHT)?, stray }, median(&mut widths)?))
}
