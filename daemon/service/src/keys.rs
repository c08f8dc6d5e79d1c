//! `Idempotency-Key`: simultaneous and repeated requests with the same key create one resource. Keys survive a restart
//! in a file of the data folder.

use super::problem::{Answer, Kind, Problem};
use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderName, header};
use nacre_base::{input, write_whole};
use nacre_capture::session::sha256;
use serde::de::DeserializeOwned;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::OwnedMutexGuard;

/// Most keys that are kept.
const KEPT: usize = 1024;

/// Most bytes of the file that are read: half a million keys of 160 bytes from one run of the service.
const LARGEST: u64 = 64 << 20;

/// Longest key in characters.
const LONGEST: usize = 200;

/// Name of the file in the data folder. Each line is one resource: key, body and id.
const FILE: &str = "keys";

/// A JSON body, and the request's key if it has one.
pub struct Keyed<T> {
    /// The body.
    pub body: T,
    /// The key.
    pub key: Option<Key>,
}

/// Key and body of a request, as hashes.
pub struct Key {
    /// Hash of the key, path and user.
    name: String,
    /// Hash of the body, whatever its formatting.
    body: String,
}

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Keyed<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let (parts, body) = request.into_parts();
        let given = parts.headers.get(HeaderName::from_static("idempotency-key"));
        let Some(given) = given.map(|key| key.to_str().unwrap_or_default().to_owned()) else {
            let Json(body) = Json::<T>::from_request(Request::from_parts(parts, body), state).await?;
            return Ok(Self { body, key: None });
        };
        if given.is_empty() || given.len() > LONGEST {
            return Err(Problem::bad(format!("Idempotency-Key must have 1 to {LONGEST} characters of ASCII")));
        }
        let user = parts.headers.get(header::AUTHORIZATION).map(|v| v.as_bytes()).unwrap_or_default();
        let name = sha256(&[parts.uri.path().as_bytes(), given.as_bytes(), user].join(&b'\n'));
        let bytes = Bytes::from_request(Request::from_parts(parts.clone(), body), state).await?;
        let request = Request::from_parts(parts, Body::from(bytes.clone()));
        let Json(body) = Json::<T>::from_request(request, state).await?;
        // Order of keys and white space do not matter.
        let mut value: serde_json::Value = serde_json::from_slice(&bytes).unwrap_or_default();
        value.sort_all_objects();
        let key = Some(Key { name, body: sha256(value.to_string().as_bytes()) });
        Ok(Self { body, key })
    }
}

/// The known keys.
pub struct Keys {
    entries: Mutex<VecDeque<Arc<Entry>>>,
    file: PathBuf,
}

struct Entry {
    name: String,
    /// Locked while a request with this key runs.
    made: Arc<tokio::sync::Mutex<Option<Made>>>,
}

/// A resource that was created, or whose creation failed.
struct Made {
    body: String,
    id: String,
}

impl Keys {
    /// Reads the keys that earlier runs of the service stored in the data folder.
    pub fn open(data: &Path) -> Self {
        let file = data.join(FILE);
        let text =
            input::read(&file, LARGEST).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default();
        let lines: Vec<&str> = text.lines().filter(|line| read(line).is_some()).collect();
        let newest = &lines[lines.len().saturating_sub(KEPT)..];
        let kept: String = newest.iter().map(|line| format!("{line}\n")).collect();
        if kept != text
            && let Err(error) = write_whole(&file, kept.as_bytes())
        {
            tracing::warn!("old idempotency keys stay: {error}");
        }
        let entries = newest.iter().filter_map(|line| read(line)).collect();
        Self { entries: Mutex::new(entries), file }
    }

    fn locked(&self) -> MutexGuard<'_, VecDeque<Arc<Entry>>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until no other request with the same key runs.
    pub async fn turn(&self, key: Option<Key>) -> Turn<'_> {
        let Some(key) = key else { return Turn { keys: self, held: None } };
        let entry = self.entry(&key.name);
        let made = entry.made.clone().lock_owned().await;
        Turn { keys: self, held: Some((key, made)) }
    }

    fn entry(&self, name: &str) -> Arc<Entry> {
        let mut entries = self.locked();
        if let Some(known) = entries.iter().rev().find(|entry| entry.name == name) {
            return known.clone();
        }
        let entry = Arc::new(Entry { name: name.to_owned(), made: Arc::default() });
        entries.push_back(entry.clone());
        // Entries that requests wait for are kept.
        if entries.len() > KEPT
            && let Some(oldest) = entries.iter().position(|e| Arc::strong_count(&e.made) == 1)
        {
            entries.remove(oldest);
        }
        entry
    }

    fn write(&self, key: &Key, id: &str) -> io::Result<()> {
        let mut file = File::options().append(true).create(true).open(&self.file)?;
        file.write_all(format!("{} {} {id}\n", key.name, key.body).as_bytes())
    }
}

/// Parses a line of the file; `None` for a truncated line.
fn read(line: &str) -> Option<Arc<Entry>> {
    let [name, body, id] = line.split(' ').collect::<Vec<_>>().try_into().ok()?;
    let hash = |text: &str| text.len() == 64 && text.bytes().all(|b| b.is_ascii_hexdigit());
    let whole = hash(name) && hash(body) && super::check_id(id).is_ok();
    let made = Some(Made { body: body.to_owned(), id: id.to_owned() });
    whole.then(|| Arc::new(Entry { name: name.to_owned(), made: Arc::new(made.into()) }))
}

/// Exclusive use of a key, or a request without one.
pub struct Turn<'a> {
    keys: &'a Keys,
    held: Option<(Key, OwnedMutexGuard<Option<Made>>)>,
}

impl Turn<'_> {
    /// Id of the resource of an earlier request with this key. Its creation may have failed, and it may have been
    /// deleted.
    pub fn made(&self) -> Option<String> {
        self.held.as_ref().and_then(|(_, made)| Some(made.as_ref()?.id.clone()))
    }

    /// Checks that the earlier request had the same body.
    ///
    /// # Errors
    /// `reused-key` if the bodies differ.
    pub fn same(&self) -> Answer<()> {
        match &self.held {
            Some((key, made)) if made.as_ref().is_some_and(|made| made.body != key.body) => {
                let detail = "Idempotency-Key was sent before with another body";
                Err(Problem::new(Kind::ReusedKey, detail).remedy("send a new key with each new request"))
            }
            _ => Ok(()),
        }
    }

    /// Id of the resource that this request creates. It is stored first, so that an interrupted request is not
    /// repeated.
    pub fn begin(&mut self) -> String {
        let id = super::new_id();
        if let Some((key, made)) = &mut self.held {
            **made = Some(Made { body: key.body.clone(), id: id.clone() });
            if let Err(error) = self.keys.write(key, &id) {
                tracing::warn!("an idempotency key will not outlive the service: {error}");
            }
        }
        id
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(name: &str, body: &str) -> Option<Key> {
        Some(Key { name: sha256(name.as_bytes()), body: sha256(body.as_bytes()) })
    }

    #[tokio::test]
    async fn keys_are_remembered_across_restarts_and_bounded() {
        let data = tempfile::tempdir().unwrap();
        let keys = Keys::open(data.path());
        let id = keys.turn(key("a", "x")).await.begin();
        for _ in 0..2 {
            std::fs::OpenOptions::new()
                .append(true)
                .open(data.path().join(FILE))
                .and_then(|mut file| file.write_all(b"cut off"))
                .unwrap();
            let keys = Keys::open(data.path());
            let turn = keys.turn(key("a", "x")).await;
            assert_eq!(turn.made().as_deref(), Some(id.as_str()));
            assert!(turn.same().is_ok());
            drop(turn);
            assert!(keys.turn(key("a", "y")).await.same().is_err());
            assert_eq!(keys.turn(key("b", "x")).await.made(), None);
        }
        for k in 0..KEPT {
            keys.turn(key(&k.to_string(), "x")).await.begin();
        }
        assert_eq!(keys.turn(key("a", "x")).await.made(), None, "the oldest is forgotten");
        let count = |keys: &Keys| keys.locked().len();
        assert_eq!((count(&keys), count(&Keys::open(data.path()))), (KEPT, KEPT));
    }

    #[tokio::test]
    async fn one_request_with_a_key_waits_for_the_other() {
        let data = tempfile::tempdir().unwrap();
        let keys = Keys::open(data.path());
        let mut first = keys.turn(key("a", "x")).await;
        let mut second = Box::pin(keys.turn(key("a", "x")));
        assert!(futures::poll!(second.as_mut()).is_pending());
        let id = first.begin();
        drop(first);
        assert_eq!(second.await.made(), Some(id));
        let (mut one, mut other) = (keys.turn(None).await, keys.turn(None).await);
        assert_ne!(one.begin(), other.begin());
    }
}
