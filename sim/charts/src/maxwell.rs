//! Studies of diffraction efficiencies against rigorous solutions of Maxwell's equations: error of scalar theory, and
//! improvement by energy balancing.

use super::environment::Last;
use nacre_base::{Error, Result};
use nacre_brdf::Section;
use nacre_optics::rcwa::{Light, Polarization, conductor};
use nacre_render::{BalancedOrder, BalancedOrders};
use nacre_sim::random::{key, uniform};
use nacre_studies::{Axis, Effort, Outcome, Scene as Stress, Setting, Study};
use std::f64::consts::{PI, TAU};
use std::time::Instant;

/// Angles of incidence in degrees; depths over the period.
const ANGLES: [f64; 8] = [0.0, 15.0, 30.0, 45.0, 55.0, 65.0, 75.0, 82.0];
const DEPTHS: [f64; 7] = [0.005, 0.01, 0.02, 0.04, 0.06, 0.08, 0.1];

/// Evanescent plane waves per side in the truth's own method.
const BEYOND: [usize; 5] = [1, 2, 4, 8, 16];

/// Largest energy imbalance of the reference, and largest number of plane waves to reach it.
const LOST: f64 = 5e-4;
const MOST_BEYOND: usize = 48;

/// Fourier harmonics of a profile: more harmonics allow steeper walls.
const HARMONICS: usize = 5;
const WALLS: [f64; 6] = [1.0, 3.0, 5.0, 9.0, 13.0, 19.0];

/// Points per profile polyline.
const POINTS: usize = 400;

pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let degrees = Sweep {
        name: "render-orders",
        title: "Orders of gratings, by the angle of the light",
        stress: Axis::linear("angle of the light", "°"),
        values: effort.pick(ANGLES.to_vec(), ANGLES.iter().copied().step_by(2).collect()),
        reference: effort.pick(2, 1),
        of: "Depths of 2 to 10 % of the period.",
        at: |value, draw| Draw { degrees: value, share: 0.02 + 0.08 * draw, harmonics: HARMONICS },
    };
    let depths = Sweep {
        name: "render-orders-depth",
        title: "Orders of gratings, by their depth",
        stress: Axis::log("depth over period", ""),
        values: effort.pick(DEPTHS.to_vec(), DEPTHS.iter().copied().step_by(2).collect()),
        reference: effort.pick(3, 1),
        of: "Light from 0 to 60°.",
        at: |value, draw| Draw { degrees: 60.0 * draw, share: value, harmonics: HARMONICS },
    };
    let walls = Sweep {
        name: "render-orders-walls",
        title: "Orders of gratings, by the steepness of their walls",
        stress: Axis::log("harmonics of the cross-section", ""),
        values: effort.pick(WALLS.to_vec(), WALLS.iter().copied().step_by(2).collect()),
        reference: effort.pick(3, 1),
        of: "Depths of 3 % of the period, light from 0 to 60°.",
        at: |value, draw| Draw { degrees: 60.0 * draw, share: 0.03, harmonics: value as usize },
    };
    [degrees, depths, walls].map(|s| s.study(effort)).into()
}

/// A study with its stress axis.
struct Sweep {
    name: &'static str,
    title: &'static str,
    stress: Axis,
    values: Vec<f64>,
    reference: usize,
    of: &'static str,
    /// Draws a foil for a stress value and a random number in [0, 1).
    at: fn(f64, f64) -> Draw,
}

/// Parameters of a foil: angle of incidence, depth over the period, and harmonics.
struct Draw {
    degrees: f64,
    share: f64,
    harmonics: usize,
}

impl Sweep {
    fn study(self, effort: Effort) -> Study {
        let (bands, foils) = effort.pick((4, 8), (2, 4));
        let methods = Method::ALL.map(|(m, name)| {
            let setting = Setting::new(name, name, 0.0);
            if m == Method::Balanced { setting.as_default() } else { setting }
        });
        let exact =
            BEYOND.map(|n| Setting::new("Maxwell's equations", format!("{n} more waves"), n as f64).without_sweep());
        let (values, at) = (self.values.clone(), self.at);
        let last = Last::<Vec<Sample>>::new();
        Study {
            name: self.name,
            group: "render",
            title: self.title.into(),
            question: format!(
                "The light that each order of a perfectly conducting grating has, unpolarised, at {bands} wavelengths from 400 to 720 nm, of {foils} gratings by chance: \
                 sinusoids, rounded teeth and rounded steps of 1 to 5 µm, light across the grooves. {} Scalar theory has too much or too little \
                 in all; its orders are scaled to 1 by their sum, or balanced so that light from any direction is neither lost nor gained. \
                 The error is the part of the light that is in a wrong order, against Maxwell's equations.",
                self.of
            ),
            knob: Axis::log("plane waves beyond those that propagate", ""),
            stress: self.stress,
            error: Axis::log("light in wrong orders", ""),
            time: Axis::log("time of a wavelength", "s"),
            predicted: "0.3 ⟨h'²⟩ / cos θ",
            settings: methods.into_iter().chain(exact).collect(),
            scenes: self.values.iter().map(|v| Stress::new(*v)).collect(),
            reference: self.reference,
            run: Box::new(move |setting, scene, seed| {
                let drawn = || (0..foils).map(|k| Foil::drawn(key(&[seed, k]), |draw| at(values[scene], draw)));
                let samples = last.get(scene, seed, || drawn().map(|f| Sample::new(f, bands)).collect())?;
                let start = Instant::now();
                let found: Vec<Orders> = samples
                    .iter()
                    .flat_map(|s| s.wavelengths().map(|nm| s.orders(setting, nm)))
                    .collect::<Result<_>>()?;
                let seconds = start.elapsed().as_secs_f64() / found.len() as f64;
                let truth = samples.iter().flat_map(|s| &s.truth);
                let off = found.iter().zip(truth).map(|(a, b)| misplaced(a, b)).sum::<f64>() / found.len() as f64;
                let balanced = Method::ALL.get(setting).is_some_and(|(m, _)| *m == Method::Balanced);
                let of = |s: &Sample| BalancedOrders::theory_error(&s.foil.section, s.foil.period_um, s.foil.angle);
                let predicted = balanced.then(|| samples.iter().map(of).sum::<f64>() / samples.len() as f64);
                Ok(Outcome { error: Some(off), seconds, masked: 0.0, wrong: 0.0, predicted })
            }),
        }
    }
}

/// A grating with its reference efficiencies.
struct Sample {
    foil: Foil,
    prepared: BalancedOrders,
    truth: Vec<Orders>,
}

impl Sample {
    fn new(foil: Foil, bands: usize) -> Result<Self> {
        let prepared = BalancedOrders::new(&foil.section, foil.period_um)?;
        let truth = (0..bands).map(|k| foil.truth(wavelength(k, bands))).collect::<Result<_>>()?;
        Ok(Self { foil, prepared, truth })
    }

    fn wavelengths(&self) -> impl Iterator<Item = f64> {
        let bands = self.truth.len();
        (0..bands).map(move |k| wavelength(k, bands))
    }

    /// Efficiencies by the method of a setting.
    fn orders(&self, setting: usize, nm: f64) -> Result<Orders> {
        let foil = &self.foil;
        let Some((method, _)) = Method::ALL.get(setting) else {
            return Ok(foil.exact(nm, BEYOND[setting - Method::ALL.len()])?.0);
        };
        let found = self.prepared.at(foil.angle, nm)?;
        let sum: f64 = found.iter().map(|o| o.scalar).sum();
        let light = |o: &BalancedOrder| match method {
            Method::Plain => o.scalar / foil.gain(o.order, nm),
            Method::Scalar => o.scalar,
            Method::Scaled => o.scalar / sum,
            Method::Balanced => o.balanced,
        };
        Ok(found.iter().map(|o| (o.order, light(o))).collect())
    }
}

/// Wavelength of band `k` in nm.
fn wavelength(k: usize, bands: usize) -> f64 {
    400.0 + 320.0 * (k as f64 + 0.5) / bands as f64
}

#[derive(Clone, Copy, PartialEq)]
enum Method {
    Plain,
    Scalar,
    Scaled,
    Balanced,
}

impl Method {
    const ALL: [(Self, &'static str); 4] = [
        (Self::Plain, "scalar theory without its gain"),
        (Self::Scalar, "scalar theory"),
        (Self::Scaled, "scalar theory over its sum"),
        (Self::Balanced, "balanced"),
    ];
}

/// Order numbers and their efficiencies.
type Orders = Vec<(i32, f64)>;

/// Half the sum of absolute differences: the share of light in a wrong order or lost.
fn misplaced(found: &Orders, truth: &Orders) -> f64 {
    let at = |m: i32| found.iter().find(|o| o.0 == m).map_or(0.0, |o| o.1);
    0.5 * truth.iter().map(|(m, light)| (at(*m) - light).abs()).sum::<f64>()
}

/// A grating under a light.
struct Foil {
    series: Vec<[f64; 2]>,
    section: Section,
    period_um: f64,
    angle: f64,
}

impl Foil {
    /// Draws a foil from a seed.
    fn drawn(seed: u64, at: impl Fn(f64) -> Draw) -> Self {
        let draw = |k: u64| uniform(key(&[seed, 11, k]));
        let period_um = 5.0_f64.powf(draw(0));
        let Draw { degrees, share, harmonics } = at(draw(1));
        let side = if draw(2) < 0.5 { -1.0 } else { 1.0 };
        let kind = (3.0 * draw(3)) as usize;
        // Fourier series of a cosine, a sawtooth or a step, with Lanczos σ-factors against ringing.
        let mut series: Vec<[f64; 2]> = (1..=harmonics)
            .map(|k| {
                let x = PI * k as f64 / (harmonics + 1) as f64;
                let smooth = x.sin() / x / k as f64;
                match kind {
                    0 => [if k == 1 { 1.0 } else { 0.0 }, 0.0],
                    1 => [0.0, smooth],
                    _ => [0.0, if k % 2 == 1 { smooth } else { 0.0 }],
                }
            })
            .collect();
        let height = |series: &[[f64; 2]], t: f64| -> f64 {
            let part = |(k, [a, b]): (f64, &[f64; 2])| a * (TAU * k * t).cos() + b * (TAU * k * t).sin();
            (1..).map(f64::from).zip(series).map(part).sum()
        };
        let lines = |series: &[[f64; 2]]| -> Vec<[f64; 2]> {
            (0..POINTS).map(|k| k as f64 / POINTS as f64).map(|t| [t, height(series, t)]).collect()
        };
        let depth = Section::Lines(lines(&series)).depth_um();
        series.iter_mut().flatten().for_each(|v| *v *= share * period_um / depth);
        Self { section: Section::Lines(lines(&series)), series, period_um, angle: side * degrees.to_radians() }
    }

    /// Efficiencies of unpolarised light with `beyond` evanescent waves per side, and their energy imbalance.
    fn exact(&self, nm: f64, beyond: usize) -> Result<(Orders, f64)> {
        // The propagation direction points away from the source.
        let light = Light { wavelength_nm: nm, angle: -self.angle };
        let harmonics = (2.0 * self.period_um * 1e3 / nm).ceil() as usize + beyond;
        let of = |polarization| conductor(&self.series, self.period_um, &light, polarization, harmonics);
        let [s, p] = [of(Polarization::Te)?, of(Polarization::Tm)?];
        let lost = (s.total() - 1.0).abs().max((p.total() - 1.0).abs());
        let both = s.reflected.iter().zip(&p.reflected);
        Ok((both.map(|(s, p)| (s.m, 0.5 * (s.efficiency + p.efficiency))).collect(), lost))
    }

    fn truth(&self, nm: f64) -> Result<Orders> {
        let mut beyond = 6;
        loop {
            let (found, lost) = self.exact(nm, beyond)?;
            if lost < LOST {
                return Ok(found);
            }
            if beyond >= MOST_BEYOND {
                let problem =
                    format!("gains or loses {lost:.1e} of the light by {beyond} plane waves more than propagate");
                return Err(Error::input("a perfect conductor", problem, "take a shallower one"));
            }
            beyond = (2 * beyond).min(MOST_BEYOND);
        }
    }

    /// Gain of an order in scalar theory, `(1 + ωi·ωr)² / (cos θi cos θr (cos θi + cos θr)²)`.
    fn gain(&self, order: i32, nm: f64) -> f64 {
        let sines = [self.angle.sin(), f64::from(order) * nm / 1e3 / self.period_um - self.angle.sin()];
        let [c, d] = sines.map(|s| (1.0 - s * s).max(1e-6).sqrt());
        (1.0 + c * d + sines[0] * sines[1]).powi(2) / (c * d * (c + d).powi(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Balanced orders are closer to Maxwell's equations than those of scalar theory, most of all at oblique incidence.
    /// For grooves as deep as a fifth of the period, both are far off.
    #[test]
    fn balanced_orders_are_nearest_to_maxwells_equations() {
        let studies = studies(Effort::Quick);
        let error = |study: &Study, method: usize, scene: usize| -> f64 {
            (1..=2).map(|seed| (study.run)(method, scene, seed).unwrap().error.unwrap()).sum::<f64>() / 2.0
        };
        let [scalar, balanced] = [1, 3].map(|m| error(&studies[0], m, 3));
        assert!(balanced < 0.5 * scalar && balanced < 0.03 && scalar > 0.01, "{scalar} {balanced}");
        let deep = studies[1].scenes.len() - 1;
        let [scalar, balanced] = [1, 3].map(|m| error(&studies[1], m, deep));
        assert!(balanced < scalar && balanced > 0.02, "{scalar} {balanced}");
        let most = Method::ALL.len() + BEYOND.len() - 1;
        assert!(error(&studies[0], most, 3) < 1e-3);
    }
}
