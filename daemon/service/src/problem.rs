//! Errors as `application/problem+json` (RFC 9457) with stable types.

use super::paths::without_folders;
use axum::extract::rejection::{BytesRejection, JsonRejection, PathRejection, QueryRejection};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_base::Error;
use nacre_base::error::is_out_of_files;
use nacre_capture::Failure;
use nacre_capture::fields::fields;
use nacre_drivers::Class;
use nacre_store::jobs::Refusal;
use serde::Serialize;
use std::io::{self, ErrorKind};
use std::path::Path;
use utoipa::ToSchema;

/// An error, for programs and for people.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Problem {
    /// Stable URI of the kind of problem.
    #[serde(rename = "type")]
    kind: String,
    /// Kind of problem in words.
    title: &'static str,
    /// HTTP status.
    status: u16,
    /// Cause of this problem.
    detail: String,
    /// Action that solves it.
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<String>,
}

/// Kinds of problems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Something in the request cannot be used.
    BadRequest,
    /// The resource does not exist.
    NotFound,
    /// The state does not allow the request.
    Conflict,
    /// Another client or session has the devices.
    Busy,
    /// The resource was changed after the client read it.
    Outdated,
    /// The request exceeds the size limit.
    TooLarge,
    /// The request arrives too slowly.
    Slow,
    /// Too many simultaneous requests or event streams.
    TooMany,
    /// The token is missing or invalid.
    Unauthorized,
    /// The token's role does not allow it, or the request comes from another origin.
    Forbidden,
    /// A device failed to execute a command.
    Device,
    /// The path does not support the HTTP method.
    Method,
    /// The idempotency key was used for another request.
    ReusedKey,
    /// The disk of the data folder is full.
    Full,
    /// The operating system refuses for the moment.
    Unavailable,
    /// An error of the service or the disk.
    Internal,
}

impl Kind {
    fn parts(self) -> (StatusCode, &'static str, &'static str) {
        match self {
            Self::BadRequest => (StatusCode::BAD_REQUEST, "bad-request", "The request cannot be used"),
            Self::NotFound => (StatusCode::NOT_FOUND, "not-found", "Not found"),
            Self::Conflict => (StatusCode::CONFLICT, "conflict", "It does not fit the state"),
            Self::Busy => (StatusCode::CONFLICT, "busy", "The devices are in use"),
            Self::Outdated => (StatusCode::PRECONDITION_FAILED, "outdated", "It was changed meanwhile"),
            Self::TooLarge => (StatusCode::PAYLOAD_TOO_LARGE, "too-large", "Too large"),
            Self::Slow => (StatusCode::REQUEST_TIMEOUT, "slow", "Too slow"),
            Self::TooMany => (StatusCode::TOO_MANY_REQUESTS, "too-many", "Too many at once"),
            Self::Unauthorized => (StatusCode::UNAUTHORIZED, "unauthorized", "A token is needed"),
            Self::Forbidden => (StatusCode::FORBIDDEN, "forbidden", "Not allowed"),
            Self::Device => (StatusCode::CONFLICT, "device", "A device did not do what it was asked to"),
            Self::Method => (StatusCode::METHOD_NOT_ALLOWED, "method", "The method is not meant for this path"),
            Self::ReusedKey => {
                (StatusCode::UNPROCESSABLE_ENTITY, "reused-key", "The idempotency key belongs to another request")
            }
            Self::Full => (StatusCode::INSUFFICIENT_STORAGE, "full", "The disk is full"),
            Self::Unavailable => (StatusCode::SERVICE_UNAVAILABLE, "unavailable", "Not possible now"),
            Self::Internal => (StatusCode::INTERNAL_SERVER_ERROR, "internal", "Something went wrong here"),
        }
    }
}

/// Longest detail in characters.
const LONGEST: usize = 4000;

/// Remedies for errors of the operating system.
const FREE: &str = "delete sessions, reconstructions or uploads, or free space on that disk, then try again";
const WRITABLE: &str = "mount it for writing, or name another data folder in the configuration of the service";
const FEWER: &str = "try again later, or raise the limit of open files of the service (ulimit -n)";

/// Result of a handler.
pub type Answer<T> = Result<T, Problem>;

impl Problem {
    /// A problem of a kind.
    pub fn new(kind: Kind, detail: impl Into<String>) -> Self {
        let (status, slug, title) = kind.parts();
        let kind = format!("https://nacre.invalid/problems/{slug}");
        // The detail may quote a whole request.
        let detail = without_folders(&detail.into()).chars().take(LONGEST).collect();
        Self { kind, title, status: status.as_u16(), detail, remedy: None }
    }

    /// Problem of an operating system error: `subject` is the part of the request that failed.
    pub fn refused(subject: impl std::fmt::Display, error: &io::Error) -> Self {
        let (kind, why, remedy) = match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => (Kind::Full, "the disk of the service is full", FREE),
            ErrorKind::ReadOnlyFilesystem => (Kind::Unavailable, "the disk of the service is read-only", WRITABLE),
            _ if is_out_of_files(error) => (Kind::Unavailable, "too many files are open", FEWER),
            _ => {
                return Self::new(Kind::Internal, format!("{subject}: {error}"))
                    .remedy("look at the log of the service");
            }
        };
        Self::new(kind, format!("{subject}: {why}")).remedy(remedy)
    }

    /// Problem of a full disk of the data folder.
    pub fn full() -> Self {
        Self::new(Kind::Full, "the disk of the service is full").remedy(FREE)
    }

    /// Adds a remedy.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(without_folders(&remedy.into()));
        self
    }

    /// Replaces the detail by `text`, which may end with the remedy. For the command line, whose user may see the
    /// machine's folders.
    pub fn in_full(self, text: &str) -> Self {
        let remedy = self.remedy.as_ref().and_then(|remedy| text.strip_suffix(remedy.as_str())?.strip_suffix("; "));
        Self { detail: remedy.unwrap_or(text).to_owned(), ..self }
    }

    /// Problem of a resource that does not exist.
    pub fn not_found(what: impl std::fmt::Display) -> Self {
        Self::new(Kind::NotFound, format!("there is no {what}"))
    }

    /// Problem of a request that cannot be used.
    pub fn bad(detail: impl Into<String>) -> Self {
        Self::new(Kind::BadRequest, detail)
    }

    /// Cause of the problem.
    pub fn detail(&self) -> &str {
        &self.detail
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_string(&self).unwrap_or_default();
        let mut response = (status, [(header::CONTENT_TYPE, "application/problem+json")], body).into_response();
        if matches!(status, StatusCode::TOO_MANY_REQUESTS | StatusCode::REQUEST_TIMEOUT) {
            // A connection that is kept open takes memory too.
            response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        response
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.detail)?;
        self.remedy.iter().try_for_each(|remedy| write!(f, "; {remedy}"))
    }
}

/// Name of a file without its folder, which clients must not see.
fn file_name(path: &Path) -> std::borrow::Cow<'_, str> {
    match path.file_name() {
        Some(name) if path.is_absolute() => name.to_string_lossy(),
        _ => path.to_string_lossy(),
    }
}

impl From<Error> for Problem {
    fn from(error: Error) -> Self {
        match error {
            // Readers of files pass on the system's error as text.
            Error::Input { subject, problem, .. } if problem.contains("(os error 24)") => {
                let subject = file_name(Path::new(&subject)).into_owned();
                Self::new(Kind::Unavailable, format!("{subject}: too many files are open")).remedy(FEWER)
            }
            Error::Input { subject, problem, remedy } => {
                let subject = fields(&file_name(Path::new(&subject)));
                Self::bad(format!("{subject}: {}", fields(&problem))).remedy(fields(&remedy))
            }
            Error::Cancelled => Self::new(Kind::Conflict, "stopped before it was done"),
            Error::Output { path, source, remedy } => {
                let refused = Self::refused(format!("{} cannot be written", file_name(&path)), &source);
                if refused.status == 500 { refused.remedy(remedy) } else { refused }
            }
        }
    }
}

impl From<Failure> for Problem {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Processing(error) => error.into(),
            Failure::Device(e) => {
                let kind = if e.class == Class::Setup { Kind::BadRequest } else { Kind::Device };
                let detail = format!("{}: {}: expected {}, got {}", e.device, e.command, e.expected, e.got);
                Self::new(kind, detail).remedy(e.remedy)
            }
            Failure::Step { step, failure } => {
                let mut problem = Self::from(*failure);
                problem.detail = format!("{step}: {}", problem.detail);
                problem
            }
            Failure::Bound(text) => Self::new(Kind::Conflict, text),
        }
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::Queue(error) => error.into(),
            Refusal::Unknown(id) => Self::not_found(format!("reconstruction {id}")),
            Refusal::State { .. } => Self::new(Kind::Conflict, refusal.to_string()),
        }
    }
}

impl From<BytesRejection> for Problem {
    fn from(rejection: BytesRejection) -> Self {
        let kind = if rejection.status() == StatusCode::PAYLOAD_TOO_LARGE { Kind::TooLarge } else { Kind::BadRequest };
        Self::new(kind, rejection.body_text())
    }
}

impl From<JsonRejection> for Problem {
    fn from(rejection: JsonRejection) -> Self {
        // The size was checked when the body was received.
        Self::bad(rejection.body_text())
    }
}

impl From<PathRejection> for Problem {
    fn from(rejection: PathRejection) -> Self {
        Self::bad(rejection.body_text())
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        Self::bad(rejection.body_text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::io::Errno;

    #[test]
    fn what_the_system_refuses_is_named_with_a_remedy() {
        for (error, status, words) in [
            (Errno::NOSPC, 507, ["is full", "delete sessions"]),
            (Errno::DQUOT, 507, ["is full", "free space"]),
            (Errno::ROFS, 503, ["is read-only", "mount it for writing"]),
            (Errno::MFILE, 503, ["too many files are open", "ulimit -n"]),
            (Errno::NFILE, 503, ["too many files are open", "try again later"]),
            (Errno::IO, 500, ["x cannot be written", "check the disk"]),
        ] {
            let error = Error::output(Path::new("/home/anna/x"), io::Error::from(error));
            let problem = Problem::from(error);
            let text = problem.to_string();
            assert_eq!(problem.status, status, "{text}");
            assert!(words.iter().all(|word| text.contains(word)) && !text.contains("anna"), "{text}");
        }
        let read = Error::file(Path::new("/a/x.png"), io::Error::from(Errno::MFILE), "give a photograph");
        assert_eq!(Problem::from(read).status, 503);
        assert_eq!(Problem::bad("é".repeat(10_000)).detail().chars().count(), LONGEST);
    }
}
