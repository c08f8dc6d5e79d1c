//! How an emulated device says what it says, in order and with what goes wrong on the way.

use super::{Action, ByteFaultKind};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// What is to be said, and not before when.
#[derive(Default)]
pub(super) struct ResponseQueue {
    late: Duration,
    queue: VecDeque<(Instant, Vec<u8>)>,
}

impl ResponseQueue {
    /// Slow answers come this much later.
    pub(super) fn new(late: Duration) -> Self {
        Self { late, queue: VecDeque::new() }
    }

    /// Says something, spoiled by a fault that concerns the saying.
    pub(super) fn push(&mut self, fault: Option<ByteFaultKind>, answer: &str) {
        let mut send_at = Instant::now();
        let mut bytes = answer.as_bytes().to_vec();
        match fault {
            Some(ByteFaultKind::HalfAnswer) => bytes.truncate(bytes.len() / 2),
            // All but the end of the line.
            Some(ByteFaultKind::Garbage) => bytes.iter_mut().filter(|b| **b >= b' ').for_each(|b| *b = *b << 1 | 0x81),
            Some(ByteFaultKind::Resend) => bytes.extend(answer.bytes()),
            Some(ByteFaultKind::Slow) => send_at += self.late,
            _ => {}
        }
        // Nothing overtakes what is late.
        let send_at = self.queue.back().map_or(send_at, |(last, _)| send_at.max(*last));
        self.queue.push_back((send_at, bytes));
    }

    /// What was to be said is forgotten.
    pub(super) fn clear(&mut self) {
        self.queue.clear();
    }

    /// What is said now.
    pub(super) fn due(&mut self) -> Vec<Action> {
        let now = Instant::now();
        let mut actions = Vec::new();
        while let Some((_, bytes)) = self.queue.pop_front_if(|(due, _)| *due <= now) {
            actions.push(Action::Send(bytes));
        }
        actions
    }
}
