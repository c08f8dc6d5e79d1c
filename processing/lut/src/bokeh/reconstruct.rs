//! Reconstruction of a bokeh photograph: height map, slice, slits and report in a new folder.

use super::deconvolution::{Deconvolved, Image, Iterations, Method, deconvolve};
use super::height::Calibration;
use super::lens::Cutoff;
use super::options::{KnownScale, Options};
use super::outcome::Outcome;
use super::output;
use super::period::{Lines, lines};
use super::photograph::{Photograph, photograph};
use super::report::{NoiseReport, Report, Scale, Seconds};
use super::rotation::Map;
use super::slice::{Line, slice};
use super::slits::slits;
use nacre_base::estimate::Work;
use nacre_base::operation::perform;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::hdr::Source;
use nacre_image::OutputFolder;
use nacre_image::budget;
use std::path::Path;
use std::time::Instant;

/// Predicts the work of [`reconstruct`] and rejects invalid input by the header of the photograph.
///
/// # Errors
/// As [`reconstruct`].
pub(super) fn check_input(input: &Path, options: &Options) -> Result<Work> {
    options.check()?;
    let part = options.crop.map(|crop| crop.0[2].saturating_mul(crop.0[3]));
    Source::check(input, budget::Operation::Bokeh { part, iterations: options.iterations.usual() })
}

/// Deconvolves the photograph at `input` (a series of exposures is merged first) and writes the results into the new
/// folder `out`.
///
/// Rotation follows deconvolution, because interpolation would correlate the noise of neighbouring pixels. Memory: nine
/// floats per pixel.
///
/// # Errors
/// `Input` for an invalid photograph or option, before anything is written, and for a measured period below the lens's
/// resolution limit. `Output` if writing fails; the partial folder is then removed. `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, options: &Options, progress: &dyn Progress) -> Result<Report> {
    perform(options, input, out, false, progress)
}

/// Deconvolves the photograph and writes the results into a folder.
pub(super) fn sharpen_into(
    folder: &OutputFolder,
    input: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Report> {
    let begun = Instant::now();
    let cutoff = options.check()?;
    let (psf, psf_name) = options.psf()?;
    progress.stage("reading", 1);
    let source = Source::find(input, progress)?;
    if source.merged.is_some() && options.noise.is_some() {
        let remedy = "leave it out: it is estimated from the photograph";
        return Err(Error::input("--noise", "is that of one photograph, not of merged exposures", remedy));
    }
    let transfer = options.transfer_of(&source.path);
    let photograph = photograph(&source.path, options.channel, transfer, options.crop)?;
    let read_s = begun.elapsed().as_secs_f64();
    let noise = options.noise(&photograph);
    if noise.is_none() && matches!(options.iterations, Iterations::Auto(_)) {
        let problem = "is too small, or too little of it is known, to tell its noise";
        return Err(Error::file(input, problem, "give --noise, or a number of --iterations"));
    }
    let image = Image { width: photograph.width, height: photograph.height, light: &photograph.light };
    let method = Method { accelerate: options.accelerate, ..Method::default() };
    let sharp = deconvolve(&image, &psf, noise.map(|n| n.0), &method, options.iterations, progress)?;
    let deconvolve_s = begun.elapsed().as_secs_f64() - read_s;
    progress.stage("measuring", 1);
    let outcome = measured(&photograph, sharp, cutoff, options)?;
    let noise = noise.map(|(noise, given)| NoiseReport::new(noise, given));
    let mut report = outcome.report(input, options, psf_name, noise);
    report.warnings.splice(0..0, source.warnings(transfer));
    report.merged = source.merged;
    output::write(folder, &outcome, !options.no_scale_bar)?;
    progress.check()?;
    report.seconds = Seconds { read: read_s, deconvolve: deconvolve_s, total: begun.elapsed().as_secs_f64() };
    progress.step();
    Ok(report)
}

/// Measures the deconvolved photograph.
fn measured(photograph: &Photograph, sharp: Deconvolved, cutoff: Option<Cutoff>, options: &Options) -> Result<Outcome> {
    let unknown = photograph.light.iter().filter(|v| !v.is_finite()).count();
    let n = sharp.light.len();
    let mean = sharp.light.iter().map(|v| f64::from(*v)).sum::<f64>() / n as f64;
    let map = Map { width: photograph.width, height: photograph.height, values: sharp.light.clone() };
    let mut map = map.turned(options.rotate_deg);
    // Cubic interpolation can undershoot below zero.
    map.values.iter_mut().for_each(|v| *v = if v.is_nan() { *v } else { v.max(0.0) });
    let slice = match options.slice {
        Some(line) => Some(slice(&map, line, options.slice_width)?),
        // A default slice may not fit into a small image, which is no error.
        None => slice(&map, Line::middle(&map), options.slice_width).ok(),
    };
    let values = slice.as_ref().map(|s| s.bridged());
    let lines = values.as_ref().and_then(|v| lines(v));
    // Slits are fitted to the blurred photograph: deconvolution would narrow bright slits.
    let soft = Map { width: photograph.width, height: photograph.height, values: photograph.light.clone() }
        .turned(options.rotate_deg);
    let soft = slice.as_ref().and_then(|s| super::slice::slice(&soft, s.line, options.slice_width).ok());
    let slits = soft.zip(lines).and_then(|(soft, lines)| slits(&soft.bridged(), &lines));
    // The slice may be oblique to the lines; this factor corrects its distances.
    let across = slice.as_ref().map_or(1.0, |s| s.tilt_deg.to_radians().cos());
    let scale = scale(options, lines, slice.as_ref().map(|s| s.light.len()), across)?;
    if let (Some(cutoff), Some(um), Some(lines)) = (cutoff, scale.pixel_um, lines) {
        cutoff.check(um * across * lines.period_px[0], "period along the slice")?;
    }
    let calibration = match (options.known, &values, lines) {
        (Some(known), Some(values), Some(lines)) => {
            let relative: Vec<f64> = values.iter().map(|v| v / mean).collect();
            Some(Calibration::of_known(&relative, &lines, known)?)
        }
        (Some(_), ..) => {
            let remedy = "give a --slice across its lines";
            return Err(Error::input("known grating", "does not show: no lines are found along the slice", remedy));
        }
        (None, ..) => options.calibration.clone(),
    };
    Ok(Outcome { map, sharp, mean, unknown, slice, lines, slits, across, scale, cutoff, calibration })
}

/// Pixel size on the sample, if known.
fn scale(options: &Options, lines: Option<Lines>, samples: Option<usize>, across: f64) -> Result<Scale> {
    let (per_mm, count) = match options.scale {
        KnownScale::Unknown => return Ok(Scale { pixel_um: None, sigma_um: None, source: "unknown" }),
        KnownScale::Pixel(um) => return Ok(Scale { pixel_um: Some(um), sigma_um: None, source: "given" }),
        KnownScale::Lines { per_mm, count } => (per_mm, count),
    };
    let counted = lines.map(|l| l.period_px);
    let by_count = count.zip(samples).map(|(n, samples)| [samples as f64 / n, 0.0]);
    let Some([period, sigma]) = by_count.or(counted) else {
        let problem = "no lines are found along the slice that could be counted";
        return Err(Error::input("--lines-per-mm", problem, "give a --slice across the lines, --lines, or --pixel-um"));
    };
    let pixel = 1000.0 / per_mm / (period * across);
    let sigma_um = by_count.is_none().then_some(pixel * sigma / period);
    Ok(Scale { pixel_um: Some(pixel), sigma_um, source: "counted lines" })
}
