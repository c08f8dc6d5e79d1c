//! Rows of the job table.

use super::record::Record;
use super::{Job, JobState, MAX_LOG, Spec};
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};
use ulid::Ulid;

/// Appends a line to a job's log, and drops the oldest lines beyond [`MAX_LOG`].
pub(super) async fn append(connection: &mut SqliteConnection, id: &str, line: &str) -> sqlx::Result<()> {
    // One entry is one line.
    let line = line.replace(['\n', '\r'], " ");
    let update = "UPDATE nacre_job SET log = log || strftime('%Y-%m-%dT%H:%M:%SZ', 'now') || ' ' || ?2 || char(10)
        WHERE id = ?1 RETURNING log";
    let log: String = sqlx::query_scalar(update).bind(id).bind(line).fetch_one(&mut *connection).await?;
    if log.len() > MAX_LOG {
        let cut = sqlx::query("UPDATE nacre_job SET log = ?2 WHERE id = ?1").bind(id).bind(newest(&log));
        cut.execute(connection).await?;
    }
    Ok(())
}

/// The newest whole lines of a log within its length limit, or the end of the last line.
fn newest(log: &str) -> &str {
    let tail = &log[log.ceil_char_boundary(log.len() - MAX_LOG)..];
    match tail.split_once('\n') {
        Some((_, lines)) if !lines.is_empty() => lines,
        _ => tail,
    }
}

/// A new job.
pub(super) fn job(spec: Spec, id: Ulid) -> Job {
    Job {
        id: spec.id.clone(),
        session: spec.session.clone(),
        upload: spec.upload.clone(),
        state: JobState::Queued,
        attempts: 0,
        progress: 0.0,
        stage: String::new(),
        remaining_s: None,
        error: None,
        created: id.timestamp_ms() / 1000,
        spec,
    }
}

/// Reads the `COLUMNS` of a row.
pub(super) fn read(row: &SqliteRow) -> sqlx::Result<Record> {
    let bad =
        |column: &str, problem: String| sqlx::Error::ColumnDecode { index: column.into(), source: problem.into() };
    let spec: Spec = serde_json::from_str(row.try_get("spec")?).map_err(|e| bad("spec", e.to_string()))?;
    let id = Ulid::from_string(&spec.id).map_err(|e| bad("id", e.to_string()))?;
    let state: &str = row.try_get("state")?;
    let state = JobState::ALL.into_iter().find(|s| s.word() == state).ok_or_else(|| bad("state", state.into()))?;
    let job = Job {
        state,
        attempts: row.try_get("attempts")?,
        progress: row.try_get("progress")?,
        stage: row.try_get("stage")?,
        error: row.try_get("error")?,
        ..job(spec, id)
    };
    Ok(Record::new(job, row.try_get("cancel")?))
}
