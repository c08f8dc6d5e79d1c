//! Looks at a reconstruction: the maps so far while frames still arrive, and one pixel with all that was measured.

use super::merge::Merge;
use super::running::{noise_of_bracket, read};
use super::views::{brackets, views};
use super::{Design, Running, orient};
use crate::frames::{Kind, Linearizer, LoadedFrames};
use crate::{Error, Result};
use serde::Serialize;

/// The maps so far, on a coarser grid.
pub struct Glance {
    /// Photographs in it.
    pub frames: usize,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Orientation in rad, NaN where masked.
    pub orientation: Vec<f32>,
    /// Its standard deviation in rad.
    pub sigma: Vec<f32>,
    /// Degree of linear polarization.
    pub dolp: Vec<f32>,
}

impl Running {
    /// The maps so far, every n-th pixel so that rows have at most `width`; the reconstruction goes on unchanged. None
    /// as long as the angles cannot tell an orientation.
    pub fn glance(&self, width: usize) -> Option<Glance> {
        let step = self.sums.width().div_ceil(width.max(1)).max(1);
        let views = &self.views[..self.sums.views()];
        let design = Design::new(&views.iter().map(|v| v.angle).collect::<Vec<_>>()).ok()?;
        let mut maps = self.sums.thinned(step).solve(&design);
        let (noise, _) = self.noise(&mut maps, &design);
        let map = orient(&mut maps, &design, &noise, 0.0);
        let dolp = (0..maps.s0.len()).map(|i| maps.s1[i].hypot(maps.s2[i]) / maps.s0[i]).collect();
        let (width, height) = (map.width, map.height);
        Some(Glance { frames: self.added(), width, height, orientation: map.orientation, sigma: map.sigma, dolp })
    }
}

/// One pixel of a set of photographs: what was measured, and the sinusoid through it.
#[derive(Clone, Debug, Serialize)]
pub struct Probe {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
    /// Light at each analyser angle, in the order of the photographs; of several exposures those that are not saturated.
    pub points: Vec<Point>,
    /// Fitted intensity is (S0 + S1 cos 2ψ + S2 sin 2ψ) / 2.
    pub s0: f64,
    /// S1.
    pub s1: f64,
    /// S2.
    pub s2: f64,
    /// Root mean square of what the fit leaves.
    pub residual_rms: f64,
    /// At some angle every value is saturated, so that the maps leave the pixel out.
    pub saturated: bool,
}

/// A measured value.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// Analyser angle in degrees.
    pub analyser_deg: f64,
    /// Light.
    pub value: f64,
    /// Photograph.
    pub file: String,
}

/// Reads one pixel of the maps from all photographs.
///
/// # Errors
/// `Input` when the set is no polarization set, or the pixel lies outside.
pub fn probe(frames: &LoadedFrames, x: usize, y: usize) -> Result<Probe> {
    let brackets = brackets(&frames.set.frames);
    let views = views(frames, &brackets)?;
    let block = views.first().map_or(1, |v| v.block);
    let (width, height) = (frames.info.width / block, frames.info.height / block);
    if x >= width || y >= height {
        let problem = format!("pixel {x}, {y} lies outside of {width} × {height}");
        return Err(Error::file(&frames.path, problem, "choose one inside"));
    }
    let linearizer = Linearizer::new(frames)?;
    let weighted = brackets.iter().any(|b| b.len() > 1);
    // Value and weight per view.
    let (mut points, mut merged, mut saturated) = (vec![], vec![], false);
    for (i, bracket) in brackets.iter().enumerate() {
        let photographs = read(frames, &linearizer, bracket)?;
        let merge = Merge::new(noise_of_bracket(frames, &linearizer, bracket));
        for view in views.iter().filter(|v| v.bracket == i) {
            let [left, top] = view.position;
            let values: Vec<(f32, u8)> = photographs
                .iter()
                .map(|photograph| {
                    let (mut light, mut bad) = (vec![0.0; width], vec![0; width]);
                    photograph.strided(y * block + top, left, block, &mut light, &mut bad);
                    (light[x], bad[x])
                })
                .collect();
            for (k, (value, _)) in bracket.iter().zip(&values).filter(|(_, (_, bad))| *bad == 0 || !weighted) {
                let file = frames.set.frames[*k].file.to_string_lossy().into_owned();
                points.push(Point { analyser_deg: view.angle.to_degrees(), value: f64::from(*value), file });
            }
            let (mut light, mut variance, mut bad) = ([values[0].0], [1.0], [values[0].1]);
            if weighted {
                bad = [0];
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

/// Whether a set can be probed and reconstructed.
pub fn is_polarimetric(kind: Kind) -> bool {
    matches!(kind, Kind::Polarization | Kind::DivisionOfFocalPlane)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polarimetry::Fit;

    /// The thinned fit has the values of the pixels that it keeps.
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
