//! Monitoring of a contact by a thread, so that short openings are counted and a hanging driver counts as open.

use super::InputLevel;
use crate::{Class, DeviceError, DeviceResult, Interlock, InterlockInfo, Level};
use async_trait::async_trait;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval between readings. Doors and buttons stay open for longer.
const PERIOD: Duration = Duration::from_millis(10);

/// Pause before a lost input is opened again.
const RETRY: Duration = Duration::from_millis(200);

/// Age in which a reading becomes invalid. It tolerates a busy machine; kernel drivers wait up to 5 s for a USB device.
const MAX_AGE: Duration = Duration::from_millis(500);

const REMEDY: &str = "check its cable and plug; close it, then resume the session";

/// A digital input.
pub trait Input: Send {
    /// Whether the input is high.
    ///
    /// # Errors
    /// The input cannot be read; it is then opened again.
    fn is_high(&mut self) -> DeviceResult<bool>;
}

/// Opens an input; called again after the input could not be read.
pub type OpenInput = Box<dyn FnMut() -> DeviceResult<Box<dyn Input>> + Send>;

/// A contact at a digital input, which a thread reads every 10 ms.
pub struct Contact {
    id: String,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    stop: AtomicBool,
}

struct State {
    /// The last reading: whether the contact is closed.
    closed: DeviceResult<bool>,
    read_at: Instant,
    changes: u64,
}

impl Contact {
    /// Opens and reads the input, and starts to monitor it. `open_level` is the level of an open contact.
    ///
    /// # Errors
    /// `Setup` if the input cannot be opened or read.
    pub fn open(id: String, mut open: OpenInput, open_level: InputLevel) -> DeviceResult<Self> {
        let opens_high = open_level == InputLevel::High;
        let mut input = open()?;
        let closed = input.is_high().map_err(|e| e.class(Class::Setup))? != opens_high;
        let state = State { closed: Ok(closed), read_at: Instant::now(), changes: 0 };
        let shared = Arc::new(Shared { state: Mutex::new(state), stop: AtomicBool::new(false) });
        let monitored = shared.clone();
        let monitor = move || monitored.monitor(input, open, opens_high);
        let thread = std::thread::Builder::new().name("interlock".into()).spawn(monitor).map_err(|e| {
            DeviceError::new(&id, "monitor it", "a thread", e.to_string())
                .remedy("free some memory")
                .class(Class::Setup)
        })?;
        Ok(Self { id, shared, thread: Some(thread) })
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn monitor(&self, input: Box<dyn Input>, mut open: OpenInput, opens_high: bool) {
        let mut input = Some(input);
        while !self.stop.load(Ordering::Relaxed) {
            let read = match input.take() {
                Some(input) => Ok(input),
                None => open(),
            };
            let read = read.and_then(|mut opened| {
                let high = opened.is_high()?;
                input = Some(opened);
                Ok(high != opens_high)
            });
            self.lock().record(read);
            std::thread::park_timeout(if input.is_some() { PERIOD } else { RETRY });
        }
    }
}

impl State {
    fn is_stale(&self) -> bool {
        self.read_at.elapsed() > MAX_AGE
    }

    /// Records a reading. A change to or from an invalid reading counts as a change of the contact.
    fn record(&mut self, closed: DeviceResult<bool>) {
        if self.is_stale() || self.closed.as_ref().ok() != closed.as_ref().ok() {
            self.changes += 1;
        }
        (self.closed, self.read_at) = (closed, Instant::now());
    }
}

#[async_trait]
impl Interlock for Contact {
    fn describe(&self) -> InterlockInfo {
        InterlockInfo { id: self.id.clone() }
    }

    async fn level(&mut self) -> DeviceResult<Level> {
        let state = self.shared.lock();
        // The class `Lost` would let the caller wait for a new link while light is on.
        let holds = state.closed.clone().map_err(|e| e.class(Class::Stop).remedy(REMEDY))?;
        if state.is_stale() {
            let got = format!("none within {} ms", MAX_AGE.as_millis());
            return Err(DeviceError::new(&self.id, "report its level", "an answer", got).remedy(REMEDY));
        }
        Ok(Level { holds, changes: state.changes })
    }
}

impl Drop for Contact {
    /// Ends the thread, and waits for it unless its driver hangs: a GPIO line must be free before it is opened again.
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let is_free = self.shared.lock().closed.is_err() || !self.shared.lock().is_stale();
            if is_free {
                // A panic of the thread has already been reported.
                let _ = thread.join();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::wait;

    /// Time in which the thread must have read the input; generous for a busy machine.
    const SOON: Duration = Duration::from_secs(20);

    #[derive(Clone, Copy, PartialEq)]
    enum Fake {
        High,
        Low,
        Gone,
        Hangs,
    }

    struct FakeInput(Arc<Mutex<Fake>>);

    impl Input for FakeInput {
        fn is_high(&mut self) -> DeviceResult<bool> {
            while *self.0.lock().unwrap() == Fake::Hangs {
                std::thread::sleep(Duration::from_millis(1));
            }
            match *self.0.lock().unwrap() {
                Fake::High => Ok(true),
                Fake::Gone => Err(DeviceError::new("door", "read", "a level", "a lost link").class(Class::Lost)),
                _ => Ok(false),
            }
        }
    }

    fn contact(fake: &Arc<Mutex<Fake>>, open_level: InputLevel) -> DeviceResult<Contact> {
        let shared = fake.clone();
        Contact::open("door".into(), Box::new(move || Ok(Box::new(FakeInput(shared.clone())))), open_level)
    }

    fn until(contact: &mut Contact, is: impl Fn(&DeviceResult<Level>) -> bool) -> DeviceResult<Level> {
        let begun = Instant::now();
        loop {
            let level = wait(contact.level());
            if is(&level) {
                return level;
            }
            assert!(begun.elapsed() < SOON, "{level:?}");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn the_contact_follows_its_input_with_either_polarity() {
        for (open_level, closed, open) in
            [(InputLevel::Low, Fake::High, Fake::Low), (InputLevel::High, Fake::Low, Fake::High)]
        {
            let fake = Arc::new(Mutex::new(closed));
            let mut door = contact(&fake, open_level).unwrap();
            assert_eq!(wait(door.level()), Ok(Level { holds: true, changes: 0 }));
            *fake.lock().unwrap() = open;
            until(&mut door, |l| *l == Ok(Level { holds: false, changes: 1 })).unwrap();
            *fake.lock().unwrap() = closed;
            until(&mut door, |l| *l == Ok(Level { holds: true, changes: 2 })).unwrap();
        }
    }

    #[test]
    fn an_unplugged_input_is_open_and_its_return_is_a_change() {
        let fake = Arc::new(Mutex::new(Fake::High));
        let mut door = contact(&fake, InputLevel::Low).unwrap();
        *fake.lock().unwrap() = Fake::Gone;
        let error = until(&mut door, Result::is_err).unwrap_err();
        assert!(error.class == Class::Stop && error.got.contains("lost link"), "{error}");
        *fake.lock().unwrap() = Fake::High;
        let level = until(&mut door, Result::is_ok).unwrap();
        assert!(level.holds && level.changes == 2, "{level:?}");
    }

    #[test]
    fn a_hanging_driver_counts_as_open_and_delays_nothing() {
        let fake = Arc::new(Mutex::new(Fake::High));
        let mut door = contact(&fake, InputLevel::Low).unwrap();
        *fake.lock().unwrap() = Fake::Hangs;
        let error = until(&mut door, Result::is_err).unwrap_err();
        assert!(error.class == Class::Stop && error.got.contains("none within 500 ms"), "{error}");
        drop(door);
        *fake.lock().unwrap() = Fake::Gone;
        assert_eq!(contact(&fake, InputLevel::Low).err().unwrap().class, Class::Setup);
    }

    #[test]
    fn a_late_reading_is_a_change() {
        let late = Instant::now().checked_sub(2 * MAX_AGE).unwrap();
        let mut state = State { closed: Ok(true), read_at: late, changes: 0 };
        state.record(Ok(true));
        state.record(Ok(true));
        assert_eq!(state.changes, 1);
    }
}
