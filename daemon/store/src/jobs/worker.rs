//! The worker: takes deliveries from `apalis` and does the jobs they name.

use super::record::{End, Failed, Record};
use super::store::{QUEUE, Store};
use super::{Job, JobState, Live, Spec, Work};
use apalis::layers::WorkerBuilderExt;
use apalis::prelude::{BackendExt, BoxDynError, PollSnapshot, PollStrategy, WorkerBuilder};
use apalis_sqlite::{Config, SqliteStorage};
use nacre_base::Error;
use nacre_base::estimate;
use nacre_base::progress::Progress;
use std::fs::{self, File, TryLockError};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::sleep;

/// How often the worker shows that it is alive, and looks for deliveries that it was not told of.
const HEARTBEAT: Duration = Duration::from_secs(2);
/// How long to wait when the database does not answer.
const PAUSE: Duration = Duration::from_secs(1);
/// Stages on their way to the log.
const STAGES: usize = 64;

/// What the queue and its worker have in common.
pub(super) struct Shared {
    pub store: Store,
    work: Work,
    changes: broadcast::Sender<String>,
    bell: Arc<Bell>,
    /// The job that is being worked on.
    current: Mutex<Option<Arc<Live>>>,
    /// Held while a job is being worked on, so that it is one at a time even when the worker had to be started anew.
    turn: tokio::sync::Mutex<()>,
    stopping: AtomicBool,
    /// Held as long as anything works on the folder; the thread of a job has a share in it.
    lock: File,
}

impl Shared {
    pub fn new(store: Store, work: Work, changes: broadcast::Sender<String>, lock: File) -> Self {
        Self {
            store,
            work,
            changes,
            bell: Arc::default(),
            current: Mutex::default(),
            turn: tokio::sync::Mutex::default(),
            stopping: AtomicBool::new(false),
            lock,
        }
    }

    pub fn subscribe(&self) -> broadcast::Receiver<String> {
        self.changes.subscribe()
    }

    /// Tells who listens that a job changed.
    pub fn changed(&self, id: &str) {
        // Nobody may be listening.
        let _ = self.changes.send(id.into());
    }

    /// A job changed, and may wait for the worker.
    pub fn queued(&self, id: &str) {
        self.changed(id);
        self.bell.ring();
    }

    /// Tells the job to stop if it is the running one.
    pub fn cancel(&self, id: &str) {
        if let Some(live) = self.current().as_ref().filter(|live| live.id == id) {
            live.cancel();
        }
    }

    /// Tells the running job to stop, and lets no other begin.
    pub fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
    }

    pub fn stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    /// The job with what its threads have reported since it was last stored.
    pub fn with_progress(&self, mut job: Job) -> Job {
        if let Some(live) = self.current().as_ref().filter(|live| live.id == job.id && job.state == JobState::Running) {
            job.progress = live.progress();
            job.stage = live.stage();
            job.remaining_s = live.remaining_s();
        }
        job
    }

    fn current(&self) -> MutexGuard<'_, Option<Arc<Live>>> {
        self.current.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Wakes the worker when there is a new delivery.
#[derive(Default)]
struct Bell(Mutex<Option<Waker>>);

impl Bell {
    fn ring(&self) {
        let waker = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(waker) = waker {
            waker.wake();
        }
    }
}

/// The worker's ear for the bell.
struct Ear(Arc<Bell>);

impl PollStrategy for Ear {
    fn poll_drive(&mut self, context: &mut Context<'_>, _: &PollSnapshot) -> Poll<Option<()>> {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(context.waker().clone());
        Poll::Pending
    }
}

/// How long a lock is waited for: a process that is being started holds all open files until it runs, locks among them.
const LOCK_PATIENCE: Duration = Duration::from_secs(2);

/// Keeps a second process from working on the folder; the system lets go when the process ends.
pub(super) async fn lock(folder: &Path) -> Result<File, Error> {
    const ELSEWHERE: &str = "check the disk, or give another folder";
    let path = folder.join("jobs.lock");
    let unusable = |source| Error::Output { path: path.clone(), source, remedy: ELSEWHERE };
    fs::create_dir_all(folder).map_err(unusable)?;
    let file = File::options().create(true).append(true).open(&path).map_err(unusable)?;
    let end = Instant::now() + LOCK_PATIENCE;
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(TryLockError::WouldBlock) if Instant::now() < end => sleep(Duration::from_millis(20)).await,
            Err(TryLockError::WouldBlock) => {
                let problem = "has jobs that another process works on";
                return Err(Error::file(folder, problem, "end it, or give another folder"));
            }
            Err(TryLockError::Error(e)) => return Err(unusable(e)),
        }
    }
}

/// Keeps a worker running until the queue is to stop.
pub(super) async fn supervise(shared: Arc<Shared>, mut stopped: watch::Receiver<bool>) {
    tokio::select! {
        () = work_on(&shared) => {}
        // An error means that the queue was dropped.
        _ = stopped.wait_for(|stop| *stop) => {}
    }
    shared.stop();
    // The running job is put back first.
    let _turn = shared.turn.lock().await;
    shared.store.close().await;
    // Otherwise the last owner lets go of it.
    let _ = shared.lock.unlock();
}

/// Starts a worker, and another one when it fails: the disk may be full only for a while.
async fn work_on(shared: &Arc<Shared>) {
    loop {
        // What an earlier worker had taken is delivered again.
        if shared.store.deliver_all().await.is_ok() {
            let config = Config::default().queue(QUEUE).batch_size(1).heartbeat_interval(HEARTBEAT);
            let deliveries = SqliteStorage::<String>::new(shared.store.pool()).with_config(config);
            let owned = shared.clone();
            let worker = WorkerBuilder::new(ulid::Ulid::generate().to_string().as_str())
                .backend(deliveries.poll_with_strategy(Ear(shared.bell.clone())))
                .concurrency(1)
                .build(move |id: String| take(owned.clone(), id));
            // Its error is not the job's; the next worker meets it again or does not.
            let _ = worker.run().await;
        }
        sleep(PAUSE).await;
    }
}

/// Takes the reports of the computing threads.
struct Reporter {
    live: Arc<Live>,
    shared: Arc<Shared>,
    /// Stages on their way to the log. One that finds it full is not logged: computing does not wait for the disk.
    stages: mpsc::Sender<String>,
}

impl Progress for Reporter {
    fn expect(&self, work: &estimate::Work) -> Result<(), Error> {
        self.live.expect(work);
        self.shared.changed(&self.live.id);
        Ok(())
    }

    fn stage(&self, name: &str, steps: u64) {
        self.live.begin(name, steps);
        let _ = self.stages.try_send(name.into());
        self.shared.changed(&self.live.id);
    }

    fn step(&self) {
        if self.live.step() {
            self.shared.changed(&self.live.id);
        }
    }

    fn cancelled(&self) -> bool {
        self.live.is_cancelled() || self.shared.stopping()
    }
}

/// Takes a delivery. The job runs in a task of its own, which outlives the worker.
async fn take(shared: Arc<Shared>, id: String) -> Result<(), BoxDynError> {
    let result = tokio::spawn(run(shared, id)).await;
    match result {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => {
            // It is delivered again at once.
            sleep(PAUSE).await;
            Err(error.into())
        }
        Err(error) => Err(error.into()),
    }
}

/// Does a job if it is queued.
async fn run(shared: Arc<Shared>, id: String) -> Result<(), Error> {
    let _turn = shared.turn.lock().await;
    if shared.stopping() {
        return Ok(());
    }
    // Before the job is running, so that a cancellation finds it.
    let live = Arc::new(Live::new(&id));
    *shared.current() = Some(live.clone());
    let begun = shared.store.change(&id, Record::begin).await;
    let result = match begun {
        Ok(Some(Ok(job))) => {
            shared.changed(&id);
            let result = attempt(&shared, job.spec, live.clone()).await;
            finish(&shared, &live, result).await;
            Ok(())
        }
        // It was cancelled meanwhile, or this delivery has been overtaken by another one.
        Ok(_) => Ok(()),
        Err(error) => Err(error),
    };
    *shared.current() = None;
    result
}

/// Works on a job, and writes its stages down meanwhile.
async fn attempt(shared: &Arc<Shared>, spec: Spec, live: Arc<Live>) -> Result<(), Failed> {
    let id = live.id.clone();
    let (stages, mut entered) = mpsc::channel::<String>(STAGES);
    let reporter = Reporter { live, shared: shared.clone(), stages };
    let work = move || (reporter.shared.work)(&spec, &reporter).inspect(|()| reporter.live.complete());
    let thread = tokio::task::spawn_blocking(work);
    // Ends when the thread drops the reporter.
    while let Some(stage) = entered.recv().await {
        // A line of the log is not worth a job.
        let _ = shared.store.change(&id, |record| record.stage(&stage)).await;
    }
    match thread.await {
        Ok(result) => result.map_err(Failed::from),
        Err(panic) => Err(Failed::Other(format!("the computation crashed: {panic}"))),
    }
}

/// Stores how an attempt ended, as soon as the disk allows it.
async fn finish(shared: &Shared, live: &Live, result: Result<(), Failed>) {
    let end = End { result, stopping: shared.stopping(), progress: live.progress() };
    while shared.store.change(&live.id, |record| record.end(&end)).await.is_err() {
        if shared.stopping() {
            // The next start finds the job running, and does it again.
            return;
        }
        sleep(PAUSE).await;
    }
    shared.queued(&live.id);
}
