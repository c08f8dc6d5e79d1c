//! Stored calibrations of benches, and their choice for a session.
//!
//! Each has a folder named by its identifier with `record.json`, `calibration.json`, `report.json` and, for a flat
//! field, `flat.exr`.

mod choice;
mod record;
#[cfg(test)]
mod tests;

pub use choice::{Choice, Chosen, MAX_AGE_DAYS, Present, age_days};
pub use record::{Conditions, Origin, Record};

use crate::ids::{is_id, new_id};
use crate::naming::checked;
use crate::plan::CalibrationKind;
use crate::session::{FLAT_FILE, MAX_FLAT, RESULTS, SessionFile};
use nacre_base::text::{from_json, read_text};
use nacre_base::{Error, OutputFolder, Version, input};
use nacre_frames::{CALIBRATION_FILE, Calibration};
use nacre_image::{Depth, info};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Name of the folder of calibrations in a data folder.
pub const FOLDER: &str = "calibrations";

/// Name of the description.
const RECORD_FILE: &str = "record.json";

/// Name of the report.
const REPORT_FILE: &str = "report.json";

/// Maximum size in bytes of `record.json` and `calibration.json`, and of a report.
const MAX_DESCRIPTION: u64 = 1 << 20;
const MAX_REPORT: u64 = 64 << 20;

/// Maximum length of notes in characters.
const LONGEST_NOTES: usize = 10_000;

/// A folder of calibrations.
#[derive(Clone, Debug)]
pub struct Calibrations {
    folder: PathBuf,
}

/// A stored calibration.
#[derive(Clone, Debug)]
pub struct Stored {
    /// Its description.
    pub record: Record,
    /// Its values.
    pub calibration: Calibration,
    /// Its folder.
    pub folder: PathBuf,
}

/// A calibration in a folder of results.
#[derive(Clone, Debug)]
pub struct Found {
    /// Its kind.
    pub kind: CalibrationKind,
    /// Its values.
    pub calibration: Calibration,
    folder: PathBuf,
}

impl Found {
    /// Reads and checks the results of an operation of `nacre calibrate`.
    ///
    /// # Errors
    /// `Input`, naming the file.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let remedy = "give the results of `nacre calibrate camera`, flat, analyser, retarder or orientation";
        let file = folder.join(CALIBRATION_FILE);
        let calibration: Calibration = parsed(&file, remedy)?;
        let bad = |problem: String| Error::file(&file, problem, remedy);
        let mut kinds = CalibrationKind::ALL.into_iter().filter(|kind| kind.is_in(&calibration));
        let (Some(kind), None) = (kinds.next(), kinds.next()) else {
            return Err(bad("does not hold one kind of calibration".into()));
        };
        if let Some((key, problem)) = problem(&calibration) {
            return Err(bad(format!("{key}: {problem}")));
        }
        input::open(&folder.join(REPORT_FILE), MAX_REPORT)
            .map_err(|e| Error::file(&folder.join(REPORT_FILE), e, remedy))?;
        Ok(Self { kind, calibration, folder: folder.into() })
    }

    /// Width and height of a flat field in pixels.
    fn flat_size(&self) -> Result<Option<[u32; 2]>, Error> {
        let Some(flat) = &self.calibration.flat else { return Ok(None) };
        let file = self.flat_file(flat.file.as_path())?;
        let found = info(&file)?;
        if found.depth != Depth::F32 || found.channels != 1 {
            return Err(Error::file(
                &file,
                format!("is {found}"),
                "give a flat field of one channel in floating point",
            ));
        }
        Ok(Some([found.width as u32, found.height as u32]))
    }

    /// Path of the flat field, which lies beside its description.
    fn flat_file(&self, name: &Path) -> Result<PathBuf, Error> {
        let file = self.folder.join(FLAT_FILE);
        if name != Path::new(FLAT_FILE) {
            let problem = format!("names the flat field {}", name.display());
            return Err(Error::file(&self.folder.join(CALIBRATION_FILE), problem, format!("call it {FLAT_FILE}")));
        }
        input::open(&file, MAX_FLAT).map_err(|e| Error::file(&file, e, "repeat the calibration"))?;
        Ok(file)
    }
}

impl Calibrations {
    /// Calibrations in this folder, which need not exist.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Calibrations of a data folder.
    pub fn of_data(data: &Path) -> Self {
        Self::new(data.join(FOLDER))
    }

    /// Folder of a calibration, whether it exists or not; `None` for an invalid identifier.
    pub fn folder_of(&self, id: &str) -> Option<PathBuf> {
        is_id(id).then(|| self.folder.join(id))
    }

    /// All calibrations, the newest photographs first; those that cannot be read as errors.
    pub fn entries(&self) -> Vec<Result<Stored, Error>> {
        let entries = std::fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
        let mut all: Vec<_> = names.filter(|name| is_id(name)).map(|id| self.read(&id)).collect();
        let time = |entry: &Result<Stored, Error>| {
            entry.as_ref().ok().map(|stored| (stored.record.taken, stored.record.id.clone()))
        };
        all.sort_by_cached_key(|entry| std::cmp::Reverse(time(entry)));
        all
    }

    /// A calibration by its identifier.
    ///
    /// # Errors
    /// `Input` if there is none, or a file of it is damaged.
    pub fn read(&self, id: &str) -> Result<Stored, Error> {
        let folder = self.folder_of(id).filter(|folder| folder.join(RECORD_FILE).is_file()).ok_or_else(|| {
            Error::input(format!("calibration {id}"), "does not exist", "`nacre calibrations list` lists them")
        })?;
        let remedy = "remove this calibration, and repeat it";
        let record: Record = parsed(&folder.join(RECORD_FILE), remedy)?;
        let found = Found::read(&folder)?;
        if record.id != id || record.kind != found.kind {
            return Err(Error::file(&folder.join(RECORD_FILE), "describes another calibration", remedy));
        }
        Ok(Stored { record, calibration: found.calibration, folder })
    }

    /// Keeps the results of an operation under a new identifier.
    ///
    /// # Errors
    /// `Input` for invalid results or texts, and without devices; `Output` if the system refuses.
    pub fn keep(&self, id: String, found: &Found, origin: Origin) -> Result<Record, Error> {
        let name = checked(&origin.name).map_err(|problem| Error::input("name", problem, "give another name"))?;
        let length = origin.notes.chars().count();
        if length > LONGEST_NOTES {
            let problem = format!("has {length} characters");
            return Err(Error::input("notes", problem, format!("shorten it to at most {LONGEST_NOTES}")));
        }
        if origin.devices.is_empty() || origin.devices.iter().any(|device| checked(device).is_err()) {
            let remedy = "name the session of the photographs, or the identity of each device";
            return Err(Error::input("devices", "are not known", remedy));
        }
        let mut conditions = origin.conditions;
        if found.kind == CalibrationKind::Camera && conditions.average.is_some_and(|count| count != 1) {
            // Means have another noise, and other levels of black and white.
            let remedy = "repeat it with camera.average = 1";
            return Err(Error::input("calibration", "was measured on averaged photographs", remedy));
        }
        let size = found.flat_size()?;
        conditions.region = size.map(|[width, height]| match conditions.region {
            Some([left, top, ..]) => [left, top, width, height],
            None => [0, 0, width, height],
        });
        let record = Record {
            version: Version,
            id: id.clone(),
            kind: found.kind,
            name,
            notes: origin.notes,
            taken: origin.taken,
            devices: origin.devices,
            conditions,
            session: origin.session,
            reconstruction: origin.reconstruction,
            software: concat!("nacre ", env!("CARGO_PKG_VERSION")).into(),
        };
        let out = OutputFolder::begin(&self.folder.join(&id), false)?;
        out.write_json(CALIBRATION_FILE, &found.calibration)?;
        copy(&found.folder, REPORT_FILE, MAX_REPORT, &out)?;
        if size.is_some() {
            copy(&found.folder, FLAT_FILE, MAX_FLAT, &out)?;
        }
        out.write_json(RECORD_FILE, &record)?;
        out.commit()?;
        Ok(record)
    }

    /// Keeps the results of a session, once.
    ///
    /// # Errors
    /// As [`Self::keep`]; `Input` if the folder is no session.
    pub fn keep_session(&self, folder: &Path) -> Result<Record, Error> {
        let session = SessionFile::read(folder)
            .map_err(|e| Error::file(folder, e, "give a session that `nacre capture` took"))?;
        let found = Found::read(&folder.join(RESULTS))?;
        let origin = Origin::of_session(found.kind, folder, &session);
        let same = |r: &Record| (r.kind, r.taken, &r.session) == (found.kind, origin.taken, &origin.session);
        let kept = self.entries().into_iter().flatten().map(|stored| stored.record).find(same);
        kept.map_or_else(|| self.keep(new_id(), &found, origin), Ok)
    }

    /// Deletes a calibration. Sessions that used it keep their copy.
    ///
    /// # Errors
    /// `Input` if there is none; `Output` if the system refuses.
    pub fn remove(&self, id: &str) -> Result<(), Error> {
        let folder = self.folder_of(id).filter(|folder| folder.is_dir()).ok_or_else(|| {
            Error::input(format!("calibration {id}"), "does not exist", "`nacre calibrations list` lists them")
        })?;
        std::fs::remove_dir_all(&folder).map_err(|e| Error::output(&folder, e))
    }
}

fn parsed<T: DeserializeOwned>(file: &Path, remedy: &str) -> Result<T, Error> {
    from_json(&read_text(file, MAX_DESCRIPTION, remedy)?).map_err(|problem| Error::file(file, problem, remedy))
}

fn copy(from: &Path, name: &str, most: u64, to: &OutputFolder) -> Result<(), Error> {
    let unreadable = |e| Error::file(&from.join(name), e, "repeat the calibration");
    let mut file = input::open(&from.join(name), most).map_err(unreadable)?;
    let target = to.path(name);
    let copied = std::fs::File::create(&target).and_then(|mut out| std::io::copy(&mut file, &mut out));
    copied.map(drop).map_err(|e| Error::output(&target, e))
}

/// Key and problem of an invalid number.
fn problem(calibration: &Calibration) -> Option<(&'static str, String)> {
    let camera = calibration.camera.as_ref().map_or_else(Vec::new, |camera| {
        let noise = &camera.noise;
        vec![
            ("camera.noise.full_scale_e", noise.full_scale_e, noise.full_scale_e > 0.0),
            ("camera.noise.read_noise_e", noise.read_noise_e, noise.read_noise_e >= 0.0),
            ("camera.gain", camera.gain, camera.gain > 0.0),
            ("camera.white", camera.white, camera.white > camera.black),
        ]
    });
    let flat = calibration.flat.as_ref().map(|flat| ("flat.sigma", flat.sigma, flat.sigma >= 0.0));
    let bad = camera.into_iter().chain(flat).find(|(_, value, valid)| !(value.is_finite() && *valid));
    bad.map(|(key, value, _)| (key, format!("{value} is out of range"))).or_else(|| calibration.problem())
}
