//! One thread per device: it connects, executes one call at a time, and reconnects after a lost link.
//!
//! A cancelled caller leaves the device in a known state. The call either runs to its end on the device's thread or, if
//! it is interruptible, is dropped at its next await and followed by its clean-up. No command is repeated after a
//! reconnection, so neither motion nor light resumes without a new command.

use crate::{Class, Clock, DeviceError, DeviceResult};
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::oneshot;

/// Opens a device; called again after the link is lost.
pub type Connect<D> = Box<dyn FnMut() -> DeviceResult<Box<D>> + Send>;

/// Future of a call on a device.
pub type Pending<'a, T> = Pin<Box<dyn Future<Output = DeviceResult<T>> + Send + 'a>>;

type Job<D> = Box<dyn FnOnce(&mut Link<D>, &tokio::runtime::Runtime) + Send>;

/// Pause before the second attempt to connect; it doubles with each further attempt.
const FIRST_PAUSE: Duration = Duration::from_millis(50);

/// A device on its own thread.
pub struct Actor<D: ?Sized> {
    id: String,
    patience: Duration,
    jobs: Option<mpsc::Sender<Job<D>>>,
    thread: Option<JoinHandle<()>>,
    /// A call that exceeded its limit still occupies the thread.
    stuck: bool,
}

/// Total time for reconnection attempts, and the clock that measures it.
#[derive(Clone)]
pub struct Patience {
    /// Total time.
    pub total: Duration,
    /// Measures the pauses between attempts.
    pub clock: Arc<dyn Clock>,
}

/// The device, while it is connected.
struct Link<D: ?Sized> {
    connect: Connect<D>,
    device: Option<Box<D>>,
    identity: fn(&D) -> String,
    id: String,
    patience: Patience,
    /// Error of the clean-up after a dropped call.
    unended: Option<DeviceError>,
}

impl<D: ?Sized + Send + 'static> Actor<D> {
    /// Connects on a new thread. `identity` reads the device's stable identity.
    ///
    /// # Errors
    /// As `connect`; the thread has then ended.
    pub async fn start<T: Send + 'static>(
        mut connect: Connect<D>,
        identity: fn(&D) -> String,
        describe: fn(&D) -> T,
        patience: Patience,
    ) -> DeviceResult<(Self, T)> {
        let (jobs, queue) = mpsc::channel::<Job<D>>();
        let (tell, replies) = oneshot::channel();
        let total = patience.total;
        let serve = move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            let opened = runtime.map_err(|e| no_thread(&e)).and_then(|runtime| Ok((runtime, connect()?)));
            let (runtime, device) = match opened {
                Ok(opened) => opened,
                Err(error) => return drop(tell.send(Err(error))),
            };
            let id = identity(&device);
            if tell.send(Ok((id.clone(), describe(&device)))).is_err() {
                return;
            }
            let mut link = Link { connect, device: Some(device), identity, id, patience, unended: None };
            queue.into_iter().for_each(|job| job(&mut link, &runtime));
        };
        let thread = std::thread::Builder::new().name("device".into()).spawn(serve).map_err(|e| no_thread(&e))?;
        match replies.await {
            Ok(Ok((id, info))) => {
                Ok((Self { id, patience: total, jobs: Some(jobs), thread: Some(thread), stuck: false }, info))
            }
            answer => {
                // The thread has sent its last message, so this does not block.
                let _ = thread.join();
                Err(answer.map_or_else(|_| died("device", "connect"), |r| r.err().unwrap_or_else(|| died("", ""))))
            }
        }
    }

    /// Runs a call on the device's thread.
    ///
    /// # Errors
    /// As the device. `Stop` if it has not answered after `limit` (plus `patience` for a reconnection), measured on the
    /// system clock.
    pub async fn call<T: Send + 'static>(
        &mut self,
        command: &str,
        limit: Duration,
        run: impl for<'a> FnOnce(&'a mut D) -> Pending<'a, T> + Send + 'static,
    ) -> DeviceResult<T> {
        let (answer, answered) = oneshot::channel();
        let named = command.to_owned();
        let job: Job<D> = Box::new(move |link, runtime| {
            let result = link.connected(&named).and_then(|device| runtime.block_on(run(device)));
            link.mark_if_lost(&result);
            // A cancelled caller does not need the answer.
            let _ = answer.send(result);
        });
        self.queue(command, limit, job, answered).await
    }

    /// Runs a call that is dropped when its caller is cancelled; `end` then brings the device to rest.
    ///
    /// # Errors
    /// As [`Actor::call`].
    pub async fn interruptible<T: Send + 'static>(
        &mut self,
        command: &str,
        limit: Duration,
        run: impl for<'a> FnOnce(&'a mut D) -> Pending<'a, T> + Send + 'static,
        end: impl for<'a> FnOnce(&'a mut D) -> Pending<'a, ()> + Send + 'static,
    ) -> DeviceResult<T> {
        let (mut answer, answered) = oneshot::channel();
        let named = command.to_owned();
        let job: Job<D> = Box::new(move |link, runtime| {
            let unended = link.unended.take().map_or(Ok(()), Err);
            let result = unended.and_then(|()| link.connected(&named)).and_then(|device| {
                runtime.block_on(async {
                    let done = tokio::select! {
                        biased;
                        () = answer.closed() => None,
                        result = run(device) => Some(result),
                    };
                    match done {
                        Some(result) => result.map(Some),
                        None => end(device).await.map(|()| None),
                    }
                })
            });
            link.mark_if_lost(&result);
            // If the clean-up failed and the caller is gone, the next caller receives the error.
            if let Some(Err(Err(error))) = result.transpose().map(|result| answer.send(result)) {
                link.unended = Some(error);
            }
        });
        self.queue(command, limit, job, answered).await
    }

    async fn queue<T>(
        &mut self,
        command: &str,
        limit: Duration,
        job: Job<D>,
        answered: oneshot::Receiver<DeviceResult<T>>,
    ) -> DeviceResult<T> {
        let silent = || {
            let got = format!("none within {:.0} s", limit.as_secs_f64());
            let remedy = "unplug the device and plug it in again, then resume the session";
            DeviceError::new(&self.id, command, "an answer", got).remedy(remedy)
        };
        if self.stuck {
            return Err(silent());
        }
        let sent = self.jobs.as_ref().is_some_and(|jobs| jobs.send(job).is_ok());
        if !sent {
            return Err(died(&self.id, command));
        }
        match tokio::time::timeout(limit + self.patience, answered).await {
            Ok(Ok(result)) => result,
            Ok(Err(_)) => Err(died(&self.id, command)),
            Err(_) => {
                let error = silent();
                self.stuck = true;
                Err(error)
            }
        }
    }
}

impl<D: ?Sized> Drop for Actor<D> {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take().filter(|_| !self.stuck) {
            // A device that panicked has already reported it.
            let _ = thread.join();
        }
    }
}

impl<D: ?Sized> Link<D> {
    /// Marks a lost device for reconnection before the next call.
    fn mark_if_lost<T>(&mut self, result: &DeviceResult<T>) {
        if result.as_ref().is_err_and(|e| e.class == Class::Lost) {
            self.device = None;
        }
    }

    /// The device, reconnected if necessary. A device of another identity is refused.
    fn connected(&mut self, command: &str) -> DeviceResult<&mut D> {
        if self.device.is_none() {
            self.device = Some(self.reconnect(command)?);
        }
        self.device.as_deref_mut().ok_or_else(|| died(&self.id, command))
    }

    fn reconnect(&mut self, command: &str) -> DeviceResult<Box<D>> {
        let (begun, mut pause) = (self.patience.clock.now(), FIRST_PAUSE);
        loop {
            match (self.connect)() {
                Ok(device) => {
                    let found = (self.identity)(&device);
                    if found == self.id {
                        return Ok(device);
                    }
                    let remedy = "plug the first device in again, or begin a new session";
                    return Err(DeviceError::new(&self.id, command, "the same device after the link was lost", found)
                        .remedy(remedy));
                }
                Err(error) if self.patience.clock.now().saturating_sub(begun) + pause > self.patience.total => {
                    return Err(DeviceError::new(
                        &self.id,
                        command,
                        format!("the link back within {:.0} s", self.patience.total.as_secs_f64()),
                        format!("{} ({})", error.got, error.command),
                    )
                    .remedy("check cable and power, then resume the session"));
                }
                Err(_) => {
                    self.patience.clock.wait(pause);
                    pause *= 2;
                }
            }
        }
    }
}

fn no_thread(e: &std::io::Error) -> DeviceError {
    DeviceError::new("device", "start its thread", "a thread", e.to_string()).remedy("free some memory")
}

fn died(id: &str, command: &str) -> DeviceError {
    DeviceError::new(id, command, "an answer", "none, its driver has crashed").remedy("report this")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    trait Counter: Send {
        fn id(&self) -> String;
        fn next<'a>(&'a mut self) -> Pending<'a, usize>;
    }

    /// Counts calls since the connection. The second call loses the link; a third one blocks until it is released.
    struct Fake {
        id: String,
        calls: usize,
        release: Arc<Mutex<()>>,
    }

    impl Counter for Fake {
        fn id(&self) -> String {
            self.id.clone()
        }

        fn next<'a>(&'a mut self) -> Pending<'a, usize> {
            self.calls += 1;
            let (calls, release) = (self.calls, self.release.clone());
            Box::pin(async move {
                if calls == 2 {
                    return Err(DeviceError::new("fake", "count", "a number", "nothing").class(Class::Lost));
                }
                drop(release.lock());
                Ok(calls)
            })
        }
    }

    fn patience(ms: u64) -> Patience {
        Patience { total: Duration::from_millis(ms), clock: Arc::new(SystemClock) }
    }

    /// The n-th connection (from 0) succeeds if `works(n)` returns the device's name.
    async fn actor(
        works: fn(usize) -> Option<&'static str>,
        release: Arc<Mutex<()>>,
        total_ms: u64,
    ) -> DeviceResult<Actor<dyn Counter>> {
        let tries = AtomicUsize::new(0);
        let connect: Connect<dyn Counter> = Box::new(move || match works(tries.fetch_add(1, Ordering::Relaxed)) {
            Some(id) => Ok(Box::new(Fake { id: id.into(), calls: 0, release: release.clone() })),
            None => Err(DeviceError::new("fake", "open", "a device", "none")),
        });
        Ok(Actor::start(connect, |d| d.id(), |_| (), patience(total_ms)).await?.0)
    }

    /// Limit for calls that return at once; only a hung machine exceeds it.
    const LONG: Duration = Duration::from_secs(60);

    fn run<T>(future: impl Future<Output = T>) -> T {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(future)
    }

    #[test]
    fn a_lost_link_comes_back_and_the_failed_call_is_not_repeated() {
        run(async {
            let mut actor = actor(|n| (n != 1 && n != 2).then_some("one"), Arc::default(), 60_000).await.unwrap();
            assert_eq!(actor.call("count", LONG, |d| d.next()).await, Ok(1));
            assert_eq!(actor.call("count", LONG, |d| d.next()).await.unwrap_err().class, Class::Lost);
            assert_eq!(actor.call("count", LONG, |d| d.next()).await, Ok(1), "a fresh connection, not the third call");
        });
    }

    #[test]
    fn a_link_that_stays_lost_or_becomes_another_device_is_an_error_with_a_remedy() {
        run(async {
            let mut gone = actor(|n| (n == 0).then_some("one"), Arc::default(), 200).await.unwrap();
            let mut other = actor(|n| Some(["one", "two"][n.min(1)]), Arc::default(), 200).await.unwrap();
            for (actor, word) in [(&mut gone, "link back"), (&mut other, "same device")] {
                actor.call("count", LONG, |d| d.next()).await.unwrap();
                actor.call("count", LONG, |d| d.next()).await.unwrap_err();
                let error = actor.call("count", LONG, |d| d.next()).await.unwrap_err();
                assert!(error.class == Class::Stop && error.expected.contains(word), "{error}");
            }
        });
    }

    #[test]
    #[allow(clippy::await_holding_lock, reason = "the device's thread waits for it, as the test wants")]
    fn a_device_that_does_not_answer_is_an_error_after_the_limit() {
        let release = Arc::new(Mutex::new(()));
        run(async {
            let mut actor = actor(|_| Some("one"), release.clone(), 0).await.unwrap();
            let held = release.lock().unwrap();
            let limit = Duration::from_millis(20);
            let error = actor.call("count", limit, |d| d.next()).await.unwrap_err();
            assert!(error.got.contains("none within"), "{error}");
            assert!(actor.call("count", limit, |d| d.next()).await.is_err(), "still stuck");
            drop(held);
        });
    }

    #[test]
    fn interrupted_calls_are_dropped_and_ended_in_order() {
        run(async {
            let mut actor = actor(|_| Some("one"), Arc::default(), 0).await.unwrap();
            let ended = Arc::new(AtomicUsize::new(0));
            let end = ended.clone();
            let endless = actor.interruptible(
                "count",
                LONG,
                |_| -> Pending<'_, usize> { Box::pin(std::future::pending()) },
                move |d| {
                    end.fetch_add(1, Ordering::Relaxed);
                    Box::pin(async move { d.next().await.map(drop) })
                },
            );
            assert!(tokio::time::timeout(Duration::from_millis(20), endless).await.is_err());
            // The clean-up was the first call, so this one is the second and loses the link.
            actor.call("count", LONG, |d| d.next()).await.unwrap_err();
            assert_eq!(ended.load(Ordering::Relaxed), 1);
        });
    }

    #[test]
    fn a_device_that_cannot_be_opened_says_why() {
        let error = run(actor(|_| None, Arc::default(), 10)).err().unwrap();
        assert_eq!(&*error.command, "open");
    }
}
