//! Fringe reconstruction: maps, pictures and a report in a new folder.

use super::answer::{Demands, Verdict};
use super::discs;
use super::input::Bench;
use super::optics::Optics;
use super::output::Output;
use super::polarization::Orientations;
use super::pose::of_geometry;
use super::report::{Counts, PixelResidual, Report, Seconds};
use super::scan::{Found, aperture, scan};
use super::settings::Settings;
use super::signals::{Carrier, Signals, carriers};
use super::solve::MAX_CARRIERS;
use nacre_base::Result;
use nacre_base::estimate::Work;
use nacre_base::operation::perform;
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use nacre_frames::{LoadedFrames, load};
use nacre_image::OutputFolder;
use nacre_image::budget;
use std::path::Path;
use std::time::Instant;

/// Most pixels that the report lists for their residuals.
const WORST: usize = 10;

/// Validates the input of [`reconstruct`] without reading pixels, and predicts the work.
///
/// # Errors
/// As [`reconstruct`].
pub(super) fn check_input(input: &Path, settings: &Settings) -> Result<Work> {
    settings.check()?;
    let frames = load(input)?;
    let shown = carriers(&frames, MAX_CARRIERS)?;
    Bench::new(&frames, settings)?;
    work(&frames, shown.len())
}

fn work(frames: &LoadedFrames, fringes: usize) -> Result<Work> {
    let first = &frames.set.frames[0];
    budget::Operation::Fringes(fringes).check(&frames.file(&first.file), frames.info)
}

/// Reconstructs maps of orientation and period from `input` (a session of fringes) in the new folder `out`.
///
/// # Errors
/// `Input` for invalid photographs, geometry or options, before anything is written. `Output` if writing fails; the
/// partial folder is then removed. `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    perform(settings, input, out, false, progress)
}

/// Reconstructs maps in a folder.
///
/// Memory: 8 bytes per pixel and fringe, independent of the number of frames, and about 200 bytes per pixel.
pub(super) fn solve_into(
    folder: &OutputFolder,
    input: &Path,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Report> {
    let begun = Instant::now();
    let frames = load(input)?;
    let shown = carriers(&frames, MAX_CARRIERS)?;
    let bench = Bench::new(&frames, settings)?;
    let known = settings.polarization.as_deref();
    let (width, height) = (frames.info.width, frames.info.height);
    let orientations = known.map(|folder| Orientations::read(folder, width, height)).transpose()?;
    let signals = Signals::read(&frames, &shown, progress)?;
    let read = begun.elapsed().as_secs_f64();
    progress.check()?;
    let points = |x: usize, y: usize| bench.geometry.point([x as f64, y as f64]);
    let mut optics = bench.optics.clone();
    let demands = demands(settings, &shown, &signals);
    if settings.aperture_mm.is_none() {
        optics.aperture_mm = aperture(&signals, &optics, &points, demands);
    }
    let calibrated = begun.elapsed().as_secs_f64();
    let mut found = scan(&signals, &optics, &points, demands, progress)?;
    let discs = discs::verify(&frames, &optics, &points, &mut found, progress)?;
    let polarization = orientations.and_then(|o| o.verify(&mut found));
    let solved = begun.elapsed().as_secs_f64();
    progress.stage("writing", 1);
    let wavelength_nm = 1000.0 * optics.wavelength_um;
    let by_wavelength = bench.wavelength_sigma_nm.map_or(0.0, |s| s / wavelength_nm);
    let periods: Vec<f64> = found.gratings.iter().flatten().map(|g| g.period_um).collect();
    let by_geometry = median(periods).and_then(|um| of_geometry(&optics, &bench.geometry.sigma, um));
    let [scale_sigma, turn_sigma] =
        by_geometry.map_or([by_wavelength, 0.0], |[scale, turn]| [by_wavelength.hypot(scale), turn]);
    let pixel_um = frames.set.geometry.and_then(|g| g.pixel_um);
    let (palette, scale_bar) = (settings.palette, !settings.no_scale_bar);
    let output =
        Output { found: &found, width, height, wavelength_nm, pixel_um, palette, scale_bar, scale_sigma, turn_sigma };
    output.write(folder)?;
    let resolved =
        || (0..width * height).filter(|i| found.verdicts[*i] == Verdict::Resolved).filter_map(|i| found.gratings[i]);
    let offset = [0, 1].map(|axis| median(resolved().map(|g| g.mirror_offset[axis].to_degrees()).collect::<Vec<_>>()));
    let mut report = Report {
        method: "spots",
        warnings: vec![],
        assumptions: bench.assumptions.clone(),
        palette: settings.palette,
        width,
        height,
        fringes: shown.len(),
        patterns: frames.set.frames.iter().filter(|f| f.fringes.is_some()).count(),
        wavelength_nm,
        periods_um: settings.periods_um,
        shortest_um: reachable(&optics),
        pixels: counts(&found),
        orientation_sigma_deg: median(resolved().map(|g| g.orientation_sigma.to_degrees()).collect::<Vec<_>>()),
        period_sigma: median(resolved().map(|g| g.period_sigma_um / g.period_um).collect::<Vec<_>>()),
        period_scale_sigma: scale_sigma,
        orientation_common_sigma_deg: turn_sigma.to_degrees(),
        mirror_offset_deg: offset[0].zip(offset[1]).map(|(x, y)| [x, y]),
        residual: median(resolved().map(|g| g.residual).collect::<Vec<_>>()),
        worst: worst(&found, width),
        aperture_mm: optics.aperture_mm,
        response: signals.response,
        discs,
        polarization,
        seconds: Seconds::default(),
    };
    if by_geometry.is_none() {
        let words = "the geometry is exact: nothing says how uncertain the places of camera, sample and panel are; 1 mm of 250 is 0.4 % of all periods";
        report.assumptions.push(words.into());
    }
    report.assumptions.push(
        "first orders are there: in a grating whose depth puts them out, the second ones would be taken for them, at half the period".into(),
    );
    report.warnings = frames.warnings.clone();
    report.warnings.extend(warnings(&report, settings, alias(&shown, &signals)));
    let total = begun.elapsed().as_secs_f64();
    report.seconds =
        Seconds { read, calibrate: calibrated - read, solve: solved - calibrated, write: total - solved, total };
    progress.step();
    Ok(report)
}

/// Shortest period whose first order reaches the panel from the sample's centre, for grating vectors at 0, 15, … 165
/// degrees.
pub fn reachable(optics: &Optics) -> Vec<Option<f64>> {
    const LONGEST_UM: f64 = 20.0;
    let place = optics.place([0.0; 3]);
    let reaches = |angle: f64, period: f64| {
        let q = optics.wavelength_um / period;
        [1.0, -1.0].into_iter().any(|sign| {
            let sines = [place.mirror[0] + sign * q * angle.cos(), place.mirror[1] + sign * q * angle.sin()];
            // The whole aperture must be covered.
            let margin = 0.5 * optics.aperture_mm;
            optics.land(place.point, sines).is_some_and(|l| optics.is_on(l.at, margin))
        })
    };
    (0..12)
        .map(|step| {
            let angle = f64::from(15 * step).to_radians();
            if !reaches(angle, LONGEST_UM) {
                return None;
            }
            // The position of an order on the panel is monotonic in the period, so bisection finds the shortest period
            // within reach.
            let (mut out, mut within) = (0.1, LONGEST_UM);
            while within - out > 1e-3 {
                let tried = 0.5 * (out + within);
                if reaches(angle, tried) { within = tried } else { out = tried }
            }
            Some(within)
        })
        .collect()
}

/// Requirements on responses, including the panel's nonlinearity.
pub(super) fn demands(settings: &Settings, shown: &[Carrier], signals: &Signals) -> Demands {
    let usual = settings.demands();
    Demands { model_error: usual.model_error.hypot(0.3 * alias(shown, signals)), ..usual }
}

/// Ratio to the fundamental of the harmonics that alias with it, given the number of phases; they appear as light at a
/// wrong position.
fn alias(shown: &[Carrier], signals: &Signals) -> f64 {
    let phases = shown.iter().map(|c| c.frames.len()).min().unwrap_or(3) as u32;
    (signals.response.harmonic(phases - 1) / signals.response.harmonic(1)).abs()
}

/// Resolved pixels with the largest residuals.
fn worst(found: &Found, width: usize) -> Vec<PixelResidual> {
    let resolved = found.verdicts.iter().zip(&found.gratings).enumerate();
    let residuals =
        resolved.filter(|(_, (verdict, _))| **verdict == Verdict::Resolved).filter_map(|(i, (_, grating))| {
            let residual = grating.as_ref()?.residual;
            Some(PixelResidual { x: i % width, y: i / width, residual })
        });
    let mut all: Vec<PixelResidual> = residuals.collect();
    all.sort_by(|a, b| b.residual.total_cmp(&a.residual));
    all.truncate(WORST);
    all
}

fn counts(found: &Found) -> Counts {
    let mut counts = Counts::default();
    for verdict in &found.verdicts {
        *match verdict {
            Verdict::Resolved => &mut counts.resolved,
            Verdict::Unusable => &mut counts.unusable,
            Verdict::Dark => &mut counts.dark,
            Verdict::NoOrder => &mut counts.no_order,
            Verdict::Unexplained => &mut counts.unexplained,
            Verdict::Ambiguous => &mut counts.ambiguous,
        } += 1;
    }
    counts
}

fn warnings(report: &Report, settings: &Settings, alias: f64) -> Vec<String> {
    let mut all = Vec::new();
    if report.pixels.resolved == 0 {
        all.push("no pixel was resolved: check the geometry, the wavelength and the panel's size".into());
    }
    if report.pixels.unusable * 100 > report.width * report.height {
        let part = 100.0 * report.pixels.unusable as f64 / (report.width * report.height) as f64;
        all.push(format!("{part:.1} % of the pixels are saturated; expose shorter"));
    }
    if let Some([x, y]) = report.mirror_offset_deg
        && x.hypot(y) > settings.mirror_deg
    {
        all.push(format!(
            "mirrored light comes from {x:.2}°, {y:.2}° beside where the geometry puts it: calibrate the geometry, or level the sample"
        ));
    }
    if !report.response.measured {
        all.push(
            "no frames of even light tell how the panel answers; it is taken to be as linear as it was asked to be"
                .into(),
        );
    } else if alias > 0.02 {
        let (power, part) = (report.response.power, 100.0 * alias);
        all.push(format!(
            "the panel's exponent is {power:.2} of what it was taken for, and {part:.1} % of a harmonic is not removed: correct spots.fringes.gamma"
        ));
    }
    all
}
