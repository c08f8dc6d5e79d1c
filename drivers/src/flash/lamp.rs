//! Common behaviour of all flashes: off when opened, off when dropped, and every state read back from the device.

use crate::{Class, Clock, DeviceError, DeviceResult, Flash, FlashInfo, Switched};
use async_trait::async_trait;
use std::sync::Arc;
use std::time::Duration;

/// Attempts to switch off before the error is reported: a light that stays on is the worst outcome.
const TRIES: usize = 3;

/// A lamp that can be switched and reports its state.
pub trait Lamp: Send {
    /// Stable identity.
    fn id(&self) -> String;

    /// Sends the command.
    ///
    /// # Errors
    /// If the device does not accept it.
    fn set(&mut self, on: bool) -> DeviceResult<()>;

    /// Reads the state back.
    ///
    /// # Errors
    /// If the device does not answer, or answers nonsense.
    fn state(&mut self) -> DeviceResult<bool>;
}

/// Settling time and maximum on-time of a flash.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Time from the command until the light is steady.
    pub settling: Duration,
    /// Maximum continuous on-time.
    pub max_on: Duration,
}

/// A flash built on a lamp.
pub struct Switchable<L: Lamp> {
    lamp: L,
    timing: Timing,
    clock: Arc<dyn Clock>,
    /// Last commanded state.
    requested: bool,
}

impl<L: Lamp> Switchable<L> {
    /// A flash that is off.
    ///
    /// # Errors
    /// If the lamp cannot be switched off, or does not confirm it.
    pub fn new(lamp: L, timing: Timing, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let mut flash = Self { lamp, timing, clock, requested: true };
        match flash.off()? {
            false => Ok(flash),
            true => Err(DeviceError::new(&flash.lamp.id(), "switch off when opened", "off", "on")
                .remedy("switch its power off and check its wiring")),
        }
    }

    /// Switches off, with retries; returns whether it is still on.
    fn off(&mut self) -> DeviceResult<bool> {
        let mut outcome = Ok(true);
        for _ in 0..TRIES {
            outcome = self.lamp.set(false).and_then(|()| self.lamp.state());
            if outcome == Ok(false) {
                self.requested = false;
                break;
            }
        }
        outcome
    }

    /// Switches on. On any answer other than "on", the light is switched off before the error is reported.
    fn on(&mut self) -> DeviceResult<bool> {
        self.requested = true;
        let outcome = self.lamp.set(true).and_then(|()| self.lamp.state());
        if outcome != Ok(true) {
            // The error of switching on is reported, not that of switching off.
            let _ = self.off();
        }
        outcome
    }
}

#[async_trait]
impl<L: Lamp> Flash for Switchable<L> {
    fn describe(&self) -> FlashInfo {
        FlashInfo {
            id: self.lamp.id(),
            settling_s: self.timing.settling.as_secs_f64(),
            max_on_s: self.timing.max_on.as_secs_f64(),
        }
    }

    async fn switch(&mut self, on: bool) -> DeviceResult<Switched> {
        let is_on = if on { self.on()? } else { self.off()? };
        // The receiver of the frames waits until the light is steady; a guardian that waited here could not handle
        // requests.
        Ok(Switched { since: self.clock.now() + self.timing.settling, on: is_on })
    }

    async fn is_on(&mut self) -> DeviceResult<bool> {
        let is_on = self.lamp.state()?;
        if is_on == self.requested {
            return Ok(is_on);
        }
        let word = |on| if on { "on" } else { "off" };
        Err(DeviceError::new(&self.lamp.id(), "report its state", word(self.requested), word(is_on))
            .remedy("something else switches it, or it was reset: check its wiring, then resume the session")
            .class(Class::Stop))
    }
}

impl<L: Lamp> Drop for Switchable<L> {
    fn drop(&mut self) {
        // On drop there is no caller to receive the error.
        let _ = self.off();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;
    use std::collections::VecDeque;
    use std::sync::Mutex;

    const SETTLING: Duration = Duration::from_secs(60);

    /// A lamp with scripted states; it records the commands.
    struct Scripted {
        states: VecDeque<Option<bool>>,
        commands: Arc<Mutex<Vec<bool>>>,
    }

    impl Lamp for Scripted {
        fn id(&self) -> String {
            "lamp".into()
        }

        fn set(&mut self, on: bool) -> DeviceResult<()> {
            self.commands.lock().unwrap().push(on);
            Ok(())
        }

        fn state(&mut self) -> DeviceResult<bool> {
            let state = self.states.pop_front().unwrap_or(Some(false));
            state.ok_or_else(|| DeviceError::new("lamp", "report", "a state", "nothing"))
        }
    }

    fn lamp(states: &[Option<bool>]) -> (DeviceResult<Switchable<Scripted>>, Arc<Mutex<Vec<bool>>>) {
        let commands = Arc::new(Mutex::new(vec![]));
        let scripted = Scripted { states: states.iter().copied().collect(), commands: commands.clone() };
        let timing = Timing { settling: SETTLING, max_on: Duration::from_secs(1) };
        (Switchable::new(scripted, timing, Arc::new(SystemClock)), commands)
    }

    fn run<T>(future: impl Future<Output = T>) -> T {
        tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(future)
    }

    #[test]
    fn it_reports_when_the_light_is_steady_without_waiting() {
        let (flash, _) = lamp(&[Some(false), Some(true), Some(false)]);
        let mut flash = flash.unwrap();
        for on in [true, false] {
            let before = SystemClock.now();
            let switched = run(flash.switch(on)).unwrap();
            assert_eq!(switched.on, on);
            assert!(switched.since >= before + SETTLING);
            assert!(SystemClock.now() < before + SETTLING / 2);
        }
    }

    #[test]
    fn off_when_opened_and_when_dropped() {
        let (flash, commands) = lamp(&[]);
        drop(flash);
        assert_eq!(*commands.lock().unwrap(), [false, false]);
    }

    #[test]
    fn one_that_stays_on_is_no_flash() {
        let (flash, _) = lamp(&[Some(true); 3]);
        assert_eq!(&*flash.err().unwrap().got, "on");
    }

    #[test]
    fn one_that_reads_off_after_on_is_switched_off_before_it_is_reported() {
        for state in [Some(false), None] {
            let (flash, commands) = lamp(&[Some(false), state]);
            let mut flash = flash.unwrap();
            let switched = run(flash.switch(true));
            assert!(switched.is_err() || !switched.unwrap().on);
            assert_eq!(*commands.lock().unwrap(), [false, true, false]);
        }
    }

    #[test]
    fn switching_off_is_tried_again() {
        let (flash, _) = lamp(&[Some(false), Some(true), Some(true), None, Some(false)]);
        let mut flash = flash.unwrap();
        assert!(run(flash.switch(true)).unwrap().on);
        assert!(!run(flash.switch(false)).unwrap().on);
    }

    #[test]
    fn a_state_that_nobody_asked_for_is_not_believed() {
        let (flash, _) = lamp(&[Some(false), Some(true), Some(false)]);
        let mut flash = flash.unwrap();
        assert!(run(flash.switch(true)).unwrap().on);
        assert_eq!(run(flash.is_on()).unwrap_err().class, Class::Stop);
    }
}
