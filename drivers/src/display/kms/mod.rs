//! A display on an output that no desktop uses, driven directly (kernel mode setting).
//!
//! This excludes interference by windows, screen blanking and night-light programs. Nacre must be DRM master of the
//! graphics card, so no desktop may run on it. With a desktop, use the browser page in full screen instead.

mod card;
mod draw;
mod tone;

pub use draw::{Geometry, draw};
pub use tone::Tone;

use crate::{Class, Clock, DeviceError, DeviceResult, Display, DisplayInfo, Pattern, Shown};
use async_trait::async_trait;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// Spacing of the rows that are read back.
pub const ROWS_APART: usize = 8;

/// A display on an output that no desktop uses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Output name, such as `HDMI-A-1`: as in /sys/class/drm, without the card.
    pub output: String,
    /// Graphics card, such as `/dev/dri/card0`; default: the card that has the output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub card: Option<String>,
    /// Width and height of the picture in mm, if the EDID is wrong or lacks them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_mm: Option<[f64; 2]>,
    /// Tone curve: luminance of each code.
    #[serde(default)]
    pub tone: Tone,
}

impl Settings {
    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
    pub fn check(&self) -> Result<(), String> {
        let named = (1..64).contains(&self.output.len());
        if !named || !self.output.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-') {
            return Err(format!("output is {:?}; give a name such as HDMI-A-1", self.output));
        }
        if let Some(size) = self.size_mm.filter(|s| !s.iter().all(|mm| (1.0..=1e5).contains(mm))) {
            return Err(format!("size_mm is {size:?}; give width and height in mm"));
        }
        self.tone.check()
    }
}

/// Interface between the driver and the kernel's graphics output.
pub trait Screen: Send {
    /// Resolution and size.
    fn geometry(&self) -> Geometry;
    /// Frame period.
    fn refresh(&self) -> Duration;
    /// Draws into the hidden buffer and flips at the next vertical blank; returns after the flip.
    fn flip(&mut self, pixels: &[u32]) -> io::Result<()>;
    /// Reads back every [`ROWS_APART`]th row of the buffer that the kernel reports as visible.
    fn shown(&mut self) -> io::Result<Vec<u32>>;
}

/// A display driven without a desktop.
pub struct KmsPanel {
    screen: Box<dyn Screen>,
    clock: Arc<dyn Clock>,
    id: String,
    tone: Tone,
    response: Duration,
}

/// Opens the display on an output and makes it black.
///
/// # Errors
/// `Setup` if there is no display, if its size is unknown, or if a desktop uses the graphics card.
pub fn open(settings: &Settings, response: Duration, clock: &Arc<dyn Clock>) -> DeviceResult<KmsPanel> {
    settings.check().map_err(|wrong| setup(&settings.output, "settings of a panel", wrong))?;
    let (screen, id) = card::open(settings)?;
    KmsPanel::new(Box::new(screen), &id, settings.tone.clone(), response, clock.clone())
}

fn setup(device: &str, expected: &str, got: impl Into<Box<str>>) -> DeviceError {
    DeviceError::new(device, "open", expected, got).remedy("correct the panel's configuration").class(Class::Setup)
}

impl KmsPanel {
    /// A display on a screen, which becomes black. `response` is the settling time of its pixels.
    ///
    /// # Errors
    /// As the screen.
    pub fn new(
        screen: Box<dyn Screen>,
        id: &str,
        tone: Tone,
        response: Duration,
        clock: Arc<dyn Clock>,
    ) -> DeviceResult<Self> {
        screen.geometry().check().map_err(|got| {
            setup(id, "a panel's size", got).remedy("measure the picture and give its width and height as `size_mm`")
        })?;
        let mut panel = Self { screen, clock, id: id.to_owned(), tone, response };
        panel.put(Pattern::Black)?;
        Ok(panel)
    }

    fn put(&mut self, pattern: Pattern) -> DeviceResult<Shown> {
        let geometry = self.screen.geometry();
        let pixels = draw(&pattern, &geometry, &self.tone).map_err(|got| {
            DeviceError::new(&self.id, "show a pattern", "a pattern on the panel", got)
                .remedy("move or shrink the light, or correct the panel's `size_mm`")
                .class(Class::Setup)
        })?;
        let failed = |e: io::Error| failure(&self.id, "show a pattern", &e);
        self.screen.flip(&pixels).map_err(failed)?;
        let width = geometry.pixels[0];
        let drawn = pixels.chunks(width).step_by(ROWS_APART).flatten();
        let shown = self.screen.shown().map_err(failed)?;
        if !drawn.eq(&shown) {
            let remedy = "end what else draws on this output, then resume the session";
            return Err(DeviceError::new(&self.id, "show a pattern", "the output to show it", "another picture")
                .remedy(remedy)
                .class(Class::Retry));
        }
        // The output scans a picture from top to bottom over one frame period.
        self.clock.wait(self.screen.refresh() + self.response);
        Ok(Shown { since: self.clock.now(), pattern })
    }
}

impl Drop for KmsPanel {
    fn drop(&mut self) {
        // The output is then switched off, and some displays show a message of their own.
        let [w, h] = self.screen.geometry().pixels;
        let _ = self.screen.flip(&vec![0; w * h]);
    }
}

#[async_trait]
impl Display for KmsPanel {
    fn describe(&self) -> DisplayInfo {
        DisplayInfo { id: self.id.clone(), size_mm: self.screen.geometry().size_mm }
    }

    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown> {
        self.put(pattern)
    }
}

/// Device error for a kernel error, with its meaning.
fn failure(id: &str, command: &str, e: &io::Error) -> DeviceError {
    let error = DeviceError::new(id, command, "the graphics card to do it", e.to_string());
    match e.kind() {
        io::ErrorKind::PermissionDenied | io::ErrorKind::ResourceBusy => error
            .remedy(
                "a desktop uses this graphics card: log out and run Nacre on a text console, or keep the desktop and \
                 open the page /display in a browser on this output's full screen (driver `page`); without a \
                 desktop, let this user use the card: `sudo usermod -aG video $USER`",
            )
            .class(Class::Setup),
        io::ErrorKind::TimedOut => error.remedy("switch the panel on").class(Class::Retry),
        io::ErrorKind::NotFound => {
            error.remedy("give an output of those in /sys/class/drm, and plug its cable in").class(Class::Setup)
        }
        _ => error.remedy("check the panel's cable and power").class(Class::Lost),
    }
}

#[cfg(test)]
mod tests;
