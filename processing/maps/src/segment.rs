//! Segmentation of the diffracting part of a sample by brightness in a photograph under a flash (2017 TOG paper,
//! section 6.1, Fig. 20).

use nacre_base::{Error, Result};
use nacre_image::{Gray, Raster, Samples, read};
use serde::Serialize;
use std::path::Path;

/// Number of histogram bins of brightness.
const LEVELS: usize = 512;

/// Fraction of the variance between both groups above which brightness counts as bimodal. A split at the middle
/// explains three quarters of a uniform distribution's variance, and two thirds of a normal distribution's.
const APART: f64 = 0.8;

/// A photograph segmented into the bright, diffracting part and the rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Segmented {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// True for pixels above the threshold, top row first.
    pub inside: Vec<bool>,
    /// Report of the segmentation.
    pub report: SegmentReport,
}

/// Report of a segmentation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SegmentReport {
    /// Brightness threshold: fraction of the largest code, or the value of an EXR.
    pub threshold: f64,
    /// True if the threshold was chosen automatically.
    pub automatic: bool,
    /// Fraction of the photograph above the threshold.
    pub share: f64,
    /// Fraction of the variance of brightness between both groups, 0 to 1.
    pub separation: f64,
    /// Limitations of the result.
    pub warnings: Vec<String>,
}

/// Segments a photograph (mean of its channels) at a given threshold, or at the one that maximises the variance between
/// both groups (Otsu 1979). Integer codes count as fractions of the largest. Values of an EXR are represented by their
/// square roots, which resemble codes.
///
/// # Errors
/// `Input` for a file that is no photograph, for uniform brightness, and for a threshold outside of the range of
/// brightness.
pub fn segment(photograph: &Path, threshold: Option<f64>) -> Result<Segmented> {
    let raster = read(photograph)?;
    let float = matches!(raster.samples, Samples::F32(_));
    let gray = brightness(&raster);
    let code = |v: f64| if float { v.max(0.0).sqrt() } else { v };
    let codes: Vec<f64> = gray.values.iter().map(|v| code(f64::from(*v))).collect();
    let fail = |problem: String, remedy: &str| Err(Error::file(photograph, problem, remedy));
    let Some(found) = otsu(&codes) else {
        return fail("has one brightness everywhere".into(), "give a photograph under a flash");
    };
    let at = threshold.map_or(found, code);
    let inside: Vec<bool> = codes.iter().map(|v| *v > at).collect();
    let share = inside.iter().filter(|i| **i).count() as f64 / inside.len() as f64;
    let value = if float { at * at } else { at };
    if share == 0.0 || share == 1.0 {
        let all = if share == 0.0 { "no pixel is" } else { "all pixels are" };
        return fail(
            format!("has no two parts: {all} brighter than {value:.3}"),
            "give another threshold, or leave it out",
        );
    }
    let separation = separation(&codes, at);
    let mut warnings = vec![];
    if separation < APART {
        warnings.push(format!(
            "brightness has no two clear groups ({:.0} % of its variance is between them): look at the mask, and give a threshold if it is wrong",
            100.0 * separation
        ));
    }
    let report = SegmentReport { threshold: value, automatic: threshold.is_none(), share, separation, warnings };
    Ok(Segmented { width: gray.width, height: gray.height, inside, report })
}

/// Mean of the channels; integer codes as fractions of the largest.
fn brightness(raster: &Raster) -> Gray {
    let mut gray = Gray::of(raster);
    if !matches!(raster.samples, Samples::F32(_)) {
        let full = raster.info().depth.full_scale();
        gray.values.iter_mut().for_each(|v| *v /= full);
    }
    gray
}

/// Otsu's threshold, which maximises the variance between both groups; `None` for uniform values.
fn otsu(values: &[f64]) -> Option<f64> {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if high <= low {
        return None;
    }
    let step = (high - low) / LEVELS as f64;
    let mut levels = vec![(0.0, 0.0); LEVELS];
    for v in values {
        let level = &mut levels[(((v - low) / step) as usize).min(LEVELS - 1)];
        *level = (level.0 + 1.0, level.1 + v);
    }
    let (count, sum) = levels.iter().fold((0.0, 0.0), |(c, s), l| (c + l.0, s + l.1));
    let (mut below, mut best) = ((0.0, 0.0), (0.0, low));
    for (k, level) in levels[..LEVELS - 1].iter().enumerate() {
        below = (below.0 + level.0, below.1 + level.1);
        let above = (count - below.0, sum - below.1);
        if below.0 > 0.0 && above.0 > 0.0 {
            let between = below.0 * above.0 * (above.1 / above.0 - below.1 / below.0).powi(2);
            // Centre of the empty bins between both groups.
            if between > best.0 * (1.0 + 1e-12) {
                let next = levels[k + 1..].iter().position(|l| l.0 > 0.0).unwrap_or(0) as f64;
                best = (between, low + (k as f64 + 1.0 + 0.5 * next) * step);
            }
        }
    }
    Some(best.1)
}

/// Fraction of the variance between the groups below and above a threshold.
fn separation(values: &[f64], threshold: f64) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let whole: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let between: f64 = [false, true]
        .iter()
        .map(|side| {
            let (count, sum) = values
                .iter()
                .filter(|v| (**v > threshold) == *side)
                .fold((0.0, 0.0), |(count, sum), v| (count + 1.0, sum + v));
            if count > 0.0 { count * (sum / count - mean).powi(2) } else { 0.0 }
        })
        .sum();
    between / whole.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_image::{write_exr, write_png16_gray};

    /// Bright stripes that cover a third of the width, on a dark ground, with noise.
    fn stripes(x: usize, y: usize) -> f64 {
        let noise = ((x * 7919 + y * 104_729) % 1000) as f64 / 1000.0 - 0.5;
        if x % 30 < 10 { 0.7 + 0.2 * noise } else { 0.1 + 0.1 * noise }
    }

    #[test]
    fn stripes_are_found_in_codes_and_in_light() {
        let folder = tempfile::tempdir().unwrap();
        let (png, exr) = (folder.path().join("flash.png"), folder.path().join("flash.exr"));
        let codes: Vec<u16> = (0..90 * 40).map(|i| (65_535.0 * stripes(i % 90, i / 90)) as u16).collect();
        write_png16_gray(&png, 90, 40, &codes).unwrap();
        write_exr(&exr, 90, 40, &["Y"], &[], &|_, y, row| {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = stripes(x, y).powi(2) as f32);
        })
        .unwrap();
        for path in [&png, &exr] {
            let found = segment(path, None).unwrap();
            assert!((0..90 * 40).all(|i| found.inside[i] == (i % 90 % 30 < 10)), "{:?}", found.report);
            assert!(found.report.separation > 0.9 && found.report.warnings.is_empty() && found.report.automatic);
            assert!((found.report.share - 1.0 / 3.0).abs() < 1e-9);
        }
        // A given threshold is used; one without pixels above it is rejected.
        let few = segment(&png, Some(0.75)).unwrap();
        assert!(few.report.share < 0.2 && !few.report.automatic && (few.report.threshold - 0.75).abs() < 1e-9);
        assert!(segment(&png, Some(2.0)).unwrap_err().to_string().contains("no pixel"));
    }

    #[test]
    fn one_group_is_reported_and_one_brightness_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ramp.png");
        let codes: Vec<u16> = (0..64 * 64).map(|i| (i * 15) as u16).collect();
        write_png16_gray(&path, 64, 64, &codes).unwrap();
        assert!(segment(&path, None).unwrap().report.warnings[0].contains("no two clear groups"));
        write_png16_gray(&path, 64, 64, &[7; 64 * 64]).unwrap();
        assert!(segment(&path, None).unwrap_err().to_string().contains("one brightness"));
    }
}
