//! `nacre check`: completeness of a session folder, and agreement of its files with the journal.

use super::salvage::misfit;
use super::{BROKEN, Journal, MAX_FRAME, SESSION_FILE, Salvaged, Seal, SeriesEnd, SessionFile};
use super::{seal, sealed_files, sha256, unreadable_journal};
use nacre_base::{Error, input};
use nacre_frames::FILE_NAME as FRAMES_FILE;
use serde::Serialize;
use std::path::Path;

/// Condition of a session folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Condition {
    /// Number of planned frames.
    pub planned: usize,
    /// Number of frames that exist and match their checksum.
    pub intact: usize,
    /// True if the capture is finished.
    pub finished: bool,
    /// End of an adaptive series.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<SeriesEnd>,
    /// Problems with other files.
    pub trouble: Vec<Trouble>,
    /// Salvage of the journal, if it was damaged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub salvaged: Option<Salvaged>,
    /// Files without recorded checksums, in sessions of older versions and salvaged ones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unverified: Vec<&'static str>,
    /// True if requested results are missing.
    #[serde(skip)]
    lacks_results: bool,
}

/// A problem with one file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Trouble {
    /// File name.
    pub file: String,
    /// Problem.
    pub problem: String,
}

impl Condition {
    /// The first of `session.json` and `frames.json` that differs from its checksum.
    pub fn changed(&self) -> Option<&str> {
        let described = |t: &&Trouble| [SESSION_FILE, FRAMES_FILE].contains(&t.file.as_str()) && t.problem == BROKEN;
        self.trouble.iter().find(described).map(|t| t.file.as_str())
    }

    /// True if nothing remains to be captured or computed.
    pub fn is_complete(&self) -> bool {
        self.finished && self.trouble.is_empty() && !self.lacks_results
    }
}

/// Checks a session folder without changing it.
///
/// # Errors
/// `Input` if it is no session folder or its journal is damaged.
pub fn check(folder: &Path) -> Result<Condition, Error> {
    let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| unreadable_journal(folder, &e))?;
    condition(folder, &journal)
}

/// Condition of a session folder with this journal.
pub(super) fn condition(folder: &Path, journal: &Journal) -> Result<Condition, Error> {
    let remedy = "give a folder that `nacre capture` made; its frames may still be whole";
    // A modified plan no longer describes the frames.
    let plan = match seal(folder, journal, SESSION_FILE) {
        Seal::Broken | Seal::Missing if journal.len() > 0 => None,
        _ => Some(SessionFile::read(folder).map_err(|e| Error::file(&folder.join(SESSION_FILE), e, remedy))?.plan),
    };
    let files: Vec<String> = match &plan {
        Some(plan) => plan.steps_with(&journal.chosen()).into_iter().map(|step| step.file).collect(),
        None => journal.files(),
    };
    let mut condition = Condition {
        planned: files.len(),
        intact: 0,
        finished: journal.finished(),
        ended: journal.ended(),
        trouble: vec![],
        salvaged: journal.salvaged().cloned(),
        unverified: vec![],
        lacks_results: plan.as_ref().is_some_and(|p| p.reconstruct.is_some())
            && !folder.join("results/report.json").exists(),
    };
    let trouble = |file: &str, problem: &str| Trouble { file: file.into(), problem: problem.into() };
    if let Some(problem) = plan.filter(|_| journal.salvaged().is_some()).and_then(|plan| misfit(journal, &plan)) {
        condition.trouble.push(trouble(Journal::NAME, &problem));
    }
    for file in sealed_files(journal) {
        match seal(folder, journal, file) {
            Seal::Intact => {}
            Seal::Broken => condition.trouble.push(trouble(file, BROKEN)),
            Seal::Missing => condition.trouble.push(trouble(file, "is missing")),
            Seal::None => condition.unverified.push(file),
        }
    }
    for file in files {
        let path = folder.join(&file);
        let problem = match journal.commit(&file).map(|commit| (commit, input::read(&path, MAX_FRAME))) {
            None if path.exists() => Some("is there, but the journal does not record it".to_owned()),
            None => Some("was not taken yet".to_owned()),
            Some((_, Err(e))) => Some(format!("is recorded, but {e}")),
            Some((commit, Ok(bytes))) if sha256(&bytes) != commit.sha256 => Some(BROKEN.to_owned()),
            Some(_) => None,
        };
        match problem {
            Some(problem) => condition.trouble.push(Trouble { file, problem }),
            None => condition.intact += 1,
        }
    }
    Ok(condition)
}
