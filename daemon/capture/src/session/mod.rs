//! A session folder: the truth about a capture, whatever happens to the process that writes it.
//!
//! `session.json` says what was asked for and with which devices; `journal` records each step before (intent) and
//! after (commit, with the file's SHA-256), and the SHA-256 of `session.json` and `frames.json`; `frames/` holds the
//! frames. Files appear whole: temporary file, sync, rename, directory sync. A torn last line of the journal is cut.

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

use crate::plan::{Plan, PlanKind};
use crate::setup::{BenchSection, Setup};
use nacre_base::Version;
use nacre_base::input::{self, Unreadable};
use nacre_frames::{FILE_NAME as FRAMES_FILE, Kind};
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
    /// Version of the program that captured.
    pub software: String,
    /// When the session was begun, in Unix seconds.
    pub created: u64,
    /// What was asked for.
    pub plan: Plan,
    /// Identities of the devices.
    pub devices: Vec<String>,
    /// Exposure time in seconds, metered or as planned.
    pub exposure_s: f64,
    /// What the frames were taken with.
    pub setup: Setup,
    /// The simulated bench, for simulated sessions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bench: Option<nacre_sim::BenchConfig>,
    /// Which devices of the machine took part, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub section: Option<BenchSection>,
}

/// Largest `session.json` and `frames.json` that are read, in bytes.
const MAX_DESCRIPTION: u64 = 64 << 20;

/// Largest frame that is read, in bytes.
const MAX_FRAME: u64 = 4 << 30;

impl SessionFile {
    /// Reads the description of a session folder.
    ///
    /// # Errors
    /// As the system answers; `InvalidData` for anything that is no such description.
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

    /// Checks every number, apart from device limits.
    fn check(&self) -> Result<(), String> {
        self.plan.check_values()?;
        match self.exposure_s {
            s if s > 0.0 && s < 1e6 => Ok(()),
            s => Err(format!("exposure_s is {s}; expected seconds above 0")),
        }
    }
}

/// Name of the description inside a session folder.
pub use nacre_frames::SESSION_FILE;

/// An open session folder, which no other process can open meanwhile.
pub struct Session<D: Disk> {
    folder: PathBuf,
    disk: D,
    journal: Journal,
    #[allow(dead_code, reason = "the open file is the lock")]
    lock: File,
}

impl<D: Disk> Session<D> {
    /// Makes a new session folder with its description; `folder` must be vacant ([`is_vacant`]).
    ///
    /// # Errors
    /// As the system answers.
    pub fn create(disk: D, folder: &Path, description: &SessionFile) -> io::Result<Self> {
        if !folder.is_dir() {
            disk.create_dir(folder)?;
        } else if !is_vacant(folder) {
            return Err(io::ErrorKind::DirectoryNotEmpty.into());
        }
        let text = serde_json::to_vec_pretty(description).map_err(io::Error::other)?;
        write_whole(&disk, folder, SESSION_FILE, &text)?;
        if let Some(parent) = folder.parent() {
            disk.sync_dir(if parent.as_os_str().is_empty() { Path::new(".") } else { parent })?;
        }
        let lock = lock(folder)?;
        let mut session = Self { folder: folder.to_path_buf(), disk, journal: Journal::default(), lock };
        session.make_frames_folder()?;
        session.record(Entry::Begun)?;
        session.seal(SESSION_FILE, &text)?;
        Ok(session)
    }

    /// Opens a folder to go on with it: reads the journal and cuts a torn tail.
    ///
    /// # Errors
    /// As the system answers; `WouldBlock` while another process has it open; `InvalidData` for a journal that is damaged
    /// before its tail, for a `session.json` or `frames.json` that was changed, and for a salvaged journal that no longer says
    /// which step a frame belongs to.
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
        Ok(session)
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

    /// What happened so far.
    pub fn journal(&self) -> &Journal {
        &self.journal
    }

    /// Whether a step's file is committed and still what the journal says.
    pub fn has(&self, file: &str) -> bool {
        let bytes = || input::read(&self.folder.join(file), MAX_FRAME).ok();
        self.journal.commit(file).is_some_and(|c| bytes().is_some_and(|b| sha256(&b) == c.sha256))
    }

    /// Stores a frame: intent, file, commit. `evidence` says why the frame is fresh.
    ///
    /// # Errors
    /// As the system answers; the file is then not committed and will be taken again.
    pub fn store(&mut self, file: &str, bytes: &[u8], evidence: Commit) -> io::Result<()> {
        self.record(Entry::Intent { file: file.into() })?;
        write_whole(&self.disk, &self.folder, file, bytes)?;
        self.record(Entry::Committed(Commit { file: file.into(), sha256: sha256(bytes), ..evidence }))
    }

    /// Writes `frames.json` and closes the session.
    ///
    /// # Errors
    /// As the system answers.
    pub fn finish(&mut self, frames_json: &str, timing: Timing) -> io::Result<()> {
        write_whole(&self.disk, &self.folder, FRAMES_FILE, frames_json.as_bytes())?;
        self.seal(FRAMES_FILE, frames_json.as_bytes())?;
        self.record(Entry::Finished(timing))
    }

    /// Adds an entry to the journal.
    ///
    /// # Errors
    /// As the system answers.
    pub fn record(&mut self, entry: Entry) -> io::Result<()> {
        let line = self.journal.line(entry)?;
        self.disk.append(&self.folder.join(Journal::NAME), line.as_bytes())?;
        if self.journal.len() == 1 {
            self.disk.sync_dir(&self.folder)?;
        }
        Ok(())
    }
}

/// Whether a file is as the journal sealed it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seal {
    /// It is.
    Intact,
    /// It has other contents.
    Broken,
    /// It cannot be read.
    Missing,
    /// It is there, and the journal has no checksum of it.
    None,
}

/// Problem of a file that was changed since its checksum was recorded.
const BROKEN: &str = "differs from its recorded checksum";

fn seal(folder: &Path, journal: &Journal, file: &str) -> Seal {
    match (journal.sealed(file), input::read(&folder.join(file), MAX_DESCRIPTION)) {
        (_, Err(_)) => Seal::Missing,
        (None, _) => Seal::None,
        (Some(sealed), Ok(bytes)) if sha256(&bytes) == sealed => Seal::Intact,
        _ => Seal::Broken,
    }
}

/// The files that must be as they were sealed: `frames.json` is written anew once a frame was taken again.
fn sealed_files(journal: &Journal) -> impl Iterator<Item = &'static str> {
    [SESSION_FILE].into_iter().chain(journal.finished().then_some(FRAMES_FILE))
}

/// Whether a new session can be made here: there is nothing, or what is left of an attempt that came to nothing.
pub fn is_vacant(folder: &Path) -> bool {
    let leftover = Path::new(SESSION_FILE).with_extension("partial");
    match std::fs::read_dir(folder) {
        Ok(entries) => entries.flatten().all(|e| Path::new(&e.file_name()) == leftover),
        Err(e) => e.kind() == io::ErrorKind::NotFound,
    }
}

fn write_whole(disk: &impl Disk, folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    let target = folder.join(name);
    let temporary = target.with_extension("partial");
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

/// The word of `frames.json` for what a plan varies.
pub(crate) fn frames_kind(kind: PlanKind) -> Kind {
    match kind {
        PlanKind::Polarization => Kind::Polarization,
        PlanKind::Exposures => Kind::Exposures,
        PlanKind::Flash => Kind::Flash,
        PlanKind::Spots => Kind::Spots,
        PlanKind::Free => Kind::Free,
    }
}

/// SHA-256 in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}
