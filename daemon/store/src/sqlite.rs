//! SQLite settings and errors shared by catalogue and job queue.

use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};
use sqlx::{Connection, SqliteConnection};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

/// Primary result codes of SQLite.
pub(crate) const ERROR: i32 = 1;
pub(crate) const BUSY: i32 = 5;
const READ_ONLY: i32 = 8;
const IO_ERROR: i32 = 10;
pub(crate) const CORRUPT: i32 = 11;
const FULL: i32 = 13;
const CANNOT_OPEN: i32 = 14;
pub(crate) const NOT_A_DATABASE: i32 = 26;

pub(crate) fn primary_code(error: &sqlx::Error) -> Option<i32> {
    let extended: i32 = error.as_database_error()?.code()?.parse().ok()?;
    Some(extended & 0xff)
}

/// Whether a database has no tables.
pub(crate) async fn is_new(connection: &mut SqliteConnection) -> sqlx::Result<bool> {
    let empty = "SELECT user_version = 0 AND NOT EXISTS (SELECT 1 FROM sqlite_schema) FROM pragma_user_version";
    sqlx::query_scalar(empty).fetch_one(connection).await
}

/// Most connections to one file.
const CONNECTIONS: u32 = 4;

/// Bytes that SQLite needs to open a file in WAL mode, with a margin.
const ROOM: usize = 64 << 10;

/// Longest wait for another process.
pub(crate) const PATIENCE: Duration = Duration::from_secs(5);

/// Size of the write-ahead log, in pages of 4 KiB, at which it is merged into the file. SQLite's default, 1000, fills
/// a small disk.
const LOG_PAGES: &str = "64";

/// Largest write-ahead log after a merge, in bytes.
const LOG_BYTES: &str = "262144";

/// Options of a file that may not exist yet.
pub(crate) fn options(path: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(true)
        .busy_timeout(PATIENCE)
        .pragma("wal_autocheckpoint", LOG_PAGES)
        .pragma("journal_size_limit", LOG_BYTES)
}

/// A connection pool that discards connections in an open transaction. They remain when begin, commit or rollback
/// fails, as on a full disk, and refuse every later transaction.
pub(crate) fn pool() -> SqlitePoolOptions {
    SqlitePoolOptions::new().max_connections(CONNECTIONS).after_release(|connection, _| {
        Box::pin(async move {
            // A rollback may still be pending; the ping waits for it.
            connection.ping().await?;
            Ok(!connection.is_in_transaction())
        })
    })
}

/// The system's error behind an SQLite error. When opening a file, SQLite has one code for a full disk, a read-only
/// disk and too many open files.
pub(crate) fn cause(path: &Path, error: sqlx::Error) -> io::Error {
    match primary_code(&error) {
        Some(FULL) => io::ErrorKind::StorageFull.into(),
        Some(READ_ONLY | IO_ERROR | CANNOT_OPEN) => writable(path).err().unwrap_or_else(|| io::Error::other(error)),
        _ => io::Error::other(error),
    }
}

/// Remedy for the user; `otherwise` for causes without a specific remedy.
pub(crate) fn remedy(cause: &io::Error, otherwise: &'static str) -> &'static str {
    match cause.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space",
        io::ErrorKind::ReadOnlyFilesystem => "mount the disk for writing, or give another folder",
        _ if nacre_base::error::is_out_of_files(cause) => nacre_base::error::OUT_OF_FILES,
        _ => otherwise,
    }
}

/// Tests whether a database and its folder can be written.
fn writable(path: &Path) -> io::Result<()> {
    File::options().append(true).create(true).open(path)?;
    let beside = path.with_extension(format!("{}.room", std::process::id()));
    let written = File::create(&beside).and_then(|mut file| file.write_all(&[0; ROOM]));
    let removed = fs::remove_file(&beside);
    written.and(removed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_connection_whose_commit_failed_is_not_used_again() {
        let home = tempfile::tempdir().unwrap();
        let pool = pool().max_connections(1).connect_lazy_with(options(&home.path().join("x.db")));
        sqlx::raw_sql("CREATE TABLE t (x)").execute(&pool).await.unwrap();
        for _ in 0..3 {
            let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await.unwrap();
            // SQLite reports a file that may not grow as a full disk, and ends the transaction.
            sqlx::raw_sql("PRAGMA max_page_count = 1").execute(&mut *transaction).await.unwrap();
            let large = sqlx::raw_sql("INSERT INTO t VALUES (zeroblob(100000))").execute(&mut *transaction).await;
            assert_eq!(primary_code(&large.unwrap_err()), Some(FULL));
            transaction.rollback().await.unwrap_err();
        }
        let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await.unwrap();
        sqlx::raw_sql("INSERT INTO t VALUES (1)").execute(&mut *transaction).await.unwrap();
        transaction.commit().await.unwrap();
    }
}
