//! Rotation stages. Each driver turns its axis in degrees; [`Mounted`] converts axis angles to analyser angles.

pub(crate) mod check;
pub mod elliptec;
pub mod grbl;
mod hand;
pub mod line;
mod mount;
pub mod rotator;
mod zero;

pub use hand::{HandStage, Prompt};
pub use mount::{Mounted, Mounting, Sense};

use crate::{Class, Clock, DeviceError, DeviceResult, Stage, alpaca, indi};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The stage of a bench: driver, and mounting of the analyser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Driver and its settings.
    pub driver: StageDriver,
    /// Mounting of the analyser on the axis.
    #[serde(default)]
    pub mounting: Mounting,
}

/// Stage drivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum StageDriver {
    /// The stage of the simulated bench.
    Simulated {},
    /// A person who turns the analyser on request.
    Hand {},
    /// A rotation stage of Thorlabs' Elliptec series.
    Elliptec(elliptec::Settings),
    /// A rotary axis on a motor controller that runs GRBL 1.1.
    Grbl(grbl::Settings),
    /// A rotator of an ASCOM Alpaca server.
    Alpaca(alpaca::rotator::Settings),
    /// A rotator of an INDI server.
    Indi(indi::rotator::Settings),
    /// A stage with a text protocol, which is described here.
    Line(Box<line::Settings>),
}

impl StageConfig {
    /// Opens a stage of this machine; `None` for simulated and hand-turned stages.
    ///
    /// # Errors
    /// `Setup` if the stage is missing, may not be opened or is another device; the message contains the remedy.
    pub fn open(&self, clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Stage>>> {
        if let Err(problem) = self.mounting.check() {
            return Some(Err(misconfigured("stage", problem)));
        }
        let axis: DeviceResult<Box<dyn Stage>> = match &self.driver {
            StageDriver::Simulated {} | StageDriver::Hand {} => return None,
            StageDriver::Elliptec(settings) => boxed(elliptec::Elliptec::open(settings, clock.clone())),
            StageDriver::Line(settings) => boxed(line::LineStage::open(settings, clock.clone())),
            StageDriver::Alpaca(settings) => alpaca::rotator::open(settings, clock.clone()),
            StageDriver::Indi(settings) => indi::rotator::open(settings, clock.clone()),
            StageDriver::Grbl(settings) => boxed(grbl::Grbl::open(settings, clock.clone())),
        };
        Some(axis.map(|axis| Box::new(Mounted::new(axis, self.mounting)) as Box<dyn Stage>))
    }
}

fn boxed<S: Stage + 'static>(opened: DeviceResult<S>) -> DeviceResult<Box<dyn Stage>> {
    opened.map(|stage| Box::new(stage) as Box<dyn Stage>)
}

/// Error of the configuration: `problem` gives the invalid key and its valid values.
fn misconfigured(device: &str, problem: String) -> DeviceError {
    DeviceError::new(device, "open", "a proper configuration", problem)
        .remedy("correct the configuration of the stage")
        .class(Class::Setup)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;

    fn opened(driver: StageDriver, mounting: Mounting) -> DeviceError {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        StageConfig { driver, mounting }.open(&clock).unwrap().err().unwrap()
    }

    #[test]
    fn failures_to_open_are_setup_errors() {
        let nowhere = elliptec::Settings { port: "/dev/there-is-no-such-port".into(), ..Default::default() };
        let gear = Mounting { gear: 0.0, ..Mounting::default() };
        for (driver, mounting, word) in [
            (StageDriver::Elliptec(nowhere.clone()), Mounting::default(), "/dev/there-is-no-such-port"),
            (StageDriver::Elliptec(nowhere), gear, "mounting.gear"),
            (StageDriver::Elliptec(elliptec::Settings::default()), Mounting::default(), "port is missing"),
            (StageDriver::Grbl(grbl::Settings::default()), Mounting::default(), "port is missing"),
        ] {
            let error = opened(driver, mounting);
            assert!(error.class == Class::Setup && error.to_string().contains(word), "{error}");
        }
    }

    #[test]
    fn devices_of_other_machines_are_not_opened() {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        for driver in [StageDriver::Simulated {}, StageDriver::Hand {}] {
            assert!(StageConfig { driver, mounting: Mounting::default() }.open(&clock).is_none());
        }
    }
}
