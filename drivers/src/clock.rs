//! Time as devices see it, so that a simulated bench can run faster than the clock on the wall.

use std::time::{Duration, Instant};

/// Monotonic time since an arbitrary start.
pub trait Clock: Send + Sync {
    /// Time now.
    fn now(&self) -> Duration;
    /// Returns once `duration` has passed on this clock.
    fn wait(&self, duration: Duration);
}

/// The machine's monotonic clock.
pub struct SystemClock(Instant);

impl Default for SystemClock {
    fn default() -> Self {
        Self(Instant::now())
    }
}

impl Clock for SystemClock {
    fn now(&self) -> Duration {
        self.0.elapsed()
    }

    fn wait(&self, duration: Duration) {
        std::thread::sleep(duration);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn system_clock_waits_at_least_as_long_as_asked() {
        let clock = SystemClock::default();
        let before = clock.now();
        clock.wait(Duration::from_millis(5));
        assert!(clock.now() - before >= Duration::from_millis(5));
    }
}
