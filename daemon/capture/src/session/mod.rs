//! Session folder: the crash-safe record of a capture.
//!
//! `session.json` holds the plan and the devices. `journal` records each step before (intent) and after (commit, with
//! the file's SHA-256), and the SHA-256 of `session.json` and `frames.json`. `frames/` holds the frames. Files are
//! written atomically: temporary file, sync, rename, directory sync. An incomplete last line of the journal is
//! truncated.

mod check;
mod disk;
mod journal;
#[cfg(test)]
mod power_loss;
mod salvage;
mod series;
#[cfg(test)]
mod tests;

pub use check::{Condition, Trouble, check};
pub use disk::{Disk, MortalDisk, RealDisk};
pub use journal::{Commit, Entry, Journal, Salvaged, Timing, unreadable_journal};
pub(crate) use journal::{SALVAGE, is_damaged};
pub use salvage::{DamagedLine, Salvage, salvage};
pub use series::{Ending, FringesSoFar, SeriesEnd, SigmaSoFar, SoFar};

use crate::plan::{CalibrationKind, Plan, PlanKind};
use crate::setup::{BenchSection, Setup};
use nacre_base::Version;
use nacre_base::input::{self, Unreadable};
use nacre_drivers::stage::Mounting;
use nacre_frames::{Calibration, FILE_NAME as FRAMES_FILE, Kind};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// `session.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionFile {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<1>,
    /// Version of the capturing program.
    pub software: String,
    /// Start of the session in Unix seconds.
    pub created: u64,
    /// Capture plan.
    pub plan: Plan,
    /// Identities of the devices.
    pub devices: Vec<String>,
    /// Exposure time in seconds, metered or as planned.
    pub exposure_s: f64,
    /// Optics and distances of the bench.
    pub setup: Setup,
    /// Description of the simulated bench, for simulated sessions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bench: Option<nacre_sim::BenchConfig>,
    /// Configured devices of the machine, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub section: Option<BenchSection>,
    /// Mounting of the analyser on its stage, if it is not the default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting: Option<Mounting>,
    /// Stored calibrations that apply to the frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
    /// Warnings at the start of the session, such as calibrations that are too old.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// Maximum size of `session.json` and `frames.json` in bytes.
const MAX_DESCRIPTION: u64 = 64 << 20;

/// Name of the results folder within a session.
pub const RESULTS: &str = "results";

/// File name of a flat field inside a session folder.
pub const FLAT_FILE: &str = "flat.exr";

/// Maximum size of a flat field in bytes.
pub(crate) const MAX_FLAT: u64 = 1 << 30;

/// Maximum size of a frame in bytes.
const MAX_FRAME: u64 = 4 << 30;

impl SessionFile {
    /// Reads the description of a session folder.
    ///
    /// # Errors
    /// Those of the system; `InvalidData` for any other content.
    pub fn read(folder: &Path) -> io::Result<Self> {
        let invalid =
            |problem: String| io::Error::new(io::ErrorKind::InvalidData, format!("{SESSION_FILE}: {problem}"));
        let bytes = input::read(&folder.join(SESSION_FILE), MAX_DESCRIPTION).map_err(|error| match error {
            Unreadable::System(error) => error,
            other => invalid(other.to_string()),
        })?;
        let session: Self = serde_json::from_slice(&bytes).map_err(|e| invalid(e.to_string()))?;
        session.check().map_err(invalid)?;
        Ok(session)
    }

    /// Validates all numbers, except for device limits.
    fn check(&self) -> Result<(), String> {
        self.plan.check_values()?;
        match self.exposure_s {
            s if s > 0.0 && s < 1e6 => Ok(()),
            s => Err(format!("exposure_s is {s}; expected seconds above 0")),
        }
    }
}

/// File name of the description inside a session folder.
pub use nacre_frames::SESSION_FILE;

/// An open session folder, locked against other processes.
pub struct Session<D: Disk> {
    folder: PathBuf,
    disk: D,
    journal: Journal,
    #[allow(dead_code, reason = "the open file is the lock")]
    lock: File,
}

impl<D: Disk> Session<D> {
    /// Creates a new session folder with its description, and its flat field if there is one; `folder` must be vacant
    /// ([`is_vacant`]).
    ///
    /// # Errors
    /// Those of the system.
    pub fn create(disk: D, folder: &Path, description: &SessionFile, flat: Option<&[u8]>) -> io::Result<Self> {
        if !folder.is_dir() {
            disk.create_dir(folder)?;
        } else if !is_vacant(folder) {
            return Err(io::ErrorKind::DirectoryNotEmpty.into());
        }
        let text = serde_json::to_vec_pretty(description).map_err(io::Error::other)?;
        // Written first, so that no session lacks its flat field; renamed later, so that no foreign file is replaced.
        if let Some(flat) = flat {
            disk.write(&partial(folder, FLAT_FILE), flat)?;
            disk.sync_dir(folder)?;
        }
        write_whole(&disk, folder, SESSION_FILE, &text)?;
        if let Some(parent) = folder.parent() {
            disk.sync_dir(if parent.as_os_str().is_empty() { Path::new(".") } else { parent })?;
        }
        let lock = lock(folder)?;
        let mut session = Self { folder: folder.to_path_buf(), disk, journal: Journal::default(), lock };
        session.make_frames_folder()?;
        session.record(Entry::Begun)?;
        session.seal(SESSION_FILE, &text)?;
        session.place_flat(description)?;
        Ok(session)
    }

    /// Opens a folder to continue the session: reads the journal and truncates an incomplete last line.
    ///
    /// # Errors
    /// Those of the system; `WouldBlock` while another process has it open. `InvalidData` for a journal damaged before
    /// its last line, for a modified `session.json` or `frames.json`, and for a salvaged journal that no longer
    /// identifies the step of a frame.
    pub fn open(disk: D, folder: &Path) -> io::Result<Self> {
        let lock = lock(folder)?;
        let (journal, intact) = Journal::read(&folder.join(Journal::NAME))?;
        if let Some(file) = sealed_files(&journal).find(|file| seal(folder, &journal, file) == Seal::Broken) {
            return Err(io::Error::new(io::ErrorKind::InvalidData, format!("{file}: {BROKEN}")));
        }
        if journal.salvaged().is_some()
            && let Some(problem) = salvage::misfit(&journal, &SessionFile::read(folder)?.plan)
        {
            return Err(io::Error::new(io::ErrorKind::InvalidData, format!("journal: {problem}")));
        }
        let mut session = Self { folder: folder.to_path_buf(), disk, journal, lock };
        session.disk.truncate(&session.folder.join(Journal::NAME), intact)?;
        session.make_frames_folder()?;
        session.record(Entry::Resumed)?;
        if session.journal.sealed(SESSION_FILE).is_none() {
            let text = input::read(&session.folder.join(SESSION_FILE), MAX_DESCRIPTION)?;
            session.seal(SESSION_FILE, &text)?;
        }
        if session.journal.sealed(FLAT_FILE).is_none() {
            session.place_flat(&SessionFile::read(folder)?)?;
        }
        Ok(session)
    }

    /// Gives the flat field its name, and records its checksum.
    fn place_flat(&mut self, description: &SessionFile) -> io::Result<()> {
        if description.calibration.as_ref().is_none_or(|calibration| calibration.flat.is_none()) {
            return Ok(());
        }
        let (temporary, target) = (partial(&self.folder, FLAT_FILE), self.folder.join(FLAT_FILE));
        if !target.exists() {
            self.disk.rename(&temporary, &target)?;
            self.disk.sync_dir(&self.folder)?;
        }
        self.seal(FLAT_FILE, &input::read(&target, MAX_FLAT)?)
    }

    /// Records a file's checksum.
    fn seal(&mut self, file: &str, bytes: &[u8]) -> io::Result<()> {
        self.record(Entry::Sealed { file: file.into(), sha256: sha256(bytes) })
    }

    fn make_frames_folder(&self) -> io::Result<()> {
        let frames = self.folder.join("frames");
        if !frames.is_dir() {
            self.disk.create_dir(&frames)?;
            self.disk.sync_dir(&self.folder)?;
        }
        Ok(())
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Journal so far.
    pub fn journal(&self) -> &Journal {
        &self.journal
    }

    /// True if a step's file is committed and matches the journal.
    pub fn has(&self, file: &str) -> bool {
        let bytes = || input::read(&self.folder.join(file), MAX_FRAME).ok();
        self.journal.commit(file).is_some_and(|c| bytes().is_some_and(|b| sha256(&b) == c.sha256))
    }

    /// Stores a frame: intent, file, commit. `evidence` proves the frame's freshness.
    ///
    /// # Errors
    /// Those of the system; the file is then not committed and will be captured again.
    pub fn store(&mut self, file: &str, bytes: &[u8], evidence: Commit) -> io::Result<()> {
        self.record(Entry::Intent { file: file.into() })?;
        write_whole(&self.disk, &self.folder, file, bytes)?;
        self.record(Entry::Committed(Commit { file: file.into(), sha256: sha256(bytes), ..evidence }))
    }

    /// Writes `frames.json` and closes the session.
    ///
    /// # Errors
    /// Those of the system.
    pub fn finish(&mut self, frames_json: &str, timing: Timing) -> io::Result<()> {
        write_whole(&self.disk, &self.folder, FRAMES_FILE, frames_json.as_bytes())?;
        self.seal(FRAMES_FILE, frames_json.as_bytes())?;
        self.record(Entry::Finished(timing))
    }

    /// Adds an entry to the journal.
    ///
    /// # Errors
    /// Those of the system.
    pub fn record(&mut self, entry: Entry) -> io::Result<()> {
        let line = self.journal.line(entry)?;
        self.disk.append(&self.folder.join(Journal::NAME), line.as_bytes())?;
        if self.journal.len() == 1 {
            self.disk.sync_dir(&self.folder)?;
        }
        Ok(())
    }
}

/// Agreement of a file with its sealed checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seal {
    /// It agrees.
    Intact,
    /// It differs.
    Broken,
    /// It cannot be read.
    Missing,
    /// The file exists, but the journal has no checksum.
    None,
}

/// Problem of a file modified since its checksum was recorded.
const BROKEN: &str = "differs from its recorded checksum";

fn seal(folder: &Path, journal: &Journal, file: &str) -> Seal {
    match (journal.sealed(file), input::read(&folder.join(file), limit(file))) {
        (_, Err(_)) => Seal::Missing,
        (None, _) => Seal::None,
        (Some(sealed), Ok(bytes)) if sha256(&bytes) == sealed => Seal::Intact,
        _ => Seal::Broken,
    }
}

/// Maximum size in bytes of a file with a seal.
fn limit(file: &str) -> u64 {
    if file == FLAT_FILE { MAX_FLAT } else { MAX_DESCRIPTION }
}

/// Files that must agree with their seals: `frames.json` is rewritten after a frame was captured again.
fn sealed_files(journal: &Journal) -> impl Iterator<Item = &'static str> {
    let flat = journal.sealed(FLAT_FILE).map(|_| FLAT_FILE);
    [SESSION_FILE].into_iter().chain(flat).chain(journal.finished().then_some(FRAMES_FILE))
}

/// True if a new session can be created here: nothing exists, or only remains of a failed attempt.
pub fn is_vacant(folder: &Path) -> bool {
    let leftovers = [SESSION_FILE, FLAT_FILE].map(|file| partial(folder, file));
    match std::fs::read_dir(folder) {
        Ok(entries) => entries.flatten().all(|e| leftovers.contains(&e.path())),
        Err(e) => e.kind() == io::ErrorKind::NotFound,
    }
}

/// Path of the temporary file under which a file is written.
fn partial(folder: &Path, name: &str) -> PathBuf {
    folder.join(name).with_extension("partial")
}

fn write_whole(disk: &impl Disk, folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    let (target, temporary) = (folder.join(name), partial(folder, name));
    disk.write(&temporary, bytes)?;
    disk.rename(&temporary, &target)?;
    disk.sync_dir(target.parent().unwrap_or(folder))
}

/// Keeps a second process from capturing into the same session while the file is open.
///
/// # Errors
/// `WouldBlock` while another process has the session open; otherwise as the system answers.
pub fn lock(folder: &Path) -> io::Result<File> {
    let file = input::open(&folder.join(SESSION_FILE), MAX_DESCRIPTION)?;
    file.try_lock()?;
    Ok(file)
}

/// Kind of the frame set of a plan.
pub(crate) fn frames_kind(plan: &Plan) -> Kind {
    match plan.kind {
        PlanKind::Polarization => Kind::Polarization,
        PlanKind::Exposures => Kind::Exposures,
        PlanKind::Flash => Kind::Flash,
        PlanKind::Spots => Kind::Spots,
        PlanKind::Free => Kind::Free,
        PlanKind::Calibration => match plan.measures() {
            Some(CalibrationKind::Camera) => Kind::Exposures,
            Some(CalibrationKind::Analyser | CalibrationKind::Retarder) => Kind::Polarization,
            _ => Kind::Free,
        },
    }
}

/// SHA-256 in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}
