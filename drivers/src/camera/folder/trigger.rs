//! Release of the shutter, by the operator or by a switched cable.

use super::settings::{Settings, Trigger};
use crate::flash::{Timing, lcus, relay, serial_line};
use crate::{Clock, DeviceError, DeviceResult, Flash, Prompt};
use std::sync::Arc;
use std::time::Duration;

/// Longest time for which an output may be closed, beyond the configured one.
const MAX_HELD: Duration = Duration::from_secs(60);

/// Release of the shutter.
pub(super) struct Release {
    prompt: Box<dyn Prompt>,
    /// Output that closes the shutter cable; `None` for the operator.
    output: Option<Box<dyn Flash>>,
    hold: Duration,
    clock: Arc<dyn Clock>,
}

impl Release {
    /// Opens the output, which is then open.
    ///
    /// # Errors
    /// `Setup` if it is missing or may not be opened.
    pub(super) fn open(settings: &Settings, clock: &Arc<dyn Clock>, prompt: Box<dyn Prompt>) -> DeviceResult<Self> {
        let timing = Timing { settling: Duration::ZERO, max_on: MAX_HELD };
        let output = match &settings.trigger {
            Trigger::Hand {} => None,
            Trigger::SerialLine(port) => Some(serial_line::open(port, timing, clock)?),
            Trigger::Relay(board) => Some(relay::open(board, timing, clock)?),
            Trigger::Lcus(board) => Some(lcus::open(board, timing, clock)?),
        };
        let hold = Duration::from_secs_f64(settings.hold_ms / 1e3);
        Ok(Self { prompt, output, hold, clock: clock.clone() })
    }

    /// Requests a photograph. The operator is asked to take it, and to change the settings in `change` before.
    ///
    /// # Errors
    /// The operator cannot be asked or cancels; the output fails.
    pub(super) async fn request(&mut self, id: &str, change: Option<String>) -> DeviceResult<()> {
        let set = change.map(|change| format!("set the camera to {change}"));
        let words = match (&self.output, set) {
            (None, Some(set)) => Some(format!("{set}, press Enter, then take the photograph")),
            (None, None) => Some("press Enter, then take the photograph".to_owned()),
            (Some(_), Some(set)) => Some(format!("{set}, then press Enter")),
            (Some(_), None) => None,
        };
        if let Some(words) = words {
            self.prompt.ask(&words).map_err(|e| {
                DeviceError::new(id, words.as_str(), "Enter", e.to_string())
                    .remedy("run the session at a terminal, or set the camera before it begins")
            })?;
        }
        let Some(output) = &mut self.output else { return Ok(()) };
        let closed = output.switch(true).await.map(drop);
        if closed.is_ok() {
            self.clock.wait(self.hold);
        }
        let opened = output.switch(false).await.map(drop);
        closed.and(opened)
    }
}
