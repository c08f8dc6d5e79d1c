//! Fringes of a fringe series.

use super::{Limits, Plan};
use crate::setup::Setup;
use nacre_drivers::Pattern;
use nacre_periods::fringes::{
    LEAST_FRINGES, MAX_CARRIERS, Optics, Prediction, Request, Setting, cheapest, frequencies, predict, reachable,
};
use nacre_polarimetry::NoiseModel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Fringes on the panel. Each of `count` directions and periods is shown at `phases` phases; three frames of uniform
/// light determine the panel's response.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FringesPlan {
    /// Number of different fringes, 4 to 31; more distinguish more panel positions. Default: the smallest number that
    /// meets the required σ for the camera's noise; the session then states it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// Number of phases per fringe, 3 to 16. With 4 or more, the panel's gamma may be wrong by a few percent.
    pub phases: u32,
    /// Period of the finest fringe in mm; the camera's aperture must not blur it.
    pub finest_mm: f64,
    /// Gamma of the panel if not known better.
    pub gamma: f64,
    /// Required relative σ of a period in a dim pixel.
    pub period_sigma: f64,
    /// Required σ of an orientation in degrees.
    pub orientation_sigma_deg: f64,
    /// Longest expected period in µm, which panel positions determine least accurately.
    pub longest_um: f64,
    /// Adds fringes until at most this fraction of the pixels with a first order on the panel is undecided. Undecided
    /// pixels are ambiguous between two gratings, or their period is less accurate than `period_sigma`. The series then
    /// begins with `count` fringes (default 10).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub until_undecided: Option<f64>,
    /// Maximum number of fringes of such a series (default: as many as fit into 64 patterns).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_most: Option<u32>,
}

/// A fringe series that continues until few pixels are undecided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UntilDecided {
    /// Number of initial fringes.
    pub start: u32,
    /// Permitted fraction of undecided pixels.
    pub undecided: f64,
    /// Maximum number of fringes.
    pub at_most: u32,
    /// Number of phases per fringe.
    pub phases: u32,
    /// Required relative σ of a period.
    pub period_sigma: f64,
}

/// Addition to an adaptive series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Added {
    /// Another analyser angle.
    Angle {
        /// Angle in degrees.
        analyser_deg: f64,
    },
    /// More fringes.
    Fringes {
        /// Total number of fringes, including the new ones.
        fringes: u32,
    },
    /// The angles around the crossed direction of an analyser, which complete its calibration.
    Crossed {
        /// Angle of the stage in degrees with the least light.
        crossed_deg: f64,
    },
}

/// Number of fringes if the camera's noise is unknown.
const USUAL: u32 = 12;

/// Initial number of fringes in an adaptive series: with fewer, one pixel in five hundred is assigned a wrong grating
/// without any indication (docs/validation/spots.md).
const FIRST: u32 = LEAST_FRINGES as u32;
/// Number of fringes per addition.
pub(crate) const MORE: u32 = 2;

/// Maximum number of patterns of an automatically chosen series.
const MAX_PATTERNS: usize = 64;

/// Phases of uniform light: white, one half, and one quarter.
pub(super) const EVEN: [f64; 3] = [0.0, 0.25, 1.0 / 3.0];

impl Default for FringesPlan {
    fn default() -> Self {
        Self {
            count: None,
            phases: 4,
            finest_mm: 28.0,
            gamma: 2.2,
            period_sigma: 0.01,
            orientation_sigma_deg: 0.5,
            longest_um: 3.0,
            until_undecided: None,
            at_most: None,
        }
    }
}

impl FringesPlan {
    /// Validates all numbers.
    ///
    /// # Errors
    /// A sentence with the key, the value and the permitted range.
    pub fn check(&self) -> Result<(), String> {
        if let Some(count) = self.count.filter(|n| !(4..=MAX_CARRIERS as u32).contains(n)) {
            return Err(format!("spots.fringes.count is {count}; give 4 to {MAX_CARRIERS}"));
        }
        for (key, value, low, high) in [
            ("period_sigma", self.period_sigma, 1e-5, 0.5),
            ("orientation_sigma_deg", self.orientation_sigma_deg, 1e-4, 45.0),
            ("longest_um", self.longest_um, 0.2, 1000.0),
        ] {
            if !(low..=high).contains(&value) {
                return Err(format!("spots.fringes.{key} is {value}; give {low} to {high}"));
            }
        }
        match (self.until_undecided, self.at_most) {
            (None, Some(_)) => return Err("spots.fringes.at_most belongs to until_undecided; remove it".into()),
            (Some(part), _) if !(1e-4..1.0).contains(&part) => {
                return Err(format!("spots.fringes.until_undecided is {part}; give a part of 1 from 0.0001"));
            }
            _ => {}
        }
        let most = MAX_CARRIERS as u32;
        if let Some(until) = self.until()
            && !(until.start..=most).contains(&until.at_most)
        {
            let start = until.start;
            return Err(format!("spots.fringes.at_most is {}; give {start} (the first ones) to {most}", until.at_most));
        }
        if !(3..=16).contains(&self.phases) {
            return Err(format!("spots.fringes.phases is {}; give 3 to 16", self.phases));
        }
        if !(1.0..=1000.0).contains(&self.finest_mm) {
            return Err(format!("spots.fringes.finest_mm is {}; give 1 to 1000", self.finest_mm));
        }
        if !(0.2..=5.0).contains(&self.gamma) {
            return Err(format!("spots.fringes.gamma is {}; give 0.2 to 5, usually 2.2", self.gamma));
        }
        Ok(())
    }

    /// Stopping criterion of an adaptive series.
    pub fn until(&self) -> Option<UntilDecided> {
        let undecided = self.until_undecided?;
        let start = self.count.unwrap_or(FIRST);
        // Two further frames: dark and black panel.
        let fit = (MAX_PATTERNS - 2 - EVEN.len()) as u32 / self.phases.max(1);
        let at_most = self.at_most.unwrap_or(fit.min(MAX_CARRIERS as u32).max(start));
        Some(UntilDecided { start, undecided, at_most, phases: self.phases, period_sigma: self.period_sigma })
    }

    /// Patterns in order, as far as known in advance.
    pub fn patterns(&self) -> Vec<Pattern> {
        self.patterns_of(self.until().map_or(self.count.unwrap_or(USUAL), |until| until.start))
    }

    /// As [`Self::patterns`], for this number of fringes.
    pub(crate) fn patterns_of(&self, count: u32) -> Vec<Pattern> {
        let (count, phases, gamma) = (count.min(MAX_CARRIERS as u32), self.phases.clamp(1, 16), self.gamma);
        let pattern = |cycles_per_mm, phase| Pattern::Fringes { cycles_per_mm, phase, gamma };
        let even = EVEN.map(|phase| pattern([0.0; 2], phase));
        let shown = frequencies(count as usize, self.finest_mm);
        let moved = shown.into_iter().flat_map(|f| (0..phases).map(move |k| (f, f64::from(k) / f64::from(phases))));
        even.into_iter().chain(moved.map(|(f, phase)| pattern(f, phase))).collect()
    }
}

/// Predicted reach and accuracy of fringes, for a bench with known geometry.
pub struct Reach {
    /// Shortest period in µm whose first order reaches the panel from the sample's centre, for grating vectors at 0,
    /// 15, … 165 degrees; `None` where none does.
    pub shortest_um: Vec<Option<f64>>,
    /// Predicted accuracy of the plan's setting, if the camera's noise is known.
    pub predicted: Option<Prediction>,
    /// True if the prediction meets the plan's requirements.
    pub meets: bool,
}

impl Reach {
    /// Text for the user.
    pub fn text(&self) -> String {
        let predicted = self.predicted.as_ref().map_or_else(String::new, |p| {
            format!(
                "\n{} fringes of {} phases, {} patterns in all: σ {:.2} % of the period and {:.2}° of the orientation in a dim pixel{}",
                p.setting.count,
                p.setting.phases,
                p.patterns,
                100.0 * p.period,
                p.orientation_deg,
                if self.meets { "" } else { ", which is more than the plan wants" }
            )
        });
        let each = self.shortest_um.iter().enumerate().map(|(k, um)| {
            let reached = um.map_or("none".to_owned(), |um| format!("{um:.2} µm"));
            format!("\n  {:3}°  {reached}", 15 * k)
        });
        let each: String = each.collect();
        format!(
            "{predicted}\nshortest period whose first order reaches the panel, by the grating vector's direction:{each}"
        )
    }
}

impl FringesPlan {
    fn setting(&self) -> Setting {
        // An adaptive series may use its maximum number.
        let count = self.until().map_or(self.count.unwrap_or(USUAL), |until| until.at_most) as usize;
        Setting { count, phases: self.phases as usize, finest_mm: self.finest_mm }
    }

    fn request(&self) -> Request {
        Request {
            period: self.period_sigma,
            orientation_deg: self.orientation_sigma_deg,
            longest_um: self.longest_um,
            at_most: MAX_PATTERNS,
        }
    }
}

impl Plan {
    /// Predicted reach and accuracy of this plan's fringes, for a bench with known geometry.
    pub fn reach(&self, setup: &Setup, limits: &Limits) -> Option<Reach> {
        let plan = self.clone().with_fringes(setup, limits);
        let fringes = plan.spots.as_ref()?.fringes.as_ref()?;
        let optics = optics(setup, limits)?;
        let predicted = noise(limits).and_then(|n| predict(&optics, &n, fringes.setting(), fringes.longest_um));
        let meets = predicted
            .as_ref()
            .is_some_and(|p| p.period <= fringes.period_sigma && p.orientation_deg <= fringes.orientation_sigma_deg);
        Some(Reach { shortest_um: reachable(&optics), predicted, meets })
    }

    /// The plan with the number of fringes required by the camera's noise, if the plan leaves it open. If no number
    /// meets the requirements, or too little is known, the usual number is used.
    pub fn with_fringes(mut self, setup: &Setup, limits: &Limits) -> Self {
        let Some(fringes) = self
            .spots
            .as_mut()
            .and_then(|s| s.fringes.as_mut())
            .filter(|f| f.count.is_none() && f.until_undecided.is_none())
        else {
            return self;
        };
        let known = optics(setup, limits).zip(noise(limits));
        let fewest =
            known.and_then(|(optics, noise)| cheapest(&optics, &noise, &fringes.setting(), &fringes.request()));
        fringes.count = Some(fewest.map_or(USUAL, |p| p.setting.count as u32));
        self
    }
}

fn noise(limits: &Limits) -> Option<NoiseModel> {
    let (full_scale_e, read_noise_e) = limits.camera.full_scale_e.zip(limits.camera.read_noise_e)?;
    Some(NoiseModel { full_scale_e, read_noise_e })
}

/// Camera and panel side by side, as described by the bench.
fn optics(setup: &Setup, limits: &Limits) -> Option<Optics> {
    let geometry = setup.geometry?;
    let (d, half) = (geometry.distance_mm, 0.5 * geometry.baseline_mm);
    Some(Optics {
        viewer_mm: [-half, 0.0, d],
        panel_axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        panel_mm: [half, 0.0, d],
        panel_size_mm: limits.display.size_mm,
        wavelength_um: setup.wavelength_nm? / 1000.0,
        band: 0.0,
        aperture_mm: 10.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fringes_are_counted_and_checked() {
        let plan: Plan =
            toml::from_str("kind = \"spots\"\nspots = { fringes = {} }\nextras = [\"display_black\"]").unwrap();
        plan.check_values().unwrap();
        let steps = plan.steps();
        assert!(steps.len() <= 64 && steps.len() == 1 + 3 + 48, "{}", steps.len());
        for (key, word) in [
            ("count = 3", "count"),
            ("phases = 2", "phases"),
            ("finest_mm = 0", "finest"),
            ("gamma = 9", "gamma"),
            ("longest_um = nan", "longest_um"),
        ] {
            let text = format!("kind = \"spots\"\nspots = {{ fringes = {{ {key} }} }}");
            let problem = toml::from_str::<Plan>(&text).unwrap().check_values().unwrap_err();
            assert!(problem.contains(word), "{problem}");
        }
        let none = toml::from_str::<Plan>("kind = \"spots\"\nspots = {}").unwrap();
        assert!(none.check_values().unwrap_err().contains("centers_mm"));
        let source = "kind = \"spots\"\nspots = { centers_mm = [[0, 0]] }\nreconstruct = { method = \"spots\" }";
        assert!(toml::from_str::<Plan>(source).unwrap().check_values().unwrap_err().contains("operation is spots"));
    }

    /// A panel of 52 × 32 cm at 25 cm, with the camera overhead, reaches 1.2 µm in all directions, and 0.8 µm (at 44°)
    /// in few.
    #[test]
    fn reach_depends_on_the_direction() {
        let plan: Plan = toml::from_str("kind = \"spots\"\nspots = { fringes = {} }").unwrap();
        let bench = nacre_sim::BenchConfig::default();
        let devices = nacre_sim::describe(&bench);
        let display = nacre_drivers::DisplayInfo { size_mm: [520.0, 320.0], ..devices.display.clone() };
        let limits = Limits { stage: devices.stage, camera: devices.camera, display, flash: None };
        let geometry =
            nacre_frames::Distances { distance_mm: 250.0, baseline_mm: 0.0, pixel_um: None, camera_px: None };
        let setup = Setup { wavelength_nm: Some(560.0), geometry: Some(geometry), ..Setup::default() };
        let shortest = plan.reach(&setup, &limits).unwrap().shortest_um;
        let [right, up] = [0, 6].map(|k| shortest[k].unwrap());
        // Upwards, the panel ends at 160 mm, minus half an aperture: sin atan(155 / 250).
        assert!((up - 0.56 / (155.0_f64 / 250.0).atan().sin()).abs() < 2e-3, "{up}");
        assert!((right - 0.56 / (255.0_f64 / 250.0).atan().sin()).abs() < 2e-3, "{right}");
        assert!(plan.reach(&Setup::default(), &limits).is_none());
        let chosen = |full_scale_e: f64| {
            let mut limits = limits.clone();
            limits.camera.full_scale_e = Some(full_scale_e);
            let plan = plan.clone().with_fringes(&setup, &limits);
            plan.steps().len()
        };
        let (good, poor) = (chosen(40_000.0), chosen(1500.0));
        assert!(good < poor && poor <= 64, "{good} {poor}");
    }
}
