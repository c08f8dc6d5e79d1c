//! One session as the catalogue knows it.

use nacre_base::Error;
use nacre_capture::naming;
use nacre_capture::plan::word;
use nacre_capture::session::{Journal, SESSION_FILE, SessionFile, sha256, unreadable_journal};
use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};
use std::io;
use std::path::Path;

/// Deepest folder whose files count into a session's size.
const MAX_DEPTH: usize = 8;

/// What the catalogue keeps of a session.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SessionRow {
    /// Made from the folder's path, so that it outlives a rebuild.
    pub id: String,
    /// Canonical path of the session folder.
    pub folder: String,
    /// Name of the session: given, or derived from its plan.
    pub name: String,
    /// What lay on the table.
    pub sample: String,
    /// Who measured.
    pub operator: String,
    /// Anything else.
    pub notes: String,
    /// What the plan varied, as plans write it.
    pub kind: String,
    /// How far the session came.
    pub state: State,
    /// Frames that the plan asks for.
    pub frames_planned: u32,
    /// Those of them that the journal records.
    pub frames_committed: u32,
    /// When the session began, in Unix seconds.
    pub created: i64,
    /// Size of all files in the folder.
    pub bytes: u64,
}

/// How far a session came.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// It ran to its end.
    Finished,
    /// It ended early, and the journal says why.
    Stopped,
    /// It is still running, or was killed.
    Unfinished,
}

impl SessionRow {
    /// Reads a session folder; its frames are not looked at.
    ///
    /// # Errors
    /// `Input` when it is no session folder or a file in it is damaged.
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

    /// Stores the row unless there is one of this session.
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

/// Size of the files in a folder, links not followed. A running capture renames its files, so a vanished one is no error.
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
