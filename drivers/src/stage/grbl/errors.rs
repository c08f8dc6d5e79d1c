//! Errors of a GRBL axis, and their remedies.

use super::Grbl;
use super::protocol::{State, alarm_name, error_name};
use crate::stage::zero::Zero;
use crate::{Class, DeviceError};

/// Alarm of a target beyond the soft limits.
const SOFT_LIMIT: u8 = 2;

/// Number of the controller's setting with the travel of X; the other axes follow.
const TRAVEL_OF_X: usize = 130;

impl Grbl {
    pub(super) fn error(&self, what: &str, expected: &str, got: impl Into<Box<str>>) -> DeviceError {
        DeviceError::new(self.lines.device(), what, expected, got)
    }

    /// Error of a command that may succeed when repeated.
    pub(super) fn passing(&self, what: &str, expected: &str, got: String) -> DeviceError {
        self.error(what, expected, got).remedy("check cable and power, then try again").class(Class::Retry)
    }

    /// Instruction for finding the zero again.
    fn again(&self) -> &'static str {
        if self.settings.homes {
            "home it, then resume the session"
        } else {
            "turn the analyser to 0°, restart the controller, then begin a new session"
        }
    }

    pub(super) fn restarted(&mut self, what: &str) -> DeviceError {
        self.zero = Zero::Forgotten;
        self.error(what, "an answer", "a reset: the controller started anew and its position is not known")
            .remedy(format!("check its power supply; {}", self.again()))
    }

    pub(super) fn moved_away(&mut self, what: &str, left_deg: f64, found_deg: f64) -> DeviceError {
        self.zero = Zero::Forgotten;
        let expected = format!("to find it where it was left, at {left_deg:.2}°");
        self.error(what, &expected, format!("{found_deg:.2}°, after a reset or another program's move"))
            .remedy(format!("check its power supply; {}", self.again()))
    }

    pub(super) fn lost_zero(&self, what: &str) -> DeviceError {
        self.error(what, "a known zero", "a controller that was reset since it was set").remedy(self.again())
    }

    pub(super) fn alarmed(&mut self, what: &str, code: Option<u8>) -> DeviceError {
        self.zero = Zero::Forgotten;
        let got = match code {
            Some(code) => format!("alarm {code} ({})", alarm_name(code)),
            None => "a state of alarm".into(),
        };
        let remedy = match code {
            Some(SOFT_LIMIT) => format!(
                "narrow limits_deg of the stage to the travel of the controller (${}), or enlarge that travel or switch \
                 soft limits off ($20=0); then home it and resume",
                TRAVEL_OF_X + self.settings.axis.index()
            ),
            _ => "see that nothing is in its way; home it, or unlock it with $X if it cannot home, then resume".into(),
        };
        self.error(what, "no alarm", got).remedy(remedy)
    }

    pub(super) fn refused(&self, what: &str, code: u8) -> DeviceError {
        let (class, remedy) = match code {
            1..=3 | 11 => (Class::Retry, "check the cable, then try again"),
            8 | 9 | 10 | 13 => (Class::Stop, "home it, or unlock it with $X if it cannot home, then resume"),
            5 => (Class::Setup, "switch homing on ($22=1), or set homes = false"),
            _ => (Class::Setup, "correct axis, feed and scale in the configuration of the stage"),
        };
        self.error(what, "ok", format!("error {code} ({})", error_name(code))).remedy(remedy).class(class)
    }

    pub(super) fn not_idle(&self, what: &str, state: State) -> DeviceError {
        let (class, remedy) = match state {
            State::Check => (Class::Setup, "leave check mode, in which nothing moves ($C)"),
            State::Door => (Class::Stop, "close the door, then resume the session"),
            State::Hold { .. } => {
                (Class::Stop, "release the hold (~) or reset the controller, then resume the session")
            }
            State::Sleep => (Class::Stop, "reset the controller and home it, then resume the session"),
            _ => {
                (Class::Stop, "check that it turns freely and that no other program drives it, then resume the session")
            }
        };
        self.error(what, "an idle controller", format!("state {state:?}")).remedy(remedy).class(class)
    }

    pub(super) fn stopped_short(&self, what: &str, target_deg: Option<f64>, at: f64) -> DeviceError {
        let expected = target_deg.map_or_else(|| "its target".to_owned(), |t| format!("{t}°"));
        self.error(what, &expected, format!("rest at {at:.2}°, without its end"))
            .remedy("try again; if this comes back, check limits, scale and units of the reports ($13=0)")
            .class(Class::Retry)
    }

    pub(super) fn no_axis(&self, what: &str) -> DeviceError {
        self.error(what, &format!("a report of axis {:?}", self.settings.axis), "none")
            .remedy("correct the axis in the configuration: boards without rotary axes have X, Y and Z")
            .class(Class::Setup)
    }

    /// Without homing, a restored link may lead to a restarted controller, so the error becomes permanent.
    pub(super) fn for_good(&self, error: DeviceError) -> DeviceError {
        match error.class {
            Class::Lost if !self.settings.homes => error.class(Class::Stop).remedy(self.again()),
            _ => error,
        }
    }
}
