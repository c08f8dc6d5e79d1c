//! `nacre check`: is a session folder complete, and are its files what the journal says?

use super::{Journal, SESSION_FILE, SeriesEnd, SessionFile, sha256};
use nacre_processing::Error;
use serde::Serialize;
use std::path::Path;

/// State of a session folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Condition {
    /// Frames that the plan asks for.
    pub planned: usize,
    /// Frames that are there, whole and as recorded.
    pub intact: usize,
    /// The capture ran to its end.
    pub finished: bool,
    /// How a series that ends by its σ has ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<SeriesEnd>,
    /// What is wrong with the rest.
    pub trouble: Vec<Trouble>,
}

/// One file that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Trouble {
    /// The file.
    pub file: String,
    /// What is wrong.
    pub problem: String,
}

/// Checks a session folder without changing it.
///
/// # Errors
/// `Input` when it is no session folder or its journal is damaged.
pub fn check(folder: &Path) -> Result<Condition, Error> {
    let bad = |path: &Path, problem: String| {
        Error::file(path, problem, "give a folder that `nacre capture` made; its frames may still be whole")
    };
    let path = folder.join(SESSION_FILE);
    let session = SessionFile::read(folder).map_err(|e| bad(&path, e.to_string()))?;
    let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| bad(folder, e.to_string()))?;
    let (finished, ended) = (journal.finished(), journal.ended());
    let mut condition = Condition { planned: 0, intact: 0, finished, ended, trouble: vec![] };
    for step in session.plan.steps_with(&journal.chosen()) {
        condition.planned += 1;
        let problem = match (journal.commit(&step.file), std::fs::read(folder.join(&step.file))) {
            (None, _) => Some("was not taken yet".to_owned()),
            (Some(_), Err(e)) => Some(format!("is recorded, but cannot be read: {e}")),
            (Some(c), Ok(bytes)) if sha256(&bytes) != c.sha256 => Some("differs from its recorded checksum".to_owned()),
            _ => None,
        };
        match problem {
            Some(problem) => condition.trouble.push(Trouble { file: step.file, problem }),
            None => condition.intact += 1,
        }
    }
    if condition.finished && !folder.join(nacre_processing::frames::FILE_NAME).exists() {
        let file = nacre_processing::frames::FILE_NAME.to_owned();
        condition.trouble.push(Trouble { file, problem: "is missing".into() });
    }
    Ok(condition)
}
