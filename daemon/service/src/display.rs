//! The pattern page of an LCD, `/display`. One page is bound; a pattern counts as shown once that page acknowledges
//! it. A page that loses the connection goes black.

use super::App;
use super::problem::{Answer, Kind, Problem};
use super::{Body, Params};
use axum::Json;
use axum::extract::State;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures::Stream;
use nacre_capture::page::{DisplayState, OtherPage, PagePattern};
use serde::Deserialize;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use utoipa::{IntoParams, ToSchema};

/// Interval of heartbeats to the page.
const BEAT: Duration = Duration::from_secs(1);

/// Longest page name and pattern hash in bytes.
const LONGEST: usize = 100;

/// Pattern to show on the page.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "pattern": { "kind": "full" } }))]
pub struct ShowPattern {
    pattern: PagePattern,
}

/// Acknowledgement of a page that its pattern is visible.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Acknowledgement {
    page: String,
    hash: String,
    viewport: [f64; 2],
    pixel_ratio: f64,
    visible: bool,
}

/// Heartbeat of a page.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Beat {
    page: String,
    visible: bool,
}

/// Name of a pattern page.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct PageId {
    /// Random name that the page chose.
    page: String,
}

fn other_page(error: OtherPage) -> Problem {
    Problem::new(Kind::Conflict, error.to_string()).remedy("close one of them")
}

/// Reads the state of the pattern page.
#[utoipa::path(get, path = "/api/v1/display", tag = "display", operation_id = "display",
    responses((status = 200, body = DisplayState)))]
pub async fn state(State(app): State<Arc<App>>) -> Json<DisplayState> {
    Json(app.link.state(app.limits.display.size_mm))
}

/// Shows a pattern on the page; answers once the page has acknowledged it.
#[utoipa::path(post, path = "/api/v1/display/pattern", tag = "display", operation_id = "show_on_display",
    request_body = ShowPattern,
    responses((status = 200, body = DisplayState), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn show(State(app): State<Arc<App>>, Body(body): Body<ShowPattern>) -> Answer<Json<DisplayState>> {
    body.pattern.check().map_err(Problem::bad)?;
    let size_mm = app.limits.display.size_mm;
    if app.config().bench.has_page() {
        return Err(Problem::new(Kind::Conflict, "the pattern page is the bench's panel")
            .remedy("show patterns with /api/v1/devices/display/show, which interlocks and STOP know of"));
    }
    let shown = app.link.show(body.pattern).await;
    shown.map_err(|why| Problem::new(Kind::Conflict, why.to_string()).remedy(why.remedy()))?;
    Ok(Json(app.link.state(size_mm)))
}

/// Binds a page, and sends its patterns as server-sent events `pattern`.
#[utoipa::path(get, path = "/api/v1/display/link", tag = "display", operation_id = "display_link", params(PageId),
    responses((status = 200, content_type = "text/event-stream", body = String), (status = 400, body = Problem),
        (status = 409, body = Problem), (status = 429, body = Problem)))]
pub async fn link(
    State(app): State<Arc<App>>,
    Params(query): Params<PageId>,
) -> Answer<Sse<impl Stream<Item = Result<Event, Infallible>> + use<>>> {
    if query.page.is_empty() || query.page.len() > LONGEST {
        return Err(Problem::bad(format!("page must be a name of 1 to {LONGEST} characters")));
    }
    if app.link.is_taken(&query.page) {
        return Err(other_page(OtherPage));
    }
    let Ok(place) = app.subscribers.clone().try_acquire_owned() else {
        return Err(Problem::new(Kind::TooMany, "too many event streams are open"));
    };
    let wanted = app.link.bind(query.page);
    let size_mm = app.limits.display.size_mm;
    let stop = app.stopping.subscribe();
    let stream = futures::stream::unfold((wanted, place), move |(mut wanted, place)| {
        let mut stop = stop.clone();
        async move {
            tokio::select! {
                changed = wanted.changed() => changed.ok()?,
                _ = stop.wait_for(|stopping| *stopping) => return None,
            }
            let (pattern, hash) = wanted.borrow_and_update().clone();
            let data = serde_json::json!({ "pattern": pattern, "hash": hash, "size_mm": size_mm });
            Some((Ok(Event::default().event("pattern").data(data.to_string())), (wanted, place)))
        }
    });
    Ok(Sse::new(stream).keep_alive(KeepAlive::new().interval(BEAT)))
}

/// Acknowledges that a pattern has been visible for two frames of the page.
#[utoipa::path(post, path = "/api/v1/display/acknowledge", tag = "display", operation_id = "acknowledge",
    request_body = Acknowledgement,
    responses((status = 200, body = DisplayState), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn acknowledge(State(app): State<Arc<App>>, Body(body): Body<Acknowledgement>) -> Answer<Json<DisplayState>> {
    if body.hash.len() > LONGEST {
        return Err(Problem::bad(format!("hash is longer than {LONGEST} characters")));
    }
    app.link.hear(&body.page, body.visible, Some((body.viewport, body.pixel_ratio))).map_err(other_page)?;
    if body.visible {
        app.link.acknowledge(body.hash);
    }
    Ok(Json(app.link.state(app.limits.display.size_mm)))
}

/// Heartbeat of the page.
#[utoipa::path(post, path = "/api/v1/display/beat", tag = "display", operation_id = "display_beat", request_body = Beat,
    responses((status = 200, body = DisplayState), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn beat(State(app): State<Arc<App>>, Body(body): Body<Beat>) -> Answer<Json<DisplayState>> {
    app.link.hear(&body.page, body.visible, None).map_err(other_page)?;
    Ok(Json(app.link.state(app.limits.display.size_mm)))
}
