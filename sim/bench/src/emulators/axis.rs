//! The bench's analyser as a motor that counts from where it was switched on.

use crate::Port;
use crate::messages::{Reply, Request};

/// The analyser, and the counter of whoever turns it.
pub(super) struct Axis {
    port: Box<dyn Port>,
    /// True angle where the counter shows 0.
    zero_deg: f64,
    /// The movement that is under way, if there is one.
    turning: Option<Turning>,
}

/// A movement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Turning {
    /// To the mechanical zero, where the counter is set to 0.
    Homing,
    /// To a place.
    Moving,
}

/// How a movement goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Progress {
    /// Nothing moves.
    Rest,
    /// It goes on.
    Turning,
    /// It is over.
    Done,
    /// The bench refused or failed.
    Failed,
}

impl Axis {
    pub(super) fn new(port: Box<dyn Port>) -> Self {
        let mut axis = Self { port, zero_deg: 0.0, turning: None };
        axis.restart();
        axis
    }

    /// Power comes on: it stands wherever it stands, and calls that 0.
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

    /// What the counter shows, in degrees.
    pub(super) fn counted_deg(&mut self) -> f64 {
        self.true_deg() - self.zero_deg
    }

    /// Begins to turn to what the counter will show.
    pub(super) fn move_to(&mut self, counted_deg: f64) -> bool {
        self.begin(self.zero_deg + counted_deg, Turning::Moving)
    }

    /// Begins to look for the mechanical zero.
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

    /// Ends a movement where it is.
    pub(super) fn halt(&mut self) {
        if self.turning.take().is_some() {
            let _ = self.port.call(&Request::Halt);
        }
    }

    /// Looks after the movement.
    pub(super) fn progress(&mut self) -> Progress {
        let Some(turning) = self.turning else { return Progress::Rest };
        match self.port.call(&Request::Arrive) {
            Ok(Reply::Turning) => Progress::Turning,
            Ok(Reply::Arrived(_)) => {
                self.turning = None;
                if turning == Turning::Homing {
                    // The index mark is where it stands now.
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
