//! Numbered events: a subscriber that lost its connection resumes where it broke. Memory is bounded, however slow
//! subscribers are.

use super::App;
use super::problem::{Answer, Kind, Problem};
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures::Stream;
use serde::Serialize;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::watch;

/// Most events that are kept for resumed connections.
const KEPT: usize = 1000;

/// Interval of comments, by which dead connections are detected.
const ALIVE: Duration = Duration::from_secs(10);

/// A sequence of numbered events.
pub struct EventLog {
    entries: Mutex<VecDeque<Entry>>,
    newest: watch::Sender<u64>,
    /// Name and data of the newest event without number.
    present: watch::Sender<Option<(&'static str, Arc<str>)>>,
    closed: watch::Sender<bool>,
}

#[derive(Clone)]
struct Entry {
    id: u64,
    name: &'static str,
    data: Arc<str>,
}

/// Data of an event, with its time.
#[derive(Serialize)]
struct Timed<'a, T> {
    #[serde(skip_serializing_if = "Option::is_none")]
    time: Option<f64>,
    #[serde(flatten)]
    data: &'a T,
}

impl Default for EventLog {
    fn default() -> Self {
        Self {
            entries: Mutex::default(),
            newest: watch::Sender::new(0),
            present: watch::Sender::new(None),
            closed: watch::Sender::new(false),
        }
    }
}

impl EventLog {
    /// Adds an event.
    pub fn push(&self, name: &'static str, data: &impl Serialize) {
        let data: Arc<str> = serde_json::to_string(data).unwrap_or_default().into();
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let id = *self.newest.borrow() + 1;
        entries.push_back(Entry { id, name, data });
        if entries.len() > KEPT {
            entries.pop_front();
        }
        drop(entries);
        self.newest.send_replace(id);
    }

    /// Sends an event without number, of which subscribers need only the newest.
    pub fn tell(&self, name: &'static str, data: &impl Serialize) {
        let data: Arc<str> = serde_json::to_string(data).unwrap_or_default().into();
        self.present.send_replace(Some((name, data)));
    }

    /// Adds an event of a session with its `time` in Unix seconds, if known.
    pub fn push_at(&self, name: &'static str, time: Option<f64>, data: &impl Serialize) {
        self.push(name, &Timed { time, data });
    }

    /// A new log that continues this one, with its events and numbers.
    pub fn continued(&self) -> Self {
        let entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Self { newest: watch::Sender::new(*self.newest.borrow()), entries: Mutex::new(entries), ..Self::default() }
    }

    /// Whether no event is kept.
    pub fn is_empty(&self) -> bool {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    /// Deletes the kept events; numbering continues.
    pub fn clear(&self) {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Ends the log: streams end after the last event.
    pub fn close(&self) {
        self.closed.send_replace(true);
    }

    /// The event after number `last`.
    fn after(&self, last: u64) -> Option<Entry> {
        let entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let at = entries.partition_point(|e| e.id <= last);
        entries.get(at).cloned()
    }

    /// Waits for the event after number `last`; `None` once the log has ended.
    async fn next(&self, last: u64) -> Option<Entry> {
        let (mut newest, mut closed) = (self.newest.subscribe(), self.closed.subscribe());
        loop {
            if let Some(entry) = self.after(last) {
                return Some(entry);
            }
            if *closed.borrow_and_update() {
                return None;
            }
            // The senders live as long as `self`.
            tokio::select! {
                _ = newest.wait_for(|n| *n > last) => {}
                _ = closed.changed() => {}
            }
        }
    }
}

/// The log as a stream of server-sent events, after the `Last-Event-ID` of the request.
///
/// # Errors
/// `too-many` when all places of subscribers are taken.
pub fn stream(
    app: &Arc<App>,
    headers: &HeaderMap,
    log: Arc<EventLog>,
) -> Answer<Sse<impl Stream<Item = Result<Event, Infallible>> + use<>>> {
    let Ok(place) = app.subscribers.clone().try_acquire_owned() else {
        let most = app.config().limits.subscribers;
        return Err(Problem::new(Kind::TooMany, format!("{most} event streams are open already")).remedy("close some"));
    };
    let last = headers.get("last-event-id").and_then(|v| v.to_str().ok()).and_then(|v| v.parse().ok()).unwrap_or(0);
    let stop = app.stopping.subscribe();
    let mut present = log.present.subscribe();
    present.mark_changed();
    let stream = futures::stream::unfold((last, log, place, present), move |(last, log, place, mut present)| {
        let mut stop = stop.clone();
        async move {
            loop {
                // The sender lives as long as the log.
                tokio::select! {
                    biased;
                    entry = log.next(last) => {
                        let entry = entry?;
                        let event = Event::default().id(entry.id.to_string()).event(entry.name).data(&*entry.data);
                        return Some((Ok(event), (entry.id, log, place, present)));
                    }
                    _ = present.changed() => {
                        let told = present.borrow_and_update().clone();
                        if let Some((name, data)) = told {
                            let event = Event::default().event(name).data(&*data);
                            return Some((Ok(event), (last, log, place, present)));
                        }
                    }
                    _ = stop.wait_for(|stopping| *stopping) => return None,
                }
            }
        }
    });
    Ok(Sse::new(stream).keep_alive(KeepAlive::new().interval(ALIVE)))
}
