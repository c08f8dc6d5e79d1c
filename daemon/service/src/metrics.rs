//! Counters in Prometheus' text format.

use nacre_capture::engine::State;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;

/// The service's counters.
pub struct Metrics {
    registry: Registry,
    requests: Family<Status, Counter>,
    sessions: Family<End, Counter>,
    subscribers: Gauge,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct Status {
    status: u32,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct End {
    state: String,
}

impl Default for Metrics {
    fn default() -> Self {
        let mut registry = Registry::with_prefix("nacre");
        let (requests, sessions, subscribers) = (Family::default(), Family::default(), Gauge::default());
        registry.register("requests", "Requests answered, by status", requests.clone());
        registry.register("sessions", "Runs of sessions ended, by state", sessions.clone());
        registry.register("event_streams", "Event streams open", subscribers.clone());
        Self { registry, requests, sessions, subscribers }
    }
}

impl Metrics {
    /// Counts an answered request.
    pub fn answered(&self, status: u16) {
        self.requests.get_or_create(&Status { status: status.into() }).inc();
    }

    /// Counts a session run that ended.
    pub fn session_ended(&self, state: State) {
        self.sessions.get_or_create(&End { state: nacre_capture::plan::word(state) }).inc();
    }

    /// All counters as text; `streams` is the number of open event streams.
    pub fn text(&self, streams: usize) -> String {
        self.subscribers.set(streams as i64);
        let mut text = String::new();
        // Writing into a string cannot fail.
        let _ = encode(&mut text, &self.registry);
        text
    }
}
