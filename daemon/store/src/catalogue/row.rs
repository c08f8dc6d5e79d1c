//! A session as stored in the catalogue.

use nacre_base::Error;
use nacre_capture::naming;
use nacre_capture::plan::word;
use nacre_capture::session::{Journal, SESSION_FILE, SessionFile, sha256, unreadable_journal};
use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};
use std::io;
use std::path::Path;

/// Levels of folders whose files count towards a session's size.
const MAX_DEPTH: usize = 8;

/// Entry of the catalogue.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SessionRow {
    /// Derived from the folder's path, so that it survives a rebuild.
    pub id: String,
    /// Canonical path of the session folder.
    pub folder: String,
    /// Name of the session: given, or derived from its plan.
    pub name: String,
    /// Name of the sample.
    pub sample: String,
    /// Name of the operator.
    pub operator: String,
    /// Free text.
    pub notes: String,
    /// Kind of plan, in the spelling of plans.
    pub kind: String,
    /// State of the session.
    pub state: State,
    /// Frames that the plan asks for.
    pub frames_planned: u32,
    /// Number of planned frames that the journal records.
    pub frames_committed: u32,
    /// Start of the session in Unix seconds.
    pub created: i64,
    /// Size of all files in the folder, in bytes.
    pub bytes: u64,
}

/// State of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Completed.
    Finished,
    /// Ended early; the journal gives the reason.
    Stopped,
    /// Still running, or killed.
    Unfinished,
}

impl SessionRow {
    /// Reads a session folder without its frames.
    ///
    /// # Errors
    /// `Input` when it is not a session folder or a file in it is damaged.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let bad = |path: &Path, problem: io::Error| {
            Error::file(path, problem, "give a folder that `nacre capture` made; its frames may still be whole")
        };
        let folder = folder.canonicalize().map_err(|e| bad(folder, e))?;
        let Some(text) = folder.to_str() else {
            return Err(Error::file(&folder, "has a path that is no UTF-8", "rename the folder"));
        };
        let session = SessionFile::read(&folder).map_err(|e| bad(&folder.join(SESSION_FILE), e))?;
        let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| unreadable_journal(&folder, &e))?;
        let steps = session.plan.steps_with(&journal.chosen());
        let taken = steps.iter().filter(|s| journal.commit(&s.file).is_some()).count();
        Ok(Self {
            id: sha256(text.as_bytes()).chars().take(16).collect(),
            folder: text.to_owned(),
            kind: word(session.plan.kind),
            state: match (journal.finished(), journal.stopped()) {
                (true, _) => State::Finished,
                (false, true) => State::Stopped,
                (false, false) => State::Unfinished,
            },
            frames_planned: journal.planned(&session.plan)[1] as u32,
            frames_committed: taken as u32,
            created: i64::try_from(session.created).unwrap_or(i64::MAX),
            bytes: size(&folder, 0).map_err(|e| bad(&folder, e))?,
            name: naming::of_session(&folder, &session.plan),
            sample: session.plan.sample,
            operator: session.plan.operator,
            notes: session.plan.notes,
        })
    }

    /// Stores the row unless this session already has one.
    pub(super) async fn insert(&self, connection: &mut SqliteConnection) -> sqlx::Result<()> {
        let searched = [&self.name, &self.sample, &self.operator, &self.notes, &self.folder];
        let words: Vec<String> = searched.iter().map(|text| text.to_lowercase()).collect();
        sqlx::query(
            "INSERT OR IGNORE INTO session (id, folder, name, sample, operator, notes, kind, state, frames_planned,
             frames_committed, created, bytes, words) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13)",
        )
        .bind(&self.id)
        .bind(&self.folder)
        .bind(&self.name)
        .bind(&self.sample)
        .bind(&self.operator)
        .bind(&self.notes)
        .bind(&self.kind)
        .bind(word(self.state))
        .bind(self.frames_planned)
        .bind(self.frames_committed)
        .bind(self.created)
        .bind(self.bytes as i64)
        .bind(words.join("\n"))
        .execute(connection)
        .await?;
        Ok(())
    }

    pub(super) fn from_sql(row: &SqliteRow) -> sqlx::Result<Self> {
        let state: String = row.try_get("state")?;
        let state = serde_json::from_value(state.into())
            .map_err(|e| sqlx::Error::ColumnDecode { index: "state".into(), source: e.into() })?;
        Ok(Self {
            id: row.try_get("id")?,
            folder: row.try_get("folder")?,
            name: row.try_get("name")?,
            sample: row.try_get("sample")?,
            operator: row.try_get("operator")?,
            notes: row.try_get("notes")?,
            kind: row.try_get("kind")?,
            state,
            frames_planned: row.try_get("frames_planned")?,
            frames_committed: row.try_get("frames_committed")?,
            created: row.try_get("created")?,
            bytes: row.try_get::<i64, _>("bytes")? as u64,
        })
    }
}

/// Size of the files in a folder in bytes, without following links. A running capture renames its files, so a vanished
/// one is no error.
fn size(folder: &Path, depth: usize) -> io::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let counted = entry.metadata().and_then(|m| match m.is_dir() {
            true if depth < MAX_DEPTH => size(&entry.path(), depth + 1),
            true => Ok(0),
            false => Ok(m.len()),
        });
        match counted {
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            other => bytes += other?,
        }
    }
    Ok(bytes)
}
