//! Journal: JSON lines, each with sequence number, time, and a CRC over entry and time.

use super::series::SeriesEnd;
use crate::failure::Failure;
use crate::plan::{Added, Plan};
use nacre_base::Error;
use nacre_base::input::{self, Unreadable};
use nacre_drivers::DeviceError;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::io;
use std::path::Path;
use std::time::SystemTime;

/// Maximum size of a journal in bytes; a frame takes about 400 bytes.
pub(super) const MAX_BYTES: u64 = 256 << 20;

/// A journal with damaged or missing lines.
#[derive(Debug, thiserror::Error)]
#[error("journal: {0}")]
pub(super) struct Damaged(String);

/// Error for an unreadable journal, with the appropriate remedy.
pub fn unreadable_journal(folder: &Path, error: &io::Error) -> Error {
    let remedy = if is_damaged(error) { SALVAGE } else { "give a folder that `nacre capture` made" };
    Error::file(folder, error, remedy)
}

/// True for the error of a damaged journal, which [`salvage`](super::salvage()) can recover.
pub fn is_damaged(error: &io::Error) -> bool {
    error.get_ref().is_some_and(|inner| inner.is::<Damaged>())
}

/// Remedy for a damaged journal. Clients of the service read it too, so it names no path.
pub const SALVAGE: &str = "`nacre salvage` on this folder makes a readable session of the rest";

/// Event of a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Entry {
    /// The session was created.
    Begun,
    /// A process resumed it.
    Resumed,
    /// `session.json` or `frames.json` was written with these contents, and must not change any more.
    Sealed {
        /// File name.
        file: String,
        /// SHA-256 of its contents.
        sha256: String,
    },
    /// A frame will be stored.
    Intent {
        /// File name.
        file: String,
    },
    /// A frame is durably stored.
    Committed(Commit),
    /// A step is repeated after a transient error.
    Retried {
        /// Error message.
        reason: String,
    },
    /// The series continues, because the required accuracy is not reached.
    Chosen {
        /// Addition to the series.
        #[serde(flatten)]
        added: Added,
        /// 90th percentile of σ before it, in degrees, over the pixels with an orientation.
        sigma_deg: Option<f64>,
        /// Fraction of undecided pixels before it, for a fringe series.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        undecided: Option<f64>,
    },
    /// An adaptive series has ended.
    Ended(SeriesEnd),
    /// The session is paused, with the light off.
    Paused,
    /// The session was stopped or failed.
    Stopped {
        /// Reason.
        reason: String,
        /// Device that caused it, for a specific remedy.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        fault: Option<Box<DeviceError>>,
    },
    /// All frames and `frames.json` are stored.
    Finished(Timing),
    /// The preceding entries are the undamaged ones of a damaged journal.
    Salvaged(Salvaged),
}

/// Salvage of a journal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Salvaged {
    /// File in the session folder with the damaged journal.
    pub damaged_journal: String,
    /// Number of recovered entries.
    pub kept: usize,
    /// Number of unreadable lines.
    pub damaged: usize,
    /// Minimum number of lost entries; the number after the last undamaged line is unknown.
    pub lost: usize,
    /// True if the capture had ended before the damage: its last entry was recovered, or all frames and `frames.json`
    /// existed.
    pub finished: bool,
}

/// Times of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Time of the devices on their clock, including metering.
    pub device_s: f64,
    /// Time added by the engine: wall-clock time without any device at work.
    pub engine_s: f64,
    /// Total wall-clock time.
    pub wall_s: f64,
}

/// A stored frame with evidence of freshness. Times are nanoseconds on the bench's clock.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Commit {
    /// File in the session folder.
    pub file: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Sequence number of the (last) frame.
    pub sequence: u64,
    /// End of its readout.
    pub timestamp_ns: u64,
    /// Time of the last change on the bench.
    pub steady_since_ns: u64,
    /// First sequence number certain to use the camera's controls.
    pub first_sequence: u64,
    /// Exposure time in use.
    pub exposure_ns: u64,
    /// Gain in use.
    pub gain: f64,
    /// Analyser angle in degrees reported by the stage; if the plan does not rotate the analyser, its angle before the
    /// frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub analyser_deg: Option<f64>,
    /// Number of stale frames dropped before it.
    pub dropped: u32,
}

/// Parsed journal.
#[derive(Default)]
pub struct Journal {
    entries: Vec<Entry>,
    /// Time of each entry in Unix milliseconds; older versions did not record it.
    times_ms: Vec<Option<u64>>,
    /// Index of each file's last commit among the entries.
    commits: HashMap<String, usize>,
}

/// One line of a journal.
#[derive(Serialize, Deserialize)]
pub(super) struct Line {
    /// Sequence number, from 0.
    pub seq: usize,
    /// Time of the entry in Unix milliseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<u64>,
    /// CRC over entry and time.
    pub crc: u32,
    /// Entry.
    pub entry: Entry,
}

impl Journal {
    /// File name inside a session folder.
    pub const NAME: &'static str = "journal";

    /// Reads a journal; also returns the length of its intact part. A missing file counts as an empty journal.
    ///
    /// # Errors
    /// `InvalidData` if a line before the last is damaged, which no crash can cause.
    pub fn read(path: &Path) -> io::Result<(Self, u64)> {
        let damaged = |problem: String| io::Error::new(io::ErrorKind::InvalidData, Damaged(problem));
        let bytes = match input::read(path, MAX_BYTES) {
            Err(Unreadable::System(e)) if e.kind() == io::ErrorKind::NotFound => return Ok((Self::default(), 0)),
            Err(e @ Unreadable::TooLarge { .. }) => return Err(damaged(e.to_string())),
            Err(Unreadable::System(e)) => return Err(e),
            Err(other) => return Err(io::Error::new(io::ErrorKind::InvalidData, format!("journal: {other}"))),
            Ok(bytes) => bytes,
        };
        let mut journal = Self::default();
        let mut intact = 0;
        for line in bytes.split_inclusive(|b| *b == b'\n') {
            let Some(line_read) = parse(line).ok().filter(|read| read.seq == journal.entries.len()) else {
                if intact + line.len() < bytes.len() {
                    return Err(damaged(format!("line {} is damaged", journal.entries.len() + 1)));
                }
                break;
            };
            journal.push(line_read);
            intact += line.len();
        }
        Ok((journal, intact as u64))
    }

    /// Adds an entry and returns its line.
    ///
    /// # Errors
    /// Never for entries of this program; declared so that a failed serialisation cannot go unnoticed.
    pub fn line(&mut self, entry: Entry) -> io::Result<String> {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        self.line_of(entry, since.ok().and_then(|t| u64::try_from(t.as_millis()).ok()))
    }

    /// Adds an entry with this Unix time in milliseconds and returns its line.
    pub(super) fn line_of(&mut self, entry: Entry, time_ms: Option<u64>) -> io::Result<String> {
        let line = Line { seq: self.entries.len(), time_ms, crc: checksum(&entry, time_ms)?, entry };
        let text = serde_json::to_string(&line).map_err(io::Error::other)? + "\n";
        // JSON has no NaN, so the line would count as damaged when it is read.
        if parse(text.as_bytes()).is_err() {
            return Err(io::Error::new(io::ErrorKind::InvalidData, format!("the journal cannot hold {text}")));
        }
        self.push(line);
        Ok(text)
    }

    fn push(&mut self, Line { entry, time_ms, .. }: Line) {
        if let Entry::Committed(commit) = &entry {
            self.commits.insert(commit.file.clone(), self.entries.len());
        }
        self.entries.push(entry);
        self.times_ms.push(time_ms);
    }

    /// Number of entries.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Last commit of a file.
    pub fn commit(&self, file: &str) -> Option<&Commit> {
        match self.entries.get(*self.commits.get(file)?) {
            Some(Entry::Committed(commit)) => Some(commit),
            _ => None,
        }
    }

    /// All committed files, in the order of their first commits.
    pub fn files(&self) -> Vec<String> {
        let mut seen = HashSet::new();
        self.commits().filter(|c| seen.insert(&c.file)).map(|c| c.file.clone()).collect()
    }

    /// All commits, in order.
    pub fn commits(&self) -> impl Iterator<Item = &Commit> {
        self.entries.iter().filter_map(|e| if let Entry::Committed(c) = e { Some(c) } else { None })
    }

    /// True if the session was finished and no frame was captured again since.
    pub fn finished(&self) -> bool {
        let ended = |entry: &Entry| match entry {
            Entry::Finished(_) => Some(true),
            Entry::Committed(_) => Some(false),
            Entry::Salvaged(salvaged) => Some(salvaged.finished),
            _ => None,
        };
        self.entries.iter().rev().find_map(ended).unwrap_or(false)
    }

    /// Last salvage of the journal, if any.
    pub fn salvaged(&self) -> Option<&Salvaged> {
        self.entries.iter().rev().find_map(|e| if let Entry::Salvaged(s) = e { Some(s) } else { None })
    }

    /// All entries in order, each with its Unix time in seconds if known.
    pub fn timed(&self) -> impl DoubleEndedIterator<Item = (Option<f64>, &Entry)> {
        let seconds = |ms: &Option<u64>| ms.map(|ms| ms as f64 / 1000.0);
        self.times_ms.iter().map(seconds).zip(&self.entries)
    }

    /// Sealed SHA-256 of a file.
    pub(crate) fn sealed(&self, name: &str) -> Option<&str> {
        self.entries.iter().rev().find_map(|e| match e {
            Entry::Sealed { file, sha256 } if file == name => Some(sha256.as_str()),
            _ => None,
        })
    }

    /// Analyser angle in degrees at the first frame that records it.
    pub fn fixed_analyser_deg(&self) -> Option<f64> {
        self.commits().find_map(|c| c.analyser_deg)
    }

    /// Additions to the series.
    pub fn chosen(&self) -> Vec<Added> {
        let added = |e: &Entry| if let Entry::Chosen { added, .. } = e { Some(*added) } else { None };
        self.entries.iter().filter_map(added).collect()
    }

    /// End of an adaptive series.
    pub fn ended(&self) -> Option<SeriesEnd> {
        self.entries.iter().find_map(|e| if let Entry::Ended(end) = e { Some(*end) } else { None })
    }

    /// Number of frames of the session: as far as known, and at most.
    pub fn planned(&self, plan: &Plan) -> [usize; 2] {
        let chosen = self.chosen();
        let known = plan.steps_with(&chosen).len();
        let open = plan.is_open() && self.ended().is_none() || plan.awaits_crossed(&chosen);
        [known, if open && !self.finished() { plan.most_steps().len() } else { known }]
    }

    /// Reason of an early end, if that is the last entry.
    pub fn why_stopped(&self) -> Option<String> {
        match self.entries.last() {
            Some(Entry::Stopped { reason, .. }) => Some(reason.clone()),
            _ => None,
        }
    }

    /// Device that ended the session, if that is the last entry.
    pub fn fault(&self) -> Option<&DeviceError> {
        match self.entries.last() {
            Some(Entry::Stopped { fault, .. }) => fault.as_deref(),
            _ => None,
        }
    }

    /// Times of a finished session.
    pub fn timing(&self) -> Option<Timing> {
        self.entries.iter().rev().find_map(|e| if let Entry::Finished(t) = e { Some(*t) } else { None })
    }

    /// True if the last entry is an early end.
    pub fn stopped(&self) -> bool {
        matches!(self.entries.last(), Some(Entry::Stopped { .. }))
    }
}

impl Entry {
    /// Entry for an early end.
    pub fn stopped(failure: &Failure) -> Self {
        Self::Stopped { reason: failure.to_string(), fault: failure.fault().cloned().map(Box::new) }
    }
}

fn checksum(entry: &Entry, time_ms: Option<u64>) -> io::Result<u32> {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&serde_json::to_vec(entry).map_err(io::Error::other)?);
    if let Some(time) = time_ms {
        hasher.update(&time.to_le_bytes());
    }
    Ok(hasher.finalize())
}

/// Parses a line, or returns the reason why it cannot be read.
pub(super) fn parse(line: &[u8]) -> Result<Line, &'static str> {
    let text = line.strip_suffix(b"\n").ok_or("is cut off")?;
    let text = std::str::from_utf8(text).map_err(|_| "is not UTF-8")?;
    let line: Line = serde_json::from_str(text).map_err(|_| "is not an entry of a journal")?;
    let same = checksum(&line.entry, line.time_ms).is_ok_and(|crc| crc == line.crc);
    if same { Ok(line) } else { Err("differs from its checksum") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(entries: &[Entry]) -> Vec<u8> {
        let mut journal = Journal::default();
        entries.iter().flat_map(|e| journal.line(e.clone()).unwrap().into_bytes()).collect()
    }

    #[test]
    fn unreadable_entries_are_not_written() {
        let mut journal = Journal::default();
        let commit = Commit { analyser_deg: Some(f64::NAN), ..Commit::default() };
        assert!(journal.line(Entry::Committed(commit)).is_err());
        assert!(journal.line(Entry::Begun).unwrap().starts_with("{\"seq\":0"));
    }

    #[test]
    fn a_torn_tail_is_cut_wherever_it_is_torn_and_damage_inside_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let entries =
            [Entry::Begun, Entry::Intent { file: "frames/0000.png".into() }, Entry::Finished(Timing::default())];
        let whole = written(&entries);
        let two = 1 + whole.iter().enumerate().filter(|(_, b)| **b == b'\n').nth(1).unwrap().0;
        for cut in two..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let (journal, intact) = Journal::read(&path).unwrap();
            assert_eq!((journal.entries.as_slice(), intact), (&entries[..2], two as u64));
            assert!(journal.timed().all(|(time, _)| time.is_some_and(|t| t > 1.7e9)));
        }
        for byte in 0..two - 1 {
            let mut damaged = whole.clone();
            damaged[byte] ^= 1;
            std::fs::write(&path, &damaged).unwrap();
            assert!(Journal::read(&path).is_err(), "byte {byte}");
        }
    }
}
