//! Inspection of a reconstruction: preview maps while frames still arrive, and all measured values of one pixel.

use crate::fit::bracket::{noise_of_bracket, read};
use crate::fit::merge::Merge;
use crate::fit::views::{Photograph, View, brackets, views};
use crate::orient;
use crate::{Demosaic, Design, Running};
use nacre_base::text::{from_json, read_text};
use nacre_base::{Error, Result};
use nacre_frames::{Kind, Linearizer, LoadedFrames};
use nacre_image::registration::Resampler;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Maximum size of a report in bytes: a few numbers and a name for each photograph.
const MAX_REPORT: u64 = 1 << 24;

/// Remedy if a report does not belong to the photographs.
const REMEDY: &str = "reconstruct again";

/// Preview maps on a coarser grid.
pub struct Preview {
    /// Number of photographs used.
    pub frames: usize,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Orientation in rad, NaN where masked.
    pub orientation: Vec<f32>,
    /// Its standard deviation in rad.
    pub sigma: Vec<f32>,
    /// Degree of linear polarization.
    pub dolp: Vec<f32>,
}

impl Running {
    /// Preview maps from every n-th pixel, with at most `width` columns; the reconstruction is unaffected. `None` while
    /// the angles do not determine an orientation.
    pub fn preview(&self, width: usize) -> Option<Preview> {
        let step = self.accumulator.width().div_ceil(width.max(1)).max(1);
        let views = &self.views[..self.accumulator.views()];
        let design = Design::new(&views.iter().map(|v| v.angle).collect::<Vec<_>>()).ok()?;
        let mut maps = self.accumulator.thinned(step).solve(&design);
        let (noise, _) = self.noise(&mut maps, &design);
        let map = orient(&mut maps, &design, &noise, 0.0);
        let dolp = (0..maps.s0.len()).map(|i| maps.s1[i].hypot(maps.s2[i]) / maps.s0[i]).collect();
        let (width, height) = (map.width, map.height);
        Some(Preview { frames: self.added(), width, height, orientation: map.orientation, sigma: map.sigma, dolp })
    }
}

/// Corrections applied by a reconstruction to its photographs, one entry for each analyser position; empty if none were
/// applied.
#[derive(Clone, Debug, Default)]
pub struct AppliedCorrections {
    /// Analyser-angle error of each position in degrees.
    angle_errors_deg: Vec<f64>,
    /// Shift of each photograph in pixels, which was corrected.
    shifts_px: Vec<[f64; 2]>,
    /// Interpolation of the images behind a sensor's polarizers.
    demosaic: Demosaic,
}

impl AppliedCorrections {
    /// Reads the corrections from `report.json` in a folder of results.
    ///
    /// # Errors
    /// `Input` if the file is missing, damaged or larger than 16 MiB.
    pub fn read(results: &Path) -> Result<Self> {
        #[derive(Deserialize)]
        struct ReportFields {
            analyser_errors_deg: Option<Vec<f64>>,
            registration: Option<Registration>,
            sensor: Option<Sensor>,
        }
        #[derive(Deserialize)]
        struct Sensor {
            demosaic: Demosaic,
        }
        #[derive(Deserialize)]
        struct Registration {
            corrected: bool,
            shifts_px: Vec<[f64; 2]>,
        }
        let path = results.join("report.json");
        let text = read_text(&path, MAX_REPORT, REMEDY)?;
        let report: ReportFields = from_json(&text).map_err(|problem| Error::file(&path, problem, REMEDY))?;
        Ok(Self {
            angle_errors_deg: report.analyser_errors_deg.unwrap_or_default(),
            demosaic: report.sensor.map(|s| s.demosaic).unwrap_or_default(),
            shifts_px: report.registration.filter(|m| m.corrected).map(|m| m.shifts_px).unwrap_or_default(),
        })
    }

    /// Whether the corrections match the number of analyser positions and the size of the photographs.
    fn fits(&self, views: usize, [width, height]: [usize; 2]) -> bool {
        let counts = [self.angle_errors_deg.len(), self.shifts_px.len()].iter().all(|n| [0, views].contains(n));
        counts && self.shifts_px.iter().all(|[x, y]| x.abs() < width as f64 && y.abs() < height as f64)
    }
}

/// One pixel of a set of photographs: measured values, and the fitted sinusoid.
#[derive(Clone, Debug, Serialize)]
pub struct Probe {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
    /// Light at each analyser angle, in the order of the photographs; from several exposures the unsaturated ones.
    pub points: Vec<Point>,
    /// S0; the fitted intensity is (S0 + S1 cos 2ψ + S2 sin 2ψ) / 2.
    pub s0: f64,
    /// S1.
    pub s1: f64,
    /// S2.
    pub s2: f64,
    /// Root mean square residual of the fit.
    pub residual_rms: f64,
    /// Whether every exposure at some angle is saturated, so that the pixel is masked in the maps.
    pub saturated: bool,
}

/// A measured value.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// Analyser angle in degrees, corrected as in the reconstruction.
    pub analyser_deg: f64,
    /// Light, with the shift corrected as in the reconstruction.
    pub value: f64,
    /// Photograph file.
    pub file: String,
}

/// Reads one pixel of the maps from all photographs, with the corrections of the reconstruction.
///
/// # Errors
/// `Input` if this is no polarization set, if the pixel lies outside, or if the corrections belong to other
/// photographs.
pub fn probe(frames: &LoadedFrames, [x, y]: [usize; 2], applied: &AppliedCorrections) -> Result<Probe> {
    let brackets = brackets(&frames.set.frames);
    let mut views = views(frames, &brackets, applied.demosaic)?;
    let step = views.first().map_or(1, |v| v.step);
    let size = [frames.info.width / step, frames.info.height / step];
    if x >= size[0] || y >= size[1] {
        let problem = format!("pixel {x}, {y} lies outside of {} × {}", size[0], size[1]);
        return Err(Error::file(&frames.path, problem, "choose one inside"));
    }
    if !applied.fits(views.len(), size) {
        let problem = format!("holds {} analyser positions, other ones than its results are of", views.len());
        return Err(Error::file(&frames.path, problem, REMEDY));
    }
    views.iter_mut().zip(&applied.angle_errors_deg).for_each(|(view, error)| view.angle += error.to_radians());
    let linearizer = Linearizer::new(frames)?;
    let weighted = brackets.iter().any(|b| b.len() > 1);
    // Value and weight per view.
    let (mut points, mut merged, mut saturated) = (vec![], vec![], false);
    for (i, bracket) in brackets.iter().enumerate() {
        let photographs = read(frames, &linearizer, bracket, applied.demosaic)?;
        let noise = noise_of_bracket(frames, &linearizer, bracket);
        for (v, view) in views.iter().enumerate().filter(|(_, view)| view.bracket == i) {
            let back = applied.shifts_px.get(v).map(|shift| Resampler::new(*shift, size[0], size[1]));
            let values: Vec<(f32, u8)> =
                photographs.iter().map(|p| value(p, view, back.as_ref(), [x, y], size[0])).collect();
            for (k, (value, _)) in bracket.iter().zip(&values).filter(|(_, (_, bad))| *bad == 0 || !weighted) {
                let file = frames.set.frames[*k].file.to_string_lossy().into_owned();
                points.push(Point { analyser_deg: view.angle.to_degrees(), value: f64::from(*value), file });
            }
            let (mut light, mut variance, mut bad) = ([values[0].0], [1.0], [values[0].1]);
            if weighted {
                bad = [0];
                let merge = Merge::new(noise.clone()).scaled(back.map_or(1.0, |b| b.noise_factor()));
                merge.row(|k, light, bad| (light[0], bad[0]) = values[k], &mut light, &mut variance, &mut bad);
            }
            saturated |= bad[0] != 0;
            merged.push((f64::from(light[0]), 1.0 / f64::from(variance[0])));
        }
    }
    let design = Design::new(&views.iter().map(|v| v.angle).collect::<Vec<_>>())?;
    let rows = || design.rows.iter().zip(&merged);
    let normal: nalgebra::Matrix3<f64> = rows().map(|(x, (_, w))| x * x.transpose() * *w).sum();
    let moments: nalgebra::Vector3<f64> = rows().map(|(x, (value, w))| x * (value * w)).sum();
    let beta = normal.try_inverse().unwrap_or(design.inverse) * moments;
    let squares: f64 = rows().map(|(x, (value, _))| (value - x.dot(&beta)).powi(2)).sum();
    let residual_rms = (squares / merged.len().max(1) as f64).sqrt();
    Ok(Probe { x, y, points, s0: 2.0 * beta[0], s1: 2.0 * beta[1], s2: 2.0 * beta[2], residual_rms, saturated })
}

/// Light of a photograph at a pixel of its view (rows of `width` pixels), with the shift corrected, and whether it is
/// unusable.
fn value(
    photograph: &Photograph,
    view: &View,
    back: Option<&Resampler>,
    [x, y]: [usize; 2],
    width: usize,
) -> (f32, u8) {
    let (mut light, mut bad) = (vec![0.0; width], vec![0; width]);
    match back {
        Some(back) => back.row(y, |y, light, bad| photograph.row(view, y, light, bad), &mut light, &mut bad),
        None => photograph.row(view, y, &mut light, &mut bad),
    }
    (light[x], bad[x])
}

/// Whether a set can be probed and reconstructed.
pub fn is_polarimetric(kind: Kind) -> bool {
    matches!(kind, Kind::Polarization | Kind::DivisionOfFocalPlane)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Fit;

    /// The thinned fit has the values of the kept pixels.
    #[test]
    fn a_thinned_fit_keeps_every_nth_pixel() {
        let (width, height) = (7, 5);
        let mut fit = Fit::new(width, height);
        let angles = [0.0_f64, 1.0, 2.0, 2.5];
        let value = |i: usize, psi: f64| 3.0 + ((i as f64).sin() * (2.0 * psi).cos() + 0.3 * (2.0 * psi).sin()) as f32;
        for psi in angles {
            fit.add(psi, |y, row, _| {
                row.iter_mut().enumerate().for_each(|(x, v)| *v = value(y * width + x, psi));
            });
        }
        let design = Design::new(&angles).unwrap();
        let (thin, whole) = (fit.thinned(3).solve(&design), fit.solve(&design));
        assert_eq!((thin.width, thin.height), (3, 2));
        for (x, y) in [(0, 0), (1, 1), (2, 1)] {
            assert_eq!(thin.s1[y * 3 + x], whole.s1[3 * y * width + 3 * x]);
        }
    }
}
