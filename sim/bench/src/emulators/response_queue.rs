//! Queue of an emulated device's answers: keeps their order, and applies faults of the transmission.

use super::{Action, ByteFaultKind};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Answers with the earliest times at which they may be sent.
#[derive(Default)]
pub(super) struct ResponseQueue {
    late: Duration,
    queue: VecDeque<(Instant, Vec<u8>)>,
}

impl ResponseQueue {
    /// Queue whose slow answers are delayed by `late`.
    pub(super) fn new(late: Duration) -> Self {
        Self { late, queue: VecDeque::new() }
    }

    /// Queues an answer, changed by a transmission fault.
    pub(super) fn push(&mut self, fault: Option<ByteFaultKind>, answer: &str) {
        let mut send_at = Instant::now();
        let mut bytes = answer.as_bytes().to_vec();
        match fault {
            Some(ByteFaultKind::HalfAnswer) => bytes.truncate(bytes.len() / 2),
            // All bytes but the end of the line.
            Some(ByteFaultKind::Garbage) => bytes.iter_mut().filter(|b| **b >= b' ').for_each(|b| *b = *b << 1 | 0x81),
            Some(ByteFaultKind::Resend) => bytes.extend(answer.bytes()),
            Some(ByteFaultKind::Slow) => send_at += self.late,
            _ => {}
        }
        // Later answers wait for a delayed one.
        let send_at = self.queue.back().map_or(send_at, |(last, _)| send_at.max(*last));
        self.queue.push_back((send_at, bytes));
    }

    /// Discards all queued answers.
    pub(super) fn clear(&mut self) {
        self.queue.clear();
    }

    /// Takes the answers that are due.
    pub(super) fn due(&mut self) -> Vec<Action> {
        let now = Instant::now();
        let mut actions = Vec::new();
        while let Some((_, bytes)) = self.queue.pop_front_if(|(due, _)| *due <= now) {
            actions.push(Action::Send(bytes));
        }
        actions
    }
}
