//! Validation of a plan, by itself and against a bench.

use super::calibration::MOST_LEVELS;
use super::estimate::{Limits, light_on_s};
use super::steps::groups;
use super::{AnalyserPlan, DisplayPlan, Plan, PlanKind, Step};
use crate::fields::fields;
use nacre_base::Error;
use nacre_base::text::{from_json, from_toml, read_text};
use nacre_frames::Illumination;
use nacre_polarimetry::MAX_BRACKET;
use std::path::Path;
use std::time::Duration;

/// Maximum number of steps.
const MAX_STEPS: usize = 100_000;

impl Plan {
    /// Illumination of the sample: for polarization plans the panel behind its retarder, unless stated otherwise.
    pub fn light(&self) -> Illumination {
        match self.kind {
            PlanKind::Polarization => self.illumination.unwrap_or(Illumination::CircularPanel),
            _ => Illumination::Unknown,
        }
    }

    /// Reads and validates a plan file (TOML, or JSON by file extension), except for device limits.
    ///
    /// # Errors
    /// `Input`, naming the file and key.
    pub fn read(path: &Path) -> Result<Self, Error> {
        const LIMIT: u64 = 16 << 20;
        let remedy = "correct the plan; `nacre schema plan` lists its keys";
        let bad = |problem: String| Error::file(path, problem, remedy);
        let text = read_text(path, LIMIT, remedy)?;
        let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        let plan: Self = if is_json { from_json(&text) } else { from_toml(&text) }.map_err(bad)?;
        plan.check_texts().and_then(|()| plan.check_values()).map_err(bad)?;
        Ok(plan.completed())
    }

    /// Validates all numbers, except for device limits.
    ///
    /// # Errors
    /// A sentence with the key, the value and the permitted range.
    pub fn check_values(&self) -> Result<(), String> {
        self.check_sections()?;
        self.check_calibration()?;
        if self.illumination.is_some() && self.kind != PlanKind::Polarization {
            return Err("illumination belongs to plans of kind polarization; remove it".into());
        }
        match &self.analyser {
            Some(AnalyserPlan::Listed(angles)) => {
                count("analyser.angles_deg", "angles", angles.len())?;
                angles.iter().try_for_each(|a| finite("analyser.angles_deg", *a, 36_000.0))?;
            }
            Some(AnalyserPlan::Until(until)) => until.check()?,
            None => {}
        }
        positive("camera.gain", self.camera.gain)?;
        positive("camera.exposure_ms", self.camera.exposure_ms.unwrap_or(1.0))?;
        self.exposures_ms.iter().try_for_each(|ms| positive("exposures_ms", *ms))?;
        check_disc("display", &self.display)?;
        if let Some(spots) = &self.spots {
            if let Some(fringes) = &spots.fringes {
                fringes.check()?;
            }
            if spots.fringes.is_none() || !spots.centers_mm.is_empty() {
                count("spots.centers_mm", "spots", spots.centers_mm.len())?;
            }
            spots.centers_mm.iter().flatten().try_for_each(|c| finite("spots.centers_mm", *c, 1e5))?;
            positive("spots.diameter_mm", spots.diameter_mm)?;
        }
        for (i, step) in self.steps.iter().enumerate() {
            let key = |name: &str| format!("steps[{i}].{name}");
            check_disc(&key("display"), &step.display.unwrap_or_default())?;
            finite(&key("analyser_deg"), step.analyser_deg.unwrap_or_default(), 36_000.0)?;
            positive(&key("exposure_ms"), step.exposure_ms.unwrap_or(1.0))?;
        }
        if self.camera.exposure_ms.is_some() && self.camera.exposure.is_some() {
            return Err("camera.exposure and camera.exposure_ms are both given; keep one".into());
        }
        if let Some(twice) = self.extras.iter().enumerate().find(|(i, e)| self.extras[..*i].contains(e)) {
            return Err(format!("extras names {:?} twice; name it once", twice.1));
        }
        match self.camera.average {
            1..=16 => Ok(()),
            n => Err(format!("camera.average is {n}; give 1 to 16")),
        }
    }

    /// Checks that the sections match the plan's kind.
    fn check_sections(&self) -> Result<(), String> {
        let kind = super::word(self.kind);
        let bracketed = matches!(self.kind, PlanKind::Polarization | PlanKind::Flash) || self.levels().is_some();
        let needs_exposures = self.kind == PlanKind::Exposures && self.bracket.is_none();
        for (key, given, belongs) in [
            ("exposures_ms", !self.exposures_ms.is_empty() && (!bracketed || self.bracket.is_some()), needs_exposures),
            ("spots", self.spots.is_some(), self.kind == PlanKind::Spots),
            ("steps", !self.steps.is_empty(), self.kind == PlanKind::Free),
            ("calibration", self.calibration.is_some(), self.kind == PlanKind::Calibration),
        ] {
            match (given, belongs) {
                (true, false) => {
                    return Err(format!("{key} does not belong to the kind {kind}; remove it or change kind"));
                }
                (false, true) => return Err(format!("{key} is missing, which the kind {kind} needs")),
                _ => {}
            }
        }
        if self.kind == PlanKind::Polarization && self.analyser.is_none() {
            return Err(
                "analyser is missing, which the kind polarization needs; give angles_deg or until_sigma_deg".into()
            );
        }
        if self.until_sigma().is_some() && self.kind != PlanKind::Polarization {
            return Err(format!("analyser.until_sigma_deg does not belong to the kind {kind}; give angles_deg"));
        }
        if self.kind == PlanKind::Free && self.analyser.is_some() {
            return Err("analyser does not belong to the kind free; give analyser_deg in each step".into());
        }
        self.check_brackets()?;
        if self.kind == PlanKind::Exposures && (self.camera.exposure_ms.is_some() || self.camera.exposure.is_some()) {
            return Err("camera.exposure_ms does not belong to the kind exposures, which has exposures_ms".into());
        }
        self.check_reconstruct()?;
        let bracket = self.bracket.map_or(0, |b| b.at_most as usize);
        if self.until_decided().is_some() && self.analyser.as_ref().is_some_and(|a| a.most() > 1) {
            return Err("spots.fringes.until_undecided does not go with several analyser angles; give one".into());
        }
        let most =
            |f: &super::FringesPlan| f.until().map_or_else(|| f.patterns(), |until| f.patterns_of(until.at_most)).len();
        let fringes = |s: &super::SpotsPlan| s.fringes.as_ref().map_or(0, most);
        let spots = self.spots.as_ref().map_or(1, |s| s.centers_mm.len() + fringes(s));
        let per_angle = self.exposures_ms.len().max(bracket).max(spots).max(1);
        let angles = self.analyser.as_ref().map_or(1, AnalyserPlan::most);
        match per_angle.saturating_mul(angles).max(self.steps.len()) {
            0..=MAX_STEPS => Ok(()),
            n => Err(format!("the plan has {n} frames; at most {MAX_STEPS} are taken")),
        }
    }

    /// Checks that an operation matches the kind, and its options.
    fn check_reconstruct(&self) -> Result<(), String> {
        let Some(order) = &self.reconstruct else { return Ok(()) };
        let (name, kind) = (order.operation.name(), super::word(self.kind));
        let fits = match name {
            "polarization" => self.kind == PlanKind::Polarization,
            "spots" => self.spots.as_ref().is_some_and(|s| s.fringes.is_some()),
            "flash" => self.kind == PlanKind::Flash,
            "hdr" | "lut" | "bokeh" => matches!(self.kind, PlanKind::Exposures | PlanKind::Flash),
            // Other operations take other input, or need more information than a plan has.
            _ => self.measures().is_some_and(|kind| kind.name() == name),
        };
        if !fits {
            return Err(format!("reconstruct.operation is {name}, but the plan's kind is {kind}; remove it"));
        }
        let turns = self.kind == PlanKind::Polarization || self.measures().is_some();
        if !turns && self.analyser.as_ref().is_some_and(|a| a.most() > 1) {
            return Err(format!(
                "reconstruct.operation {name} merges one view, but analyser names several angles; name one"
            ));
        }
        if name == "bokeh" && !order.options.contains_key("psf") {
            return Err("the operation bokeh needs the blur; give reconstruct.options.psf.sigma in pixels".into());
        }
        order.check().map_err(|error| format!("reconstruct.options.{}", fields(&error.to_string())))
    }

    /// Checks exposures captured at each angle of a polarization plan, or under the flash.
    fn check_brackets(&self) -> Result<(), String> {
        if let Some(bracket) = self.bracket {
            let kind = super::word(self.kind);
            if !matches!(self.kind, PlanKind::Exposures | PlanKind::Flash) {
                return Err(format!("bracket does not belong to the kind {kind}; give exposures_ms"));
            }
            if !(0.5..=6.0).contains(&bracket.step_ev) {
                return Err(format!("bracket.step_ev is {}; give 0.5 to 6", bracket.step_ev));
            }
            if !(2..=MAX_BRACKET as u32).contains(&bracket.at_most) {
                return Err(format!("bracket.at_most is {}; give 2 to {MAX_BRACKET}", bracket.at_most));
            }
        }
        if self.exposures_ms.is_empty() && self.bracket.is_none() || self.kind == PlanKind::Exposures {
            return Ok(());
        }
        if self.camera.exposure_ms.is_some() || self.camera.exposure.is_some() {
            return Err("camera.exposure_ms or exposure and exposures_ms are both given; keep one".into());
        }
        let most = if self.levels().is_some() { MOST_LEVELS } else { MAX_BRACKET };
        if self.exposures_ms.len() > most {
            let n = self.exposures_ms.len();
            return Err(format!("exposures_ms holds {n} exposures at each angle; give at most {most}"));
        }
        let twice = self.exposures_ms.iter().enumerate().find(|(i, ms)| self.exposures_ms[..*i].contains(ms));
        twice.map_or(Ok(()), |(_, ms)| Err(format!("exposures_ms holds {ms} twice; average instead (camera.average)")))
    }

    /// Checks the plan against the devices' limits.
    ///
    /// # Errors
    /// One sentence for each kind of violation, with the first affected frame.
    pub fn check_limits(&self, limits: &Limits) -> Vec<String> {
        let (camera, stage, display) = (&limits.camera, &limits.stage, &limits.display);
        let within = |key: &str, value: f64, [low, high]: [f64; 2], device: &str| {
            let problem = || format!("{key} is {value}, but the {device} takes {low} to {high}");
            if (low..=high).contains(&value) { None } else { Some(problem()) }
        };
        let offered = |key: &str, ms: f64| {
            let nearest = camera.choice(ms / 1000.0).err()?;
            let nearest: Vec<String> = nearest.iter().map(|s| format!("{} ms", (1e8 * s).round() / 1e5)).collect();
            Some(format!("{key} is {ms}, which the {} does not offer; choose {}", camera.id, nearest.join(" or ")))
        };
        let steps = self.most_steps();
        let exposures = camera.exposure_s.map(|s| 1000.0 * s);
        let of_steps = |problem: &dyn Fn(&Step) -> Option<String>| steps.iter().find_map(problem);
        let dark = self.extras_taken().0.contains(&super::Extra::Dark);
        let shutter = match self.levels() {
            Some(_) => {
                let id = &camera.id;
                format!("the {id} has no shutter; darken the room, and give calibration.darkness = \"display_black\"")
            }
            None => format!("extras has a dark frame, but the {} has no shutter; leave it out", camera.id),
        };
        [
            within("camera.gain", self.camera.gain, camera.gain, &camera.id),
            self.camera.exposure_ms.and_then(|ms| {
                let key = "camera.exposure_ms";
                within(key, ms, exposures, &camera.id).or_else(|| offered(key, ms))
            }),
            of_steps(&|s| {
                let key = format!("the exposure of {} in ms", s.file);
                s.state.exposure_ms.and_then(|ms| within(&key, ms, exposures, &camera.id).or_else(|| offered(&key, ms)))
            }),
            of_steps(&|s| {
                let key = format!("the analyser angle of {}", s.file);
                s.state.analyser_deg.and_then(|a| within(&key, a, stage.limits_deg, &stage.id))
            }),
            of_steps(&|s| {
                let (reach, [w, h]) = (s.state.pattern.reach_mm(), display.size_mm);
                let fits = reach[0] <= 0.5 * w && reach[1] <= 0.5 * h;
                let problem = || {
                    format!(
                        "the pattern of {} (display.diameter_mm, center_mm or spots) reaches {:.1} × {:.1} mm from the middle \
                         of the {}, which is {w} × {h} mm",
                        s.file, reach[0], reach[1], display.id
                    )
                };
                if fits { None } else { Some(problem()) }
            }),
            Some(shutter).filter(|_| dark && !camera.shutter),
            self.check_roi(limits),
            self.check_flash(limits, &steps),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn check_roi(&self, limits: &Limits) -> Option<String> {
        let ([left, top, width, height], camera) = (self.camera.roi?, &limits.camera);
        let fits = |start: u32, size: u32, all: usize| size > 0 && u64::from(start) + u64::from(size) <= all as u64;
        if fits(left, width, camera.width) && fits(top, height, camera.height) {
            return None;
        }
        Some(format!(
            "camera.roi is [{left}, {top}, {width}, {height}], but the {} has {} × {} pixels",
            camera.id, camera.width, camera.height
        ))
    }

    /// Checks that the flash exists, and that its on-time stays within its limit.
    fn check_flash(&self, limits: &Limits, steps: &[Step]) -> Option<String> {
        let first = steps.iter().find(|s| s.state.flash)?;
        let Some(flash) = &limits.flash else {
            return Some(format!("{} needs a flash, and there is none", first.file));
        };
        let session = Duration::from_secs_f64(self.camera.exposure_ms.unwrap_or(0.0) / 1000.0);
        groups(steps).filter(|g| g[0].state.flash).find_map(|group| {
            let on = light_on_s(group[0].state.exposure(session), group.len() * self.camera.average as usize, limits);
            let problem = || {
                format!(
                    "{} would keep the {} on for {on:.1} s, but it must not be on for more than {} s at a time; expose \
                     shorter, average less, or put other steps in between",
                    group[0].file, flash.id, flash.max_on_s
                )
            };
            if on > flash.max_on_s { Some(problem()) } else { None }
        })
    }
}

fn count(key: &str, of: &str, n: usize) -> Result<(), String> {
    match n {
        1..=MAX_STEPS => Ok(()),
        n => Err(format!("{key} holds {n} {of}; give 1 to {MAX_STEPS}")),
    }
}

fn finite(key: &str, value: f64, most: f64) -> Result<(), String> {
    if value.is_finite() && value.abs() <= most {
        Ok(())
    } else {
        Err(format!("{key} holds {value}; give a finite number"))
    }
}

fn positive(key: &str, value: f64) -> Result<(), String> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(format!("{key} is {value}; give a number above 0")) }
}

fn check_disc(key: &str, display: &DisplayPlan) -> Result<(), String> {
    positive(&format!("{key}.diameter_mm"), display.diameter_mm)?;
    display.center_mm.iter().try_for_each(|c| finite(&format!("{key}.center_mm"), *c, 1e5))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::steps::tests::DOCUMENTED;

    #[test]
    fn wrong_plans_are_refused_by_key() {
        for (from, to, word) in [
            ("average = 1", "average = 0", "camera.average"),
            ("gain = 1.0", "gain = -1", "camera.gain"),
            ("[0, 15,", "[nan, 15,", "angles_deg"),
            ("gain = 1.0", "exposure = \"meter\"", "camera.exposure"),
            ("diameter_mm = 180", "diameter_mm = inf", "display.diameter_mm"),
            ("diameter_mm = 180", "center_mm = [nan, 0]", "display.center_mm"),
            ("\"dark\"", "\"display_black\"", "extras"),
            ("kind = \"polarization\"", "kind = \"flash\"", "reconstruct"),
            ("kind = \"polarization\"", "kind = \"spots\"", "spots"),
            ("kind = \"polarization\"", "kind = \"exposures\"", "exposures_ms"),
            ("kind = \"polarization\"", "kind = \"free\"", "steps"),
            ("kind = \"polarization\"", "kind = \"polarization\"\nexposures_ms = [1]", "exposures_ms"),
        ] {
            let plan: Plan = toml::from_str(&DOCUMENTED.replacen(from, to, 1)).unwrap();
            let problem = plan.check_values().unwrap_err();
            assert!(problem.contains(word), "{to}: {problem}");
        }
        assert!(toml::from_str::<Plan>(&DOCUMENTED.replace("extras", "extra")).is_err());
    }

    #[test]
    fn a_wanted_sigma_is_checked_by_key() {
        let plan = |analyser: &str, more: &str| -> Result<Plan, String> {
            let text = format!("kind = \"polarization\"\nanalyser = {{ {analyser} }}\n{more}");
            let plan: Plan = toml::from_str(&text).map_err(|e| e.to_string())?;
            plan.check_values().map(|()| plan)
        };
        for (analyser, more, word) in [
            ("until_sigma_deg = 0", "", "until_sigma_deg"),
            ("until_sigma_deg = nan", "", "until_sigma_deg"),
            ("until_sigma_deg = inf", "", "until_sigma_deg"),
            ("until_sigma_deg = 1, start = 2", "", "start"),
            ("until_sigma_deg = 1, start = 9, at_most = 8", "", "start"),
            ("until_sigma_deg = 1, at_most = 361", "", "at_most"),
            ("until_sigma_deg = 1, angles_deg = [0]", "", "both"),
            ("angles_deg = [0, 60, 120], at_most = 8", "", "at_most"),
            ("start = 4", "", "until_sigma_deg"),
            ("until_sigma_deg = 1, sigma = 3", "", "sigma"),
            ("until_sigma_deg = 1", "camera = { exposure_ms = 3 }\nexposures_ms = [1, 2]", "exposures_ms"),
            ("until_sigma_deg = 1", "exposures_ms = [1, 2, 1]", "twice"),
            ("until_sigma_deg = 1", "exposures_ms = [1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17]", "17"),
        ] {
            let problem = plan(analyser, more).unwrap_err();
            assert!(problem.contains(word), "{analyser}: {problem}");
        }
        let whole = plan("until_sigma_deg = 0.3", "").unwrap();
        assert_eq!((whole.steps().len(), whole.most_steps().len()), (4, 24));
        let again: Plan = serde_json::from_value(serde_json::to_value(&whole).unwrap()).unwrap();
        assert_eq!(again, whole);
        let flash = "kind = \"flash\"\nanalyser = { until_sigma_deg = 0.3 }";
        assert!(toml::from_str::<Plan>(flash).unwrap().check_values().unwrap_err().contains("until_sigma_deg"));
    }
}
