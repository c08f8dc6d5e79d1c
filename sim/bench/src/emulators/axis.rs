//! The bench's analyser as a motor axis whose counter starts at 0 at power-up.

use crate::Port;
use crate::messages::{Reply, Request};

/// The analyser, and the counter of its controller.
pub(super) struct Axis {
    port: Box<dyn Port>,
    /// True angle in degrees at which the counter shows 0.
    zero_deg: f64,
    /// The movement under way.
    turning: Option<Turning>,
}

/// Kind of a movement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Turning {
    /// To the mechanical zero, where the counter is set to 0.
    Homing,
    /// To a target.
    Moving,
}

/// State of a movement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Progress {
    /// No movement.
    Rest,
    /// Still moving.
    Turning,
    /// Completed.
    Done,
    /// The bench refused the movement or failed.
    Failed,
}

impl Axis {
    pub(super) fn new(port: Box<dyn Port>) -> Self {
        let mut axis = Self { port, zero_deg: 0.0, turning: None };
        axis.restart();
        axis
    }

    /// Power-up: the counter shows 0 at the present angle.
    pub(super) fn restart(&mut self) {
        self.halt();
        self.zero_deg = self.true_deg();
    }

    fn true_deg(&mut self) -> f64 {
        match self.port.call(&Request::Position) {
            Ok(Reply::Angle(angle)) => angle,
            _ => f64::NAN,
        }
    }

    /// Value of the counter in degrees.
    pub(super) fn counted_deg(&mut self) -> f64 {
        self.true_deg() - self.zero_deg
    }

    /// Starts a movement to a value of the counter; returns false if the bench refuses.
    pub(super) fn move_to(&mut self, counted_deg: f64) -> bool {
        self.begin(self.zero_deg + counted_deg, Turning::Moving)
    }

    /// Starts a movement to the mechanical zero.
    pub(super) fn home(&mut self) -> bool {
        self.begin(0.0, Turning::Homing)
    }

    fn begin(&mut self, true_deg: f64, turning: Turning) -> bool {
        let begun = self.port.call(&Request::MoveTo { angle_deg: true_deg }).is_ok();
        self.turning = begun.then_some(turning);
        begun
    }

    pub(super) fn is_turning(&self) -> bool {
        self.turning.is_some()
    }

    /// Stops the movement.
    pub(super) fn halt(&mut self) {
        if self.turning.take().is_some() {
            let _ = self.port.call(&Request::Halt);
        }
    }

    /// Updates and returns the state of the movement.
    pub(super) fn progress(&mut self) -> Progress {
        let Some(turning) = self.turning else { return Progress::Rest };
        match self.port.call(&Request::Arrive) {
            Ok(Reply::Turning) => Progress::Turning,
            Ok(Reply::Arrived(_)) => {
                self.turning = None;
                if turning == Turning::Homing {
                    // The axis stands at the index mark now.
                    self.zero_deg = 0.0;
                }
                Progress::Done
            }
            _ => {
                self.turning = None;
                Progress::Failed
            }
        }
    }
}
