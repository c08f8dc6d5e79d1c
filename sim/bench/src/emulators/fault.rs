//! What goes wrong on a wire.

use serde::{Deserialize, Serialize};

/// A fault of an emulated device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ByteFault {
    /// What it does.
    pub kind: ByteFaultKind,
    /// Commands that it answers properly before.
    #[serde(default)]
    pub after: u64,
    /// Commands that fail; all further ones when it is not given.
    #[serde(default)]
    pub times: Option<u64>,
}

/// What an emulated device does wrong with a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ByteFaultKind {
    /// Says nothing, and does nothing.
    NoAnswer,
    /// Does it, but falls silent half-way through its answer.
    HalfAnswer,
    /// The link is gone.
    Dropped,
    /// Does it, and answers bytes that mean nothing.
    Garbage,
    /// Answers twice.
    Resend,
    /// Starts anew as after power-up, forgetting where it was, and says what it says then.
    Reset,
    /// Answers properly, but late.
    Slow,
    /// Answers a status of error.
    WrongStatus,
    /// Says that it is busy, for ever.
    StuckBusy,
}

impl ByteFaultKind {
    /// All of them.
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

/// Counts commands and says which of them fail.
#[derive(Clone, Debug, Default)]
pub struct Strikes {
    faults: Vec<ByteFault>,
    commands: u64,
}

impl Strikes {
    /// These faults; none have struck yet.
    pub fn new(faults: Vec<ByteFault>) -> Self {
        Self { faults, commands: 0 }
    }

    /// The fault that strikes the next command, which is counted.
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
