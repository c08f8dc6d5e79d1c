//! Clock interface of the devices, so that a simulated bench can run faster than real time.

use std::time::Duration;

/// Monotonic time since an arbitrary start.
pub trait Clock: Send + Sync {
    /// Current time.
    fn now(&self) -> Duration;
    /// Returns once `duration` has passed on this clock.
    fn wait(&self, duration: Duration);
}

/// The system's monotonic clock, which also stamps the kernel's camera frames.
#[derive(Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now(&self) -> Duration {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec as u32)
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
        let clock = SystemClock;
        let before = clock.now();
        clock.wait(Duration::from_millis(5));
        assert!(clock.now() - before >= Duration::from_millis(5));
    }
}
