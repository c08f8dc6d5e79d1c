//! Errors of maps against the printed pattern.

use super::TilesPhotograph;
use nacre_base::Result;
use nacre_image::read_exr;
use nacre_periods::flash::Report;
use std::f64::consts::PI;
use std::path::Path;

/// Distance from an edge in pixels within which errors are counted separately.
const EDGE_PX: f64 = 2.0;

/// Number of standard deviations beyond which a result counts as confidently wrong.
const CONFIDENTLY: f64 = 5.0;

/// Errors of maps against the printed pattern.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    /// Mean orientation error in degrees more than two pixels from an edge; NaN without such pixels.
    pub inside_deg: f64,
    /// 99th percentile of these errors.
    pub inside_99_deg: f64,
    /// Mean orientation error in degrees within two pixels of an edge.
    pub edge_deg: f64,
    /// Mean relative error of the period.
    pub bias: f64,
    /// Standard deviation of the relative error of the period.
    pub spread: f64,
    /// Fraction of pixels with grooves that are masked.
    pub masked: f64,
    /// Same fraction more than two pixels from an edge.
    pub masked_inside: f64,
    /// Fraction of all pixels with grooves whose orientation or period is off by more than five times its σ.
    pub wrong: f64,
    /// Same fraction for three times σ.
    pub beyond_three: f64,
    /// Root mean square of the orientation's reported σ in degrees, more than two pixels from an edge.
    pub said_deg: f64,
    /// Root mean square of the period's relative σ.
    pub said_period: f64,
    /// Root mean square orientation error in degrees, more than two pixels from an edge.
    pub rms_deg: f64,
    /// Number of pixels with grooves.
    pub pixels: usize,
}

impl TilesPhotograph {
    /// Compares the maps in a folder with the printed pattern.
    ///
    /// # Errors
    /// `Input` when they cannot be read.
    pub fn score(&self, folder: &Path, report: &Report) -> Result<Score> {
        let path = |name: &str| folder.join(name);
        let mut orientation = read_exr(&path("orientation.exr"))?;
        let mut period = read_exr(&path("period.exr"))?;
        let angle = orientation.take("orientation", &path("orientation.exr"))?;
        let angle_sigma = orientation.take("sigma", &path("orientation.exr"))?;
        let periods = period.take("period", &path("period.exr"))?;
        let period_sigma = period.take("sigma", &path("period.exr"))?;
        let (grooves, sheet, pitch) = (self.grooves(), self.sheet_mm(), report.pixel_um / 1000.0);
        let from_corner = [report.reference_mm[0] + 0.5 * sheet[0], 0.5 * sheet[1] - report.reference_mm[1]];
        // The tile at the centre of the map.
        let size = [report.width, report.height].map(|n| n as f64 * pitch);
        let tile = [0, 1].map(|k| ((from_corner[k] + 0.5 * size[k]) / self.tile_mm[k]).floor().max(0.0) as usize);
        let off = self.offset_mm(tile);
        let begin = [0, 1].map(|k| from_corner[k] - tile[k] as f64 * self.tile_mm[k] - off[k]);
        let mut sums = Sums::default();
        for i in 0..angle.len() {
            let at = [i % report.width, i / report.width];
            let place = [0, 1].map(|k| begin[k] + (at[k] as f64 + 0.5) * pitch);
            let Some(truth) = grooves(place) else { continue };
            let inside = truth.edge_mm > EDGE_PX * pitch;
            sums.seen[usize::from(inside)] += 1.0;
            if !angle[i].is_finite() {
                continue;
            }
            let turn = (f64::from(angle[i]) - truth.orientation).rem_euclid(PI);
            let error = turn.min(PI - turn);
            let off = f64::from(periods[i]) / truth.period_um - 1.0;
            let said = [f64::from(angle_sigma[i]), f64::from(period_sigma[i]) / truth.period_um];
            sums.add(inside, error.to_degrees(), off, [error / said[0], off.abs() / said[1]], said);
        }
        Ok(sums.score())
    }
}

/// Sums over pixels; index 0 is near edges, 1 elsewhere.
#[derive(Default)]
struct Sums {
    seen: [f64; 2],
    errors: [Vec<f64>; 2],
    periods: Vec<f64>,
    said: Vec<[f64; 2]>,
    wrong: f64,
    beyond_three: f64,
}

impl Sums {
    fn add(&mut self, inside: bool, error_deg: f64, off: f64, sigmas: [f64; 2], said: [f64; 2]) {
        self.errors[usize::from(inside)].push(error_deg);
        self.periods.push(off);
        if inside {
            self.said.push(said);
        }
        let worst = sigmas[0].max(sigmas[1]);
        self.wrong += f64::from(u8::from(worst > CONFIDENTLY));
        self.beyond_three += f64::from(u8::from(worst > 3.0));
    }

    fn score(mut self) -> Score {
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let all = self.seen[0] + self.seen[1];
        let bias = mean(&self.periods);
        let squares: Vec<f64> = self.periods.iter().map(|p| (p - bias).powi(2)).collect();
        let rms = |k: usize| mean(&self.said.iter().map(|s| s[k] * s[k]).collect::<Vec<_>>()).sqrt();
        self.errors[1].sort_by(f64::total_cmp);
        let inside = &self.errors[1];
        Score {
            inside_deg: mean(inside),
            inside_99_deg: inside.get(inside.len() * 99 / 100).copied().unwrap_or(f64::NAN),
            edge_deg: mean(&self.errors[0]),
            bias,
            spread: mean(&squares).sqrt(),
            masked: 1.0 - self.periods.len() as f64 / all,
            masked_inside: 1.0 - inside.len() as f64 / self.seen[1],
            wrong: self.wrong / all,
            beyond_three: self.beyond_three / all,
            said_deg: rms(0).to_degrees(),
            said_period: rms(1),
            rms_deg: mean(&inside.iter().map(|e| e * e).collect::<Vec<_>>()).sqrt(),
            pixels: all as usize,
        }
    }
}
