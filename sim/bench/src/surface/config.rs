//! Configuration of samples.

use super::planted::PlantedDefect;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A synthetic sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SampleConfig {
    /// Kind of sample.
    pub kind: SampleKind,
    /// Side of the tile, or diameter, in mm. Default: that of the real sample.
    pub size_mm: Option<f64>,
    /// Peak-to-peak depth of the grating in µm.
    pub depth_um: f64,
    /// Period in µm. Default: 1.6 for a CD, 1.2 for a mosaic, otherwise 1. It scales all periods of a sample.
    pub period_um: Option<f64>,
    /// Smooth variation of the reflectance over the sample: 0.4 means ±40 %.
    pub reflectance_variation: f64,
    /// Pitch of the printed grating dots in µm. Default: orientations vary continuously.
    pub dot_um: Option<f64>,
    /// Fraction of dots (50 µm without `dot_um`) without grating.
    pub dead_dots: f64,
    /// Fraction of dots with a random orientation, so that pixels are mixed. At most 1 together with `dead_dots`.
    pub mixed_dots: f64,
    /// Root mean square slope of smooth surface bumps per direction, in degrees.
    pub bumps_deg: f64,
    /// Number of scratches.
    pub scratches: u32,
    /// Seed of the sample; by default that of the bench, on which its noise depends too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Turn of the sheet about its middle in degrees, anticlockwise.
    #[serde(skip_serializing_if = "is_zero")]
    pub turn_deg: f64,
    /// Shift of the turned sheet in mm, right and up.
    #[serde(skip_serializing_if = "are_zero")]
    pub shift_mm: [f64; 2],
    /// Defects of known place, class and size.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub planted: Vec<PlantedDefect>,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn are_zero(values: &[f64; 2]) -> bool {
    *values == [0.0; 2]
}

/// Kinds of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SampleKind {
    /// Kinematic tile: ten sectors in which the orientation rotates by 180°, smaller ones at the corners.
    #[default]
    Kinematic,
    /// Gradient stars of several sizes.
    Stars,
    /// Paper of polygons with few orientations.
    Polygons,
    /// Overlapping circles.
    Circles,
    /// Bursts of strokes, circles and small stars.
    Fireworks,
    /// Round logo of polygons, 15 mm, on non-diffracting paper.
    Logo,
    /// Currency emblem: bands of orientations, and fine rings of longer periods.
    Emblem,
    /// Compact disc, tracks tangential, with hub and hole.
    Cd,
    /// Foil of random squares whose periods depend on their orientations, so that a flash makes a spiral.
    Stochastic,
    /// Independent polygons with random orientations, and periods from the sample's to 2.5 times that.
    Mosaic,
    /// Reference for calibration: a grating of one orientation, with its vector along `turn_deg`.
    Ruled,
    /// Reference for calibration: a front-surface aluminium mirror.
    Mirror,
    /// Reference for calibration: a round linear polarizer in a black mount, on a front-surface mirror, with its axis
    /// along `turn_deg`.
    Polarizer,
    /// Reference for calibration: white paper, which scatters and depolarises.
    Paper,
}

impl SampleKind {
    /// All samples with patterns.
    pub const ALL: [Self; 10] = [
        Self::Kinematic,
        Self::Stars,
        Self::Polygons,
        Self::Circles,
        Self::Fireworks,
        Self::Logo,
        Self::Emblem,
        Self::Cd,
        Self::Stochastic,
        Self::Mosaic,
    ];

    /// All references for calibration, whose reflectance is uniform.
    pub const REFERENCES: [Self; 4] = [Self::Ruled, Self::Mirror, Self::Polarizer, Self::Paper];

    /// Name in files and options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Kinematic => "kinematic",
            Self::Stars => "stars",
            Self::Polygons => "polygons",
            Self::Circles => "circles",
            Self::Fireworks => "fireworks",
            Self::Logo => "logo",
            Self::Emblem => "emblem",
            Self::Cd => "cd",
            Self::Stochastic => "stochastic",
            Self::Mosaic => "mosaic",
            Self::Ruled => "ruled",
            Self::Mirror => "mirror",
            Self::Polarizer => "polarizer",
            Self::Paper => "paper",
        }
    }
}

impl Default for SampleConfig {
    fn default() -> Self {
        Self {
            kind: SampleKind::default(),
            size_mm: None,
            depth_um: 0.1,
            period_um: None,
            reflectance_variation: 0.4,
            dot_um: None,
            dead_dots: 0.0,
            mixed_dots: 0.0,
            bumps_deg: 0.0,
            scratches: 0,
            seed: None,
            turn_deg: 0.0,
            shift_mm: [0.0; 2],
            planted: vec![],
        }
    }
}

impl SampleConfig {
    /// Side of the tile, or diameter, in mm.
    pub fn size_mm(&self) -> f64 {
        self.size_mm.unwrap_or(match self.kind {
            SampleKind::Kinematic => 25.0,
            SampleKind::Logo => 15.0,
            SampleKind::Emblem | SampleKind::Mosaic => 20.0,
            SampleKind::Cd => 100.0,
            _ => 40.0,
        })
    }

    /// Side of the camera's square field in mm, with a margin around samples that have a surround.
    pub fn field_mm(&self) -> f64 {
        let margin = match self.kind {
            SampleKind::Logo | SampleKind::Emblem | SampleKind::Cd => 1.08,
            _ => 1.0,
        };
        margin * self.size_mm()
    }

    /// Coordinates on the sheet of a point of the bench, in mm.
    pub fn on_sheet(&self, x: f64, y: f64) -> [f64; 2] {
        let (dx, dy) = (x - self.shift_mm[0], y - self.shift_mm[1]);
        if self.turn_deg == 0.0 {
            return [dx, dy];
        }
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        [dx * cos + dy * sin, dy * cos - dx * sin]
    }

    /// Shortest and longest period of the sample in µm.
    pub fn periods_um(&self) -> [f64; 2] {
        let relative = match self.kind {
            SampleKind::Emblem => [1.0, 2.0],
            SampleKind::Stochastic => [0.78, 1.64],
            SampleKind::Mosaic => [1.0, 2.5],
            _ => [1.0, 1.0],
        };
        relative.map(|p| p * self.period_um())
    }

    /// Period in µm.
    pub fn period_um(&self) -> f64 {
        self.period_um.unwrap_or(match self.kind {
            SampleKind::Cd => 1.6,
            SampleKind::Mosaic => 1.2,
            _ => 1.0,
        })
    }

    /// Pitch of dots and defects in mm.
    pub(super) fn cell_mm(&self) -> f64 {
        self.dot_um.unwrap_or(if self.kind == SampleKind::Stochastic { 60.0 } else { 50.0 }) / 1000.0
    }

    /// Checks all values.
    ///
    /// # Errors
    /// A sentence with the key, its value and the allowed range.
    pub fn validate(&self) -> Result<(), String> {
        for (key, value, low, high) in [
            ("size_mm", self.size_mm(), 0.1, 1000.0),
            ("depth_um", self.depth_um, 1e-4, 10.0),
            ("period_um", self.period_um(), 0.2, 50.0),
            ("reflectance_variation", self.reflectance_variation, 0.0, 0.95),
            ("dot_um", self.dot_um.unwrap_or(50.0), 1.0, 1e4),
            ("dead_dots", self.dead_dots, 0.0, 1.0),
            ("mixed_dots", self.mixed_dots, 0.0, 1.0),
            ("bumps_deg", self.bumps_deg, 0.0, 20.0),
            ("scratches", self.scratches.into(), 0.0, 1000.0),
            ("turn_deg", self.turn_deg, -360.0, 360.0),
            ("shift_mm", self.shift_mm[0], -1000.0, 1000.0),
            ("shift_mm", self.shift_mm[1], -1000.0, 1000.0),
        ] {
            if !(low..=high).contains(&value) {
                return Err(format!("sample.{key} is {value}; give a number from {low} to {high}"));
            }
        }
        let (dead, mixed) = (self.dead_dots, self.mixed_dots);
        if dead + mixed > 1.0 {
            return Err(format!(
                "sample.mixed_dots is {mixed} beside dead_dots {dead}; give shares that sum to 1 at most"
            ));
        }
        self.planted.iter().try_for_each(PlantedDefect::validate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_samples_are_refused_by_key() {
        let refused = |change: fn(&mut SampleConfig)| {
            let mut config = SampleConfig::default();
            change(&mut config);
            config.validate().unwrap_err()
        };
        assert!(refused(|c| c.size_mm = Some(f64::NAN)).contains("sample.size_mm"));
        assert!(refused(|c| c.depth_um = -0.1).contains("sample.depth_um"));
        assert!(refused(|c| c.dead_dots = 1.5).contains("sample.dead_dots"));
        assert!(refused(|c| c.period_um = Some(f64::INFINITY)).contains("sample.period_um"));
        assert!(refused(|c| c.size_mm = Some(1e4)).contains("from 0.1 to 1000"));
        assert!(refused(|c| (c.dead_dots, c.mixed_dots) = (0.6, 0.6)).contains("sample.mixed_dots"));
        assert!(SampleConfig::default().validate().is_ok());
    }
}
