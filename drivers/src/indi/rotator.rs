//! Rotators of INDI servers.

use super::client::{Client, New, misconfigured};
use super::property::State;
use crate::stage::rotator::{Motion, Port, Reading, Rotator};
use crate::{Class, Clock, DeviceResult, Stage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::{Duration, Instant};

const PROPERTY: &str = "ABS_ROTATOR_ANGLE";
const ANGLE: &str = "ANGLE";
const ABORT: &str = "ROTATOR_ABORT_MOTION";
const REVERSE: &str = "ROTATOR_REVERSE";
/// Time without a message of a moving rotator, after which it is asked.
const SILENCE: Duration = Duration::from_secs(2);

/// A rotator of an INDI server. The driver switches its reversal off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Host of the server, or host and port; the default port is 7624.
    #[serde(default = "localhost")]
    pub address: String,
    /// Name of the rotator on the server.
    pub device: String,
    /// Times, angles and limits.
    #[serde(default)]
    pub motion: Motion,
}

pub(crate) fn localhost() -> String {
    "localhost".into()
}

/// Opens a rotator.
///
/// # Errors
/// `Setup` if the server or the rotator cannot be reached, or the settings are wrong.
pub fn open(settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Box<dyn Stage>> {
    settings.motion.check().map_err(|wrong| misconfigured(&settings.device, wrong))?;
    let limit = settings.motion.answer();
    let mut client = Client::open(&settings.address, &settings.device, limit, &[PROPERTY])?;
    if client.known.switch(REVERSE, "INDI_ENABLED") == Some(true) {
        let off = client.choose("switch its reversal off", REVERSE, "INDI_DISABLED");
        off.map_err(|e| e.class(Class::Setup))?;
    }
    let port = IndiPort { client, heard: Instant::now() };
    let rotator = Rotator::new(port, settings.motion.clone(), clock).map_err(|e| e.class(Class::Setup))?;
    Ok(Box::new(rotator))
}

struct IndiPort {
    client: Client,
    /// Time of the last message about the angle.
    heard: Instant,
}

impl Port for IndiPort {
    fn id(&self) -> &str {
        self.client.id()
    }

    fn halts(&self) -> bool {
        self.client.known.get(ABORT).is_some()
    }

    fn read(&mut self, what: &str) -> DeviceResult<Reading> {
        let before = self.client.known.updates(PROPERTY);
        self.client.catch_up(what)?;
        let mut state = self.client.known.get(PROPERTY).map(|p| p.state);
        if self.client.known.updates(PROPERTY) > before {
            self.heard = Instant::now();
        }
        // A moving rotator sends its angle by itself.
        if state != Some(State::Busy) || self.heard.elapsed() > SILENCE {
            state = Some(self.client.read(what, PROPERTY)?);
            self.heard = Instant::now();
        }
        let Some((angle_deg, _)) = self.client.known.number(PROPERTY, ANGLE) else {
            let error = self.client.error(what, "an angle", self.client.complaint("none"));
            return Err(error.remedy("see the rotator in a client of INDI, then try again").class(Class::Retry));
        };
        Ok(Reading { angle_deg, moving: state == Some(State::Busy) })
    }

    fn go(&mut self, what: &str, angle_deg: f64) -> DeviceResult<()> {
        let range = self.client.known.number(PROPERTY, ANGLE).map_or([0.0; 2], |(_, range)| range);
        let Some(angle_deg) = within(angle_deg, range) else {
            let expected = format!("an angle from {}° to {}°", range[0], range[1]);
            return Err(self
                .client
                .error(what, expected, format!("{angle_deg}°"))
                .remedy("correct limits_deg of the stage")
                .class(Class::Setup));
        };
        self.client.command(what, PROPERTY, &[New::Number(ANGLE, angle_deg)])?;
        self.heard = Instant::now();
        Ok(())
    }

    fn stop(&mut self) -> DeviceResult<()> {
        self.client.command("halt", ABORT, &[New::Switch("ABORT", true)]).map(drop)
    }
}

/// The angle of the circle within a range; equal ends are no limits.
fn within(angle_deg: f64, [low, high]: [f64; 2]) -> Option<f64> {
    if low >= high {
        return Some(angle_deg);
    }
    [0.0, -360.0, 360.0].into_iter().map(|turn| angle_deg + turn).find(|angle| (low..=high).contains(angle))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_sent_within_the_rotators_range() {
        assert_eq!(within(350.0, [0.0, 360.0]), Some(350.0));
        assert_eq!(within(350.0, [-180.0, 180.0]), Some(-10.0));
        assert_eq!(within(200.0, [0.0, 180.0]), None);
        assert_eq!(within(200.0, [0.0, 0.0]), Some(200.0));
    }
}
