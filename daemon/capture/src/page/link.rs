//! The way to the pattern page. One page is bound at a time, and a pattern counts as shown once the page has acknowledged it.

use crate::session::sha256;
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use utoipa::ToSchema;

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

/// Another page is bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("another page is bound")]
pub struct OtherPage;

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
    /// Checks its numbers.
    ///
    /// # Errors
    /// A length, an angle, an exponent or the number of discs is out of range.
    pub fn check(&self) -> Result<(), &'static str> {
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
        if ok { Ok(()) } else { Err("the pattern has a number that makes no sense") }
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
    pub(crate) fn still_shows(&self) -> Result<(), NotShown> {
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

    /// Whether a page other than this one is bound and was heard of lately.
    pub fn is_taken(&self, page: &str) -> bool {
        self.alive().is_some_and(|b| b.page != page)
    }

    /// Binds a page, in place of the one before; returns the patterns that it is to show with their hashes, the present one first.
    pub fn bind(&self, page: String) -> watch::Receiver<(PagePattern, String)> {
        *self.bound() = Some(Bound { page, heard: Instant::now(), visible: true, viewport: None, pixel_ratio: None });
        let mut wanted = self.wanted.subscribe();
        wanted.mark_changed();
        wanted
    }

    /// Notes a sign of life of a page, and its viewport in CSS pixels with the device's pixels in each.
    ///
    /// # Errors
    /// Another page is bound.
    pub fn hear(&self, page: &str, visible: bool, viewport: Option<([f64; 2], f64)>) -> Result<(), OtherPage> {
        let mut bound = self.bound();
        let bound = bound.as_mut().filter(|b| b.page == page).ok_or(OtherPage)?;
        (bound.heard, bound.visible) = (Instant::now(), visible);
        if let Some((viewport, ratio)) = viewport {
            (bound.viewport, bound.pixel_ratio) = (Some(viewport), Some(ratio));
        }
        if !visible {
            self.acknowledged.send_replace(String::new());
        }
        Ok(())
    }

    /// Notes that the page shows the pattern with this hash; that of an earlier pattern counts for nothing.
    pub fn acknowledge(&self, hash: String) {
        if hash == self.wanted.borrow().1 {
            self.acknowledged.send_replace(hash);
        }
    }

    /// The page as it is, on a panel of this size.
    pub fn state(&self, size_mm: [f64; 2]) -> DisplayState {
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
