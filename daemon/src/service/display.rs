//! The pattern page for an LCD, `/display`: one page is bound, and what it shows counts only once it has acknowledged
//! it. The page goes black by itself when it hears nothing.

use super::App;
use super::problem::{Answer, Kind, Problem};
use super::{Body, Params};
use crate::session::sha256;
use axum::Json;
use axum::extract::State;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures::Stream;
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use utoipa::{IntoParams, ToSchema};

/// The page is told this often that the service lives.
const BEAT: Duration = Duration::from_secs(1);

/// A page that was not heard of for this long is gone.
const SILENCE: Duration = Duration::from_secs(3);

/// A pattern has to be acknowledged within this.
const PATIENCE: Duration = Duration::from_secs(1);

/// What the pattern page can show; lengths in mm from the panel's middle, to the right and up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[allow(missing_docs, reason = "each pattern explains its numbers")]
pub enum PagePattern {
    /// Nothing.
    Black {},
    /// White everywhere.
    Full {},
    /// A white disc.
    Disc { center_mm: [f64; 2], diameter_mm: f64 },
    /// White on one side of a line; its normal points to the white side.
    Edge { angle_deg: f64, offset_mm: f64 },
    /// Luminance that grows from black to white along a direction, linearly (1) or with the square (2).
    Gradient { order: u8, angle_deg: f64 },
    /// Rings: (1 + cos(2π r / period + phase)) / 2.
    Radial { period_mm: f64, phase_deg: f64 },
    /// Stripes across a direction: (1 + cos(2π u / period + phase)) / 2.
    Axial { period_mm: f64, angle_deg: f64, phase_deg: f64 },
    /// Stripes over the whole panel whose luminance is (1 + cos 2π(f · x + phase)) / 2 on a panel of this exponent.
    Fringes { cycles_per_mm: [f64; 2], phase: f64, gamma: f64 },
    /// White discs.
    Spots { centers_mm: Vec<[f64; 2]>, diameter_mm: f64 },
    /// Black and white squares.
    Checkerboard { square_mm: f64 },
}

/// What to show on the page.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "pattern": { "kind": "full" } }))]
pub struct ShowPattern {
    pattern: PagePattern,
}

/// A page says what it shows.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Acknowledgement {
    page: String,
    hash: String,
    viewport: [f64; 2],
    pixel_ratio: f64,
    visible: bool,
}

/// A page says that it lives.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Beat {
    page: String,
    visible: bool,
}

/// Which page.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct PageId {
    /// A random name that the page gave itself.
    page: String,
}

/// The pattern page as it is.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct DisplayState {
    /// The page that is bound.
    bound: Option<String>,
    visible: bool,
    viewport: Option<[f64; 2]>,
    pixel_ratio: Option<f64>,
    /// Of the pattern that is to be shown.
    hash: String,
    /// The page shows it.
    acknowledged: bool,
    size_mm: [f64; 2],
}

/// Why the page does not show a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotShown {
    /// Nobody has it open.
    #[error("no pattern page is open")]
    NoPage,
    /// It is behind something else.
    #[error("the pattern page is hidden")]
    Hidden,
    /// It says nothing.
    #[error("the pattern page did not acknowledge the pattern")]
    Silent,
}

impl NotShown {
    /// What the user can do.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::NoPage => "open /display on the LCD",
            Self::Hidden => "bring it to the front",
            Self::Silent => "check that it is in front and not asleep",
        }
    }
}

/// The way to the page.
pub struct Link {
    wanted: watch::Sender<(PagePattern, String)>,
    bound: Mutex<Option<Bound>>,
    acknowledged: watch::Sender<String>,
}

#[derive(Clone)]
struct Bound {
    page: String,
    heard: Instant,
    visible: bool,
    viewport: Option<[f64; 2]>,
    pixel_ratio: Option<f64>,
}

impl Default for Link {
    fn default() -> Self {
        Self {
            wanted: watch::Sender::new(hashed(PagePattern::Black {})),
            bound: Mutex::default(),
            acknowledged: watch::Sender::default(),
        }
    }
}

fn hashed(pattern: PagePattern) -> (PagePattern, String) {
    let hash = sha256(&serde_json::to_vec(&pattern).unwrap_or_default());
    (pattern, hash)
}

impl PagePattern {
    fn check(&self) -> Answer<()> {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite() && v.abs() <= 1e5);
        let ok = match self {
            Self::Black {} | Self::Full {} => true,
            Self::Disc { center_mm, diameter_mm } => finite(center_mm) && finite(&[*diameter_mm]) && *diameter_mm > 0.0,
            Self::Edge { angle_deg, offset_mm } => finite(&[*angle_deg, *offset_mm]),
            Self::Gradient { order, angle_deg } => (1..=2).contains(order) && finite(&[*angle_deg]),
            Self::Radial { period_mm, phase_deg } => finite(&[*period_mm, *phase_deg]) && *period_mm > 0.0,
            Self::Axial { period_mm, angle_deg, phase_deg } => {
                finite(&[*period_mm, *angle_deg, *phase_deg]) && *period_mm > 0.0
            }
            Self::Fringes { cycles_per_mm, phase, gamma } => {
                finite(cycles_per_mm) && finite(&[*phase]) && (0.2..=5.0).contains(gamma)
            }
            Self::Spots { centers_mm, diameter_mm } => {
                centers_mm.len() <= 10_000
                    && finite(centers_mm.as_flattened())
                    && finite(&[*diameter_mm])
                    && *diameter_mm > 0.0
            }
            Self::Checkerboard { square_mm } => finite(&[*square_mm]) && *square_mm > 0.0,
        };
        if ok { Ok(()) } else { Err(Problem::bad("the pattern has a number that makes no sense")) }
    }
}

impl Link {
    fn bound(&self) -> MutexGuard<'_, Option<Bound>> {
        self.bound.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Shows a pattern on the page; returns once the page has acknowledged it.
    ///
    /// # Errors
    /// There is no page, or it does not show it.
    pub async fn show(&self, pattern: PagePattern) -> Result<(), NotShown> {
        let alive = self.alive();
        let wanted = hashed(pattern);
        let hash = wanted.1.clone();
        // A page that is hidden or comes later shows it then.
        self.acknowledged.send_replace(String::new());
        self.wanted.send_replace(wanted);
        match alive {
            None => return Err(NotShown::NoPage),
            Some(bound) if !bound.visible => return Err(NotShown::Hidden),
            Some(_) => {}
        }
        let mut acknowledged = self.acknowledged.subscribe();
        let shown = tokio::time::timeout(PATIENCE, acknowledged.wait_for(|h| *h == hash)).await;
        if matches!(shown, Ok(Ok(_))) { Ok(()) } else { Err(NotShown::Silent) }
    }

    /// That the page still shows what it was asked for last.
    ///
    /// # Errors
    /// It is gone, hidden, or shows something else.
    pub fn still_shows(&self) -> Result<(), NotShown> {
        let alive = self.alive().ok_or(NotShown::NoPage)?;
        if !alive.visible {
            return Err(NotShown::Hidden);
        }
        if *self.acknowledged.borrow() == self.wanted.borrow().1 { Ok(()) } else { Err(NotShown::Silent) }
    }

    /// The page that is bound and was heard of lately.
    fn alive(&self) -> Option<Bound> {
        self.bound().clone().filter(|b| b.heard.elapsed() < SILENCE)
    }

    fn hear(&self, page: &str, visible: bool, look: Option<([f64; 2], f64)>) -> Answer<()> {
        let mut bound = self.bound();
        let Some(bound) = bound.as_mut().filter(|b| b.page == page) else {
            return Err(Problem::new(Kind::Conflict, "another page is bound").remedy("close one of them"));
        };
        (bound.heard, bound.visible) = (Instant::now(), visible);
        if let Some((viewport, ratio)) = look {
            (bound.viewport, bound.pixel_ratio) = (Some(viewport), Some(ratio));
        }
        if !visible {
            self.acknowledged.send_replace(String::new());
        }
        Ok(())
    }

    fn state(&self, size_mm: [f64; 2]) -> DisplayState {
        let (alive, hash) = (self.alive(), self.wanted.borrow().1.clone());
        let visible = alive.as_ref().is_some_and(|b| b.visible);
        DisplayState {
            visible,
            viewport: alive.as_ref().and_then(|b| b.viewport),
            pixel_ratio: alive.as_ref().and_then(|b| b.pixel_ratio),
            acknowledged: visible && *self.acknowledged.borrow() == hash,
            bound: alive.map(|b| b.page),
            hash,
            size_mm,
        }
    }
}

/// The pattern page as it is.
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
    body.pattern.check()?;
    let size_mm = app.limits.display.size_mm;
    if app.config.bench.has_page() {
        return Err(Problem::new(Kind::Conflict, "the pattern page is the bench's panel")
            .remedy("show patterns with /api/v1/devices/display/show, which interlocks and STOP know of"));
    }
    let shown = app.link.show(body.pattern).await;
    shown.map_err(|why| Problem::new(Kind::Conflict, why.to_string()).remedy(why.remedy()))?;
    Ok(Json(app.link.state(size_mm)))
}

/// Binds a page and tells it what to show, as server-sent events: `pattern`.
#[utoipa::path(get, path = "/api/v1/display/link", tag = "display", operation_id = "display_link", params(PageId),
    responses((status = 200, content_type = "text/event-stream", body = String), (status = 400, body = Problem),
        (status = 409, body = Problem), (status = 429, body = Problem)))]
pub async fn link(
    State(app): State<Arc<App>>,
    Params(query): Params<PageId>,
) -> Answer<Sse<impl Stream<Item = Result<Event, Infallible>> + use<>>> {
    if query.page.is_empty() || query.page.len() > 100 {
        return Err(Problem::bad("page must be a name of 1 to 100 characters"));
    }
    if app.link.alive().is_some_and(|b| b.page != query.page) {
        return Err(Problem::new(Kind::Conflict, "another page is bound").remedy("close one of them"));
    }
    let Ok(place) = app.subscribers.clone().try_acquire_owned() else {
        return Err(Problem::new(Kind::TooMany, "too many event streams are open"));
    };
    let bound = Bound { page: query.page, heard: Instant::now(), visible: true, viewport: None, pixel_ratio: None };
    *app.link.bound() = Some(bound);
    let mut wanted = app.link.wanted.subscribe();
    wanted.mark_changed();
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

/// The page shows a pattern since two of its frames.
#[utoipa::path(post, path = "/api/v1/display/acknowledge", tag = "display", operation_id = "acknowledge",
    request_body = Acknowledgement,
    responses((status = 200, body = DisplayState), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn acknowledge(State(app): State<Arc<App>>, Body(body): Body<Acknowledgement>) -> Answer<Json<DisplayState>> {
    app.link.hear(&body.page, body.visible, Some((body.viewport, body.pixel_ratio)))?;
    if body.visible && body.hash == app.link.wanted.borrow().1 {
        app.link.acknowledged.send_replace(body.hash);
    }
    Ok(Json(app.link.state(app.limits.display.size_mm)))
}

/// The page lives.
#[utoipa::path(post, path = "/api/v1/display/beat", tag = "display", operation_id = "display_beat", request_body = Beat,
    responses((status = 200, body = DisplayState), (status = 400, body = Problem), (status = 409, body = Problem)))]
pub async fn beat(State(app): State<Arc<App>>, Body(body): Body<Beat>) -> Answer<Json<DisplayState>> {
    app.link.hear(&body.page, body.visible, None)?;
    Ok(Json(app.link.state(app.limits.display.size_mm)))
}
