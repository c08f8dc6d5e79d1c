//! Database access: jobs in `nacre_job`, deliveries in the tables of `apalis`.

use super::order;
use super::record::Record;
use super::row::{append, job, read};
use super::{Job, JobState, Refusal, Saved, Spec};
use crate::sqlite::{self, CORRUPT, ERROR, NOT_A_DATABASE, is_new, primary_code};
use apalis::prelude::{TaskBuilder, TaskId};
use apalis_sqlite::{SqliteStorage, queries::push_tasks};
use nacre_base::Error;
use sqlx::migrate::MigrateError;
use sqlx::sqlite::{SqlitePool, SqliteSynchronous};
use sqlx::{Connection, SqliteConnection};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use ulid::{Generator, Ulid};

/// Name of our deliveries in the tables of `apalis`.
pub(super) const QUEUE: &str = "nacre";
/// SQLite application id of a job queue ("NacJ"); the same number is in `SCHEMA`.
const APPLICATION: i64 = 0x4e61_634a;
const VERSION: i64 = 1;
const SCHEMA: &str = "
    CREATE TABLE nacre_job (
        id TEXT PRIMARY KEY,
        spec TEXT NOT NULL,
        state TEXT NOT NULL,
        attempts INTEGER NOT NULL,
        progress REAL NOT NULL,
        stage TEXT NOT NULL,
        error TEXT,
        cancel INTEGER NOT NULL,
        log TEXT NOT NULL DEFAULT '',
        turn INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE INDEX nacre_job_open ON nacre_job (state, id);
    PRAGMA application_id = 0x4e61634a;
    PRAGMA user_version = 1;";
pub(super) const COLUMNS: &str = "id, spec, state, attempts, progress, stage, error, cancel";
/// Attempts of a delivery: unlimited, until the database lets the job begin.
const ALWAYS: usize = i32::MAX as usize;
pub(super) const AWAY: &str = "move it away; the queue then begins empty";

pub(super) struct Store {
    path: PathBuf,
    pool: SqlitePool,
    /// Increasing ids of deliveries.
    ids: Mutex<Generator>,
}

impl Store {
    /// Opens the file, and creates missing tables.
    pub async fn open(path: &Path) -> Result<Self, Error> {
        // Full synchronization, since a queue cannot be rebuilt, unlike the catalogue.
        let options = sqlite::options(path).synchronous(SqliteSynchronous::Full);
        let pool = sqlite::pool().connect_lazy_with(options);
        let store = Self { path: path.into(), pool, ids: Mutex::new(Generator::new()) };
        match store.make_tables().await.map_err(|e| store.fault(e))? {
            (APPLICATION, VERSION) => {}
            (APPLICATION, v) => {
                let problem = format!("has version {v} of the job queue; this program reads version {VERSION}");
                return Err(Error::file(path, problem, AWAY));
            }
            _ => return Err(Error::file(path, "is the database of another program", AWAY)),
        }
        let damage: String =
            sqlx::query_scalar("PRAGMA quick_check(1)").fetch_one(&store.pool).await.map_err(|e| store.fault(e))?;
        if damage != "ok" {
            return Err(Error::file(path, format!("is no intact job queue: {damage}"), AWAY));
        }
        // `setup()` would also turn off waiting for the disk.
        SqliteStorage::migrations().run(&store.pool).await.map_err(|e| match e {
            MigrateError::Execute(e) | MigrateError::ExecuteMigration(e, _) => store.fault(e),
            other => Error::file(path, format!("has deliveries of another version: {other}"), AWAY),
        })?;
        Ok(store)
    }

    /// Creates our tables in a new file; returns the file's application id and version.
    async fn make_tables(&self) -> sqlx::Result<(i64, i64)> {
        let mut connection = self.pool.acquire().await?;
        if is_new(&mut connection).await? {
            sqlx::raw_sql("PRAGMA journal_mode = WAL").execute(&mut *connection).await?;
            let mut transaction = connection.begin_with("BEGIN IMMEDIATE").await?;
            sqlx::raw_sql(SCHEMA).execute(&mut *transaction).await?;
            transaction.commit().await?;
        }
        let header = "SELECT application_id, user_version FROM pragma_application_id, pragma_user_version";
        let header = sqlx::query_as(header).fetch_one(&mut *connection).await?;
        if header == (APPLICATION, VERSION) {
            order::add_turns(&mut connection).await?;
        }
        Ok(header)
    }

    pub fn pool(&self) -> &SqlitePool {
        &self.pool
    }

    pub async fn close(&self) {
        self.pool.close().await;
    }

    /// Adds a job and its delivery.
    pub async fn insert(&self, spec: Spec) -> Result<Job, Error> {
        let bad = |problem: &str| Error::input(format!("job {}", spec.id), problem, "give a new ULID");
        let Ok(id) = Ulid::from_string(&spec.id) else { return Err(bad("has no ULID")) };
        if id.to_string() != spec.id {
            return Err(bad("has a ULID that is not in capitals"));
        }
        let text = serde_json::to_string(&spec).map_err(|e| bad(&e.to_string()))?;
        let insert = async {
            let mut transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
            let fresh = "INSERT INTO nacre_job (id, spec, state, attempts, progress, stage, cancel)
                VALUES (?1, ?2, 'queued', 0, 0.0, '', 0) ON CONFLICT DO NOTHING";
            if sqlx::query(fresh).bind(&spec.id).bind(text).execute(&mut *transaction).await?.rows_affected() == 0 {
                return Ok(None);
            }
            let record = Record::submitted(job(spec.clone(), id));
            self.store(&mut transaction, &record).await?;
            transaction.commit().await?;
            Ok(Some(record.job))
        };
        insert.await.map_err(|e| self.fault(e))?.ok_or_else(|| bad("exists already"))
    }

    /// Changes a job in one transaction, with its log and its delivery; `None` when it does not exist. If the change
    /// fails, nothing is stored.
    pub async fn change(
        &self,
        id: &str,
        change: impl FnOnce(&mut Record) -> Result<(), Refusal>,
    ) -> Result<Option<Result<Job, Refusal>>, Error> {
        let apply = async {
            let mut transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
            let query = format!("SELECT {COLUMNS} FROM nacre_job WHERE id = ?1");
            let query = sqlx::query(sqlx::AssertSqlSafe(query)).bind(id);
            let Some(row) = query.fetch_optional(&mut *transaction).await? else { return Ok(None) };
            let mut record = read(&row)?;
            if let Err(refusal) = change(&mut record) {
                return Ok(Some(Err(refusal)));
            }
            self.store(&mut transaction, &record).await?;
            transaction.commit().await?;
            Ok(Some(Ok(record.job)))
        };
        apply.await.map_err(|e| self.fault(e))
    }

    /// Stores a changed job, its log lines and its delivery.
    async fn store(&self, transaction: &mut SqliteConnection, record: &Record) -> sqlx::Result<()> {
        let job = &record.job;
        let update =
            "UPDATE nacre_job SET state = ?2, attempts = ?3, progress = ?4, stage = ?5, error = ?6, cancel = ?7
            WHERE id = ?1";
        sqlx::query(update)
            .bind(&job.id)
            .bind(job.state.word())
            .bind(job.attempts)
            .bind(job.progress)
            .bind(&job.stage)
            .bind(&job.error)
            .bind(record.cancel)
            .execute(&mut *transaction)
            .await?;
        for line in &record.lines {
            append(transaction, &job.id, line).await?;
        }
        if record.deliver {
            order::to_the_end(transaction, &job.id).await?;
            self.deliver(transaction, &job.id).await?;
        }
        Ok(())
    }

    async fn deliver(&self, transaction: &mut SqliteConnection, id: &str) -> sqlx::Result<()> {
        let payload = serde_json::to_vec(id).map_err(|e| sqlx::Error::Encode(e.into()))?;
        let next = {
            let mut ids = self.ids.lock().unwrap_or_else(PoisonError::into_inner);
            ids.generate().unwrap_or_else(|overflow| overflow.commit_overflow_increment())
        };
        // Run time 0, so that a clock that is set back delays nothing.
        let task = TaskBuilder::new(payload)
            .task_id(TaskId::from_string(next.to_string()))
            .run_at_timestamp(0)
            .max_attempts(ALWAYS)
            .build();
        push_tasks(transaction, QUEUE, &[task]).await.map_err(|e| match e {
            apalis_sqlite::Error::Database(e) => e,
            other => sqlx::Error::Encode(Box::new(other)),
        })
    }

    /// Replaces all deliveries by one for each queued job. Call it while no worker runs.
    pub async fn deliver_all(&self) -> Result<(), Error> {
        let apply = async {
            let mut transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
            sqlx::raw_sql("DELETE FROM Jobs; DELETE FROM Workers").execute(&mut *transaction).await?;
            for id in in_state(&mut transaction, JobState::Queued).await? {
                self.deliver(&mut transaction, &id).await?;
            }
            transaction.commit().await
        };
        apply.await.map_err(|e| self.fault(e))
    }

    /// Queues the jobs again that an earlier process was running when it ended, before all others.
    pub async fn recover(&self) -> Result<(), Error> {
        let running = async { in_state(&mut *self.pool.acquire().await?, JobState::Running).await };
        for id in running.await.map_err(|e| self.fault(e))? {
            if let Some(Ok(Job { state: JobState::Queued, .. })) = self.change(&id, Record::cut_off).await? {
                // A refusal means that the job is queued no more, which nobody but this process changes.
                let _ = self.to_the_front(&id).await;
            }
        }
        Ok(())
    }

    pub async fn get(&self, id: &str) -> Result<Option<Job>, Error> {
        let query = format!("SELECT {COLUMNS} FROM nacre_job WHERE id = ?1");
        let row = sqlx::query(sqlx::AssertSqlSafe(query)).bind(id).fetch_optional(&self.pool).await;
        let row = row.map_err(|e| self.fault(e))?;
        row.map(|row| read(&row)).transpose().map(|found| found.map(|record| record.job)).map_err(|e| self.fault(e))
    }

    /// A page of jobs, newest first, and the start of the next one.
    pub async fn list(&self, limit: u32, after: Option<&str>) -> Result<(Vec<Job>, Option<String>), Error> {
        // ULIDs grow with time. One row more shows whether there is another page.
        let query = format!("SELECT {COLUMNS} FROM nacre_job WHERE ?1 IS NULL OR id < ?1 ORDER BY id DESC LIMIT ?2");
        let query = sqlx::query(sqlx::AssertSqlSafe(query)).bind(after).bind(limit + 1);
        let rows = query.fetch_all(&self.pool).await.map_err(|e| self.fault(e))?;
        let more = rows.len() > limit as usize;
        let jobs = rows.iter().take(limit as usize).map(|row| Ok(read(row)?.job));
        let jobs = jobs.collect::<sqlx::Result<Vec<_>>>().map_err(|e| self.fault(e))?;
        let next = jobs.last().filter(|_| more).map(|job| job.id.clone());
        Ok((jobs, next))
    }

    /// Deletes a job that has ended; remaining deliveries of it have no effect.
    pub async fn remove(&self, id: &str) -> Result<(), Refusal> {
        let apply = async {
            let mut transaction = self.pool.begin_with("BEGIN IMMEDIATE").await?;
            let query = format!("SELECT {COLUMNS} FROM nacre_job WHERE id = ?1");
            let query = sqlx::query(sqlx::AssertSqlSafe(query)).bind(id);
            let Some(row) = query.fetch_optional(&mut *transaction).await? else { return Ok(None) };
            let state = read(&row)?.job.state;
            if !matches!(state, JobState::Queued | JobState::Running) {
                sqlx::query("DELETE FROM nacre_job WHERE id = ?1").bind(id).execute(&mut *transaction).await?;
                transaction.commit().await?;
            }
            Ok(Some(state))
        };
        match apply.await.map_err(|e| self.fault(e))? {
            None => Err(Refusal::Unknown(id.into())),
            Some(state @ (JobState::Queued | JobState::Running)) => {
                Err(Refusal::State { id: id.into(), state, wish: "deleted; cancel it first" })
            }
            Some(_) => Ok(()),
        }
    }

    pub async fn rename(&self, id: &str, name: &str) -> Result<(), Error> {
        let update = sqlx::query("UPDATE nacre_job SET spec = json_set(spec, '$.name', ?2) WHERE id = ?1");
        update.bind(id).bind(name).execute(&self.pool).await.map(drop).map_err(|e| self.fault(e))
    }

    /// Adds a job that has ended, without a delivery.
    pub async fn restore(&self, saved: &Saved) -> Result<(), Error> {
        let bad = |problem: &str| Error::input(format!("job {}", saved.spec.id), problem, "ask for it anew");
        if matches!(saved.state, JobState::Queued | JobState::Running) {
            return Err(bad("had not ended"));
        }
        let insert = "INSERT INTO nacre_job (id, spec, state, attempts, progress, stage, error, cancel, log)
            VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, 0, ?8) ON CONFLICT DO NOTHING";
        let inserted = sqlx::query(insert)
            .bind(&saved.spec.id)
            .bind(serde_json::to_string(&saved.spec).map_err(|e| bad(&e.to_string()))?)
            .bind(saved.state.word())
            .bind(saved.attempts)
            .bind(saved.progress)
            .bind(&saved.stage)
            .bind(&saved.error)
            .bind(&saved.log)
            .execute(&self.pool)
            .await;
        inserted.map(drop).map_err(|e| self.fault(e))
    }

    /// Uploads of jobs, as inputs or lights, each with one of the jobs.
    pub async fn uploads(&self) -> Result<Vec<(String, String)>, Error> {
        let query = "SELECT json_extract(spec, '$.upload') AS upload, id FROM nacre_job WHERE upload IS NOT NULL
            UNION SELECT json_extract(spec, '$.light.upload') AS upload, id FROM nacre_job WHERE upload IS NOT NULL";
        sqlx::query_as(query).fetch_all(&self.pool).await.map_err(|e| self.fault(e))
    }

    /// A job of a session that has not ended.
    pub async fn open_of_session(&self, session: &str) -> Result<Option<String>, Error> {
        let query =
            "SELECT id FROM nacre_job WHERE state IN ('queued', 'running') AND json_extract(spec, '$.session') = ?1
            ORDER BY id LIMIT 1";
        sqlx::query_scalar(query).bind(session).fetch_optional(&self.pool).await.map_err(|e| self.fault(e))
    }

    pub async fn log(&self, id: &str) -> Result<Option<String>, Error> {
        let query = sqlx::query_scalar("SELECT log FROM nacre_job WHERE id = ?1").bind(id);
        query.fetch_optional(&self.pool).await.map_err(|e| self.fault(e))
    }

    /// Converts an SQLite error into one for the user.
    pub fn fault(&self, error: sqlx::Error) -> Error {
        match (primary_code(&error), &error) {
            // The statements are fixed, so an error in one of them means an unexpected table.
            (Some(ERROR | CORRUPT | NOT_A_DATABASE), _) | (_, sqlx::Error::ColumnDecode { .. }) => {
                Error::file(&self.path, format!("is no intact job queue: {error}"), AWAY)
            }
            (_, sqlx::Error::PoolClosed) => Error::Cancelled,
            _ => {
                let source = sqlite::cause(&self.path, error);
                let remedy = sqlite::remedy(&source, "check the disk, or give another folder");
                Error::Output { path: self.path.clone(), source, remedy }
            }
        }
    }
}

async fn in_state(connection: &mut SqliteConnection, state: JobState) -> sqlx::Result<Vec<String>> {
    // Row ids grow with every submission; ULIDs of one millisecond, or after a clock was set back, do not.
    let query = sqlx::query_scalar("SELECT id FROM nacre_job WHERE state = ?1 ORDER BY rowid").bind(state.word());
    query.fetch_all(connection).await
}
