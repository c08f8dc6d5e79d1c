//! Fringes of a spot scan.

use super::{Limits, Plan};
use crate::session::Setup;
use nacre_drivers::Pattern;
use nacre_processing::spots::{MAX_CARRIERS, Optics, frequencies, reachable};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Stripes that move over the panel. Each of `count` directions and widths is shown at `phases` phases; three frames of even light tell how
/// the panel answers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FringesPlan {
    /// How many different ones, 4 to 31: more tell more places apart.
    pub count: u32,
    /// Phases of each, 3 to 16: from 4 on, the panel's exponent may be a few percent wrong.
    pub phases: u32,
    /// Period of the finest in mm; one that the camera's aperture blurs away tells nothing.
    pub finest_mm: f64,
    /// Exponent that the panel is taken to have where nothing better is known.
    pub gamma: f64,
}

/// Phases of even light: white, half of it, and a quarter.
const EVEN: [f64; 3] = [0.0, 0.25, 1.0 / 3.0];

impl Default for FringesPlan {
    fn default() -> Self {
        Self { count: 12, phases: 4, finest_mm: 28.0, gamma: 2.2 }
    }
}

impl FringesPlan {
    /// Checks every number.
    ///
    /// # Errors
    /// A sentence that names the key, what was found and what is allowed.
    pub fn check(&self) -> Result<(), String> {
        if !(4..=MAX_CARRIERS as u32).contains(&self.count) {
            return Err(format!("spots.fringes.count is {}; give 4 to {MAX_CARRIERS}", self.count));
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

    /// What the panel shows, in order.
    pub fn patterns(&self) -> Vec<Pattern> {
        let (count, phases, gamma) = (self.count.min(MAX_CARRIERS as u32), self.phases.clamp(1, 16), self.gamma);
        let pattern = |cycles_per_mm, phase| Pattern::Fringes { cycles_per_mm, phase, gamma };
        let even = EVEN.map(|phase| pattern([0.0; 2], phase));
        let shown = frequencies(count as usize, self.finest_mm);
        let moved = shown.into_iter().flat_map(|f| (0..phases).map(move |k| (f, f64::from(k) / f64::from(phases))));
        even.into_iter().chain(moved.map(|(f, phase)| pattern(f, phase))).collect()
    }
}

/// Which periods a panel reaches.
pub struct Reach {
    /// Shortest period in µm whose first order reaches the panel, for grating vectors at 0, 15, … 165 degrees, from the sample's middle;
    /// none where none does.
    pub shortest_um: Vec<Option<f64>>,
}

impl Reach {
    /// As a person reads it.
    pub fn text(&self) -> String {
        let each = self.shortest_um.iter().enumerate().map(|(k, um)| {
            let reached = um.map_or("none".to_owned(), |um| format!("{um:.2} µm"));
            format!("\n  {:3}°  {reached}", 15 * k)
        });
        format!("\nshortest period whose first order reaches the panel, by the grating vector's direction:{}", each.collect::<String>())
    }
}

impl Plan {
    /// Which periods the fringes of this plan can tell, where the bench says where things stand.
    pub fn reach(&self, setup: &Setup, limits: &Limits) -> Option<Reach> {
        self.spots.as_ref()?.fringes.as_ref()?;
        let geometry = setup.geometry?;
        let (d, half) = (geometry.distance_mm, 0.5 * geometry.baseline_mm);
        let optics = Optics {
            viewer_mm: [-half, 0.0, d],
            panel_axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            panel_mm: [half, 0.0, d],
            panel_size_mm: limits.display.size_mm,
            wavelength_um: setup.wavelength_nm? / 1000.0,
            band: 0.0,
            aperture_mm: 10.0,
        };
        Some(Reach { shortest_um: reachable(&optics) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fringes_are_counted_and_checked() {
        let plan: Plan = toml::from_str("kind = \"spots\"\nspots = { fringes = {} }\nextras = [\"display_black\"]").unwrap();
        plan.check_values().unwrap();
        let steps = plan.steps();
        assert!(steps.len() <= 64 && steps.len() == 1 + 3 + 48, "{}", steps.len());
        for (key, word) in [("count = 3", "count"), ("phases = 2", "phases"), ("finest_mm = 0", "finest"), ("gamma = 9", "gamma")] {
            let text = format!("kind = \"spots\"\nspots = {{ fringes = {{ {key} }} }}");
            let problem = toml::from_str::<Plan>(&text).unwrap().check_values().unwrap_err();
            assert!(problem.contains(word), "{problem}");
        }
        let none = toml::from_str::<Plan>("kind = \"spots\"\nspots = {}").unwrap();
        assert!(none.check_values().unwrap_err().contains("centers_mm"));
        let asked = "kind = \"spots\"\nspots = { centers_mm = [[0, 0]] }\nreconstruct = { method = \"spots\" }";
        assert!(toml::from_str::<Plan>(asked).unwrap().check_values().unwrap_err().contains("method is spots"));
    }

    /// A panel of 52 × 32 cm at 25 cm reaches 1.2 µm in all directions with the camera overhead, and 0.8 µm, 44° off, in few.
    #[test]
    fn reach_depends_on_the_direction() {
        let plan: Plan = toml::from_str("kind = \"spots\"\nspots = { fringes = {} }").unwrap();
        let bench = nacre_sim::BenchConfig::default();
        let devices = nacre_sim::describe(&bench);
        let display = nacre_drivers::DisplayInfo { size_mm: [520.0, 320.0], ..devices.display.clone() };
        let limits = Limits { stage: devices.stage, camera: devices.camera, display, flash: None };
        let geometry =
            nacre_processing::frames::Geometry { distance_mm: 250.0, baseline_mm: 0.0, pixel_um: None, camera_px: None };
        let setup = Setup { wavelength_nm: Some(560.0), geometry: Some(geometry), ..Setup::default() };
        let shortest = plan.reach(&setup, &limits).unwrap().shortest_um;
        let [right, up] = [0, 6].map(|k| shortest[k].unwrap());
        // Straight up the panel ends 160 mm away, less half an aperture: sin atan(155 / 250).
        assert!((up - 0.56 / (155.0_f64 / 250.0).atan().sin()).abs() < 2e-3, "{up}");
        assert!((right - 0.56 / (255.0_f64 / 250.0).atan().sin()).abs() < 2e-3, "{right}");
        assert!(plan.reach(&Setup::default(), &limits).is_none());
    }
}
