//! The whole job: photographs to maps, pictures and a report in a new folder.

use super::decide::decide;
use super::fit::{Found, Observed, SPECULAR, Why, copies, fit};
use super::highlight::{self, Highlight};
use super::lobe::Lobe;
use super::output::Output;
use super::paper::brightest;
use super::photographs::{Groups, Photograph, groups, merged};
use super::report::{Masked, PeriodReport, Registration, Report, Seconds};
use super::settings::{Orientation, Settings};
use super::solve::{Prior, solve};
use super::spool::Spool;
use super::tiling::{Moved, Tiling, tiling};
use super::view::{View, half, view};
use super::corners;
use crate::frames::{Linearizer, LoadedFrames, load};
use crate::image::OutputFolder;
use crate::progress::Progress;
use crate::{Error, Result, geometry};
use rayon::prelude::*;
use std::path::Path;
use std::time::Instant;

/// File beside `frames.json` that says where camera and sample were.
const GEOMETRY: &str = "geometry.json";

/// A highlight that lies this part of a lobe's width from where it should moves the light.
const MISPLACED: f64 = 0.12;

/// Full width at half maximum of a Gaussian over its standard deviation.
const FWHM: f64 = 2.354_82;

/// Widths of lobes that are tried, over that of the highlight.
const WIDTHS: [f64; 7] = [0.8, 0.87, 0.93, 1.0, 1.07, 1.15, 1.25];

/// Pixels that they are tried on.
const TRIED: usize = 300;

/// Whether there is something to make maps of, without a look at any pixel.
///
/// # Errors
/// As [`reconstruct`] for settings and sets that make no sense.
pub fn check_input(input: &Path, settings: &Settings) -> Result<()> {
    settings.check()?;
    let frames = load(input)?;
    let settings = completed(settings, &frames)?;
    let groups = groups(&frames)?;
    known_lights(&groups, &settings, &frames)?;
    wavelength(&settings, &frames)?;
    if settings.reference_px.is_none() && settings.size_mm.is_none() {
        let remedy = "give width and height of the sheet in mm, or reference_px";
        return Err(Error::input("size_mm", "is not known", remedy));
    }
    Ok(())
}

/// Makes maps of `input` (a session, or a `frames.json` of kind flash) in the new folder `out`.
///
/// Memory: one photograph (8 bytes per pixel and what decoding takes), two rows of the tile with all copies, and 50 bytes per pixel of the
/// tile; copies of the tile under every light are on disk meanwhile.
///
/// # Errors
/// `Input` for anything about the photographs or the settings, before anything is written; `Output` when writing fails, after
/// which nothing is left behind; `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    let begun = Instant::now();
    settings.check()?;
    let folder = OutputFolder::begin(out, settings.overwrite)?;
    let frames = load(input)?;
    let settings = completed(settings, &frames)?;
    let job = Job::read(&frames, &settings, progress)?;
    let read = begun.elapsed().as_secs_f64();
    let (found, period, lobe, prior) = job.fitted(&settings, progress)?;
    let fitted = begun.elapsed().as_secs_f64();
    progress.stage("writing", 1);
    let mut report = job.report(&found, period, &lobe, &prior, &settings);
    Output { found: &found, report: &report }.write(&folder)?;
    let total = begun.elapsed().as_secs_f64();
    report.seconds = Seconds { read, fit: fitted - read, write: total - fitted, total };
    folder.write("report.json", report.json().as_bytes())?;
    progress.check()?;
    folder.commit()?;
    progress.step();
    Ok(report)
}

/// Settings with the geometry that lies beside the photographs, unless they have another one.
fn completed(settings: &Settings, frames: &LoadedFrames) -> Result<Settings> {
    let own = settings.geometry.is_some() || settings.camera_mm.is_some() || settings.corners_px.is_some();
    let beside = frames.folder.join(GEOMETRY);
    let geometry = if own || !beside.is_file() { settings.geometry.clone() } else { Some(geometry::load(&beside)?) };
    Ok(Settings { geometry, ..settings.clone() })
}

fn wavelength(settings: &Settings, frames: &LoadedFrames) -> Result<f64> {
    let of_geometry = settings.geometry.as_ref().and_then(|g| g.wavelength_nm);
    settings.wavelength_nm.or(frames.set.wavelength_nm).or(of_geometry).ok_or_else(|| {
        Error::input("wavelength_nm", "is not known", "give that of the filter, or write it into frames.json")
    })
}

/// Places of lights where they are said; refuses those that cannot be found.
fn known_lights(groups: &Groups, settings: &Settings, frames: &LoadedFrames) -> Result<Vec<Option<[f64; 3]>>> {
    let one = settings.geometry.as_ref().and_then(|g| g.light_mm).filter(|_| groups.lights.len() == 1);
    let lights: Vec<Option<[f64; 3]>> = groups.lights.iter().map(|g| g.light_mm.or(one)).collect();
    if settings.light_height_mm.is_none() && lights.contains(&None) {
        let problem = "does not say where the flash was (light_mm of its frames)";
        return Err(Error::file(&frames.path, problem, "add it, or give light_height_mm: the highlight tells the rest"));
    }
    Ok(lights)
}

/// Photographs as copies of the tile.
struct Job {
    view: View,
    tiling: Tiling,
    moved: Option<Moved>,
    lights: Vec<[f64; 3]>,
    highlights: Vec<Option<Highlight>>,
    /// Lights that were moved to where their highlights say.
    corrected: usize,
    spool: Spool,
    wavelength_nm: f64,
    band: f64,
    light_mm: f64,
    noise_known: bool,
    corners_found: bool,
    geometry_sigma: geometry::Uncertainty,
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
            spool: Spool::new(&tiling),
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
        };
        for (group, stated) in groups.lights.iter().zip(stated) {
            progress.check()?;
            let photograph = merged(frames, group, &linearizer)?;
            job.take_in(&photograph, stated, settings)?;
            progress.step();
        }
        let mut widths: Vec<f64> = job.highlights.iter().flatten().map(|h| h.light_mm).collect();
        widths.sort_by(f64::total_cmp);
        job.light_mm = settings.light_sigma_mm.or(widths.get(widths.len() / 2).copied()).ok_or_else(|| {
            let remedy = "photograph it, or say how large the light is with light_sigma_mm";
            Error::file(&frames.path, "shows no highlight, whose width is that of all lobes", remedy)
        })?;
        Ok(job)
    }

    /// Finds a photograph's highlight and light, and keeps its copies of the tile.
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
        self.spool.add(photograph, &self.tiling, &self.view)
    }

    /// Copies of the places of a row, one after the other.
    fn row<T>(&self, y: usize, of: &mut dyn FnMut(usize, &[Observed]) -> T) -> Result<Vec<T>> {
        let rows = self.spool.row(y)?;
        let tiles = self.tiling.origins.len();
        let mut observed = Vec::with_capacity(rows.len() * tiles);
        let mut all = Vec::with_capacity(self.tiling.width);
        for x in 0..self.tiling.width {
            observed.clear();
            for (row, light) in rows.iter().zip(&self.lights) {
                for tile in 0..tiles {
                    let seen = self.view.half(self.tiling.place(tile, x, y), *light);
                    observed.push(Observed { seen, light: row[x * tiles + tile] });
                }
            }
            all.push(of(x, &observed));
        }
        Ok(all)
    }

    /// Gratings of all pixels.
    fn fitted(
        &self,
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<(Vec<Found>, PeriodReport, Lobe, Prior)> {
        let highlight = Lobe { light_mm: self.light_mm, band: self.band };
        let prior = self.prior(settings, &highlight);
        if settings.orientation == Orientation::Image {
            progress.stage("looking for the brightest", self.tiling.height as u64);
            let found = self.rows(progress, &|_, observed| self.by_brightness(observed, &highlight))?;
            let report = PeriodReport { choice: super::PeriodChoice::Pixel, why: "as the paper has it".into(), ..PeriodReport::default() };
            return Ok((found, report, highlight, prior));
        }
        let lobe = if settings.light_sigma_mm.is_some() { highlight } else { self.refined(&highlight, &prior)? };
        progress.stage("fitting gratings", self.tiling.height as u64);
        let of = |prior: Prior| {
            move |_: usize, observed: &[Observed]| match copies(observed, &lobe) {
                Ok(copies) => fit(&copies, &prior),
                Err(why) => Found::Masked(why),
            }
        };
        let found = self.rows(progress, &of(prior))?;
        let decision = decide(&found, self.tiling.width, settings.period);
        let prior = Prior { shared: decision.shared, ..prior };
        if decision.shared.is_none() {
            return Ok((found, decision.report, lobe, prior));
        }
        progress.stage("fitting gratings of one period", self.tiling.height as u64);
        let found = self.rows(progress, &of(prior))?;
        Ok((found, decision.report, lobe, prior))
    }

    fn rows(
        &self,
        progress: &dyn Progress,
        of: &(dyn Fn(usize, &[Observed]) -> Found + Sync),
    ) -> Result<Vec<Found>> {
        let row = |y: usize| {
            progress.check()?;
            let found = self.row(y, &mut |x, observed| of(x, observed))?;
            progress.step();
            Ok(found)
        };
        let rows: Result<Vec<Vec<Found>>> = (0..self.tiling.height).into_par_iter().map(row).collect();
        Ok(rows?.concat())
    }

    fn by_brightness(&self, observed: &[Observed], lobe: &Lobe) -> Found {
        // Where the highlight lies: half-way in sines, for each light.
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
        brightest(observed, &towards, lobe).map_or(Found::Masked(Why::Dark), Found::Grating)
    }

    /// Range of lengths that gratings may have: as asked for, or all that lie outside of the order zero and within what is seen.
    fn prior(&self, settings: &Settings, lobe: &Lobe) -> Prior {
        let um = self.wavelength_nm / 1000.0;
        if let Some([low, high]) = settings.period_um {
            return Prior { range: [um / high, um / low], shared: None };
        }
        let (mut largest, mut width) = (0.0_f64, 0.0_f64);
        for light in &self.lights {
            for tile in 0..self.tiling.origins.len() {
                let seen = self.view.half(self.tiling.place(tile, self.tiling.width / 2, self.tiling.height / 2), *light);
                largest = largest.max(seen.half[0].hypot(seen.half[1]));
                width = width.max(lobe.at(&seen).width());
            }
        }
        let least = (SPECULAR + 1.0) * width;
        Prior { range: [least, largest.max(1.5 * least)], shared: None }
    }

    /// The lobe whose width leaves least over at some bright places.
    fn refined(&self, highlight: &Lobe, prior: &Prior) -> Result<Lobe> {
        let rows: Vec<usize> = (0..12).map(|k| (2 * k + 1) * self.tiling.height / 24).collect();
        let step = (12 * self.tiling.width / TRIED).max(1);
        let of_row = |y: &usize| {
            let mut sums = vec![];
            self.row(*y, &mut |x, observed| {
                if x % step == 0 {
                    sums.push(WIDTHS.map(|width| {
                        let lobe = Lobe { light_mm: width * highlight.light_mm, ..*highlight };
                        // The same copies for all, so that what is left over can be compared.
                        left_over(observed, highlight, &lobe, prior)
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
        // What a few odd places leave over does not count for more than that of others.
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

    /// Relative change of a half vector of this length when the light is higher, or the camera, by a mm: means over the sheet.
    fn per_mm(&self, length: f64) -> [f64; 2] {
        let mut sums = [0.0; 3];
        let [x, y, z] = self.view.viewer;
        for light in &self.lights {
            for tile in 0..self.tiling.origins.len() {
                let place = self.tiling.place(tile, self.tiling.width / 2, self.tiling.height / 2);
                let size = |v: [f64; 2]| v[0].hypot(v[1]);
                let now = size(self.view.half(place, *light).half);
                let weight = (-0.5 * ((now - length) / (0.2 * length)).powi(2)).exp();
                let raised = [light[0], light[1], light[2] + 1.0];
                sums[0] += weight;
                sums[1] += weight * (size(self.view.half(place, raised).half) / now - 1.0);
                sums[2] += weight * (size(half([x, y, z + 1.0], place, *light).half) / now - 1.0);
            }
        }
        [sums[1] / sums[0].max(1e-9), sums[2] / sums[0].max(1e-9)]
    }

    fn report(
        &self,
        found: &[Found],
        period: PeriodReport,
        lobe: &Lobe,
        prior: &Prior,
        settings: &Settings,
    ) -> Report {
        let um = self.wavelength_nm / 1000.0;
        let median = |mut values: Vec<f64>, share: usize| {
            values.sort_by(f64::total_cmp);
            values.get(values.len().saturating_sub(1) * share / 100).copied()
        };
        let gratings = || found.iter().filter_map(|f| if let Found::Grating(g) = f { Some(g) } else { None });
        let lengths: Vec<f64> = gratings().map(|g| g.length).collect();
        let typical = median(lengths.clone(), 50).unwrap_or(prior.range[0]);
        let [light_per_mm, camera_per_mm] = self.per_mm(typical);
        let sigma = &self.geometry_sigma;
        let of_wavelength = sigma.wavelength_nm.unwrap_or(0.0) / self.wavelength_nm;
        let of_light = sigma.light_mm.map_or(0.0, |s| s[2] * light_per_mm);
        let of_camera = sigma.sample_mm.map_or(0.0, |s| s[2] * camera_per_mm);
        let common_sigma = of_wavelength.hypot(of_light).hypot(of_camera);
        let middle = self.tiling.place(0, self.tiling.width / 2, self.tiling.height / 2);
        let seen = self.view.half(middle, self.lights[0]);
        let shared_um = prior.shared.map(|[length, _]| um / length);
        let period = PeriodReport {
            um: shared_um,
            sigma_um: prior.shared.zip(shared_um).map(|([l, s], um)| um * (s / l).hypot(common_sigma)),
            median_um: median(lengths.clone(), 50).map(|l| um / l),
            range_um: median(lengths.clone(), 95).zip(median(lengths, 5)).map(|(a, b)| [um / a, um / b]),
            ..period
        };
        let mut report = Report {
            method: "flash",
            warnings: vec![],
            assumptions: vec![],
            width: self.tiling.width,
            height: self.tiling.height,
            pixel_um: 1000.0 * self.tiling.pitch_mm,
            tiles: self.tiling.origins.len(),
            reference_mm: self.tiling.origins[0],
            registration: self.moved.map(|m| Registration {
                most_px: m.most_px,
                sigma_px: m.sigma_px,
                left_out: m.left_out,
            }),
            lights_mm: self.lights.clone(),
            highlights: self.highlights.iter().map(|h| h.map(|h| h.half)).collect(),
            light_sigma_mm: lobe.light_mm,
            lobe: lobe.at(&seen).width(),
            spacing: self.spacing(middle),
            wavelength_nm: self.wavelength_nm,
            searched_um: [um / prior.range[1], um / prior.range[0]],
            relative: self.view.relative.is_some(),
            orientation: settings.orientation,
            period,
            sigma_deg: median(gratings().map(|g| g.orientation_sigma.to_degrees()).collect(), 50),
            period_sigma: median(gratings().map(|g| (g.length_sigma / g.length).hypot(common_sigma)).collect(), 50),
            common_sigma,
            masked: masked(found),
            seconds: Seconds::default(),
        };
        report.assumptions = self.assumptions(settings, [light_per_mm, camera_per_mm]);
        report.warnings = self.warnings(&report, settings);
        report
    }

    /// How far apart the half vectors of a place's copies lie, both signs folded.
    fn spacing(&self, at: [f64; 2]) -> f64 {
        let [width, height] = [self.tiling.width, self.tiling.height].map(|n| n as f64 * self.tiling.pitch_mm);
        let half = |dx: f64, dy: f64| self.view.half([at[0] + dx, at[1] + dy], self.lights[0]).half;
        let (o, x, y) = (half(0.0, 0.0), half(1.0, 0.0), half(0.0, 1.0));
        let area = ((x[0] - o[0]) * (y[1] - o[1]) - (x[1] - o[1]) * (y[0] - o[0])).abs();
        (area * width * height / (2 * self.lights.len()) as f64).sqrt()
    }

    fn assumptions(&self, settings: &Settings, [light, camera]: [f64; 2]) -> Vec<String> {
        let mut all = vec![
            format!(
                "the wavelength is right: 1 nm is {:.2} % of the period",
                100.0 / self.wavelength_nm
            ),
            format!(
                "heights of light and camera are right: 1 mm of the light's is {:.2} % of the period, 1 mm of the camera's {:.2} %",
                100.0 * light.abs(),
                100.0 * camera.abs()
            ),
            "the sheet is flat, and each place has one grating; first orders are at least half as bright as higher ones, as of grooves \
             less than about a quarter of a wavelength deep"
                .into(),
        ];
        if settings.period_um.is_some() {
            all.push("all periods lie in the range that was given".into());
        }
        if !self.noise_known {
            all.push("the camera's noise is not known; a modest one was assumed".into());
        }
        if self.corners_found {
            all.push("the brightest area of the photograph by room light is the sheet".into());
        }
        if let Some(why) = &self.view.relative {
            all.push(why.clone());
        }
        all
    }

    fn warnings(&self, report: &Report, settings: &Settings) -> Vec<String> {
        let mut all = vec![];
        if report.relative {
            all.push("periods are relative: right up to a common factor only (no calibrated geometry)".into());
        }
        let tiles = report.tiles > 1;
        match &report.registration {
            None if tiles => all.push(
                "tiles were taken to lie on an exact grid, since no photograph by room light shows where they do; orientations near edges may \
                 be of the polygon next to them"
                    .into(),
            ),
            Some(r) if r.left_out > 0 => {
                all.push(format!("{} tiles look like no other and were left out", r.left_out));
            }
            _ => {}
        }
        if self.corrected > 0 {
            all.push(format!(
                "highlights lie elsewhere than {} of {} lights would have them; the lights were moved to where they say",
                self.corrected,
                self.lights.len()
            ));
        }
        let missing = report.highlights.iter().filter(|h| h.is_none()).count();
        if missing > 0 {
            all.push(format!("{missing} of the highlights are not in the picture, so nothing checks where those lights were"));
        }
        if settings.orientation == Orientation::Half && report.spacing > 2.2 * report.lobe {
            let lights = (self.lights.len() as f64 * (report.spacing / (2.0 * report.lobe)).powi(2)).ceil();
            all.push(format!(
                "copies of a place are seen under half vectors {:.3} apart, but lobes have a σ of {:.3}: many places are lit by chance; about \
                 {lights:.0} lights would do",
                report.spacing, report.lobe
            ));
        }
        if settings.orientation == Orientation::Image {
            all.push("orientations and periods are those of the brightest copies, which are biased; half does better".into());
        }
        if report.sigma_deg.is_none() {
            all.push("no pixel has a grating that is known: see masked".into());
        }
        if report.masked.ambiguous > 0.02 {
            all.push(format!(
                "{:.0} % of the pixels have light that several gratings or orders explain; more lights, or a range of periods, tell them \
                 apart",
                100.0 * report.masked.ambiguous
            ));
        }
        all
    }
}

/// What the best fit with a lobe leaves over; none where there is no light.
fn left_over(observed: &[Observed], same: &Lobe, lobe: &Lobe, prior: &Prior) -> Option<f64> {
    // Copies with the widest lobe's order zero left out.
    let mut all = copies(observed, &Lobe { light_mm: same.light_mm * WIDTHS[WIDTHS.len() - 1], ..*same }).ok()?;
    let bright = all.iter().max_by(|a, b| a.light.total_cmp(&b.light))?.half;
    let usable = observed.iter().filter(|o| o.light[0].is_finite() && o.light[1] > 0.0);
    let mut shapes = usable.map(|o| (o.seen.half, lobe.at(&o.seen)));
    for copy in &mut all {
        // In the same order, less those left out.
        copy.shape = shapes.find(|(half, _)| *half == copy.half)?.1;
    }
    let length = bright[0].hypot(bright[1]);
    let start = if length > prior.range[1] { bright.map(|v| 0.5 * v) } else { bright };
    solve(&all, start, prior).map(|s| s.cost)
}

fn masked(found: &[Found]) -> Masked {
    let share = |why: Why| {
        let count = found.iter().filter(|f| matches!(f, Found::Masked(w) if *w == why)).count();
        count as f64 / found.len().max(1) as f64
    };
    let all = found.iter().filter(|f| matches!(f, Found::Masked(_))).count();
    Masked {
        all: all as f64 / found.len().max(1) as f64,
        unseen: share(Why::Unseen),
        dark: share(Why::Dark),
        ambiguous: share(Why::Ambiguous),
        several: share(Why::Several),
        uncertain: share(Why::Uncertain),
        unexplained: share(Why::Unexplained),
    }
}
