//! Properties of SQLite that catalogue and job queue share.

use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};
use sqlx::{Connection, SqliteConnection};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

/// SQLite's primary result codes.
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

/// Whether a database holds nothing yet.
pub(crate) async fn is_new(connection: &mut SqliteConnection) -> sqlx::Result<bool> {
    let empty = "SELECT user_version = 0 AND NOT EXISTS (SELECT 1 FROM sqlite_schema) FROM pragma_user_version";
    sqlx::query_scalar(empty).fetch_one(connection).await
}

/// Connections of one file.
const CONNECTIONS: u32 = 4;

/// Room that SQLite needs to open a file in WAL mode, and somewhat more, in bytes.
const ROOM: usize = 64 << 10;

/// How long one process waits for another.
pub(crate) const PATIENCE: Duration = Duration::from_secs(5);

/// Pages of 4 KiB that the write-ahead log may have before they are moved into the file. SQLite's usual 1000 fill a small disk.
const LOG_PAGES: &str = "64";

/// Largest write-ahead log after that, in bytes.
const LOG_BYTES: &str = "262144";

/// Options of a file that may be new.
pub(crate) fn options(path: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(true)
        .busy_timeout(PATIENCE)
        .pragma("wal_autocheckpoint", LOG_PAGES)
        .pragma("journal_size_limit", LOG_BYTES)
}

/// A pool without connections that are left within a transaction: when its begin, commit or rollback failed, as on a full disk, the
/// connection would refuse every later one.
pub(crate) fn pool() -> SqlitePoolOptions {
    SqlitePoolOptions::new().max_connections(CONNECTIONS).after_release(|connection, _| {
        Box::pin(async move {
            // A rollback may still be on its way.
            connection.ping().await?;
            Ok(!connection.is_in_transaction())
        })
    })
}

/// The system's reason for an error of SQLite, which has one code for a full disk, a read-only one and too many open files when it
/// opens a file.
pub(crate) fn cause(path: &Path, error: sqlx::Error) -> io::Error {
    match primary_code(&error) {
        Some(FULL) => io::ErrorKind::StorageFull.into(),
        Some(READ_ONLY | IO_ERROR | CANNOT_OPEN) => writable(path).err().unwrap_or_else(|| io::Error::other(error)),
        _ => io::Error::other(error),
    }
}

/// What the user can do about it; `otherwise` for causes that say no more.
pub(crate) fn remedy(cause: &io::Error, otherwise: &'static str) -> &'static str {
    match cause.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space",
        io::ErrorKind::ReadOnlyFilesystem => "mount the disk for writing, or give another folder",
        _ if nacre_base::error::is_out_of_files(cause) => nacre_base::error::OUT_OF_FILES,
        _ => otherwise,
    }
}

/// Tries to write to a database and beside it.
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
            // The file may not grow: for SQLite the disk is full, and it ends the transaction by itself.
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
