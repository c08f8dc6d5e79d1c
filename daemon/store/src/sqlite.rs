//! Properties of SQLite that catalogue and job queue share.

use sqlx::SqliteConnection;

/// SQLite's primary result codes.
pub(crate) const ERROR: i32 = 1;
pub(crate) const BUSY: i32 = 5;
pub(crate) const CORRUPT: i32 = 11;
pub(crate) const FULL: i32 = 13;
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
