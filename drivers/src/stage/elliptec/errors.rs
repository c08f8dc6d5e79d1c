//! Errors of an Elliptec stage, and their remedies.

use super::Elliptec;
use super::protocol::Status;
use crate::stage::zero::Zero;
use crate::{Class, DeviceError};
use std::time::Duration;

impl Elliptec {
    pub(super) fn error(&self, what: &str, expected: &str, got: impl Into<Box<str>>) -> DeviceError {
        DeviceError::new(self.lines.device(), what, expected, got)
    }

    /// Error of a query or movement that may succeed when repeated.
    pub(super) fn passing(&self, what: &str, expected: &str, got: impl Into<Box<str>>) -> DeviceError {
        self.error(what, expected, got)
            .remedy("check cable, power and the address of the stage, then try again")
            .class(Class::Retry)
    }

    /// Error for a status that is neither ok nor busy: the present action has failed.
    pub(super) fn failed(&mut self, what: &str, status: Status) -> DeviceError {
        self.zero = if status == Status::Initialising { Zero::Forgotten } else { Zero::Unchecked };
        let (class, remedy) = match status {
            Status::CommunicationTimeout | Status::CommandError => (Class::Retry, "check the cable, then try again"),
            Status::MechanicalTimeout => (
                Class::Stop,
                "check that it turns freely; search its frequencies or clean its track if it gets stuck without a load",
            ),
            Status::OutOfRange | Status::OutOfTravel => (Class::Setup, "correct limits_deg of the stage"),
            Status::Isolated | Status::OutOfIsolation => (Class::Stop, "switch it off and on, then home it"),
            Status::Initialising => (
                Class::Stop,
                "it was reset and has forgotten its zero: check its power supply, home it, then resume the session",
            ),
            Status::Thermal => (Class::Stop, "let it cool down, then resume the session"),
            _ => (Class::Stop, "switch it off and on, and have it repaired if this comes back"),
        };
        let got = format!("status {} ({})", status.code(), status.name());
        self.error(what, "status 0 (ok)", got).remedy(remedy).class(class)
    }

    pub(super) fn lost_position(&mut self, what: &str, left_deg: f64, found_deg: f64) -> DeviceError {
        self.zero = Zero::Forgotten;
        let expected = format!("to find it where it was left, at {left_deg:.2}°");
        self.error(what, &expected, format!("{found_deg:.2}°"))
            .remedy("it was reset or turned by hand: check its power supply, home it, then resume the session")
    }

    pub(super) fn stuck(&self, what: &str, limit: Duration) -> DeviceError {
        let got = format!("status 9 (busy) for {:.1} s", limit.as_secs_f64());
        self.error(what, "status 0 (ok)", got)
            .remedy("check that it turns freely, switch it off and on, then resume the session")
    }
}
