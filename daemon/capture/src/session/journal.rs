//! The journal: JSON Lines, each with its number, its time and a CRC over entry and time.

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

/// Longest journal that is read; a frame takes about 400 bytes.
pub(super) const MAX_BYTES: u64 = 256 << 20;

/// A journal with damaged or missing lines.
#[derive(Debug, thiserror::Error)]
#[error("journal: {0}")]
pub(super) struct Damaged(String);

/// The error of a session whose journal cannot be read, with the remedy that fits.
pub fn unreadable_journal(folder: &Path, error: &io::Error) -> Error {
    let remedy = if is_damaged(error) { SALVAGE } else { "give a folder that `nacre capture` made" };
    Error::file(folder, error, remedy)
}

/// Whether this is the error of a damaged journal, of which [`salvage`](super::salvage()) keeps the rest.
pub fn is_damaged(error: &io::Error) -> bool {
    error.get_ref().is_some_and(|inner| inner.is::<Damaged>())
}

/// Remedy for a damaged journal. Clients of the service read it too, so it names no path.
pub const SALVAGE: &str = "`nacre salvage` on this folder makes a readable session of the rest";

/// What happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Entry {
    /// The session was made.
    Begun,
    /// A process went on with it.
    Resumed,
    /// `session.json` or `frames.json` was written with these contents, and is not to change any more.
    Sealed {
        /// Its name.
        file: String,
        /// Of its contents.
        sha256: String,
    },
    /// A frame is about to be stored.
    Intent {
        /// Its file.
        file: String,
    },
    /// A frame is stored for good.
    Committed(Commit),
    /// A step went wrong in a way that may pass, and is done again.
    Retried {
        /// What went wrong.
        reason: String,
    },
    /// The series goes on, since too little is known.
    Chosen {
        /// What is added to it.
        #[serde(flatten)]
        added: Added,
        /// σ before it, in degrees: 90 % of the pixels that carry an orientation are as good.
        sigma_deg: Option<f64>,
        /// Part of the pixels that were undecided before it, for a spot scan.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        undecided: Option<f64>,
    },
    /// A series that goes on until enough is known has ended.
    Ended(SeriesEnd),
    /// The session waits, with the light off.
    Paused,
    /// The session ended early.
    Stopped {
        /// Why.
        reason: String,
        /// The device that was at fault, so that a person can be told what helps.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        fault: Option<Box<DeviceError>>,
    },
    /// All frames and `frames.json` are there.
    Finished(Timing),
    /// The entries before this one are the undamaged ones of a damaged journal.
    Salvaged(Salvaged),
}

/// How a journal was salvaged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Salvaged {
    /// File in the session folder that the damaged journal was kept as.
    pub damaged_journal: String,
    /// Number of entries that were kept.
    pub kept: usize,
    /// Number of lines that could not be read.
    pub damaged: usize,
    /// Number of entries that are lost, at least: how many followed the last undamaged line is unknown.
    pub lost: usize,
    /// Whether the capture had ended before the damage: its last entry was kept, or all frames and `frames.json` were there.
    pub finished: bool,
}

/// Where the time of a run went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// What the devices needed, on their own clock, metering included.
    pub device_s: f64,
    /// What the engine itself added: time on the clock on the wall in which no device was at work.
    pub engine_s: f64,
    /// Of all that happened, on the clock on the wall.
    pub wall_s: f64,
}

/// A stored frame and the evidence that it is fresh. Times are nanoseconds on the bench's clock.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Commit {
    /// File in the session folder.
    pub file: String,
    /// Of the file.
    pub sha256: String,
    /// Sequence number of the (last) frame.
    pub sequence: u64,
    /// End of its readout.
    pub timestamp_ns: u64,
    /// Since when nothing changed on the bench.
    pub steady_since_ns: u64,
    /// First sequence number that is sure to have the camera's controls.
    pub first_sequence: u64,
    /// Exposure time in force.
    pub exposure_ns: u64,
    /// Gain in force.
    pub gain: f64,
    /// Analyser angle in degrees, as the stage reports it; of a plan that does not turn the analyser, as it was before the frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub analyser_deg: Option<f64>,
    /// Stale frames dropped before it.
    pub dropped: u32,
}

/// The journal in memory: what its lines said.
#[derive(Default)]
pub struct Journal {
    entries: Vec<Entry>,
    /// When each happened, in Unix milliseconds; older versions did not record it.
    times_ms: Vec<Option<u64>>,
    /// Where the last commit of each file is among the entries.
    commits: HashMap<String, usize>,
}

/// One line of a journal.
#[derive(Serialize, Deserialize)]
pub(super) struct Line {
    /// Its number, from 0.
    pub seq: usize,
    /// When the entry was made, in Unix milliseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<u64>,
    /// Over entry and time.
    pub crc: u32,
    /// The entry.
    pub entry: Entry,
}

impl Journal {
    /// File name inside a session folder.
    pub const NAME: &'static str = "journal";

    /// Reads a journal; also returns the length of its intact part. A missing file is an empty journal.
    ///
    /// # Errors
    /// `InvalidData` when a line before the last is damaged, which no crash can cause.
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
    /// Never for entries of this program; kept so that a failed serialisation cannot be overlooked.
    pub fn line(&mut self, entry: Entry) -> io::Result<String> {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        self.line_of(entry, since.ok().and_then(|t| u64::try_from(t.as_millis()).ok()))
    }

    /// Adds an entry of this time, in Unix milliseconds, and returns its line.
    pub(super) fn line_of(&mut self, entry: Entry, time_ms: Option<u64>) -> io::Result<String> {
        let line = Line { seq: self.entries.len(), time_ms, crc: checksum(&entry, time_ms)?, entry };
        let text = serde_json::to_string(&line).map_err(io::Error::other)? + "\n";
        // JSON has no NaN: the line would be taken for a damaged one when it is read.
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

    /// The last commit of a file.
    pub fn commit(&self, file: &str) -> Option<&Commit> {
        match self.entries.get(*self.commits.get(file)?) {
            Some(Entry::Committed(commit)) => Some(commit),
            _ => None,
        }
    }

    /// All files that were committed, in the order of their first commits.
    pub fn files(&self) -> Vec<String> {
        let mut seen = HashSet::new();
        self.commits().filter(|c| seen.insert(&c.file)).map(|c| c.file.clone()).collect()
    }

    /// All commits in order.
    pub fn commits(&self) -> impl Iterator<Item = &Commit> {
        self.entries.iter().filter_map(|e| if let Entry::Committed(c) = e { Some(c) } else { None })
    }

    /// Whether the session was finished, and no frame was taken again since.
    pub fn finished(&self) -> bool {
        let ended = |entry: &Entry| match entry {
            Entry::Finished(_) => Some(true),
            Entry::Committed(_) => Some(false),
            Entry::Salvaged(salvaged) => Some(salvaged.finished),
            _ => None,
        };
        self.entries.iter().rev().find_map(ended).unwrap_or(false)
    }

    /// How the journal was salvaged, the last time that it was.
    pub fn salvaged(&self) -> Option<&Salvaged> {
        self.entries.iter().rev().find_map(|e| if let Entry::Salvaged(s) = e { Some(s) } else { None })
    }

    /// All entries in order, each with its time in Unix seconds where it is known.
    pub fn timed(&self) -> impl DoubleEndedIterator<Item = (Option<f64>, &Entry)> {
        let seconds = |ms: &Option<u64>| ms.map(|ms| ms as f64 / 1000.0);
        self.times_ms.iter().map(seconds).zip(&self.entries)
    }

    /// SHA-256 with which a file was sealed.
    pub(crate) fn sealed(&self, name: &str) -> Option<&str> {
        self.entries.iter().rev().find_map(|e| match e {
            Entry::Sealed { file, sha256 } if file == name => Some(sha256.as_str()),
            _ => None,
        })
    }

    /// Where the analyser stood at the first frame that says so, in degrees.
    pub fn stood(&self) -> Option<f64> {
        self.commits().find_map(|c| c.analyser_deg)
    }

    /// What was added to the series.
    pub fn chosen(&self) -> Vec<Added> {
        let added = |e: &Entry| if let Entry::Chosen { added, .. } = e { Some(*added) } else { None };
        self.entries.iter().filter_map(added).collect()
    }

    /// How a series that goes on until enough is known has ended.
    pub fn ended(&self) -> Option<SeriesEnd> {
        self.entries.iter().find_map(|e| if let Entry::Ended(end) = e { Some(*end) } else { None })
    }

    /// Frames that the session will have: as far as is known, and at most.
    pub fn planned(&self, plan: &Plan) -> [usize; 2] {
        let known = plan.steps_with(&self.chosen()).len();
        let open = plan.is_open() && self.ended().is_none() && !self.finished();
        [known, if open { plan.most_steps().len() } else { known }]
    }

    /// Why it ended early, if that is the last thing that happened.
    pub fn why_stopped(&self) -> Option<String> {
        match self.entries.last() {
            Some(Entry::Stopped { reason, .. }) => Some(reason.clone()),
            _ => None,
        }
    }

    /// The device that ended it, if one did and nothing happened since.
    pub fn fault(&self) -> Option<&DeviceError> {
        match self.entries.last() {
            Some(Entry::Stopped { fault, .. }) => fault.as_deref(),
            _ => None,
        }
    }

    /// Where the time went, of a finished session.
    pub fn timing(&self) -> Option<Timing> {
        self.entries.iter().rev().find_map(|e| if let Entry::Finished(t) = e { Some(*t) } else { None })
    }

    /// Whether the last thing that happened is an early end.
    pub fn stopped(&self) -> bool {
        matches!(self.entries.last(), Some(Entry::Stopped { .. }))
    }
}

impl Entry {
    /// That a session ended early, and why.
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

/// Reads a line, or says why it cannot be read.
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
    fn what_could_not_be_read_again_is_not_written() {
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
