//! Modified session files, and sessions of versions that recorded less.

use super::{Commit, Entry, Journal, RealDisk, SESSION_FILE, Session, SessionFile, Setup, Timing, check, salvage};
use crate::plan::Added;
use nacre_base::Version;
use nacre_frames::FILE_NAME as FRAMES_FILE;
use std::path::Path;

fn description() -> SessionFile {
    SessionFile {
        version: Version,
        software: "test".into(),
        created: 0,
        setup: Setup::default(),
        plan: toml::from_str("kind = \"polarization\"\nanalyser = { angles_deg = [0, 60, 120] }").unwrap(),
        devices: vec![],
        exposure_s: 0.01,
        bench: None,
        section: None,
        mounting: None,
        calibration: None,
        warnings: vec![],
    }
}

fn take(session: &mut Session<RealDisk>, frames_json: &str) {
    for step in description().plan.steps() {
        if !session.has(&step.file) {
            session.store(&step.file, step.file.as_bytes(), Commit::default()).unwrap();
        }
    }
    session.finish(frames_json, Timing::default()).unwrap();
}

fn complete(folder: &Path) {
    take(&mut Session::create(RealDisk, folder, &description(), None).unwrap(), "{ \"frames\": [1, 2, 3] }");
    assert!(check(folder).unwrap().is_complete());
}

#[test]
fn any_changed_byte_is_seen_and_refused() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("s");
    complete(&folder);
    for file in [SESSION_FILE, FRAMES_FILE] {
        let whole = std::fs::read(folder.join(file)).unwrap();
        let one_changed = (0..whole.len()).map(|at| {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            bytes
        });
        for bytes in one_changed.chain([vec![], whole[1..].to_vec(), [&whole[..], b"\n"].concat()]) {
            std::fs::write(folder.join(file), &bytes).unwrap();
            let condition = check(&folder).unwrap();
            assert_eq!(condition.changed(), Some(file), "{condition:?}");
            assert_eq!((condition.planned, condition.intact, condition.is_complete()), (3, 3, false));
            let refused = Session::open(RealDisk, &folder).err().unwrap();
            assert!(
                refused.kind() == std::io::ErrorKind::InvalidData && refused.to_string().contains(file),
                "{refused}"
            );
        }
        std::fs::write(folder.join(file), whole).unwrap();
    }
    assert!(check(&folder).unwrap().is_complete());
}

/// A frame captured again may have another exposure, which `frames.json` must state.
#[test]
fn frames_json_is_written_anew_after_a_frame_was_taken_again() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("s");
    complete(&folder);
    let frame = description().plan.steps().remove(1).file;
    std::fs::remove_file(folder.join(&frame)).unwrap();
    let mut session = Session::open(RealDisk, &folder).unwrap();
    session.store(&frame, frame.as_bytes(), Commit::default()).unwrap();
    // Interrupted once more, after the file was written and before the journal records it.
    std::fs::write(folder.join(FRAMES_FILE), "{ \"frames\": [1, 4, 3] }").unwrap();
    drop(session);
    assert!(!check(&folder).unwrap().finished);
    take(&mut Session::open(RealDisk, &folder).unwrap(), "{ \"frames\": [1, 4, 3] }");
    assert!(check(&folder).unwrap().is_complete());
}

/// Rewrites a journal in the format of older versions: without times and checksums of files.
fn age(folder: &Path) {
    let path = folder.join(Journal::NAME);
    let (journal, _) = Journal::read(&path).unwrap();
    let entries = journal.timed().map(|(_, entry)| entry).filter(|e| !matches!(e, Entry::Sealed { .. }));
    let line = |(seq, entry): (usize, &Entry)| {
        let json = serde_json::to_string(entry).unwrap();
        format!("{{\"seq\":{seq},\"crc\":{},\"entry\":{json}}}\n", crc32fast::hash(json.as_bytes()))
    };
    std::fs::write(path, entries.enumerate().map(line).collect::<String>()).unwrap();
}

#[test]
fn sessions_of_older_versions_are_checked_and_resumed() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("s");
    complete(&folder);
    age(&folder);
    let condition = check(&folder).unwrap();
    assert!(condition.is_complete(), "{condition:?}");
    assert_eq!(condition.unverified, [SESSION_FILE, FRAMES_FILE]);
    std::fs::remove_file(folder.join(FRAMES_FILE)).unwrap();
    assert_eq!(check(&folder).unwrap().trouble[0].file, FRAMES_FILE);
    // From now on, checksums are recorded.
    take(&mut Session::open(RealDisk, &folder).unwrap(), "{}");
    let condition = check(&folder).unwrap();
    assert!(condition.is_complete() && condition.unverified.is_empty(), "{condition:?}");
}

/// A process that ended before it recorded the checksum.
#[test]
fn a_session_without_a_checksum_yet_gets_one() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("s");
    drop(Session::create(RealDisk, &folder, &description(), None).unwrap());
    age(&folder);
    drop(Session::open(RealDisk, &folder).unwrap());
    let (journal, _) = Journal::read(&folder.join(Journal::NAME)).unwrap();
    assert!(journal.sealed(SESSION_FILE).is_some());
}

/// Rewrites a journal without some of its lines, and salvages it.
fn lose(folder: &Path, lost: impl Fn(&str) -> bool) {
    let path = folder.join(Journal::NAME);
    let text = std::fs::read_to_string(&path).unwrap();
    let kept: String = text.split_inclusive('\n').filter(|line| !lost(line)).collect();
    let count = text.lines().count() - kept.lines().count();
    std::fs::write(path, kept).unwrap();
    assert!(count > 0 && salvage(folder, true).unwrap().salvaged.lost == count);
}

/// Angles added to a series determine the meaning of its frames: without them, no frame may be captured under another's
/// name.
#[test]
fn a_series_whose_added_angles_are_lost_is_refused() {
    let home = tempfile::tempdir().unwrap();
    let plan = "kind = \"polarization\"\nanalyser = { until_sigma_deg = 0.1, at_most = 9 }";
    let description = SessionFile { plan: toml::from_str(plan).unwrap(), ..description() };
    let first = description.plan.steps().len();
    let last = format!("frames/{:04}.png", first + 2);
    let is_first_angle = |line: &str| line.contains("\"chosen\"") && line.contains("31.0");
    let of_last = |line: &str| line.contains("\"committed\"") && line.contains(&last);
    let any = |line: &str| line.contains("\"intent\"") && line.contains("0001.png");
    for (name, lost, fits) in [
        ("an angle", &is_first_angle as &dyn Fn(&str) -> bool, false),
        ("an angle and a frame", &|line: &str| is_first_angle(line) || of_last(line), false),
        ("the last frame", &of_last, true),
        ("an intent", &any, true),
    ] {
        let folder = home.path().join(name);
        let mut session = Session::create(RealDisk, &folder, &description, None).unwrap();
        let mut chosen = vec![];
        for k in 0..first + 3 {
            if k >= first {
                let added = Added::Angle { analyser_deg: 31.0 + 7.0 * (k - first) as f64 };
                chosen.push(added);
                session.record(Entry::Chosen { added, sigma_deg: Some(1.0), undecided: None }).unwrap();
            }
            let step = &description.plan.steps_with(&chosen)[k];
            let commit = Commit { analyser_deg: step.state.analyser_deg.map(|a| a + 0.02), ..Commit::default() };
            session.store(&step.file, b"frame", commit).unwrap();
        }
        session.record(Entry::Paused).unwrap();
        drop(session);
        lose(&folder, lost);
        let journal = std::fs::read(folder.join(Journal::NAME)).unwrap();
        match Session::open(RealDisk, &folder) {
            Ok(_) => assert!(fits, "{name}"),
            Err(refused) => {
                assert!(!fits && refused.to_string().contains("frames/"), "{name}: {refused}");
                assert!(check(&folder).unwrap().trouble.iter().any(|t| t.file == Journal::NAME), "{name}");
                assert_eq!(std::fs::read(folder.join(Journal::NAME)).unwrap(), journal, "nothing is touched");
            }
        }
    }
}
