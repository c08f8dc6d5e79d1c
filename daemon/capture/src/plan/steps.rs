//! Expansion of a plan into a list of frames.

use super::calibration::thousandths;
use super::fringes::EVEN;
use super::{Added, AnalyserPlan, Extra, FreeStep, FringesPlan, Plan, PlanKind, UntilDecided, UntilSigma};
use nacre_drivers::Pattern;
use serde::Serialize;
use std::collections::BTreeSet;
use std::time::Duration;

/// One frame: state of the bench, and target file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// File in the session folder.
    pub file: String,
    /// Purpose of the frame.
    pub role: Role,
    /// State of the bench.
    #[serde(flatten)]
    pub state: State,
}

/// Purpose of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Part of the series.
    Series,
    /// Additional frame.
    Extra(Extra),
}

/// State of the bench during an exposure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct State {
    /// Pattern on the panel.
    pub pattern: Pattern,
    /// Analyser angle in degrees; `None` leaves it unmoved.
    pub analyser_deg: Option<f64>,
    /// True if the flash is on.
    pub flash: bool,
    /// True if the camera's shutter is closed.
    pub covered: bool,
    /// Exposure time in ms; `None` for the session's.
    pub exposure_ms: Option<f64>,
}

impl State {
    /// Exposure time, given that of the session.
    pub fn exposure(&self, session: Duration) -> Duration {
        self.exposure_ms.map_or(session, |ms| Duration::from_secs_f64(ms / 1000.0))
    }
}

impl Plan {
    /// Steps captured in any case, in order. Additional frames come first, because processing of the series needs them.
    pub fn steps(&self) -> Vec<Step> {
        self.steps_with(&[])
    }

    /// Steps of a series with these additions.
    pub fn steps_with(&self, chosen: &[Added]) -> Vec<Step> {
        let series = self.series(chosen);
        let mut seen = BTreeSet::new();
        let exposures = series.iter().map(|s| s.exposure_ms).filter(|e| seen.insert(e.map(f64::to_bits)));
        // Exposures that are not metered yet are equal.
        let exposures: Vec<Option<f64>> = if self.levels().is_some() { self.exposures() } else { exposures.collect() };
        let (extras, times) = self.extras_taken();
        let numbered = |extra: Extra| {
            let copies = move |(k, e): (usize, &Option<f64>)| {
                (0..times).map(move |copy| (extra, k, copy, *e)).collect::<Vec<_>>()
            };
            exposures.iter().enumerate().flat_map(copies)
        };
        let extras = extras.into_iter().flat_map(numbered).map(|(extra, number, copy, exposure_ms)| Step {
            file: extra_file(extra, (exposures.len() > 1).then_some(number), (times > 1).then_some(copy)),
            role: Role::Extra(extra),
            state: State {
                pattern: Pattern::Black,
                // Ambient light passes through the analyser, too; a closed shutter hides it.
                analyser_deg: series.first().and_then(|s| s.analyser_deg).filter(|_| extra == Extra::DisplayBlack),
                flash: false,
                covered: extra == Extra::Dark,
                exposure_ms,
            },
        });
        let numbered = series.iter().enumerate();
        let series = numbered.map(|(i, state)| Step {
            file: format!("frames/{i:04}.png"),
            role: Role::Series,
            state: state.clone(),
        });
        extras.chain(series).collect()
    }

    /// Frame subtracted from those of the series with an exposure, if the plan captures any: ambient light, or else the
    /// dark frame.
    pub(crate) fn subtracted<'a>(&self, steps: &'a [Step], exposure_ms: Option<f64>) -> Option<&'a str> {
        subtractable(steps, exposure_ms).first().copied()
    }

    /// Frame subtracted from this one of the series. Several frames of darkness at its exposure take turns.
    pub(crate) fn subtracted_from<'a>(&self, steps: &'a [Step], step: &Step) -> Option<&'a str> {
        let exposure_ms = step.state.exposure_ms;
        let all = subtractable(steps, exposure_ms);
        if all.len() < 2 {
            return all.first().copied();
        }
        let mut alike = steps.iter().filter(|s| s.role == Role::Series && s.state.exposure_ms == exposure_ms);
        Some(all[alike.position(|s| s.file == step.file)? % all.len()])
    }

    /// The plan with metered exposures.
    pub fn with_bracket(mut self, exposures_ms: Vec<f64>) -> Self {
        if self.bracket.is_some() || !exposures_ms.is_empty() {
            (self.exposures_ms, self.bracket) = (exposures_ms, None);
            (self.camera.exposure, self.camera.exposure_ms) = (None, None);
        }
        self
    }

    /// Exposures of each view: as stated, or the session's; before metering, the maximum number of unknown ones of a
    /// bracket, or those of a camera's calibration.
    fn exposures(&self) -> Vec<Option<f64>> {
        let unknown = self.levels().or(self.bracket.map(|b| b.at_most)).unwrap_or(1) as usize;
        if self.exposures_ms.is_empty() {
            vec![None; unknown]
        } else {
            self.exposures_ms.iter().copied().map(Some).collect()
        }
    }

    /// True if the plan rotates the analyser.
    pub fn turns(&self) -> bool {
        self.analyser.is_some() || self.steps.iter().any(|s| s.analyser_deg.is_some())
    }

    /// True if the session's exposure time must be metered.
    pub fn is_metered(&self) -> bool {
        self.camera.exposure_ms.is_none() && self.steps().iter().any(|s| s.state.exposure_ms.is_none())
    }

    /// True for an adaptive series.
    pub fn is_open(&self) -> bool {
        self.until_sigma().is_some() || self.until_decided().is_some()
    }

    /// Stopping criterion of an adaptive fringe series.
    pub fn until_decided(&self) -> Option<UntilDecided> {
        self.spots.as_ref()?.fringes.as_ref()?.until()
    }

    /// Stopping criterion of an adaptive series of angles.
    pub fn until_sigma(&self) -> Option<UntilSigma> {
        match self.analyser {
            Some(AnalyserPlan::Until(until)) => Some(until),
            _ => None,
        }
    }

    /// Maximum list of steps, with representative angles for those not yet known.
    pub fn most_steps(&self) -> Vec<Step> {
        let angles = self.until_sigma().map_or_else(Vec::new, |until| until.likely());
        let angles = angles.into_iter().map(|analyser_deg| Added::Angle { analyser_deg });
        let fringes = self.until_decided().map(|until| Added::Fringes { fringes: until.at_most });
        let crossed = self.awaits_crossed(&[]).then_some(Added::Crossed { crossed_deg: 90.0 });
        self.steps_with(&angles.chain(fringes).chain(crossed).collect::<Vec<_>>())
    }

    /// Number of frames at each analyser angle of a polarization series.
    pub(crate) fn frames_per_angle(&self) -> usize {
        self.exposures_ms.len().max(1)
    }

    /// Number of frames of an addition to a series of `frames`.
    pub(crate) fn frames_of(&self, added: Added, frames: usize) -> usize {
        let fringes = |f: &FringesPlan, count: u32| self.frames_before_fringes() + (f.phases * count) as usize;
        match (added, self.spots.as_ref().and_then(|s| s.fringes.as_ref())) {
            (Added::Fringes { fringes: count }, Some(f)) => fringes(f, count).saturating_sub(frames),
            _ => self.frames_per_angle(),
        }
    }

    /// Number of frames of a fringe series before its fringes: discs and uniform light.
    pub(crate) fn frames_before_fringes(&self) -> usize {
        self.spots.as_ref().map_or(0, |s| s.centers_mm.len()) + EVEN.len()
    }

    fn series(&self, chosen: &[Added]) -> Vec<State> {
        let added = chosen.iter().flat_map(|a| match a {
            Added::Angle { analyser_deg } => vec![*analyser_deg],
            Added::Fringes { .. } => vec![],
            Added::Crossed { crossed_deg } => {
                self.crossed_offsets_deg().iter().map(|by| thousandths(crossed_deg + by)).collect()
            }
        });
        let fringes = chosen.iter().rev().find_map(|a| match a {
            Added::Fringes { fringes } => Some(*fringes),
            Added::Angle { .. } | Added::Crossed { .. } => None,
        });
        let angles = match &self.analyser {
            Some(analyser) => analyser.known().into_iter().chain(added).map(Some).collect(),
            None => vec![None],
        };
        let flash = self.kind == PlanKind::Flash;
        let pattern = if flash { Pattern::Black } else { self.display.pattern() };
        let state = |analyser_deg| State { pattern, analyser_deg, flash, covered: false, exposure_ms: None };
        match self.kind {
            PlanKind::Polarization if !self.exposures_ms.is_empty() => {
                // Ordered by angle, so that the exposures of an angle can be merged as soon as they arrive.
                let exposures = |a: Option<f64>| {
                    self.exposures_ms.iter().map(move |ms| State { exposure_ms: Some(*ms), ..state(a) })
                };
                angles.into_iter().flat_map(exposures).collect()
            }
            PlanKind::Polarization => angles.into_iter().map(state).collect(),
            // A rotation of the analyser costs less time than a change of the exposure.
            PlanKind::Exposures | PlanKind::Flash => {
                let at = |exposure_ms| angles.iter().map(|a| State { exposure_ms, ..state(*a) }).collect::<Vec<_>>();
                self.exposures().into_iter().flat_map(at).collect()
            }
            PlanKind::Spots => {
                let spots = self.spots.iter().flat_map(|s| s.centers_mm.iter().map(|c| (*c, s.diameter_mm)));
                let mut discs: Vec<_> =
                    spots.map(|(center_mm, diameter_mm)| Pattern::Disc { center_mm, diameter_mm }).collect();
                let shown = |f: &FringesPlan| fringes.map_or_else(|| f.patterns(), |count| f.patterns_of(count));
                discs.extend(self.spots.iter().filter_map(|s| s.fringes.as_ref()).flat_map(shown));
                let at = |a: &Option<f64>| discs.iter().map(|d| State { pattern: *d, ..state(*a) }).collect::<Vec<_>>();
                angles.iter().flat_map(at).collect()
            }
            PlanKind::Calibration => {
                let count = self.flat_frames().unwrap_or(if self.levels().is_some() { 2 } else { 1 }) as usize;
                let states = angles.into_iter().flat_map(|a| {
                    let exposures = self.exposures().into_iter();
                    exposures.map(|exposure_ms| State { exposure_ms, ..state(a) }).collect::<Vec<_>>()
                });
                states.flat_map(|state| vec![state; count]).collect()
            }
            PlanKind::Free => {
                // Made explicit, so that a resumed session does not depend on the present angle of the analyser.
                let mut angle = self.steps.iter().find_map(|s| s.analyser_deg);
                let mut place = |step: &FreeStep| {
                    angle = step.analyser_deg.or(angle);
                    angle
                };
                self.steps.iter().map(|s| State { analyser_deg: place(s), ..self.free(s) }).collect()
            }
        }
    }

    fn free(&self, step: &FreeStep) -> State {
        State {
            pattern: step.display.unwrap_or(self.display).pattern(),
            analyser_deg: step.analyser_deg,
            flash: step.flash,
            covered: false,
            exposure_ms: step.exposure_ms,
        }
    }
}

fn extra_file(extra: Extra, number: Option<usize>, copy: Option<usize>) -> String {
    let number = number.map_or_else(String::new, |number| format!("_{number:02}"));
    let copy = copy.map_or_else(String::new, |copy| format!("_{copy}"));
    format!("frames/{}{number}{copy}.png", super::word(extra))
}

/// Frames of ambient light at an exposure, or else dark frames.
fn subtractable(steps: &[Step], exposure_ms: Option<f64>) -> Vec<&str> {
    let of = |extra| {
        let wanted = |s: &&Step| s.role == Role::Extra(extra) && s.state.exposure_ms == exposure_ms;
        let extras = steps.iter().take_while(|s| s.role != Role::Series);
        extras.filter(wanted).map(|s| s.file.as_str()).collect::<Vec<_>>()
    };
    let ambient = of(Extra::DisplayBlack);
    if ambient.is_empty() { of(Extra::Dark) } else { ambient }
}

/// Groups consecutive steps with equal state, which are captured together, so that repetitions are separate exposures.
pub fn groups(steps: &[Step]) -> impl Iterator<Item = &[Step]> {
    steps.chunk_by(|a, b| a.state == b.state)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn plan(text: &str) -> Plan {
        let plan: Plan = toml::from_str(text).unwrap();
        plan.check_values().unwrap();
        plan
    }

    /// Plan from the documentation.
    pub(in crate::plan) const DOCUMENTED: &str = r#"
        kind = "polarization"
        name = "kinematic tile, first look"
        camera = { exposure_ms = 40, gain = 1.0, average = 1, roi = [0, 0, 1024, 1024] }
        display = { pattern = "disc", diameter_mm = 180 }
        analyser = { angles_deg = [0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165] }
        extras = ["dark", "display_black"]
        reconstruct = { method = "polarization", model = "auto" }
    "#;

    #[test]
    fn the_documented_plan_compiles_to_its_steps() {
        let plan = plan(DOCUMENTED);
        let steps = plan.steps();
        assert_eq!(steps.len(), 14);
        assert_eq!((steps[5].state.analyser_deg, steps[5].file.as_str()), (Some(45.0), "frames/0003.png"));
        assert!(steps[0].state.covered && steps[1].state.pattern == Pattern::Black);
        assert_eq!(plan.subtracted(&steps, None), Some("frames/display_black.png"));
        assert!(!plan.is_metered());
    }

    #[test]
    fn each_exposure_has_its_own_dark_frame() {
        let plan = plan(
            "kind = \"exposures\"\nexposures_ms = [1, 10]\nanalyser = { angles_deg = [0, 90] }\nextras = [\"dark\"]",
        );
        let steps = plan.steps();
        let files: Vec<&str> = steps.iter().map(|s| s.file.as_str()).collect();
        assert_eq!(files[..3], ["frames/dark_00.png", "frames/dark_01.png", "frames/0000.png"]);
        assert_eq!(plan.subtracted(&steps, Some(10.0)), Some("frames/dark_01.png"));
        assert_eq!(steps[4].state.exposure(Duration::ZERO), Duration::from_millis(10));
        assert!(!plan.is_metered());
    }

    #[test]
    fn exposures_of_a_polarization_plan_are_taken_angle_by_angle() {
        let plan = plan(
            "kind = \"polarization\"\nexposures_ms = [1, 10]\nanalyser = { until_sigma_deg = 1, start = 3 }\nextras = [\"display_black\"]",
        );
        let steps = plan.steps_with(&[Added::Angle { analyser_deg: 17.0 }]);
        let series: Vec<_> = steps[2..].iter().map(|s| (s.state.analyser_deg, s.state.exposure_ms)).collect();
        let wanted = [0.0, 60.0, 120.0, 17.0].map(|a| [(Some(a), Some(1.0)), (Some(a), Some(10.0))]).concat();
        assert_eq!(series, wanted);
        assert!(!plan.is_metered());
        // Additions come after the known steps, so that files keep their names.
        assert_eq!(steps[..8], plan.steps());
    }

    #[test]
    fn calibrations_state_their_frames() {
        let completed = |text: &str| plan(text).completed();
        let camera = completed("kind = \"calibration\"\ncalibration = { of = \"camera\", levels = 4 }");
        assert!(camera.is_metered() && camera.steps().len() == 16);
        let device = nacre_sim::describe(&nacre_sim::BenchConfig::default()).camera;
        let mut device = nacre_drivers::CameraInfo { exposure_s: [1e-3, 0.19], ..device };
        let metered = camera.level_exposures_ms(Duration::from_millis(100), &device);
        assert_eq!(metered, [2.0, 51.0, 100.0, 190.0]);
        device.exposure_choices_s = vec![0.001, 0.05, 0.1, 0.125];
        let offered = camera.level_exposures_ms(Duration::from_millis(100), &device);
        assert_eq!(offered, [1.0, 50.0, 100.0, 125.0]);
        let camera = camera.with_bracket(metered);
        camera.check_values().unwrap();
        let steps = camera.steps();
        assert_eq!((steps.len(), steps[3].file.as_str()), (16, "frames/dark_01_1.png"));
        assert!(steps[..8].iter().all(|s| s.state.covered) && steps[8..].iter().all(|s| !s.state.covered));
        let darks: Vec<_> = steps[8..12].iter().map(|s| camera.subtracted_from(&steps, s).unwrap()).collect();
        let wanted = ["dark_00_0", "dark_00_1", "dark_01_0", "dark_01_1"].map(|name| format!("frames/{name}.png"));
        assert_eq!(darks, wanted);
        let stated = "kind = \"calibration\"\ncalibration = { of = \"camera\", darkness = \"display_black\" }\ncamera = { exposure_ms = 10 }";
        let stated = completed(stated);
        assert!(stated.steps()[0].file.contains("display_black") && stated.steps().len() == 48);
        let flat = completed("kind = \"calibration\"\ncalibration = { of = \"flat\" }").steps();
        assert_eq!((flat.len(), groups(&flat).count()), (17, 2));
        let analyser = completed("kind = \"calibration\"\ncalibration = { of = \"analyser\" }");
        let steps = analyser.steps_with(&[Added::Crossed { crossed_deg: 40.5 }]);
        let angles: Vec<f64> = steps.iter().filter_map(|s| s.state.analyser_deg).collect();
        assert_eq!(
            (angles[1..4].to_vec(), angles[25..].to_vec()),
            (vec![0.0, 15.0, 30.0], vec![38.5, 39.5, 41.5, 42.5])
        );
        assert_eq!((analyser.steps().len(), analyser.most_steps().len(), analyser.frame_counts()), (25, 29, [29, 29]));
        let retarder = completed("kind = \"calibration\"\ncalibration = { of = \"retarder\" }");
        assert_eq!(retarder.frame_counts(), [25, 25]);
    }

    #[test]
    fn spots_flashes_and_free_steps_state_their_light() {
        let spots = plan("kind = \"spots\"\nspots = { centers_mm = [[0, 0], [50, -20]], diameter_mm = 10 }");
        let pattern = Pattern::Disc { center_mm: [50.0, -20.0], diameter_mm: 10.0 };
        assert_eq!(spots.steps()[1].state.pattern, pattern);
        assert!(spots.is_metered());
        let flash = plan("kind = \"flash\"\nextras = [\"display_black\"]").steps();
        assert_eq!((flash[0].state.flash, flash[1].state.flash, flash[1].state.pattern), (false, true, Pattern::Black));
        let bracket = plan("kind = \"flash\"\nbracket = { at_most = 3 }\nextras = [\"dark\"]");
        assert!(bracket.is_metered() && bracket.steps().len() == 4);
        let known = bracket.with_bracket(vec![1.0, 4.0]).steps();
        assert!(known.len() == 4 && known[3].state.flash && known[3].state.exposure_ms == Some(4.0));
        let free = plan(
            "kind = \"free\"\n[[steps]]\nflash = true\nexposure_ms = 2\n[[steps]]\nanalyser_deg = 30\n[[steps]]\nanalyser_deg = 30",
        );
        let steps = free.steps();
        assert_eq!(groups(&steps).map(<[Step]>::len).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(steps[0].state.analyser_deg, Some(30.0));
        assert!(free.is_metered() && steps[0].state.flash && steps[1].state.pattern != Pattern::Black);
    }
}
