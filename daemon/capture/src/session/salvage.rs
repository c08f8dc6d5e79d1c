//! `nacre salvage`: rebuilds a journal from the undamaged lines of a damaged one.
//!
//! Every line has a checksum, so a matching line is intact wherever the damage lies. Missing lines appear as gaps in
//! the sequence numbers. A frame whose commit is lost stays on the disk, but cannot be verified.

use super::check::{Condition, condition};
use super::journal::{MAX_BYTES, parse, unreadable_journal};
use super::{Entry, FRAMES_FILE, Journal, RealDisk, SESSION_FILE, Salvaged, Seal, lock, seal, write_whole};
use crate::plan::Plan;
use nacre_base::input::{self, Unreadable};
use nacre_base::{Error, error};
use serde::Serialize;
use std::collections::{HashMap, HashSet};
use std::io::{self, BufRead, BufReader};
use std::path::Path;

/// Maximum size of a damaged journal in bytes; it is read line by line, independent of memory.
const MAX_DAMAGED: u64 = 4 << 30;

/// Maximum length of a valid line in bytes; the longest entries are early ends with a device's message.
const MAX_LINE: usize = 1 << 20;

/// Maximum number of listed damaged lines; further ones are only counted.
const MAX_LISTED: usize = 1000;

/// Maximum difference in degrees between planned and recorded angle of a frame; errors of stages are far smaller.
const SAME_ANGLE_DEG: f64 = 1.0;

/// Names of entries in the journal.
const NAMES: [&str; 12] = [
    "begun",
    "resumed",
    "sealed",
    "intent",
    "committed",
    "retried",
    "chosen",
    "ended",
    "paused",
    "stopped",
    "finished",
    "salvaged",
];

/// Result of salvaging a damaged journal.
#[derive(Clone, Debug, Serialize)]
pub struct Salvage {
    /// Entry in the new journal.
    #[serde(flatten)]
    pub salvaged: Salvaged,
    /// The first thousand damaged lines.
    pub lines: Vec<DamagedLine>,
    /// Condition of the session with the new journal.
    pub condition: Condition,
}

/// An unreadable line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DamagedLine {
    /// Line number in the file, from 1.
    pub line: usize,
    /// Length in bytes.
    pub bytes: u64,
    /// Reason why it is unreadable.
    pub problem: String,
    /// Kind of entry, if still recognisable.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub entry: Option<&'static str>,
    /// File name, if still recognisable.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
}

/// Replaces a damaged journal by its undamaged lines if `write` is set, and keeps the damaged one beside it. Frames,
/// `session.json` and `frames.json` are only read.
///
/// # Errors
/// `Input` for a folder that is no session, and for a session in use by another process. `Input` also for a journal
/// that is undamaged or has no undamaged line. `Output` if the system refuses.
pub fn salvage(folder: &Path, write: bool) -> Result<Salvage, Error> {
    let _lock = lock(folder).map_err(|e| match e.kind() {
        io::ErrorKind::WouldBlock => {
            Error::file(folder, "is being captured by another process", "wait for it or stop it")
        }
        _ => Error::file(&folder.join(SESSION_FILE), e, "give a folder that `nacre capture` made"),
    })?;
    let Scan { mut journal, mut text, lines, damaged, misplaced, lost } = scan(folder)?;
    if damaged == 0 && lost == 0 && misplaced == 0 {
        return Err(Error::file(folder, "has an undamaged journal", "`nacre check` says what else is wrong"));
    }
    if journal.len() == 0 {
        let remedy = "where frames.json is there, `nacre reconstruct` works without the journal";
        return Err(Error::file(folder, "has a journal without any undamaged line", remedy));
    }
    let finished = had_finished(folder, &journal, &condition(folder, &journal)?);
    let damaged_journal = spare_name(folder);
    let salvaged = Salvaged { damaged_journal, kept: journal.len(), damaged, lost, finished };
    let failed = |e: io::Error| Error::output(folder, e);
    text += &journal.line(Entry::Salvaged(salvaged.clone())).map_err(failed)?;
    if write {
        let path = folder.join(Journal::NAME);
        let beside = folder.join(&salvaged.damaged_journal);
        // Some file systems do not support hard links.
        std::fs::hard_link(&path, &beside).or_else(|_| std::fs::copy(&path, &beside).map(drop)).map_err(failed)?;
        write_whole(&RealDisk, folder, Journal::NAME, text.as_bytes()).map_err(failed)?;
    }
    Ok(Salvage { condition: condition(folder, &journal)?, salvaged, lines })
}

/// Reason why the plan, with the additions remaining in a salvaged journal, does not describe its frames; `None` if it
/// does.
pub(super) fn misfit(journal: &Journal, plan: &Plan) -> Option<String> {
    let steps = plan.steps_with(&journal.chosen());
    let angles: HashMap<&str, Option<f64>> = steps.iter().map(|s| (s.file.as_str(), s.state.analyser_deg)).collect();
    journal.commits().find_map(|commit| {
        let elsewhere = match (angles.get(commit.file.as_str()), commit.analyser_deg) {
            (None, _) => true,
            // An analyser at 180° is equivalent to one at 0°.
            (Some(Some(step)), Some(at)) => ((at - step + 90.0).rem_euclid(180.0) - 90.0).abs() > SAME_ANGLE_DEG,
            _ => false,
        };
        elsewhere.then(|| format!("the entry that added {} to the series is lost", commit.file))
    })
}

/// True if the capture had ended: its entry exists, or it is lost and the files prove it.
fn had_finished(folder: &Path, journal: &Journal, found: &Condition) -> bool {
    let says = |(_, entry): (_, &Entry)| matches!(entry, Entry::Finished(_));
    let all = found.planned > 0 && found.intact == found.planned;
    // frames.json is written after the last frame.
    let last = journal.timed().rev().find_map(|(_, entry)| match entry {
        Entry::Committed(_) => Some(false),
        Entry::Sealed { file, .. } if file == FRAMES_FILE => Some(true),
        _ => None,
    });
    let described = match seal(folder, journal, FRAMES_FILE) {
        Seal::Intact => last == Some(true),
        Seal::None => true,
        Seal::Broken | Seal::Missing => false,
    };
    journal.finished() || (!journal.timed().any(says) && all && described)
}

/// A file name not yet used in the folder.
fn spare_name(folder: &Path) -> String {
    let names = (1..).map(|k| if k == 1 { "journal.damaged".into() } else { format!("journal.damaged-{k}") });
    let mut free = names.filter(|name: &String| folder.join(name).symlink_metadata().is_err());
    free.next().unwrap_or_default()
}

/// Undamaged lines of a journal, and positions of the others.
#[derive(Default)]
struct Scan {
    journal: Journal,
    /// Undamaged lines with new sequence numbers.
    text: String,
    lines: Vec<DamagedLine>,
    damaged: usize,
    /// Number of undamaged lines that are duplicated, or whose sequence number, which no checksum covers, does not fit.
    misplaced: usize,
    lost: usize,
}

fn scan(folder: &Path) -> Result<Scan, Error> {
    let path = folder.join(Journal::NAME);
    let file = input::open(&path, MAX_DAMAGED).map_err(|e| match e {
        Unreadable::System(e) if error::is_out_of_files(&e) => Error::file(&path, e, error::OUT_OF_FILES),
        other => Error::file(&path, other, "where frames.json is there, `nacre reconstruct` works without the journal"),
    })?;
    let mut reader = BufReader::new(file);
    let mut scan = Scan::default();
    let (mut line, mut number) = (vec![], 0);
    let mut seen = HashSet::new();
    // Sequence numbers of the undamaged lines.
    let mut numbers = vec![];
    // Number of damaged lines since the last undamaged one.
    let mut trailing = 0;
    loop {
        let bytes = next_line(&mut reader, &mut line).map_err(|e| unreadable_journal(folder, &e))?;
        if bytes == 0 {
            break;
        }
        number += 1;
        let read = if bytes > MAX_LINE as u64 { Err("is longer than any entry") } else { parse(&line) };
        match read {
            Ok(read) if !seen.insert((read.seq, read.crc)) => scan.misplaced += 1,
            Ok(read) => {
                numbers.push(read.seq);
                trailing = 0;
                let text =
                    scan.journal.line_of(read.entry, read.time_ms).map_err(|e| unreadable_journal(folder, &e))?;
                scan.text += &text;
                if scan.text.len() as u64 > MAX_BYTES {
                    let problem = format!("has more than {MAX_BYTES} bytes of undamaged lines");
                    return Err(Error::file(&path, problem, "begin a new session"));
                }
            }
            Err(problem) => {
                trailing += 1;
                scan.damaged += 1;
                if scan.lines.len() < MAX_LISTED {
                    scan.lines.push(damaged_line(number, bytes, problem, &line));
                }
            }
        }
    }
    let (lost, misnumbered) = gaps(&numbers);
    scan.lost = lost + trailing;
    scan.misplaced += misnumbered;
    Ok(scan)
}

/// Number of missing sequence numbers, and number of misplaced ones.
fn gaps(numbers: &[usize]) -> (usize, usize) {
    let (mut lost, mut misnumbered, mut expected) = (0, 0, 0);
    for (k, number) in numbers.iter().enumerate() {
        // A number after a gap is correct if the next one continues from it.
        let goes_on = || numbers.get(k + 1).is_none_or(|next| next > number);
        if *number == expected || (*number > expected && goes_on()) {
            lost += number - expected;
            expected = number + 1;
        } else {
            misnumbered += 1;
            expected += 1;
        }
    }
    (lost, misnumbered)
}

/// Reads a line; returns its length in bytes including its end, 0 at the end of the file. `line` receives at most its
/// first [`MAX_LINE`] bytes.
fn next_line(reader: &mut impl BufRead, line: &mut Vec<u8>) -> io::Result<u64> {
    line.clear();
    let mut bytes = 0;
    loop {
        let here = reader.fill_buf()?;
        let end = here.iter().position(|byte| *byte == b'\n');
        let used = end.map_or(here.len(), |end| end + 1);
        line.extend_from_slice(&here[..used.min(MAX_LINE - line.len())]);
        reader.consume(used);
        bytes += used as u64;
        if end.is_some() || used == 0 {
            return Ok(bytes);
        }
    }
}

fn damaged_line(line: usize, bytes: u64, problem: &str, contents: &[u8]) -> DamagedLine {
    let text = String::from_utf8_lossy(contents);
    let entry = NAMES.into_iter().find(|name| text.contains(&format!("\"{name}\"")));
    let named = text.split_once("\"file\":\"").and_then(|(_, rest)| rest.split_once('"')).map(|(name, _)| name);
    let plain = |name: &&str| name.len() < 64 && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"/._".contains(&b));
    DamagedLine { line, bytes, problem: problem.into(), entry, file: named.filter(plain).map(str::to_owned) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_and_wrong_numbers_are_distinguished() {
        for (numbers, expected) in [
            (&[0, 1, 2, 3][..], (0, 0)),
            (&[1, 2, 3], (1, 0)),
            (&[0, 1, 5, 6], (3, 0)),
            // One digit was decreased or increased.
            (&[0, 1, 0, 3], (0, 1)),
            (&[0, 1, 9, 3], (0, 1)),
            (&[8, 1, 2], (0, 1)),
            (&[], (0, 0)),
        ] {
            assert_eq!(gaps(numbers), expected, "{numbers:?}");
        }
    }

    #[test]
    fn lines_are_read_to_their_limit() {
        let text = [&b"one\n\n"[..], &vec![b'x'; 3 * MAX_LINE], b"\nlast"].concat();
        let mut reader = BufReader::new(&text[..]);
        let mut line = vec![];
        let mut lengths = vec![];
        loop {
            let bytes = next_line(&mut reader, &mut line).unwrap();
            lengths.push((bytes as usize, line.len()));
            if bytes == 0 {
                break;
            }
        }
        assert_eq!(lengths, [(4, 4), (1, 1), (3 * MAX_LINE + 1, MAX_LINE), (4, 4), (0, 0)]);
    }
}
