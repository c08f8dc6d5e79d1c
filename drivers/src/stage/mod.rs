//! Rotation stages. Each driver turns its own axis in degrees; [`Mounted`] makes it the analyser's angle.

mod hand;
mod mount;

pub use hand::{HandStage, Prompt};
pub use mount::{Mounted, Mounting, Sense};

use crate::{Clock, DeviceResult, Stage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The stage of a bench: which driver, and how the analyser sits on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Which driver, with its settings.
    pub driver: StageDriver,
    /// How the analyser sits on the axis.
    #[serde(default)]
    pub mounting: Mounting,
}

/// The drivers of stages: one line each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum StageDriver {
    /// The stage of the simulated bench.
    Simulated {},
    /// A person who turns the analyser when asked.
    Hand {},
}

impl StageConfig {
    /// Opens a stage that is a device of this machine; None for those that are not: simulated and hand-turned.
    ///
    /// # Errors
    /// `Setup` when it is not there, may not be opened or is something else; the message says what to do.
    pub fn open(&self, _clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Stage>>> {
        match &self.driver {
            StageDriver::Simulated {} | StageDriver::Hand {} => None,
        }
    }
}
