//! Choice of calibrations for a session: of each kind the newest one of the devices in use, up to a maximum age.

use super::{Calibrations, Record, Stored};
use crate::plan::{CalibrationKind, CalibrationsPlan, Limits, Plan};
use crate::session::FLAT_FILE;
use crate::setup::Setup;
use nacre_base::Error;
use nacre_drivers::stage::Mounting;
use nacre_frames::{Calibration, CalibrationSource};
use std::path::PathBuf;

/// Default of the maximum age in days.
pub const MAX_AGE_DAYS: u32 = 90;

/// Difference of wavelengths in nm above which a retardance does not apply: 1 % of the retardance in green light.
const SAME_WAVELENGTH_NM: f64 = 5.0;

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Calibrations for sessions, and their maximum age.
#[derive(Clone, Debug)]
pub struct Choice {
    /// The calibrations.
    pub calibrations: Calibrations,
    /// Maximum age in days.
    pub max_age_days: u32,
}

/// Devices and settings of the present bench on which calibrations depend.
#[derive(Clone, Debug, PartialEq)]
pub struct Present {
    /// Identity of the stage.
    stage: String,
    /// Identity of the camera.
    camera: String,
    /// Identity of the panel.
    display: String,
    /// Mounting of the analyser, if it is not the default.
    mounting: Option<Mounting>,
    /// Wavelength in nm, if known.
    wavelength_nm: Option<f64>,
    /// Pixels of the camera in use: left, top, width, height.
    region: [u32; 4],
}

/// Calibrations chosen for a session.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chosen {
    /// Their values with their origins; `None` if there are none.
    pub calibration: Option<Calibration>,
    /// Flat field, to be copied into the session.
    pub flat: Option<PathBuf>,
    /// Reasons why newer or existing calibrations are not used.
    pub warnings: Vec<String>,
}

impl Present {
    /// A bench and the region of interest of a plan.
    pub fn new(limits: &Limits, mounting: Option<Mounting>, setup: &Setup, roi: Option<[u32; 4]>) -> Self {
        let camera = &limits.camera;
        Self {
            stage: limits.stage.id.clone(),
            camera: camera.id.clone(),
            display: limits.display.id.clone(),
            mounting: mounting.filter(|mounting| *mounting != Mounting::default()),
            wavelength_nm: setup.wavelength_nm,
            region: roi.unwrap_or([0, 0, camera.width as u32, camera.height as u32]),
        }
    }

    /// Identities of the devices that calibrations of a kind depend on.
    pub fn devices(&self, kind: CalibrationKind) -> Vec<String> {
        match kind {
            CalibrationKind::Camera => vec![self.camera.clone()],
            CalibrationKind::Flat => vec![self.camera.clone(), self.display.clone()],
            CalibrationKind::Retarder => vec![self.display.clone()],
            CalibrationKind::Analyser | CalibrationKind::Orientation => vec![self.stage.clone()],
        }
    }

    /// Reason why a calibration does not apply to this bench, as the predicate of a sentence about it.
    pub fn mismatch(&self, record: &Record) -> Option<String> {
        let (here, conditions) = (self.devices(record.kind), &record.conditions);
        if record.devices != here {
            return Some(format!("is of {}, the bench has {}", record.devices.join(" and "), here.join(" and ")));
        }
        match record.kind {
            CalibrationKind::Analyser | CalibrationKind::Orientation if conditions.mounting != self.mounting => {
                Some("was taken with another mounting of the analyser".into())
            }
            CalibrationKind::Retarder => {
                let (then, now) = conditions.wavelength_nm.zip(self.wavelength_nm)?;
                ((then - now).abs() > SAME_WAVELENGTH_NM)
                    .then(|| format!("was taken at {then} nm, the bench is at {now} nm"))
            }
            CalibrationKind::Flat if conditions.region != Some(self.region) => {
                let text =
                    |[left, top, width, height]: [u32; 4]| format!("{width} × {height} pixels from {left}, {top}");
                let region = conditions.region.map_or("unknown pixels".into(), text);
                Some(format!("covers {region}, the session {}", text(self.region)))
            }
            _ => None,
        }
    }
}

/// Age of a calibration in days at a time in Unix seconds; 0 for one from the future.
pub fn age_days(record: &Record, now: u64) -> f64 {
    now.saturating_sub(record.taken) as f64 / DAY_S
}

impl Choice {
    /// Reason why a calibration is not used on a bench, as the predicate of a sentence about it.
    pub fn refusal(&self, record: &Record, present: &Present, now: u64) -> Option<String> {
        let age = age_days(record, now);
        let old = || {
            let limit = self.max_age_days;
            (age > f64::from(limit)).then(|| format!("is {age:.0} days old, and {limit} days are the limit"))
        };
        present.mismatch(record).or_else(old)
    }

    /// Chooses calibrations for a session that begins at a time in Unix seconds.
    ///
    /// # Errors
    /// `Input` if a calibration that the plan lists does not exist, does not apply, or is one of two of its kind.
    pub fn choose(&self, plan: &Plan, present: &Present, now: u64) -> Result<Chosen, Error> {
        let mut chosen = Chosen::default();
        match &plan.calibrations {
            CalibrationsPlan::Off => {}
            CalibrationsPlan::Listed(ids) => {
                let mut kinds = vec![];
                for id in ids {
                    let stored = self.calibrations.read(id)?;
                    let kind = stored.record.kind;
                    let problem = match present.mismatch(&stored.record) {
                        Some(problem) => Some(problem),
                        None if kinds.contains(&kind) => Some(format!("is a second {}", kind.title())),
                        None if plan.measures() == Some(kind) => {
                            Some("is of the kind that the session measures".into())
                        }
                        None => None,
                    };
                    if let Some(problem) = problem {
                        let remedy = "remove it from calibrations in the plan";
                        return Err(Error::input(format!("calibration {id}"), problem, remedy));
                    }
                    kinds.push(kind);
                    chosen.add(stored);
                }
            }
            CalibrationsPlan::Auto => {
                let mut all = vec![];
                for entry in self.calibrations.entries() {
                    match entry {
                        Ok(stored) => all.push(stored),
                        Err(error) => chosen.warnings.push(format!("a calibration is not used: {error}")),
                    }
                }
                let wanted = CalibrationKind::ALL.into_iter().filter(|kind| plan.measures() != Some(*kind));
                wanted.for_each(|kind| self.newest(kind, &all, present, now, &mut chosen));
            }
        }
        Ok(chosen)
    }

    /// Adds the newest applicable calibration of a kind, or the reason why the newest one is not used.
    fn newest(&self, kind: CalibrationKind, all: &[Stored], present: &Present, now: u64, chosen: &mut Chosen) {
        let of_kind = || all.iter().filter(|stored| stored.record.kind == kind);
        let applicable = of_kind().find(|stored| present.mismatch(&stored.record).is_none());
        let Some(newest) = applicable.or_else(|| of_kind().next()) else { return };
        match self.refusal(&newest.record, present, now) {
            None => chosen.add(newest.clone()),
            Some(reason) => {
                let id = &newest.record.id;
                chosen.warnings.push(format!("the newest {} is not used: {id} {reason}", kind.title()));
            }
        }
    }
}

impl Chosen {
    fn add(&mut self, stored: Stored) {
        let Stored { record, mut calibration, folder } = stored;
        if let Some(flat) = &mut calibration.flat {
            self.flat = Some(folder.join(&flat.file));
            flat.file = FLAT_FILE.into();
        }
        let source = CalibrationSource { id: record.id, taken: record.taken, devices: record.devices };
        record.kind.transfer(calibration, source, self.calibration.get_or_insert_default());
    }
}
