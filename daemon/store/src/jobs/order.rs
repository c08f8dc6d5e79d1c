//! Order of the waiting jobs.
//!
//! A queued job has a turn; the lowest one runs next. Deliveries carry no order: each one runs the next job.

use super::row::read;
use super::store::{COLUMNS, Store};
use super::{Job, Refusal};
use nacre_base::Error;
use sqlx::SqliteConnection;

/// Adds the column of turns to a file of an earlier version. That version ignores the column.
pub(super) async fn add_turns(connection: &mut SqliteConnection) -> sqlx::Result<()> {
    let known = "SELECT count(*) FROM pragma_table_info('nacre_job') WHERE name = 'turn'";
    if sqlx::query_scalar::<_, i64>(known).fetch_one(&mut *connection).await? == 0 {
        let add = "ALTER TABLE nacre_job ADD COLUMN turn INTEGER NOT NULL DEFAULT 0";
        sqlx::raw_sql(add).execute(connection).await?;
    }
    Ok(())
}

/// Gives a job the last turn.
pub(super) async fn to_the_end(connection: &mut SqliteConnection, id: &str) -> sqlx::Result<()> {
    let update = "UPDATE nacre_job SET turn = (SELECT max(turn) FROM nacre_job) + 1 WHERE id = ?1";
    sqlx::query(update).bind(id).execute(connection).await.map(drop)
}

impl Store {
    /// Id of the next job.
    pub async fn next(&self) -> Result<Option<String>, Error> {
        let query = "SELECT id FROM nacre_job WHERE state = 'queued' ORDER BY turn, rowid LIMIT 1";
        sqlx::query_scalar(query).fetch_optional(self.pool()).await.map_err(|e| self.fault(e))
    }

    /// The running job, then the queued ones in their order.
    pub async fn open_jobs(&self) -> Result<Vec<Job>, Error> {
        let query = format!(
            "SELECT {COLUMNS} FROM nacre_job WHERE state IN ('running', 'queued') ORDER BY state = 'queued', turn, rowid"
        );
        let rows = sqlx::query(sqlx::AssertSqlSafe(query)).fetch_all(self.pool()).await.map_err(|e| self.fault(e))?;
        rows.iter().map(|row| Ok(read(row)?.job)).collect::<sqlx::Result<_>>().map_err(|e| self.fault(e))
    }

    /// Gives a queued job the first turn.
    pub async fn to_the_front(&self, id: &str) -> Result<(), Refusal> {
        let update = "UPDATE nacre_job SET turn = (SELECT min(turn) FROM nacre_job WHERE state = 'queued') - 1
            WHERE id = ?1 AND state = 'queued'";
        let moved = sqlx::query(update).bind(id).execute(self.pool()).await.map_err(|e| self.fault(e))?;
        if moved.rows_affected() == 1 {
            return Ok(());
        }
        let job = self.get(id).await?.ok_or_else(|| Refusal::Unknown(id.into()))?;
        Err(Refusal::State { id: id.into(), state: job.state, wish: "moved to the front; only waiting jobs can" })
    }
}
