//! Synthetic diffracting samples: the surface at every point, with defects.

mod config;
mod defects;
mod discs;
mod patterns;
mod planted;
mod polygons;
mod shapes;

pub use config::{SampleConfig, SampleKind};
pub use planted::{DefectClass, PlantedDefect, Planting};

use defects::Defects;

/// Surface at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Kind of surface.
    pub surface: Surface,
    /// Reflectance, 0 to 1, which multiplies all light.
    pub reflectance: f32,
    /// Tilt of the surface, dz/dx and dz/dy.
    pub slope: [f32; 2],
}

impl Point {
    /// Whether two points of a pixel may stand for those between them: the same kind of surface, within a few per cent
    /// of orientation, period, depth, reflectance and tilt.
    pub fn is_like(&self, other: &Self) -> bool {
        const NEAR: f32 = 0.05;
        let near = |a: f32, b: f32| (a - b).abs() <= NEAR * a.abs().max(b.abs());
        let surface = match (self.surface, other.surface) {
            (
                Surface::Grating { orientation: a, period_um: p, depth_um: d },
                Surface::Grating { orientation: b, period_um: q, depth_um: e },
            ) => (a - b).sin().abs() < NEAR && near(p, q) && near(d, e),
            (a, b) => a == b,
        };
        let tilt = self.slope.iter().zip(other.slope).all(|(a, b)| (a - b).abs() < NEAR * NEAR);
        surface && near(self.reflectance, other.reflectance) && tilt
    }
}

/// Kinds of surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surface {
    /// A one-dimensional grating.
    Grating {
        /// Direction of the grating vector in `[0, π)` rad, anticlockwise from x, y up.
        orientation: f32,
        /// Period in µm.
        period_um: f32,
        /// Peak-to-peak depth in µm.
        depth_um: f32,
    },
    /// Metal without a grating, under the film.
    Mirror,
    /// Metal without film, behind a linear polarizer if there is an axis (rad, anticlockwise from x).
    Bare {
        /// Transmission axis of the polarizer.
        polarizer: Option<f32>,
    },
    /// Paper or plastic: scatters and depolarises.
    Diffuse,
    /// No reflection.
    Nothing,
}

/// A pattern of gratings; the sample is centred at (0, 0), x right, y up, in mm.
trait Pattern: Send + Sync {
    /// Surface at a point: orientation in any range, period relative to the sample's.
    fn at(&self, x: f64, y: f64) -> Ideal;
}

/// Ideal surface of a pattern at a point.
#[derive(Clone, Copy)]
enum Ideal {
    /// Orientation (rad, any range) and period relative to the sample's.
    Grating(f64, f64),
    Mirror,
    /// Metal without film, with or without a polarizer whose axis is horizontal.
    Bare {
        polarized: bool,
    },
    Diffuse,
    Nothing,
}

/// A sample with its defects.
pub struct Sample {
    pattern: Box<dyn Pattern>,
    defects: Defects,
    config: SampleConfig,
}

impl Sample {
    /// Builds the sample; equal configurations and seeds give equal surfaces.
    pub fn new(config: &SampleConfig, seed: u64) -> Self {
        let half = 0.5 * config.size_mm();
        let pattern: Box<dyn Pattern> = match config.kind {
            SampleKind::Kinematic => Box::new(discs::Kinematic { half }),
            SampleKind::Stars => Box::new(shapes::Stars::new(half, seed)),
            SampleKind::Polygons => Box::new(polygons::Paper::new(half, seed)),
            SampleKind::Circles => Box::new(discs::Circles::new(half, seed)),
            SampleKind::Fireworks => Box::new(shapes::Fireworks::new(half, seed)),
            SampleKind::Logo => Box::new(polygons::Logo::new(half, seed)),
            SampleKind::Emblem => Box::new(patterns::Emblem { half }),
            SampleKind::Cd => Box::new(discs::Cd { half }),
            SampleKind::Mosaic => Box::new(polygons::Mosaic::new(half, seed)),
            SampleKind::Stochastic => Box::new(patterns::Stochastic { square: config.cell_mm(), seed }),
            SampleKind::Ruled => Box::new(patterns::Uniform(Ideal::Grating(0.0, 1.0))),
            SampleKind::Mirror => Box::new(patterns::Uniform(Ideal::Bare { polarized: false })),
            SampleKind::Polarizer => Box::new(patterns::Polarizer { half }),
            SampleKind::Paper => Box::new(patterns::Uniform(Ideal::Diffuse)),
        };
        Self { pattern, defects: Defects::new(config, seed), config: config.clone() }
    }

    /// Side of the camera's square field in mm.
    pub fn field_mm(&self) -> f64 {
        self.config.field_mm()
    }

    /// The surface at a point of the bench in mm; the sheet on it is rotated and shifted.
    pub fn at(&self, x: f64, y: f64) -> Point {
        let [u, v] = self.config.on_sheet(x, y);
        let mut point = self.on_sheet(u, v);
        if self.config.turn_deg != 0.0 {
            let turn = self.config.turn_deg.to_radians();
            if let Surface::Grating { orientation: axis, .. } | Surface::Bare { polarizer: Some(axis) } =
                &mut point.surface
            {
                *axis = fold(f64::from(*axis) + turn);
            }
            let ([a, b], (sin, cos)) = (point.slope, (turn as f32).sin_cos());
            point.slope = [a * cos - b * sin, a * sin + b * cos];
        }
        point
    }

    /// The surface at a point (mm) of the sheet.
    fn on_sheet(&self, x: f64, y: f64) -> Point {
        let cell = self.config.cell_mm();
        let (column, row) = ((x / cell).floor(), (y / cell).floor());
        // A printed dot has the orientation of the pattern at its centre.
        let (px, py) = match self.config.dot_um {
            Some(_) => ((column + 0.5) * cell, (row + 0.5) * cell),
            None => (x, y),
        };
        let surface = match self.pattern.at(px, py) {
            Ideal::Grating(orientation, period) => {
                self.defects.dot(column as i64, row as i64, |turn| Surface::Grating {
                    orientation: fold(orientation + turn),
                    period_um: (period * self.config.period_um()) as f32,
                    depth_um: self.config.depth_um as f32,
                })
            }
            Ideal::Mirror => Surface::Mirror,
            Ideal::Bare { polarized } => Surface::Bare { polarizer: polarized.then_some(0.0) },
            Ideal::Diffuse => Surface::Diffuse,
            Ideal::Nothing => Surface::Nothing,
        };
        let point = self.defects.apply(surface, x, y);
        let planted = self.config.planted.iter().filter(|defect| defect.distance_mm(x, y) <= 0.0);
        planted.fold(point, |point, defect| defect.applied(point))
    }
}

/// Folds an angle into `[0, π)` in f32, whose rounding may reach π.
fn fold(angle: f64) -> f32 {
    let folded = angle.rem_euclid(std::f64::consts::PI) as f32;
    if folded >= std::f32::consts::PI { 0.0 } else { folded }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn sample(kind: SampleKind) -> Sample {
        Sample::new(&SampleConfig { kind, ..SampleConfig::default() }, 3)
    }

    fn orientation(s: &Sample, x: f64, y: f64) -> f64 {
        match s.at(x, y).surface {
            Surface::Grating { orientation, .. } => orientation.into(),
            other => panic!("{other:?} at {x}, {y}"),
        }
    }

    proptest! {
        #[test]
        fn every_sample_is_sound_everywhere(x in -0.6..0.6f64, y in -0.6..0.6f64, kind in 0..10usize, seed in 0..50u64) {
            let config = SampleConfig { kind: SampleKind::ALL[kind], mixed_dots: 0.1, dead_dots: 0.1, bumps_deg: 0.2, scratches: 3, ..SampleConfig::default() };
            let (a, b) = (Sample::new(&config, seed), Sample::new(&config, seed));
            let (x, y) = (x * a.field_mm(), y * a.field_mm());
            let point = a.at(x, y);
            prop_assert_eq!(point, b.at(x, y));
            prop_assert!((0.0..=1.0).contains(&point.reflectance));
            if let Surface::Grating { orientation, period_um, depth_um } = point.surface {
                prop_assert!((0.0..std::f32::consts::PI).contains(&orientation));
                prop_assert!(period_um > 0.1 && depth_um > 0.0);
            }
        }
    }

    #[test]
    fn the_kinematic_tile_runs_ten_times_through_half_a_turn() {
        let s = sample(SampleKind::Kinematic);
        let mut turned = 0.0;
        let steps = 1000;
        let at = |k: i32| {
            let phi = 2.0 * PI * f64::from(k) / f64::from(steps);
            orientation(&s, 5.0 * phi.cos(), 5.0 * phi.sin())
        };
        for k in 0..steps {
            turned += (at(k + 1) - at(k) + PI / 2.0).rem_euclid(PI) - PI / 2.0;
        }
        assert!((turned / PI - 10.0).abs() < 1e-3, "{turned}");
    }

    #[test]
    fn a_cd_diffracts_radially() {
        let s = sample(SampleKind::Cd);
        for phi in [0.1_f64, 1.0, 2.5, 4.0] {
            let got = orientation(&s, 40.0 * phi.cos(), 40.0 * phi.sin());
            assert!(((got - phi + PI / 2.0).rem_euclid(PI) - PI / 2.0).abs() < 1e-5);
        }
        assert_eq!(s.at(0.0, 0.0).surface, Surface::Nothing);
        assert_eq!(s.at(15.0, 0.0).surface, Surface::Diffuse);
    }

    #[test]
    fn the_stochastic_foil_ties_period_to_orientation() {
        let s = sample(SampleKind::Stochastic);
        for k in 0..200 {
            let Surface::Grating { orientation, period_um, .. } = s.at(0.061 * f64::from(k), 1.0).surface else {
                panic!()
            };
            let wanted = 0.8 + 0.8 * f64::from(orientation) / PI;
            assert!((f64::from(period_um) / wanted - 1.0).abs() < 0.03, "{orientation} {period_um}");
        }
    }

    #[test]
    fn references_are_uniform() {
        for kind in SampleKind::REFERENCES {
            let s = sample(kind);
            let first = s.at(0.0, 0.0);
            assert!(first.reflectance > 0.5);
            assert!((0..400).all(|k| s.at(f64::from(k % 20) - 10.0, f64::from(k / 20) - 10.0) == first), "{kind:?}");
        }
    }

    #[test]
    fn another_seed_makes_another_sample_where_there_is_chance() {
        for kind in SampleKind::ALL {
            let config = SampleConfig { kind, ..SampleConfig::default() };
            let [a, b] = [3, 4].map(|seed| Sample::new(&config, seed));
            let at = |s: &Sample, k: i32| s.at(0.3 * f64::from(k % 20) - 3.0, 0.3 * f64::from(k / 20) - 3.0).surface;
            let differs = (0..400).any(|k| at(&a, k) != at(&b, k));
            let drawn = matches!(kind, SampleKind::Kinematic | SampleKind::Emblem | SampleKind::Cd);
            assert_ne!(differs, drawn, "{kind:?}");
        }
    }

    #[test]
    fn the_emblem_has_a_crown_rings_and_bands() {
        let s = sample(SampleKind::Emblem);
        let surface = |u: f64, v: f64| match s.at(10.0 * u, 10.0 * v).surface {
            Surface::Grating { orientation, period_um, .. } => Some((orientation, period_um)),
            _ => None,
        };
        assert_eq!(surface(0.95, 0.9), None, "paper");
        let (crown, period) = surface(0.0, -0.2).unwrap();
        assert!((crown - 0.33 * std::f32::consts::PI).abs() < 1e-3 && period == 1.0, "{crown} {period}");
        // Below the crown, alternating rings 0.25 mm apart.
        let rings: Vec<_> =
            (0..4).map(|k| surface(0.0, -0.2 - 0.0125 - 0.025 * f64::from(20 + k)).unwrap().1).collect();
        assert_eq!(rings, [2.0, 1.4, 2.0, 1.4]);
        let bands = [0.55, 0.635, 0.72].map(|v| surface(0.0, v).unwrap().0);
        assert!(bands[0] != bands[1] && bands[1] != bands[2], "{bands:?}");
        assert_eq!(surface(0.1, 0.55).unwrap().0, bands[0], "a band runs near-horizontally");
    }

    /// 160,000 points over 40 mm.
    fn points(config: SampleConfig, seed: u64) -> Vec<Point> {
        let s = Sample::new(&config, seed);
        (0..160_000).map(|k| s.at(f64::from(k % 400) * 0.1 - 20.0, f64::from(k / 400) * 0.1 - 20.0)).collect()
    }

    #[test]
    fn the_asked_share_of_dots_is_dead() {
        // Points 0.1 mm apart lie on different dots. Many seeds, since one in 370 exceeds three sigma.
        let config = SampleConfig { dead_dots: 0.2, ..SampleConfig::default() };
        let (mut dead, mut n) = (0.0, 0.0);
        for seed in 0..20 {
            let points = points(config.clone(), seed);
            n += points.len() as f64;
            dead += points.iter().filter(|p| p.surface == Surface::Mirror).count() as f64;
        }
        assert!((dead / n - 0.2).abs() < 3.0 * (0.2 * 0.8 / n).sqrt(), "{}", dead / n);
    }

    #[test]
    fn bumps_have_the_asked_slope_in_both_directions() {
        let wanted = 0.5_f64.to_radians().tan();
        for seed in 0..8 {
            let points = points(SampleConfig { bumps_deg: 0.5, ..SampleConfig::default() }, seed);
            for axis in 0..2 {
                let sum: f64 = points.iter().map(|p| f64::from(p.slope[axis]).powi(2)).sum();
                let slope = (sum / points.len() as f64).sqrt();
                assert!((slope / wanted - 1.0).abs() < 0.1, "seed {seed} axis {axis}: {}", slope / wanted);
            }
        }
    }

    #[test]
    fn reflectance_varies_as_much_as_asked() {
        for variation in [0.0, 0.4, 0.95] {
            let config = SampleConfig { reflectance_variation: variation, ..SampleConfig::default() };
            let (low, high) = points(config, 9)
                .iter()
                .fold((f64::INFINITY, 0.0_f64), |(l, h), p| (l.min(p.reflectance.into()), h.max(p.reflectance.into())));
            let wanted = (1.0 - variation) / (1.0 + variation);
            let ratio = low / high;
            assert!(high <= 0.95 + 1e-6 && ratio > wanted - 1e-6 && ratio < wanted + 0.02, "{low} {high}");
        }
    }
}
