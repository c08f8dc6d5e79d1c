//! Catalogue: a searchable index of session folders. The folders are authoritative; the catalogue can be deleted and
//! rebuilt from them at any time.

mod row;
mod search;
mod survey;

pub use row::{SessionRow, State};
pub use search::{Cursor, Page, Query};
pub use survey::DELETED_FILE;

use crate::sqlite::{self, BUSY, CORRUPT, ERROR, NOT_A_DATABASE, is_new, primary_code};
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use serde::Serialize;
use sqlx::Connection;
use sqlx::sqlite::{SqliteConnectOptions, SqlitePool, SqliteSynchronous};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// SQLite application id of a catalogue ("Nacr"); the same number is in `SCHEMA`.
const APPLICATION: i64 = 0x4e61_6372;
const VERSION: i64 = 1;
/// `seq` grows with every change of a row and is never reused; `id` is derived from the folder and survives a rebuild.
const SCHEMA: &str = "
    CREATE TABLE session (
        seq INTEGER PRIMARY KEY AUTOINCREMENT,
        id TEXT NOT NULL UNIQUE,
        folder TEXT NOT NULL,
        name TEXT NOT NULL,
        sample TEXT NOT NULL,
        operator TEXT NOT NULL,
        notes TEXT NOT NULL,
        kind TEXT NOT NULL,
        state TEXT NOT NULL,
        frames_planned INTEGER NOT NULL,
        frames_committed INTEGER NOT NULL,
        created INTEGER NOT NULL,
        bytes INTEGER NOT NULL,
        words TEXT NOT NULL
    ) STRICT;
    CREATE INDEX session_newest ON session (created, id);
    PRAGMA application_id = 0x4e616372;
    PRAGMA user_version = 1;";
const REBUILD: &str = "give another --catalogue, or delete it and run `nacre catalogue rebuild DIR`";

/// An open catalogue. Several processes can use it at the same time.
pub struct Catalogue {
    path: PathBuf,
    pool: SqlitePool,
}

/// Result of a rebuild.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Rebuilt {
    /// Number of sessions in the catalogue.
    pub sessions: usize,
    /// Omitted folders, with reasons.
    pub warnings: Vec<String>,
}

impl Catalogue {
    /// Opens a catalogue; creates it and its folder if missing.
    ///
    /// # Errors
    /// `Input` when the file is not a catalogue of this version; `Output` when it cannot be created or used.
    pub async fn open(path: &Path) -> Result<Self, Error> {
        // An absolute path cannot be one of SQLite's special names, such as `:memory:`.
        let path = std::path::absolute(path).map_err(|e| Error::file(path, e, "give another --catalogue"))?;
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(|e| unusable(&path, e))?;
        }
        let options = sqlite::options(&path).synchronous(SqliteSynchronous::Normal);
        let catalogue = Self { path, pool: sqlite::pool().connect_lazy_with(options) };
        catalogue.prepare().await?;
        Ok(catalogue)
    }

    /// A catalogue in memory, while a full disk prevents a file.
    ///
    /// # Errors
    /// `Output` when memory is exhausted.
    pub async fn in_memory() -> Result<Self, Error> {
        let options = SqliteConnectOptions::new().in_memory(true);
        // The database exists only in its connection, so there is a single one, which stays open.
        let pool = sqlite::pool().max_connections(1).idle_timeout(None).max_lifetime(None);
        let catalogue = Self { path: "catalogue in memory".into(), pool: pool.connect_lazy_with(options) };
        catalogue.prepare().await?;
        Ok(catalogue)
    }

    /// Creates the tables in a new file and refuses other files.
    async fn prepare(&self) -> Result<(), Error> {
        let end = Instant::now() + sqlite::PATIENCE;
        let (application, version) = loop {
            match self.make_tables().await {
                // SQLite does not wait for the lock that the change to WAL needs.
                Err(e) if primary_code(&e) == Some(BUSY) && Instant::now() < end => {
                    tokio::time::sleep(Duration::from_millis(20)).await;
                }
                other => break other.map_err(|e| self.fault(e))?,
            }
        };
        match (application, version) {
            (APPLICATION, VERSION) => Ok(()),
            (APPLICATION, v) => {
                let problem = format!("has version {v} of the catalogue; this program reads version {VERSION}");
                Err(Error::file(&self.path, problem, REBUILD))
            }
            _ => Err(Error::file(&self.path, "is the database of another program", REBUILD)),
        }
    }

    /// Creates the tables in a new file; returns the file's application id and version.
    async fn make_tables(&self) -> sqlx::Result<(i64, i64)> {
        let mut connection = self.pool.acquire().await?;
        if is_new(&mut connection).await? {
            sqlx::raw_sql("PRAGMA journal_mode = WAL").execute(&mut *connection).await?;
            let mut transaction = connection.begin_with("BEGIN IMMEDIATE").await?;
            // Another process may have created them meanwhile.
            if is_new(&mut transaction).await? {
                sqlx::raw_sql(SCHEMA).execute(&mut *transaction).await?;
            }
            transaction.commit().await?;
        }
        let header = "SELECT application_id, user_version FROM pragma_application_id, pragma_user_version";
        sqlx::query_as(header).fetch_one(&mut *connection).await
    }

    /// Adds or replaces a session.
    ///
    /// # Errors
    /// `Input` when the catalogue is damaged, `Output` when it cannot be written.
    pub async fn put(&self, row: &SessionRow) -> Result<(), Error> {
        self.try_put(row).await.map_err(|e| self.fault(e))
    }

    async fn try_put(&self, row: &SessionRow) -> sqlx::Result<()> {
        let mut transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
        sqlx::query("DELETE FROM session WHERE id = ?1").bind(&row.id).execute(&mut *transaction).await?;
        row.insert(&mut transaction).await?;
        transaction.commit().await
    }

    /// Replaces the whole catalogue by the sessions under these folders, at most eight levels deep.
    ///
    /// Symbolic links are not followed. Sessions that are added meanwhile are kept. If it fails, the catalogue is
    /// unchanged.
    ///
    /// # Errors
    /// `Input` when a root is not a folder or the catalogue is damaged, `Output` when it cannot be written,
    /// `Cancelled`.
    pub async fn rebuild(&self, roots: &[PathBuf], progress: &dyn Progress) -> Result<Rebuilt, Error> {
        let newest = sqlx::query_scalar("SELECT COALESCE(MAX(seq), 0) FROM session").fetch_one(&self.pool);
        let newest: i64 = newest.await.map_err(|e| self.fault(e))?;
        let (sessions, warnings) = survey::survey(roots, progress).await?;
        self.replace(newest, &sessions).await.map_err(|e| self.fault(e))?;
        Ok(Rebuilt { sessions: sessions.len(), warnings })
    }

    /// Replaces all rows up to `newest`.
    async fn replace(&self, newest: i64, sessions: &[SessionRow]) -> sqlx::Result<()> {
        let mut transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
        sqlx::query("DELETE FROM session WHERE seq <= ?1").bind(newest).execute(&mut *transaction).await?;
        for row in sessions {
            row.insert(&mut transaction).await?;
        }
        transaction.commit().await
    }

    /// Removes a session.
    ///
    /// # Errors
    /// `Input` when the catalogue is damaged, `Output` when it cannot be written.
    pub async fn remove(&self, id: &str) -> Result<(), Error> {
        let removed = sqlx::query("DELETE FROM session WHERE id = ?1").bind(id).execute(&self.pool).await;
        removed.map(drop).map_err(|e| self.fault(e))
    }

    /// Waits until everything is stored and closes the file.
    pub async fn close(&self) {
        self.pool.close().await;
    }

    /// Converts an SQLite error into one for the user.
    fn fault(&self, error: sqlx::Error) -> Error {
        match (primary_code(&error), &error) {
            // The statements are fixed, so an error in one of them means an unexpected table.
            (Some(ERROR | CORRUPT | NOT_A_DATABASE), _) | (_, sqlx::Error::ColumnDecode { .. }) => {
                Error::file(&self.path, format!("is no intact catalogue: {error}"), REBUILD)
            }
            _ => unusable(&self.path, sqlite::cause(&self.path, error)),
        }
    }
}

fn unusable(path: &Path, source: io::Error) -> Error {
    let remedy = sqlite::remedy(&source, "check the disk, or give another place with --catalogue");
    Error::Output { path: path.into(), source, remedy }
}

/// Default path of the catalogue: `NACRE_CATALOGUE`, or else a file in the user's data folder.
///
/// # Errors
/// `Input` when the environment names no such folder.
pub fn default_path() -> Result<PathBuf, Error> {
    let set = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let data = || set("XDG_DATA_HOME").filter(|path| path.is_absolute());
    let home = || Some(set("HOME")?.join(".local/share"));
    set("NACRE_CATALOGUE")
        .or_else(|| Some(data().or_else(home)?.join("nacre/catalogue.db")))
        .ok_or_else(|| Error::input("catalogue", "has no place, as HOME is not set", "set NACRE_CATALOGUE"))
}

/// Opens a catalogue for one piece of work, on a new runtime. Do not call it from asynchronous code.
///
/// # Errors
/// Those of the catalogue and the work.
pub fn with_catalogue<T>(path: &Path, work: impl AsyncFnOnce(&Catalogue) -> Result<T, Error>) -> Result<T, Error> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .build()
        .map_err(|e| Error::input("tokio", format!("cannot start: {e}"), "free some memory"))?;
    runtime.block_on(async {
        let catalogue = Catalogue::open(path).await?;
        let result = work(&catalogue).await;
        catalogue.close().await;
        result
    })
}

/// Adds a session to the default catalogue. Do not call it from asynchronous code.
///
/// # Errors
/// Those of reading the session and of writing the catalogue; the session itself is not changed.
pub fn note_session(folder: &Path) -> Result<(), Failure> {
    let row = SessionRow::read(folder)?;
    with_catalogue(&default_path()?, async |catalogue| catalogue.put(&row).await)?;
    Ok(())
}
