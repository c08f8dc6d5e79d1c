//! What is said of the maps.

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
    /// What the reader must know before trusting the results.
    pub warnings: Vec<String>,
    /// What was taken for granted.
    pub assumptions: Vec<String>,
    /// Colours of angles in pictures.
    pub palette: Palette,
    /// Pixels of the maps.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Size of a pixel on the sheet, in µm.
    pub pixel_um: f64,
    /// Tiles whose copies were used.
    pub tiles: usize,
    /// Left top corner of the tile that the maps show, in mm right and up of the sheet's middle.
    pub reference_mm: [f64; 2],
    /// How tiles were laid over each other.
    pub registration: Option<Registration>,
    /// Places of the flash that were used, in mm.
    pub lights_mm: Vec<[f64; 3]>,
    /// Half vector at each highlight, which is zero where the geometry is right; none where it is not in the picture.
    pub highlights: Vec<Option<[f64; 2]>>,
    /// Standard deviation of the light in mm.
    pub light_sigma_mm: f64,
    /// Standard deviation of a lobe over half vectors, and how far apart a place's copies typically lie, both signs folded.
    pub lobe: f64,
    /// As said.
    pub spacing: f64,
    /// Wavelength in nm.
    pub wavelength_nm: f64,
    /// Range in µm that periods were looked for in.
    pub searched_um: [f64; 2],
    /// Whether periods are known up to a common factor only.
    pub relative: bool,
    /// How orientations were told.
    pub orientation: Orientation,
    /// Whether polygons share few directions.
    pub directions: DirectionsReport,
    /// One period or many.
    pub period: PeriodReport,
    /// Median σ of an orientation in degrees; none when all is masked.
    pub sigma_deg: Option<f64>,
    /// Median σ of a period over itself.
    pub period_sigma: Option<f64>,
    /// Part of σ that all periods share: wavelength and geometry.
    pub common_sigma: f64,
    /// Shares of pixels that are masked, by why.
    pub masked: Masked,
    /// Where the time went.
    pub seconds: Seconds,
}

/// How tiles were laid over each other.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Registration {
    /// Largest move of a tile, in pixels of the map.
    pub most_px: f64,
    /// Typical σ of a tile's place, in pixels.
    pub sigma_px: f64,
    /// Tiles left out, since they look like no other.
    pub left_out: usize,
}

/// Whether polygons share few directions.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
pub struct DirectionsReport {
    /// `shared` or `free`.
    pub choice: Directions,
    /// Why.
    pub why: String,
    /// The shared ones in degrees, anticlockwise from the right.
    pub degrees: Vec<f64>,
    /// Their periods in µm.
    pub um: Vec<f64>,
    /// Areas of one grating that were asked for their own.
    pub areas: usize,
    /// Share of them whose own is the shared one, 0 to 1.
    pub agree: f64,
    /// How far areas scatter about the shared directions, in degrees.
    pub scatter_deg: f64,
    /// Share of the places with light that have one of the shared gratings, 0 to 1.
    pub explained: f64,
}

/// One period or many.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "FlashPeriodReport")]
pub struct PeriodReport {
    /// `sample` or `pixel`.
    pub choice: PeriodChoice,
    /// Why.
    pub why: String,
    /// The period in µm, where all share one.
    pub um: Option<f64>,
    /// Its σ.
    pub sigma_um: Option<f64>,
    /// Median period, and those that a twentieth lie below and above of, in µm.
    pub median_um: Option<f64>,
    /// As said.
    pub range_um: Option<[f64; 2]>,
    /// Bayesian information criterion of one period for all (less is better).
    pub bic_one: f64,
    /// Of one for each of 6 × 6 parts of the tile.
    pub bic_parts: f64,
    /// Of one per pixel.
    pub bic_pixels: f64,
    /// Pixels that had a say.
    pub pixels: usize,
    /// How far the part that differs most lies from all, in its σ.
    pub largest_part_sigmas: f64,
}

/// Shares of pixels, 0 to 1.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
pub struct Masked {
    /// All.
    pub all: f64,
    /// Not in any photograph.
    pub unseen: f64,
    /// No order's light.
    pub dark: f64,
    /// Several gratings explain them, or the order is not known.
    pub ambiguous: f64,
    /// More than one grating.
    pub several: f64,
    /// Too few copies near a lobe.
    pub uncertain: f64,
    /// No grating explains them.
    pub unexplained: f64,
}

/// Seconds.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "FlashSeconds")]
pub struct Seconds {
    /// Photographs decoded, tiles registered and copied.
    pub read: f64,
    /// Gratings fitted.
    pub fit: f64,
    /// Maps and pictures written.
    pub write: f64,
    /// All.
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
