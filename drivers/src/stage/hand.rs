//! An analyser turned by hand: "turn to 45° and press Enter".

use crate::{Arrived, Clock, DeviceError, DeviceResult, Stage, StageInfo};
use async_trait::async_trait;
use std::sync::Arc;

/// Asks a person for an action; returns once it is done.
pub trait Prompt: Send {
    /// # Errors
    /// If the person cannot be asked or cancels.
    fn ask(&mut self, request: &str) -> std::io::Result<()>;
}

/// The hand-turned analyser.
pub struct HandStage {
    prompt: Box<dyn Prompt>,
    clock: Arc<dyn Clock>,
    /// Simulated stage that turns the analyser in the person's place.
    turned: Option<Box<dyn Stage>>,
    angle_deg: Option<f64>,
}

/// Reading accuracy of a person on a degree scale.
const TOLERANCE_DEG: f64 = 1.0;

impl HandStage {
    /// An analyser of unknown angle. `turned` follows the requests in a simulation.
    pub fn new(prompt: Box<dyn Prompt>, clock: Arc<dyn Clock>, turned: Option<Box<dyn Stage>>) -> Self {
        Self { prompt, clock, turned, angle_deg: None }
    }

    /// Limits and tolerances of hand operation.
    pub fn info() -> StageInfo {
        StageInfo {
            id: "hand-turned analyser".into(),
            speed_deg_s: 20.0,
            settling_s: 1.0,
            limits_deg: [-360.0, 720.0],
            tolerance_deg: TOLERANCE_DEG,
            approach_deg: 0.0,
            // Time limit for a person.
            longest_s: 24.0 * 3600.0,
            halts: true,
            by_hand: true,
        }
    }

    async fn turn(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let command = format!("turn to {angle_deg}°");
        self.prompt
            .ask(&format!("turn the analyser to {angle_deg}° and press Enter"))
            .map_err(|e| DeviceError::new(&self.describe().id, command.as_str(), "Enter", e.to_string()))?;
        let since = match &mut self.turned {
            Some(stage) => stage.move_to(angle_deg).await?.since,
            None => self.clock.now(),
        };
        self.angle_deg = Some(angle_deg);
        Ok(Arrived { since, angle_deg })
    }
}

#[async_trait]
impl Stage for HandStage {
    fn describe(&self) -> StageInfo {
        Self::info()
    }

    /// A hand-turned stage needs no zero: angles are read from the scale.
    async fn home(&mut self) -> DeviceResult<Arrived> {
        let since = match &mut self.turned {
            Some(stage) => stage.home().await?.since,
            None => self.clock.now(),
        };
        Ok(Arrived { since, angle_deg: self.angle_deg.unwrap_or(0.0) })
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        self.turn(angle_deg).await
    }

    /// A person without a request stops anyway.
    async fn halt(&mut self) -> DeviceResult<()> {
        match &mut self.turned {
            Some(stage) => stage.halt().await,
            None => Ok(()),
        }
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        self.angle_deg.ok_or_else(|| {
            DeviceError::new("hand-turned analyser", "report its position", "an angle", "none, it was not turned yet")
        })
    }
}
