//! The bench in the service: one thread owns the devices and runs one job at a time.

mod owner;

pub use owner::{Owner, Picture};

use super::problem::{Kind, Problem};
use nacre_capture::Failure;
use nacre_capture::engine::{Control, Input};
use nacre_capture::rig::{Place, Stop};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use tokio::sync::oneshot;

/// Owner of the devices while the panel is measured, in place of a session id.
pub const PANEL: &str = "panel";

type Job = Box<dyn FnOnce(&mut Owner) + Send>;

/// Handle to the bench's thread.
pub struct Bench {
    jobs: Mutex<Option<Sender<Job>>>,
    shared: Arc<Common>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// State that other threads read while the bench's thread works.
#[derive(Default)]
struct Common {
    /// Session that has the devices or waits for them, and its control.
    session: Mutex<Option<(String, Arc<Control>)>>,
    /// Control of the manual operation under way, to abort it.
    manual: Mutex<Option<Arc<Control>>>,
    /// Number of STOP requests so far.
    stops: AtomicU64,
    end: Stop,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Bench {
    /// Opens the devices on a new thread.
    ///
    /// # Errors
    /// Those of the rig.
    pub async fn open(place: Place) -> Result<Self, Failure> {
        let shared = Arc::new(Common::default());
        let (jobs, queue) = mpsc::channel::<Job>();
        let (tell, told) = oneshot::channel();
        let common = shared.clone();
        let serve = move || {
            let opened = Owner::open(&place, common);
            match opened {
                Ok(mut owner) => {
                    let _ = tell.send(Ok(()));
                    owner.serve(&queue);
                }
                Err(failure) => drop(tell.send(Err(failure))),
            }
        };
        let thread = std::thread::Builder::new().name("bench".into()).spawn(serve);
        let thread = thread.map_err(|e| nacre_base::Error::input("bench", e, "free some memory"))?;
        told.await.unwrap_or_else(|_| Err(died()))?;
        Ok(Self { jobs: Mutex::new(Some(jobs)), shared, thread: Mutex::new(Some(thread)) })
    }

    /// Runs a job on the bench's thread when it is free.
    ///
    /// # Errors
    /// `busy` while a session has the devices; otherwise those of the job.
    pub async fn work<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Owner) -> Result<T, Failure> + Send + 'static,
    ) -> Result<T, Problem> {
        if let Some(id) = self.session() {
            return Err(busy(&id));
        }
        let (tell, told) = oneshot::channel();
        let asked = self.shared.stops.load(Ordering::SeqCst);
        self.send(Box::new(move |owner| {
            owner.asked = asked;
            drop(tell.send(work(owner)));
        }))?;
        Ok(told.await.unwrap_or_else(|_| Err(died()))?)
    }

    /// Gives the devices to a session until `work` returns, then calls the closure that it returned.
    ///
    /// Devices are free before that closure reports the end of the session.
    ///
    /// # Errors
    /// `busy` while another session has the devices.
    pub fn begin<Told: FnOnce()>(
        &self,
        id: &str,
        control: Arc<Control>,
        work: impl FnOnce(&mut Owner) -> Told + Send + 'static,
    ) -> Result<(), Problem> {
        {
            let mut session = locked(&self.shared.session);
            if let Some((other, _)) = session.as_ref() {
                return Err(busy(other));
            }
            // From here on the session can be aborted, even while it waits for the thread.
            let _ = control.send(Input::Start);
            *session = Some((id.to_owned(), control));
        }
        let sent = self.send(Box::new(move |owner| {
            let tell = work(owner);
            owner.forget();
            *locked(&owner.shared.session) = None;
            tell();
        }));
        if sent.is_err() {
            *locked(&self.shared.session) = None;
        }
        sent
    }

    /// Id of the session that has the devices, or [`PANEL`].
    pub fn session(&self) -> Option<String> {
        locked(&self.shared.session).as_ref().map(|s| s.0.clone())
    }

    /// Aborts running and waiting work and switches all light off; returns when the light is off.
    ///
    /// # Errors
    /// Those of the lamps.
    pub async fn stop(&self) -> Result<(), Problem> {
        let session = self.shared.abort();
        let (tell, told) = oneshot::channel();
        self.send(Box::new(move |owner| drop(tell.send(owner.dark()))))?;
        let dark = async {
            match session {
                Some(control) => control.is_dark().await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            // The session's own light is off; storing its last frames need not be waited for.
            () = dark => Ok(()),
            done = told => Ok(done.unwrap_or_else(|_| Err(died()))?),
        }
    }

    /// Ends the thread, with the light off.
    pub fn close(&self) {
        self.shared.end.fetch_add(1, Ordering::Relaxed);
        self.shared.abort();
        locked(&self.jobs).take();
        if let Some(thread) = locked(&self.thread).take() {
            let _ = thread.join();
        }
    }

    fn send(&self, job: Job) -> Result<(), Problem> {
        let sent = locked(&self.jobs).as_ref().is_some_and(|jobs| jobs.send(job).is_ok());
        if sent { Ok(()) } else { Err(Problem::new(Kind::Conflict, "the bench is closed")) }
    }
}

impl Common {
    /// Aborts running work and drops work that has not begun. Returns the session's control.
    fn abort(&self) -> Option<Arc<Control>> {
        self.stops.fetch_add(1, Ordering::SeqCst);
        let session = locked(&self.session).as_ref().map(|s| s.1.clone());
        let manual = locked(&self.manual).clone();
        for control in session.iter().chain(&manual) {
            // A run that has ended needs no abort.
            let _ = control.send(Input::Abort);
        }
        session
    }
}

fn busy(session: &str) -> Problem {
    let who = if session == PANEL { "a measurement of the panel".into() } else { format!("the session {session}") };
    Problem::new(Kind::Busy, format!("{who} has the devices")).remedy("wait until it is done, or stop it")
}

fn died() -> Failure {
    nacre_base::Error::input("bench", "ended unexpectedly", "restart the service, and report this").into()
}
