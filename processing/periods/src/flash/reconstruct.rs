//! Flash reconstruction: maps, pictures and a report in a new folder.

use super::corners;
use super::fit::{Found, MaskReason, Observed, SPECULAR, copies, fit};
use super::highlight::{self, Highlight};
use super::input::{completed, known_lights, wavelength};
use super::lobe::Lobe;
use super::output::Output;
use super::paper::brightest;
use super::period_selection::select_periods;
use super::photographs::{Photograph, groups, merged};
use super::regularisation::{mask_accidental, regularised};
use super::report::{DirectionsReport, PeriodReport, Report, Seconds};
use super::settings::{Directions, Orientation, PeriodChoice, Settings};
use super::shared;
use super::solve::{Prior, solve};
use super::spool;
use super::tiling::{Moved, Tiling, tiling};
use super::view::{View, view};
use nacre_base::operation::perform;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::{Linearizer, LoadedFrames, load};
use nacre_image::{OutputFolder, Spool};
use nacre_optics::geometry;
use rayon::prelude::*;
use std::path::Path;
use std::time::Instant;

/// Displacement of a highlight, relative to the lobe's width, above which the light's position is corrected.
const MISPLACED: f64 = 0.12;

/// Ratio of full width at half maximum to standard deviation of a Gaussian.
const FWHM: f64 = 2.354_82;

/// Candidate lobe widths relative to that of the highlight.
const WIDTHS: [f64; 7] = [0.8, 0.87, 0.93, 1.0, 1.07, 1.15, 1.25];

/// Number of pixels used to compare them.
const TRIED: usize = 300;

/// Reconstructs maps from `input` (a session, or a `frames.json` of kind flash) in the new folder `out`.
///
/// # Errors
/// `Input` for invalid photographs or options, before anything is written. `Output` if writing fails; the partial
/// folder is then removed. `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    perform(settings, input, out, false, progress)
}

/// Reconstructs maps in a folder.
///
/// Memory: one photograph (8 bytes per pixel, plus decoding), two rows of the tile with all copies, and 160 bytes per
/// pixel of the tile. Shared gratings need up to 80 MiB more. Copies of the tile under each light are kept on disk.
pub(super) fn fit_into(
    folder: &OutputFolder,
    input: &Path,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Report> {
    let begun = Instant::now();
    let frames = load(input)?;
    let settings = completed(settings, &frames)?;
    let job = Job::read(&frames, &settings, progress)?;
    let read = begun.elapsed().as_secs_f64();
    let fit = job.fitted(&settings, progress)?;
    let fitted = begun.elapsed().as_secs_f64();
    progress.stage("writing", 1);
    let mut report = job.report(&fit, &settings);
    report.warnings.splice(0..0, job.of_files.iter().cloned());
    Output { found: &fit.found, report: &report, scale_bar: !settings.no_scale_bar }.write(folder)?;
    let total = begun.elapsed().as_secs_f64();
    report.seconds = Seconds { read, fit: fitted - read, write: total - fitted, total };
    progress.step();
    Ok(report)
}

/// Gratings of all pixels, with the parameters of the fit.
pub(super) struct Fitted {
    pub found: Vec<Found>,
    pub period: PeriodReport,
    pub directions: DirectionsReport,
    pub lobe: Lobe,
    pub prior: Prior,
}

/// Photographs as copies of the tile.
pub(super) struct Job {
    pub view: View,
    pub tiling: Tiling,
    /// Parts of tiles that other tiles overlap.
    overlaps: Vec<Vec<[f64; 4]>>,
    pub moved: Option<Moved>,
    pub lights: Vec<[f64; 3]>,
    pub highlights: Vec<Option<Highlight>>,
    /// Number of lights whose positions were corrected by their highlights.
    pub corrected: usize,
    spool: Spool,
    pub wavelength_nm: f64,
    band: f64,
    light_mm: f64,
    pub noise_known: bool,
    pub corners_found: bool,
    pub geometry_sigma: geometry::Uncertainty,
    /// Warnings about the photographs' files.
    of_files: Vec<String>,
}

impl Job {
    fn read(frames: &LoadedFrames, settings: &Settings, progress: &dyn Progress) -> Result<Self> {
        let groups = groups(frames)?;
        let stated = known_lights(&groups, settings, frames)?;
        let wavelength_nm = wavelength(settings, frames)?;
        progress.stage("reading photographs", groups.lights.len() as u64 + 1);
        let linearizer = Linearizer::new(frames)?;
        let image = [frames.info.width, frames.info.height];
        let room = groups.room.as_ref().map(|group| merged(frames, group, &linearizer)).transpose()?;
        let finds = settings.geometry.is_none() && settings.corners_px.is_none();
        let corners = if finds { room.as_ref().map(corners::find).transpose()? } else { settings.corners_px };
        let view = view(settings, corners, image)?;
        let (tiling, moved) = tiling(settings, &view, room.as_ref(), image)?;
        drop(room);
        progress.step();
        let mut job = Self {
            spool: spool::of_copies(&tiling),
            overlaps: tiling.overlaps(),
            view,
            tiling,
            moved,
            lights: vec![],
            highlights: vec![],
            corrected: 0,
            wavelength_nm,
            band: frames.set.band_nm.map_or(0.0, |band| band / FWHM / wavelength_nm),
            light_mm: 0.0,
            noise_known: frames.set.noise.is_some(),
            corners_found: finds,
            geometry_sigma: settings.geometry.as_ref().map(|g| g.sigma).unwrap_or_default(),
            of_files: frames.warnings.clone(),
        };
        for (group, stated) in groups.lights.iter().zip(stated) {
            progress.check()?;
            let photograph = merged(frames, group, &linearizer)?;
            job.take_in(&photograph, stated, settings)?;
            progress.step();
        }
        job.of_files.extend(linearizer.clipping());
        let mut widths: Vec<f64> = job.highlights.iter().flatten().map(|h| h.light_mm).collect();
        widths.sort_by(f64::total_cmp);
        job.light_mm = settings.light_sigma_mm.or(widths.get(widths.len() / 2).copied()).ok_or_else(|| {
            let remedy = "photograph it, or say how large the light is with --light-sigma-mm";
            Error::file(&frames.path, "shows no highlight, whose width is that of all lobes", remedy)
        })?;
        Ok(job)
    }

    /// Determines a photograph's highlight and light, and stores its copies of the tile.
    fn take_in(&mut self, photograph: &Photograph, stated: Option<[f64; 3]>, settings: &Settings) -> Result<()> {
        let found = highlight::find(photograph, &self.view, self.tiling.extent(), stated, settings.light_height_mm);
        let light = match (stated, &found) {
            (Some(light), Some(h)) => {
                let lobe = Lobe { light_mm: h.light_mm, band: 0.0 };
                let width = lobe.at(&self.view.half(h.place, light)).width();
                let misplaced = h.half[0].hypot(h.half[1]) > MISPLACED * width;
                self.corrected += usize::from(misplaced && !settings.trust_lights);
                let moves = misplaced && !settings.trust_lights;
                if moves { self.view.light_at(h.place, light[2]) } else { light }
            }
            (Some(light), None) => light,
            (None, Some(h)) => self.view.light_at(h.place, settings.light_height_mm.unwrap_or(h.light_mm)),
            (None, None) => {
                let problem = "shows no highlight, so nothing tells where the flash was";
                return Err(Error::input("photographs", problem, "write light_mm into frames.json"));
            }
        };
        self.lights.push(light);
        self.highlights.push(found);
        spool::add(&mut self.spool, photograph, &self.tiling, &self.view)
    }

    /// Visits the copies of all positions of a row; overlapped copies have no light.
    pub fn row<T>(&self, y: usize, of: &mut dyn FnMut(usize, &[Observed]) -> T) -> Result<Vec<T>> {
        let rows = self.spool.row(y)?;
        let tiles = self.tiling.origins.len();
        let mut observed = Vec::with_capacity(rows.len() * tiles);
        let mut all = Vec::with_capacity(self.tiling.width);
        let within = |[left, top, right, bottom]: &[f64; 4], x: usize| {
            let [x, y] = [x, y].map(|n| n as f64 + 0.5);
            x > *left && x < *right && y > *top && y < *bottom
        };
        let copy = |row: &[f32], i: usize| [row[2 * i], row[2 * i + 1]];
        for x in 0..self.tiling.width {
            observed.clear();
            for (row, light) in rows.iter().zip(&self.lights) {
                for tile in 0..tiles {
                    let seen = self.view.half(self.tiling.place(tile, x, y), *light);
                    let is_hidden = self.overlaps[tile].iter().any(|part| within(part, x));
                    observed.push(Observed {
                        seen,
                        light: if is_hidden { [f32::NAN; 2] } else { copy(row, x * tiles + tile) },
                    });
                }
            }
            all.push(of(x, &observed));
        }
        Ok(all)
    }

    /// Fits gratings to all pixels.
    fn fitted(&self, settings: &Settings, progress: &dyn Progress) -> Result<Fitted> {
        let lobe = Lobe { light_mm: self.light_mm, band: self.band };
        let prior = self.prior(settings, &lobe);
        if settings.orientation == Orientation::Image {
            progress.stage("looking for the brightest", self.tiling.height as u64);
            let found = self.rows(progress, &|_, observed| self.by_brightness(observed, &lobe))?;
            let why = || "as the paper has it".to_owned();
            let period = PeriodReport { choice: PeriodChoice::Pixel, why: why(), ..PeriodReport::default() };
            let directions = DirectionsReport { choice: Directions::Free, why: why(), ..DirectionsReport::default() };
            return Ok(Fitted { found, period, directions, lobe, prior });
        }
        let lobe = if settings.light_sigma_mm.is_some() { lobe } else { self.refined(&lobe, &prior)? };
        let free = self.free(settings, lobe, prior, progress)?;
        shared::refit(self, free, settings, progress)
    }

    /// Fits each pixel independently.
    fn free(&self, settings: &Settings, lobe: Lobe, prior: Prior, progress: &dyn Progress) -> Result<Fitted> {
        progress.stage("fitting gratings", self.tiling.height as u64);
        let of = |prior: Prior| {
            move |_: usize, observed: &[Observed]| match copies(observed, &lobe) {
                Ok(copies) => fit(&copies, &prior),
                Err(why) => Found::Masked(why),
            }
        };
        let mut found = self.rows(progress, &of(prior))?;
        let selection = select_periods(&found, self.tiling.width, settings.period, self.view.uneven);
        let mut prior = Prior { shared: selection.shared, ..prior };
        if selection.shared.is_some() {
            progress.stage("fitting gratings of one period", self.tiling.height as u64);
            found = self.rows(progress, &of(prior))?;
        }
        let found = mask_accidental(regularised(&found, self.tiling.width));
        let mut period = selection.report;
        // Masked pixels provide no evidence about the period.
        if !found.iter().any(|f| matches!(f, Found::Grating(_))) {
            prior.shared = None;
            period = PeriodReport { choice: PeriodChoice::Pixel, why: "no pixel has a period".into(), ..period };
        }
        Ok(Fitted { found, period, directions: DirectionsReport::default(), lobe, prior })
    }

    pub fn rows<T: Send + Clone>(
        &self,
        progress: &dyn Progress,
        of: &(dyn Fn(usize, &[Observed]) -> T + Sync),
    ) -> Result<Vec<T>> {
        let row = |y: usize| {
            progress.check()?;
            let found = self.row(y, &mut |x, observed| of(x, observed))?;
            progress.step();
            Ok(found)
        };
        let rows: Result<Vec<Vec<T>>> = (0..self.tiling.height).into_par_iter().map(row).collect();
        Ok(rows?.concat())
    }

    fn by_brightness(&self, observed: &[Observed], lobe: &Lobe) -> Found {
        // Direction from each copy to the highlight, which divides the line from camera to light in the ratio of
        // heights.
        let tiles = self.tiling.origins.len();
        let towards: Vec<[f64; 2]> = (0..observed.len())
            .map(|i| {
                let light = self.lights[i / tiles];
                let share = self.view.viewer[2] / (self.view.viewer[2] + light[2]);
                let viewer = self.view.viewer;
                let highlight = [0, 1].map(|k| viewer[k] + share * (light[k] - viewer[k]));
                let place = observed[i].seen.place;
                [highlight[0] - place[0], highlight[1] - place[1]]
            })
            .collect();
        brightest(observed, &towards, lobe).map_or(Found::Masked(MaskReason::Dark), Found::Grating)
    }

    /// Prior range of grating-vector lengths: as requested, or all lengths outside of the zero order and within the
    /// observed half vectors.
    fn prior(&self, settings: &Settings, lobe: &Lobe) -> Prior {
        let um = self.wavelength_nm / 1000.0;
        if let Some([low, high]) = settings.period_um {
            return Prior { range: [um / high, um / low], shared: None };
        }
        let (mut largest, mut width) = (0.0_f64, 0.0_f64);
        for light in &self.lights {
            for tile in 0..self.tiling.origins.len() {
                let seen =
                    self.view.half(self.tiling.place(tile, self.tiling.width / 2, self.tiling.height / 2), *light);
                largest = largest.max(seen.half[0].hypot(seen.half[1]));
                width = width.max(lobe.at(&seen).width());
            }
        }
        let least = (SPECULAR + 1.0) * width;
        Prior { range: [least, largest.max(1.5 * least)], shared: None }
    }

    /// Lobe whose width minimises the residual at some bright positions.
    fn refined(&self, highlight: &Lobe, prior: &Prior) -> Result<Lobe> {
        let rows: Vec<usize> = (0..12).map(|k| (2 * k + 1) * self.tiling.height / 24).collect();
        let step = (12 * self.tiling.width / TRIED).max(1);
        let of_row = |y: &usize| {
            let mut sums = vec![];
            self.row(*y, &mut |x, observed| {
                if x % step == 0 {
                    sums.push(WIDTHS.map(|width| {
                        let lobe = Lobe { light_mm: width * highlight.light_mm, ..*highlight };
                        // The same copies for all widths, so that residuals are comparable.
                        residual(observed, highlight, &lobe, prior)
                    }));
                }
            })?;
            Ok(sums)
        };
        let sums: Result<Vec<Vec<[Option<f64>; WIDTHS.len()]>>> = rows.par_iter().map(of_row).collect();
        let all: Vec<[f64; WIDTHS.len()]> = sums?
            .concat()
            .into_iter()
            .filter(|s| s.iter().all(Option::is_some))
            .map(|s| s.map(|v| v.unwrap_or(0.0)))
            .collect();
        if all.is_empty() {
            return Ok(*highlight);
        }
        // The contribution of each position is limited, so that outliers do not dominate.
        let total = WIDTHS.iter().enumerate().map(|(k, _)| {
            all.iter().map(|s| (s[k] - s.iter().copied().fold(f64::MAX, f64::min)).min(50.0)).sum::<f64>()
        });
        let total: Vec<f64> = total.collect();
        let best = (0..WIDTHS.len()).min_by(|a, b| total[*a].total_cmp(&total[*b])).unwrap_or(WIDTHS.len() / 2);
        let mut width = WIDTHS[best];
        if best > 0 && best + 1 < WIDTHS.len() {
            let [a, b, c] = [total[best - 1], total[best], total[best + 1]];
            let (left, right) = ((WIDTHS[best] / WIDTHS[best - 1]).ln(), (WIDTHS[best + 1] / WIDTHS[best]).ln());
            let bend = (a - b) / left + (c - b) / right;
            let off = 0.5 * ((a - b) / left * right - (c - b) / right * left) / bend.max(1e-9);
            width *= off.clamp(-left, right).exp();
        }
        Ok(Lobe { light_mm: width * highlight.light_mm, ..*highlight })
    }
}

/// Residual of the best fit with a lobe; `None` without light.
fn residual(observed: &[Observed], same: &Lobe, lobe: &Lobe, prior: &Prior) -> Option<f64> {
    // The widest lobe's zero order is excluded for all widths, so that the copies are the same.
    let widest = Lobe { light_mm: same.light_mm * WIDTHS[WIDTHS.len() - 1], ..*same };
    let usable = |o: &&Observed| {
        let shape = widest.at(&o.seen);
        shape.square(widest.middle(&o.seen)) > SPECULAR * SPECULAR
    };
    let outside: Vec<Observed> = observed.iter().filter(usable).copied().collect();
    let all = copies(&outside, lobe).ok()?;
    let bright = all.iter().max_by(|a, b| a.light.total_cmp(&b.light))?.half;
    let length = bright[0].hypot(bright[1]);
    let start = if length > prior.range[1] { bright.map(|v| 0.5 * v) } else { bright };
    solve(&all, start, prior).map(|s| s.cost)
}
