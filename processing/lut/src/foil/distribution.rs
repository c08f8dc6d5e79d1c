//! Joint histogram of orientation and period.

use nacre_base::{Error, Result};
use nacre_image::{Attribute, read_exr, write_exr, write_whole_with};
use std::f64::consts::PI;
use std::path::Path;

/// Maximum number of bins along either axis.
pub const MAX_BINS: usize = 2048;

/// Fraction of the dots per bin of orientation and period. Bins are equally wide in orientation and in line density
/// (1/period).
#[derive(Clone, Debug, PartialEq)]
pub struct Distribution {
    /// Number of orientation bins over [0, π).
    pub orientations: usize,
    /// Number of line-density bins.
    pub periods: usize,
    /// Minimum and maximum line density per µm.
    pub lines_per_um: [f64; 2],
    /// Area fraction of the dots in each bin, by line density, then orientation; sums to 1.
    pub share: Vec<f64>,
    /// Standard deviation of `share`; NaN where unknown.
    pub sigma: Vec<f64>,
    /// 1 if the photograph covers the bin on at least one side of the zero order, otherwise 0. Unknown shares are set
    /// to 0.
    pub coverage: Vec<f64>,
    /// True if lengths are known only up to a common factor.
    pub relative: bool,
}

impl Distribution {
    /// Line density per µm at the lower edge of a bin.
    pub fn edge(&self, bin: usize) -> f64 {
        let [low, high] = self.lines_per_um;
        low + (high - low) * bin as f64 / self.periods as f64
    }

    /// Bin of an orientation in rad and a period in µm; `None` outside of the histogram.
    pub fn bin(&self, theta: f64, period_um: f64) -> Option<usize> {
        let [low, high] = self.lines_per_um;
        let row = (1.0 / period_um - low) / (high - low) * self.periods as f64;
        let column = (theta.rem_euclid(PI) / PI * self.orientations as f64) as usize;
        let inside = (0.0..self.periods as f64).contains(&row);
        inside.then(|| row as usize * self.orientations + column.min(self.orientations - 1))
    }

    /// Marginal distribution of orientation.
    pub fn of_orientations(&self) -> Vec<f64> {
        (0..self.orientations).map(|c| self.share.iter().skip(c).step_by(self.orientations).sum()).collect()
    }

    /// Marginal distribution of period, longest first.
    pub fn of_periods(&self) -> Vec<f64> {
        self.share.chunks(self.orientations).map(|row| row.iter().sum()).collect()
    }

    /// Mean and standard deviation of the period in µm, from bin centres.
    pub fn period_um(&self) -> [f64; 2] {
        let middle = |k: usize| 2.0 / (self.edge(k) + self.edge(k + 1));
        let rows = self.of_periods();
        let mean: f64 = rows.iter().enumerate().map(|(k, s)| s * middle(k)).sum();
        let square: f64 = rows.iter().enumerate().map(|(k, s)| s * (middle(k) - mean).powi(2)).sum();
        [mean, square.sqrt()]
    }

    /// Writes the histogram as EXR: a row per line-density bin, a column per orientation bin.
    ///
    /// # Errors
    /// `Output` if writing fails.
    pub fn write(&self, path: &Path) -> Result<()> {
        let about = "columns: orientation from 0 to pi; rows: lines per um from first to last";
        let mut attributes = vec![
            ("units", Attribute::Text("share of all dots, by area".into())),
            ("bins", Attribute::Text(about.into())),
            ("first_lines_per_um", Attribute::Number(self.lines_per_um[0])),
            ("last_lines_per_um", Attribute::Number(self.lines_per_um[1])),
        ];
        if self.relative {
            attributes.push(("periods", Attribute::Text("relative".into())));
        }
        let planes = [&self.share, &self.sigma, &self.coverage];
        write_whole_with(path, |file| {
            write_exr(
                file,
                self.orientations,
                self.periods,
                &["share", "sigma", "coverage"],
                &attributes,
                &|c, y, row| {
                    row.iter_mut().zip(&planes[c][y * self.orientations..]).for_each(|(to, from)| *to = *from as f32);
                },
            )
        })
    }

    /// Reads a histogram.
    ///
    /// # Errors
    /// `Input` for any other file.
    pub fn read(path: &Path) -> Result<Self> {
        let remedy = "give a histogram.exr of `nacre reconstruct foil`";
        let mut exr = read_exr(path)?;
        let number = |name: &str| {
            let text = exr.attributes.get(name).and_then(|t| t.parse::<f64>().ok());
            text.ok_or_else(|| Error::file(path, format!("has no attribute {name}"), remedy))
        };
        let lines_per_um = [number("first_lines_per_um")?, number("last_lines_per_um")?];
        let relative = exr.attributes.get("periods").is_some_and(|t| t == "relative");
        let [low, high] = lines_per_um;
        if !(low > 0.0 && low < high && high <= 100.0) {
            return Err(Error::file(path, format!("has {low} to {high} lines per µm"), remedy));
        }
        if exr.width.max(exr.height) > MAX_BINS {
            return Err(Error::file(path, format!("has {} × {} bins", exr.width, exr.height), remedy));
        }
        let (orientations, periods) = (exr.width, exr.height);
        let mut plane = |name: &str| exr.take(name, path).map(|p| p.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
        let (mut share, sigma, coverage) = (plane("share")?, plane("sigma")?, plane("coverage")?);
        let sum: f64 = share.iter().sum();
        if !(share.iter().all(|s| *s >= 0.0) && sum > 0.0 && sum.is_finite()) {
            return Err(Error::file(path, "has shares that are none", remedy));
        }
        share.iter_mut().for_each(|s| *s /= sum);
        Ok(Self { orientations, periods, lines_per_um, share, sigma, coverage, relative })
    }
}
