//! Report of the flash reconstruction.

use super::settings::{Directions, Orientation, PeriodChoice};
use nacre_base::operation::{Summary, lines};
use nacre_image::Palette;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Report of a reconstruction.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "FlashReport")]
pub struct Report {
    /// Always `flash`.
    pub method: &'static str,
    /// Limitations of the results.
    pub warnings: Vec<String>,
    /// Unverified assumptions.
    pub assumptions: Vec<String>,
    /// Colour map of angles in pictures.
    pub palette: Palette,
    /// Width of the maps in pixels.
    pub width: usize,
    /// Height of the maps in pixels.
    pub height: usize,
    /// Pixel size on the sheet in µm.
    pub pixel_um: f64,
    /// Number of tiles.
    pub tiles: usize,
    /// Top left corner of the reference tile, in mm to the right of and above the sheet's centre.
    pub reference_mm: [f64; 2],
    /// Registration of the tiles.
    pub registration: Option<Registration>,
    /// Positions of the flash in mm.
    pub lights_mm: Vec<[f64; 3]>,
    /// Half vector at each highlight, zero for a correct geometry; `None` if the highlight is outside of the picture.
    pub highlights: Vec<Option<[f64; 2]>>,
    /// Standard deviation of the light in mm.
    pub light_sigma_mm: f64,
    /// Standard deviation of a lobe over half vectors.
    pub lobe: f64,
    /// Typical distance between half vectors of a position's copies, with both signs folded.
    pub spacing: f64,
    /// Wavelength in nm.
    pub wavelength_nm: f64,
    /// Searched range of periods in µm.
    pub searched_um: [f64; 2],
    /// True if periods are known only up to a common factor.
    pub relative: bool,
    /// Method of orientation measurement.
    pub orientation: Orientation,
    /// Shared directions of polygons.
    pub directions: DirectionsReport,
    /// Common or individual periods.
    pub period: PeriodReport,
    /// Median σ of orientation in degrees; `None` if all pixels are masked.
    pub sigma_deg: Option<f64>,
    /// Median relative σ of the period.
    pub period_sigma: Option<f64>,
    /// Relative σ common to all periods, from wavelength and geometry.
    pub common_sigma: f64,
    /// Fractions of masked pixels, by reason.
    pub masked: Masked,
    /// Computation times.
    pub seconds: Seconds,
}

/// Registration of the tiles.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Registration {
    /// Largest displacement of a tile in map pixels.
    pub most_px: f64,
    /// Typical σ of a tile's position in pixels.
    pub sigma_px: f64,
    /// Number of rejected tiles, which resemble no other.
    pub left_out: usize,
}

/// Shared directions of polygons.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
pub struct DirectionsReport {
    /// `shared` or `free`.
    pub choice: Directions,
    /// Reason for the choice.
    pub why: String,
    /// Shared directions in degrees, anticlockwise from the right.
    pub degrees: Vec<f64>,
    /// Shared periods in µm.
    pub um: Vec<f64>,
    /// Number of areas whose individual gratings were fitted.
    pub areas: usize,
    /// Fraction of these areas that confirm the shared grating, 0 to 1.
    pub agree: f64,
    /// Scatter of areas about the shared directions in degrees.
    pub scatter_deg: f64,
    /// Fraction of lit positions with a shared grating, 0 to 1.
    pub explained: f64,
}

/// Common or individual periods.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "FlashPeriodReport")]
pub struct PeriodReport {
    /// `sample` or `pixel`.
    pub choice: PeriodChoice,
    /// Reason for the choice.
    pub why: String,
    /// Common period in µm, if all pixels share one.
    pub um: Option<f64>,
    /// Standard deviation of `um`.
    pub sigma_um: Option<f64>,
    /// Median period in µm.
    pub median_um: Option<f64>,
    /// 5 % and 95 % quantiles of the period in µm.
    pub range_um: Option<[f64; 2]>,
    /// Bayesian information criterion of one common period (lower is better).
    pub bic_one: f64,
    /// Bayesian information criterion of one period for each of 6 × 6 parts of the tile.
    pub bic_parts: f64,
    /// Bayesian information criterion of one period per pixel.
    pub bic_pixels: f64,
    /// Number of pixels in the decision.
    pub pixels: usize,
    /// Largest deviation of a part's period from the common one, in standard deviations.
    pub largest_part_sigmas: f64,
}

/// Fractions of pixels, 0 to 1.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
pub struct Masked {
    /// All masked pixels.
    pub all: f64,
    /// In no photograph.
    pub unseen: f64,
    /// Without diffracted light.
    pub dark: f64,
    /// Several gratings fit, or the order is ambiguous.
    pub ambiguous: f64,
    /// Several gratings in one pixel.
    pub several: f64,
    /// Too few copies near a lobe.
    pub uncertain: f64,
    /// No grating fits.
    pub unexplained: f64,
}

/// Computation times in seconds.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "FlashSeconds")]
pub struct Seconds {
    /// Decoding, registration and copying of tiles.
    pub read: f64,
    /// Fit of gratings.
    pub fit: f64,
    /// Writing.
    pub write: f64,
    /// Total.
    pub total: f64,
}

impl Summary for Report {
    fn summary(&self) -> String {
        let mut text = format!("map       {} × {} pixels of {:.0} µm\n", self.width, self.height, self.pixel_um);
        let registered = self.registration.map_or("on a grid".into(), |r| {
            format!("moved by up to {:.2} pixels, known to {:.3}, {} left out", r.most_px, r.sigma_px, r.left_out)
        });
        let _ = writeln!(text, "tiles     {}, {registered}", self.tiles);
        let _ = writeln!(
            text,
            "lights    {}, σ {:.2} mm: lobes of σ {:.3} on half vectors {:.3} apart",
            self.lights_mm.len(),
            self.light_sigma_mm,
            self.lobe,
            self.spacing
        );
        let relative = if self.relative { " (relative)" } else { "" };
        let period = &self.period;
        let um = match (period.um, period.sigma_um, period.range_um) {
            (Some(um), Some(sigma), _) => format!("{um:.4} ± {sigma:.4} µm{relative}"),
            (_, _, Some([low, high])) => format!("{low:.3} to {high:.3} µm{relative}"),
            _ => "unknown".into(),
        };
        let _ = writeln!(text, "period    {um}: {}", period.why);
        let shared = &self.directions;
        let _ = match shared.degrees.len() {
            0 => writeln!(text, "directions free: {}", shared.why),
            n => writeln!(text, "directions {n} shared: {}", shared.why),
        };
        let percent = |v: Option<f64>| v.map_or("unknown".into(), |v| format!("{:.2} %", 100.0 * v));
        let degrees = self.sigma_deg.map_or("unknown".into(), |v| format!("{v:.3}°"));
        let _ = writeln!(
            text,
            "quality   σ of a typical orientation {degrees}, of a period {}",
            percent(self.period_sigma)
        );
        let m = &self.masked;
        let share = |v: f64| 100.0 * v;
        let _ = writeln!(
            text,
            "masked    {:.1} %: dark {:.1}, several gratings {:.1}, ambiguous {:.1}, uncertain {:.1}, unexplained {:.1}, unseen {:.1}",
            share(m.all),
            share(m.dark),
            share(m.several),
            share(m.ambiguous),
            share(m.uncertain),
            share(m.unexplained),
            share(m.unseen)
        );
        text += &lines(&self.assumptions, &self.warnings);
        let s = &self.seconds;
        let _ = write!(
            text,
            "time      {:.2} s: reading {:.2}, fitting {:.2}, writing {:.2}",
            s.total, s.read, s.fit, s.write
        );
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
