//! Planted defects: regions of known place, class and size, by which an inspection is judged.

use super::{Point, Surface, fold};
use crate::random::{key, uniform};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Reflectance of dirt and of the ground of a scratch, which scatter.
const DARK: f32 = 0.15;

/// Number of draws after which no free place is left on the sheet.
const MOST_DRAWS: u64 = 10_000;

/// Class of a planted defect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DefectClass {
    /// Metal without a grating.
    Missing,
    /// A grating turned by `turn_deg`.
    WrongOrientation,
    /// A grating whose period is `period_factor` times the intended one.
    WrongPeriod,
    /// A narrow line that scatters.
    Scratch,
    /// A disc that scatters.
    Dirt,
}

impl DefectClass {
    /// All classes.
    pub const ALL: [Self; 5] = [Self::Missing, Self::WrongOrientation, Self::WrongPeriod, Self::Scratch, Self::Dirt];
}

/// A planted defect: a disc, or a line with round ends where `length_mm` exceeds the width.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlantedDefect {
    /// Class.
    pub class: DefectClass,
    /// Centre on the sheet in mm, from its middle, right and up.
    pub at_mm: [f64; 2],
    /// Diameter of the disc, or width of the line, in mm.
    pub width_mm: f64,
    /// Length of the line in mm, round ends excluded; 0 for a disc.
    #[serde(default)]
    pub length_mm: f64,
    /// Direction of the line in degrees, anticlockwise from the right.
    #[serde(default)]
    pub direction_deg: f64,
    /// Turn of the grating vector in degrees, of `wrong_orientation`.
    #[serde(default)]
    pub turn_deg: f64,
    /// Period over the intended one, of `wrong_period`.
    #[serde(default = "one")]
    pub period_factor: f64,
}

fn one() -> f64 {
    1.0
}

impl PlantedDefect {
    /// A disc of a class.
    pub fn disc(class: DefectClass, at_mm: [f64; 2], width_mm: f64) -> Self {
        Self { class, at_mm, width_mm, length_mm: 0.0, direction_deg: 0.0, turn_deg: 0.0, period_factor: 1.0 }
    }

    /// Distance in mm of a point of the sheet from the edge of the defect, negative inside.
    pub fn distance_mm(&self, x: f64, y: f64) -> f64 {
        let (sin, cos) = self.direction_deg.to_radians().sin_cos();
        let (dx, dy) = (x - self.at_mm[0], y - self.at_mm[1]);
        let half = 0.5 * self.length_mm;
        let along = dx * cos + dy * sin;
        let across = dy * cos - dx * sin;
        (along - along.clamp(-half, half)).hypot(across) - 0.5 * self.width_mm
    }

    /// Area in mm².
    pub fn area_mm2(&self) -> f64 {
        0.25 * PI * self.width_mm.powi(2) + self.length_mm * self.width_mm
    }

    /// The surface with this defect.
    pub(super) fn applied(&self, point: Point) -> Point {
        let surface = match (self.class, point.surface) {
            (DefectClass::Missing, Surface::Grating { .. }) => Surface::Mirror,
            (DefectClass::WrongOrientation, Surface::Grating { orientation, period_um, depth_um }) => {
                let orientation = fold(f64::from(orientation) + self.turn_deg.to_radians());
                Surface::Grating { orientation, period_um, depth_um }
            }
            (DefectClass::WrongPeriod, Surface::Grating { orientation, period_um, depth_um }) => {
                Surface::Grating { orientation, period_um: period_um * self.period_factor as f32, depth_um }
            }
            (DefectClass::Scratch | DefectClass::Dirt, _) => {
                return Point { surface: Surface::Diffuse, reflectance: DARK, ..point };
            }
            (_, other) => other,
        };
        Point { surface, ..point }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A sentence that names the key, the value and the allowed range.
    pub(super) fn validate(&self) -> Result<(), String> {
        for (key, value, low, high) in [
            ("at_mm", self.at_mm[0], -1000.0, 1000.0),
            ("at_mm", self.at_mm[1], -1000.0, 1000.0),
            ("width_mm", self.width_mm, 1e-4, 1000.0),
            ("length_mm", self.length_mm, 0.0, 1000.0),
            ("direction_deg", self.direction_deg, -360.0, 360.0),
            ("turn_deg", self.turn_deg, -360.0, 360.0),
            ("period_factor", self.period_factor, 0.1, 10.0),
        ] {
            if !(low..=high).contains(&value) {
                return Err(format!("sample.planted.{key} is {value}; give a number from {low} to {high}"));
            }
        }
        Ok(())
    }
}

/// Random defects of one area for a sheet.
#[derive(Clone, Debug)]
pub struct Planting {
    /// Classes, used in turn.
    pub classes: Vec<DefectClass>,
    /// Number of defects.
    pub count: usize,
    /// Area of each in mm².
    pub area_mm2: f64,
    /// Width of scratches in mm.
    pub scratch_mm: f64,
    /// Half the side of the square in which all lie, in mm.
    pub half_mm: f64,
    /// Smallest distance between the edges of two defects in mm.
    pub gap_mm: f64,
}

impl Planting {
    /// Draws the defects. `fits` decides whether a defect may lie there, from the candidate.
    ///
    /// Orientations are off by 10° to 80°, periods by a factor of 0.7 to 0.85 or 1.2 to 1.5. Fewer than `count` defects
    /// result where no free place is found.
    pub fn draw(&self, seed: u64, fits: &dyn Fn(&PlantedDefect) -> bool) -> Vec<PlantedDefect> {
        let mut found: Vec<PlantedDefect> = vec![];
        for draw in 0..MOST_DRAWS {
            if found.len() == self.count || self.classes.is_empty() {
                break;
            }
            let class = self.classes[found.len() % self.classes.len()];
            let candidate = self.candidate(class, key(&[seed, 0xdefe, draw]));
            if self.is_free(&candidate, &found) && fits(&candidate) {
                found.push(candidate);
            }
        }
        found
    }

    fn candidate(&self, class: DefectClass, bits: u64) -> PlantedDefect {
        let random = |k: u64| uniform(key(&[bits, k]));
        let at_mm = [0, 1].map(|k| self.half_mm * (2.0 * random(k) - 1.0));
        let mut defect = PlantedDefect::disc(class, at_mm, (4.0 * self.area_mm2 / PI).sqrt());
        if class == DefectClass::Scratch {
            defect.width_mm = self.scratch_mm;
            defect.length_mm = (self.area_mm2 - 0.25 * PI * self.scratch_mm.powi(2)).max(0.0) / self.scratch_mm;
            defect.direction_deg = 180.0 * random(2);
        }
        let sign = if random(3) < 0.5 { -1.0 } else { 1.0 };
        match class {
            DefectClass::WrongOrientation => defect.turn_deg = sign * (10.0 + 70.0 * random(4)),
            DefectClass::WrongPeriod if sign < 0.0 => defect.period_factor = 0.7 + 0.15 * random(4),
            DefectClass::WrongPeriod => defect.period_factor = 1.2 + 0.3 * random(4),
            _ => {}
        }
        defect
    }

    /// True if the defect lies within the square and apart from the others.
    fn is_free(&self, defect: &PlantedDefect, others: &[PlantedDefect]) -> bool {
        let ends = |d: &PlantedDefect| {
            let (sin, cos) = d.direction_deg.to_radians().sin_cos();
            let steps = (d.length_mm / self.gap_mm.max(1e-3)).ceil().clamp(1.0, 1000.0) as usize;
            let at = move |k: usize| d.length_mm * (k as f64 / steps as f64 - 0.5);
            (0..=steps).map(|k| [d.at_mm[0] + at(k) * cos, d.at_mm[1] + at(k) * sin]).collect::<Vec<_>>()
        };
        let points = ends(defect);
        let half = 0.5 * defect.width_mm;
        let inside = points.iter().all(|p| p.iter().all(|v| v.abs() + half <= self.half_mm));
        let apart = |other: &PlantedDefect| points.iter().all(|p| other.distance_mm(p[0], p[1]) - half >= self.gap_mm);
        inside && others.iter().all(apart)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{Sample, SampleConfig};

    fn planting() -> Planting {
        let classes = DefectClass::ALL.to_vec();
        Planting { classes, count: 20, area_mm2: 0.25, scratch_mm: 0.1, half_mm: 11.0, gap_mm: 0.5 }
    }

    #[test]
    fn defects_have_the_requested_area_and_keep_apart() {
        let drawn = planting().draw(7, &|_| true);
        assert_eq!(drawn.len(), 20);
        for (k, defect) in drawn.iter().enumerate() {
            assert!((defect.area_mm2() - 0.25).abs() < 1e-9, "{defect:?}");
            let others = drawn.iter().enumerate().filter(|(other, _)| *other != k);
            assert!(others.into_iter().all(|(_, o)| o.distance_mm(defect.at_mm[0], defect.at_mm[1]) > 0.5));
        }
        assert_eq!(drawn, planting().draw(7, &|_| true));
        assert_ne!(drawn, planting().draw(8, &|_| true));
    }

    #[test]
    fn each_class_changes_the_surface_as_it_says() {
        let clean = Sample::new(&SampleConfig::default(), 3);
        let surface = |class, turn_deg, period_factor| {
            let defect = PlantedDefect { turn_deg, period_factor, ..PlantedDefect::disc(class, [4.0, 3.0], 1.0) };
            let config = SampleConfig { planted: vec![defect], ..SampleConfig::default() };
            let sample = Sample::new(&config, 3);
            assert_eq!(sample.at(5.0, 3.0), clean.at(5.0, 3.0), "unchanged outside");
            sample.at(4.1, 3.1)
        };
        let Surface::Grating { orientation, period_um, .. } = clean.at(4.1, 3.1).surface else { panic!() };
        assert_eq!(surface(DefectClass::Missing, 0.0, 1.0).surface, Surface::Mirror);
        assert_eq!(surface(DefectClass::Dirt, 0.0, 1.0).reflectance, DARK);
        let Surface::Grating { orientation: turned, .. } = surface(DefectClass::WrongOrientation, 30.0, 1.0).surface
        else {
            panic!()
        };
        let turn = (f64::from(turned) - f64::from(orientation)).rem_euclid(PI);
        assert!((turn - PI / 6.0).abs() < 1e-5, "{turn}");
        let Surface::Grating { period_um: longer, .. } = surface(DefectClass::WrongPeriod, 0.0, 1.3).surface else {
            panic!()
        };
        assert!((longer / period_um - 1.3).abs() < 1e-5);
    }

    #[test]
    fn a_turned_and_shifted_sheet_is_the_same_sheet_elsewhere() {
        let at_rest = Sample::new(&SampleConfig::default(), 3);
        let config = SampleConfig { turn_deg: 3.0, shift_mm: [5.0, -1.0], ..SampleConfig::default() };
        let moved = Sample::new(&config, 3);
        let (sin, cos) = 3.0_f64.to_radians().sin_cos();
        let (x, y) = (4.0, 2.5);
        let there = moved.at(5.0 + x * cos - y * sin, -1.0 + x * sin + y * cos);
        let (Surface::Grating { orientation: a, .. }, Surface::Grating { orientation: b, .. }) =
            (at_rest.at(x, y).surface, there.surface)
        else {
            panic!()
        };
        let turn = (f64::from(b) - f64::from(a)).rem_euclid(PI);
        assert!((turn.to_degrees() - 3.0).abs() < 1e-3, "{turn}");
    }
}
