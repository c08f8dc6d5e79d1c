//! The worker: receives deliveries from `apalis` and runs their jobs.

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

/// Interval of the worker's heartbeat, and of its search for deliveries without a notification.
const HEARTBEAT: Duration = Duration::from_secs(2);
/// Wait before a retry when the database does not answer.
const PAUSE: Duration = Duration::from_secs(1);
/// Most stages that wait to be written to the log.
const STAGES: usize = 64;

/// State shared by the queue and its worker.
pub(super) struct Shared {
    pub store: Store,
    work: Work,
    changes: broadcast::Sender<String>,
    bell: Arc<Bell>,
    /// The running job.
    current: Mutex<Option<Arc<Live>>>,
    /// Held while a job runs, so that jobs run one at a time even after a restart of the worker.
    turn: tokio::sync::Mutex<()>,
    stopping: AtomicBool,
    /// Held while anything works on the folder; the thread of a job holds a share.
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

    /// Notifies subscribers that a job changed.
    pub fn changed(&self, id: &str) {
        // There may be no subscribers.
        let _ = self.changes.send(id.into());
    }

    /// Notifies subscribers and the worker that a job was queued.
    pub fn queued(&self, id: &str) {
        self.changed(id);
        self.bell.ring();
    }

    /// Requests the end of the job if it is the running one.
    pub fn cancel(&self, id: &str) {
        if let Some(live) = self.current().as_ref().filter(|live| live.id == id) {
            live.cancel();
        }
    }

    /// Asks the running job for its result so far; false if another one is running.
    pub fn finish(&self, id: &str) -> bool {
        let current = self.current();
        let live = current.as_ref().filter(|live| live.id == id);
        live.inspect(|live| live.finish()).is_some()
    }

    /// Requests the end of the running job, and prevents others from starting.
    pub fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
    }

    pub fn stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    /// The job with the progress that its threads have reported since it was last stored.
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

/// Stream of the bell's wake-ups for the worker.
struct Ear(Arc<Bell>);

impl PollStrategy for Ear {
    fn poll_drive(&mut self, context: &mut Context<'_>, _: &PollSnapshot) -> Poll<Option<()>> {
        *self.0.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(context.waker().clone());
        Poll::Pending
    }
}

/// Longest wait for a lock. A child process that is being started shares all open files until it runs, locks included.
const LOCK_PATIENCE: Duration = Duration::from_secs(2);

/// Locks the folder against other processes; the system unlocks it when the process ends.
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

/// Keeps a worker running until the queue stops.
pub(super) async fn supervise(shared: Arc<Shared>, mut stopped: watch::Receiver<bool>) {
    tokio::select! {
        () = work_on(&shared) => {}
        // An error means that the queue was dropped.
        _ = stopped.wait_for(|stop| *stop) => {}
    }
    shared.stop();
    // Waits until the running job is back in the queue.
    let _turn = shared.turn.lock().await;
    shared.store.close().await;
    // If this fails, dropping the last owner unlocks the file.
    let _ = shared.lock.unlock();
}

/// Starts a worker, and another one when it fails: a full disk may be temporary.
async fn work_on(shared: &Arc<Shared>) {
    loop {
        // Jobs that an earlier worker had taken are delivered again.
        if shared.store.deliver_all().await.is_ok() {
            let config = Config::default().queue(QUEUE).batch_size(1).heartbeat_interval(HEARTBEAT);
            let deliveries = SqliteStorage::<String>::new(shared.store.pool()).with_config(config);
            let owned = shared.clone();
            let worker = WorkerBuilder::new(ulid::Ulid::generate().to_string().as_str())
                .backend(deliveries.poll_with_strategy(Ear(shared.bell.clone())))
                .concurrency(1)
                .build(move |_: String| take(owned.clone()));
            // The error is not the job's. If it persists, the next worker returns it again.
            let _ = worker.run().await;
        }
        sleep(PAUSE).await;
    }
}

/// Receives the progress reports of the computing threads.
struct Reporter {
    live: Arc<Live>,
    shared: Arc<Shared>,
    /// Stages to be logged. When the channel is full, a stage is not logged: computation does not wait for the disk.
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

    fn is_enough(&self) -> bool {
        self.live.is_enough()
    }
}

/// Takes a delivery. The job runs in a separate task, which outlives the worker.
async fn take(shared: Arc<Shared>) -> Result<(), BoxDynError> {
    let result = tokio::spawn(run(shared)).await;
    match result {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => {
            // The job is delivered again at once.
            sleep(PAUSE).await;
            Err(error.into())
        }
        Err(error) => Err(error.into()),
    }
}

/// Runs the next job. Each queued job has at least one delivery, so that all get their turn.
async fn run(shared: Arc<Shared>) -> Result<(), Error> {
    let _turn = shared.turn.lock().await;
    if shared.stopping() {
        return Ok(());
    }
    // Without a queued job, the delivery belongs to a cancelled one.
    let Some(id) = shared.store.next().await? else { return Ok(()) };
    // Registered before the job runs, so that a cancellation finds it.
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
        // The job was cancelled meanwhile.
        Ok(_) => Ok(()),
        Err(error) => Err(error),
    };
    *shared.current() = None;
    result
}

/// Runs a job, and logs its stages.
async fn attempt(shared: &Arc<Shared>, spec: Spec, live: Arc<Live>) -> Result<(), Failed> {
    let id = live.id.clone();
    let (stages, mut entered) = mpsc::channel::<String>(STAGES);
    let reporter = Reporter { live, shared: shared.clone(), stages };
    let work = move || (reporter.shared.work)(&spec, &reporter).inspect(|()| reporter.live.complete());
    let thread = tokio::task::spawn_blocking(work);
    // Ends when the thread drops the reporter.
    while let Some(stage) = entered.recv().await {
        // A failed log line does not fail the job.
        let _ = shared.store.change(&id, |record| record.stage(&stage)).await;
    }
    match thread.await {
        Ok(result) => result.map_err(Failed::from),
        Err(panic) => Err(Failed::Other(format!("the computation crashed: {panic}"))),
    }
}

/// Stores the end of an attempt, as soon as the disk allows it.
async fn finish(shared: &Shared, live: &Live, result: Result<(), Failed>) {
    let end = End { result, stopping: shared.stopping(), progress: live.progress() };
    while shared.store.change(&live.id, |record| record.end(&end)).await.is_err() {
        if shared.stopping() {
            // The next start finds the job running, and repeats it.
            return;
        }
        sleep(PAUSE).await;
    }
    shared.queued(&live.id);
}
