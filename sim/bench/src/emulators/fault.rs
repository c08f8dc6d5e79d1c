//! Faults of emulated devices at byte level.

use serde::{Deserialize, Serialize};

/// A fault of an emulated device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ByteFault {
    /// Kind of the fault.
    pub kind: ByteFaultKind,
    /// Number of commands before the fault.
    #[serde(default)]
    pub after: u64,
    /// Number of commands that fail. Default: all further ones.
    #[serde(default)]
    pub times: Option<u64>,
}

/// Kinds of faults of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ByteFaultKind {
    /// Neither executes nor answers the command.
    NoAnswer,
    /// Executes the command, but sends only half of the answer.
    HalfAnswer,
    /// The connection is lost.
    Dropped,
    /// Executes the command, and answers invalid bytes.
    Garbage,
    /// Answers twice.
    Resend,
    /// Restarts as after power-up, loses its position, and sends its greeting.
    Reset,
    /// Answers correctly, but late.
    Slow,
    /// Answers an error status.
    WrongStatus,
    /// Reports busy permanently.
    StuckBusy,
}

impl ByteFaultKind {
    /// All kinds.
    pub const ALL: [Self; 9] = [
        Self::NoAnswer,
        Self::HalfAnswer,
        Self::Dropped,
        Self::Garbage,
        Self::Resend,
        Self::Reset,
        Self::Slow,
        Self::WrongStatus,
        Self::StuckBusy,
    ];
}

/// Counts commands and selects those that fail.
#[derive(Clone, Debug, Default)]
pub struct Strikes {
    faults: Vec<ByteFault>,
    commands: u64,
}

impl Strikes {
    /// These faults, with no command counted yet.
    pub fn new(faults: Vec<ByteFault>) -> Self {
        Self { faults, commands: 0 }
    }

    /// Counts the next command and returns its fault.
    pub fn strike(&mut self) -> Option<ByteFaultKind> {
        self.commands += 1;
        let count = self.commands;
        let strikes = |f: &&ByteFault| count > f.after && f.times.is_none_or(|n| count <= f.after.saturating_add(n));
        self.faults.iter().find(strikes).map(|f| f.kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_strike_when_they_are_due() {
        let mut strikes = Strikes::new(vec![ByteFault { kind: ByteFaultKind::Slow, after: 1, times: Some(2) }]);
        let struck: Vec<bool> = (0..4).map(|_| strikes.strike().is_some()).collect();
        assert_eq!(struck, [false, true, true, false]);
    }
}
