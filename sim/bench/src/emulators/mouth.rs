//! How an emulated device says what it says, in order and with what goes wrong on the way.

use super::{Action, ByteFaultKind};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// What is to be said, and not before when.
#[derive(Default)]
pub(super) struct Mouth {
    late: Duration,
    queue: VecDeque<(Instant, Vec<u8>)>,
}

impl Mouth {
    /// Slow answers come this much later.
    pub(super) fn new(late: Duration) -> Self {
        Self { late, queue: VecDeque::new() }
    }

    /// Says something, spoiled by a fault that concerns the saying.
    pub(super) fn say(&mut self, fault: Option<ByteFaultKind>, answer: &str) {
        let mut due = Instant::now();
        let mut bytes = answer.as_bytes().to_vec();
        match fault {
            Some(ByteFaultKind::HalfAnswer) => bytes.truncate(bytes.len() / 2),
            // All but the end of the line.
            Some(ByteFaultKind::Garbage) => bytes.iter_mut().filter(|b| **b >= b' ').for_each(|b| *b = *b << 1 | 0x81),
            Some(ByteFaultKind::Resend) => bytes.extend(answer.bytes()),
            Some(ByteFaultKind::Slow) => due += self.late,
            _ => {}
        }
        // Nothing overtakes what is late.
        let due = self.queue.back().map_or(due, |(last, _)| due.max(*last));
        self.queue.push_back((due, bytes));
    }

    /// What was to be said is forgotten.
    pub(super) fn shut(&mut self) {
        self.queue.clear();
    }

    /// What is said now.
    pub(super) fn speak(&mut self) -> Vec<Action> {
        let now = Instant::now();
        let mut actions = Vec::new();
        while let Some((_, bytes)) = self.queue.pop_front_if(|(due, _)| *due <= now) {
            actions.push(Action::Send(bytes));
        }
        actions
    }
}
