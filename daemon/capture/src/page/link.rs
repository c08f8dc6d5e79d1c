//! Connection to the pattern page. One page is bound at a time, and a pattern counts as shown once the page has
//! acknowledged it.

use crate::session::sha256;
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use utoipa::ToSchema;

/// Time without a message after which a page counts as gone.
const SILENCE: Duration = Duration::from_secs(3);

/// Time limit for the acknowledgement of a pattern.
const PATIENCE: Duration = Duration::from_secs(1);

/// Patterns of the page; lengths in mm from the panel's centre, to the right and upwards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[allow(missing_docs, reason = "each pattern explains its numbers")]
pub enum PagePattern {
    /// Black.
    Black {},
    /// Uniform white.
    Full {},
    /// A white disc.
    Disc { center_mm: [f64; 2], diameter_mm: f64 },
    /// Half plane of white; the line's normal points to the white side.
    Edge { angle_deg: f64, offset_mm: f64 },
    /// Luminance that increases from black to white along a direction, linearly (1) or quadratically (2).
    Gradient { order: u8, angle_deg: f64 },
    /// Rings: (1 + cos(2π r / period + phase)) / 2.
    Radial { period_mm: f64, phase_deg: f64 },
    /// Stripes across a direction: (1 + cos(2π u / period + phase)) / 2.
    Axial { period_mm: f64, angle_deg: f64, phase_deg: f64 },
    /// Fringes over the whole panel with luminance (1 + cos 2π(f · x + phase)) / 2, for a panel with this gamma.
    Fringes { cycles_per_mm: [f64; 2], phase: f64, gamma: f64 },
    /// White discs.
    Spots { centers_mm: Vec<[f64; 2]>, diameter_mm: f64 },
    /// Black and white squares.
    Checkerboard { square_mm: f64 },
}

/// State of the pattern page.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct DisplayState {
    /// Id of the bound page.
    bound: Option<String>,
    visible: bool,
    viewport: Option<[f64; 2]>,
    pixel_ratio: Option<f64>,
    /// Hash of the requested pattern.
    hash: String,
    /// True if the page shows it.
    acknowledged: bool,
    size_mm: [f64; 2],
}

/// Reason why the page does not show a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotShown {
    /// The page is not open.
    #[error("no pattern page is open")]
    NoPage,
    /// The page is hidden.
    #[error("the pattern page is hidden")]
    Hidden,
    /// The page does not answer.
    #[error("the pattern page did not acknowledge the pattern")]
    Silent,
}

impl NotShown {
    /// Action for the user.
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

/// Connection to the page.
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
    /// Validates the numbers of a pattern.
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
    /// No page is bound, or it does not show the pattern.
    pub async fn show(&self, pattern: PagePattern) -> Result<(), NotShown> {
        let alive = self.alive();
        let wanted = hashed(pattern);
        let hash = wanted.1.clone();
        // Stored, so that a hidden or later page shows it.
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

    /// Checks that the page still shows the last requested pattern.
    ///
    /// # Errors
    /// It is gone, hidden, or shows another pattern.
    pub(crate) fn still_shows(&self) -> Result<(), NotShown> {
        let alive = self.alive().ok_or(NotShown::NoPage)?;
        if !alive.visible {
            return Err(NotShown::Hidden);
        }
        if *self.acknowledged.borrow() == self.wanted.borrow().1 { Ok(()) } else { Err(NotShown::Silent) }
    }

    /// Bound page, if recently active.
    fn alive(&self) -> Option<Bound> {
        self.bound().clone().filter(|b| b.heard.elapsed() < SILENCE)
    }

    /// True if another page is bound and recently active.
    pub fn is_taken(&self, page: &str) -> bool {
        self.alive().is_some_and(|b| b.page != page)
    }

    /// Binds a page in place of the previous one; returns the patterns to show with their hashes, starting with the
    /// present one.
    pub fn bind(&self, page: String) -> watch::Receiver<(PagePattern, String)> {
        *self.bound() = Some(Bound { page, heard: Instant::now(), visible: true, viewport: None, pixel_ratio: None });
        let mut wanted = self.wanted.subscribe();
        wanted.mark_changed();
        wanted
    }

    /// Records activity of a page, and its viewport in CSS pixels with the device pixel ratio.
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

    /// Records that the page shows the pattern with this hash; hashes of earlier patterns are ignored.
    pub fn acknowledge(&self, hash: String) {
        if hash == self.wanted.borrow().1 {
            self.acknowledged.send_replace(hash);
        }
    }

    /// State of the page, on a panel of this size.
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
