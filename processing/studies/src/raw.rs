//! The file of measurements: JSON Lines with one header, then one line per measurement, each synced to disk. An
//! incomplete last line, left by a killed program, is cut.

use super::{Machine, Outcome, Plan, Study};
use nacre_base::{Error, Result, writable};
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Repetition, from 0.
    pub run: usize,
    /// Position in [`Study::scenes`].
    pub scene: usize,
    /// Position in [`Study::settings`].
    pub setting: usize,
    /// Result of the run.
    #[serde(flatten)]
    pub outcome: Outcome,
}

/// Conditions common to all measurements of a file; a file is continued only under the same conditions.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    study: String,
    plan: Plan,
    machine: Machine,
    settings: Vec<String>,
    scenes: Vec<String>,
}

/// Maximum size of a file of measurements in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// The open file, locked against a second program.
pub(super) struct RawFile {
    file: File,
    /// Measurements already in the file.
    pub records: Vec<Record>,
}

impl RawFile {
    /// Opens or creates the file of a study.
    pub fn open(path: &Path, study: &Study, plan: &Plan) -> Result<Self> {
        let refused = |e| Error::output(path, e);
        // Reading a pipe or a device would not end.
        writable(path)?;
        let mut file = OpenOptions::new().read(true).append(true).create(true).open(path).map_err(refused)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(Error::file(path, "is being written by another program", "wait for it, or stop it"));
            }
            Err(TryLockError::Error(e)) => return Err(refused(e)),
        }
        let mut bytes = vec![];
        (&mut file).take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(refused)?;
        if bytes.len() as u64 > MAX_BYTES {
            let problem = format!("has more than the {MAX_BYTES} bytes that are read");
            return Err(Error::file(path, problem, "choose another --out, or measure anew with --force"));
        }
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |at| at + 1);
        file.set_len(whole as u64).map_err(refused)?;
        file.seek(SeekFrom::End(0)).map_err(refused)?;
        let text = String::from_utf8_lossy(&bytes[..whole]).into_owned();
        let mut lines = text.lines();
        let header = Header::of(study, plan);
        let mut raw = Self { file, records: vec![] };
        match lines.next() {
            None => raw.line(&header).map_err(refused)?,
            Some(line) => header.must_equal(line, path)?,
        }
        for line in lines {
            let record = serde_json::from_str(line).map_err(|e| {
                Error::file(path, format!("holds a line that is no measurement ({e})"), "begin anew with --force")
            })?;
            raw.records.push(record);
        }
        Ok(raw)
    }

    /// Appends a measurement and syncs it to disk.
    pub fn push(&mut self, record: Record, path: &Path) -> Result<()> {
        self.line(&record).map_err(|e| Error::output(path, e))?;
        self.records.push(record);
        Ok(())
    }

    fn line(&mut self, value: &impl Serialize) -> std::io::Result<()> {
        let mut line = serde_json::to_vec(value)?;
        line.push(b'\n');
        self.file.write_all(&line)?;
        self.file.sync_data()
    }
}

impl Header {
    fn of(study: &Study, plan: &Plan) -> Self {
        let scene = |s: &super::Scene| if s.label.is_empty() { s.value.to_string() } else { s.label.clone() };
        Self {
            study: study.name.into(),
            plan: plan.clone(),
            machine: Machine::this(),
            settings: study.settings.iter().map(|s| format!("{}: {}", s.method, s.label)).collect(),
            scenes: study.scenes.iter().map(scene).collect(),
        }
    }

    fn must_equal(&self, line: &str, path: &Path) -> Result<()> {
        let other: Self = serde_json::from_str(line)
            .map_err(|e| Error::file(path, format!("is no file of measurements ({e})"), "choose another --out"))?;
        let (ours, theirs) = (&self.plan, &other.plan);
        let what = if self == &other {
            return Ok(());
        } else if ours.seed != theirs.seed {
            format!("was measured with --seed {}", theirs.seed)
        } else if ours.version != theirs.version {
            format!("was measured by another build of the program ({})", theirs.version)
        } else if self.machine != other.machine {
            format!("was measured on another machine ({}, {} cores)", other.machine.cpu, other.machine.cores)
        } else {
            "was measured with other settings".to_owned()
        };
        Err(Error::file(path, what, "choose another --out, or measure anew with --force"))
    }
}
