//! The databases of the service, and the task that maintains its data folder.
//!
//! The task opens and repairs databases that a full disk kept closed, deletes expired uploads and trash, and reports a
//! full disk.

use super::problem::Problem;
use super::{App, stored_uploads, trash};
use nacre_base::Error;
use nacre_base::progress::Silent;
use nacre_base::temporary::sweep_all;
use nacre_capture::calibrations;
use nacre_store::catalogue::{Catalogue, SessionRow};
use nacre_store::jobs::{Jobs, Work};
use rustix::fs::statvfs;
use rustix::process::geteuid;
use std::fs::DirBuilder;
use std::io::{self, ErrorKind};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, PoisonError, RwLock};
use std::time::{Duration, Instant};

/// Interval of disk checks and of retries.
const OFTEN: Duration = Duration::from_secs(1);

/// Wait after a failed repair, which reads all sessions.
const LATER: Duration = Duration::from_secs(10);

/// Interval of the search for expired uploads and trash.
const SELDOM: Duration = Duration::from_secs(3600);

/// Free bytes below which the disk counts as full: opening a database needs this many.
const ROOM: u64 = 64 << 10;

/// Free bytes below which space is short, or 5 % of the disk if less. The trash is then kept empty.
const SHORT: u64 = 1 << 30;

/// Folders in the data folder.
const FOLDERS: [&str; 5] = ["sessions", "reconstructions", "uploads", calibrations::FOLDER, "trash"];

/// The databases. On a full disk the service starts with a catalogue in memory and without a job queue, so that
/// sessions and uploads can be deleted.
pub struct Stores {
    data: PathBuf,
    work: Work,
    catalogue: RwLock<Arc<Catalogue>>,
    /// The catalogue is incomplete: it is in memory, or an entry could not be written.
    stale: AtomicBool,
    in_memory: AtomicBool,
    jobs: OnceLock<Jobs>,
    full: AtomicBool,
}

impl Stores {
    /// Opens the databases in the data folder, which is created if missing.
    ///
    /// # Errors
    /// Any error that makes the folder unusable, except a full disk.
    pub async fn open(data: &Path, work: Work) -> Result<Self, Error> {
        let refused = |path: &Path, error: io::Error| match error.kind() {
            // Retried later.
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Ok(()),
            ErrorKind::ReadOnlyFilesystem => {
                let problem = "lies on a disk that is mounted read-only";
                Err(Error::file(path, problem, "mount it for writing, or give another --data folder"))
            }
            _ => Err(Error::output(path, error)),
        };
        // Private to the user: photographs, names and notes.
        DirBuilder::new().recursive(true).mode(0o700).create(data).or_else(|e| refused(data, e))?;
        for folder in FOLDERS.map(|name| data.join(name)) {
            std::fs::create_dir_all(&folder).or_else(|e| refused(&folder, e))?;
        }
        let owned = data.to_path_buf();
        let _ = tokio::task::spawn_blocking(move || sweep(&owned)).await;
        let catalogue = match catalogue(data).await {
            Err(error) if is_full(&error) => None,
            opened => Some(opened?),
        };
        let in_memory = catalogue.is_none();
        let catalogue = match catalogue {
            Some(catalogue) => catalogue,
            None => rebuilt(Catalogue::in_memory().await?, data).await?,
        };
        let stores = Self {
            data: data.into(),
            work,
            catalogue: RwLock::new(Arc::new(catalogue)),
            stale: AtomicBool::new(in_memory),
            in_memory: AtomicBool::new(in_memory),
            jobs: OnceLock::new(),
            full: AtomicBool::new(false),
        };
        match stores.open_jobs().await {
            Err(error) if is_full(&error) => {}
            // The lock is held, so no other process uses the folder.
            Ok(()) => stored_uploads::sweep_earlier(&data.join("uploads")),
            Err(error) => return Err(error),
        }
        stores.look();
        Ok(stores)
    }

    async fn open_jobs(&self) -> Result<(), Error> {
        let jobs = Jobs::open(&self.data, self.work.clone()).await?;
        // Only one task opens the queue, so it is not set yet.
        let _ = self.jobs.set(jobs);
        Ok(())
    }

    /// The catalogue.
    pub fn catalogue(&self) -> Arc<Catalogue> {
        self.catalogue.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The job queue, once it is open.
    pub fn jobs(&self) -> Option<&Jobs> {
        self.jobs.get()
    }

    /// Updates an entry of the catalogue. If it cannot be written, the catalogue is repaired later.
    pub async fn note(&self, row: &SessionRow) {
        self.noted(self.catalogue().put(row).await);
    }

    /// Removes an entry of the catalogue, now or at the next repair.
    pub async fn forget(&self, row: &SessionRow) {
        self.noted(self.catalogue().remove(&row.id).await);
    }

    fn noted(&self, result: Result<(), Error>) {
        if let Err(error) = result {
            tracing::warn!("the catalogue will be repaired: {error}");
            self.stale.store(true, Ordering::Relaxed);
        }
    }

    /// Whether the disk was full at the last check.
    pub fn is_full(&self) -> bool {
        self.full.load(Ordering::Relaxed) || self.jobs.get().is_none()
    }

    /// Problems of the data folder as sentences for people; empty if there are none.
    pub fn problems(&self) -> Vec<String> {
        let full = Problem::full();
        let queue = self.jobs.get().is_none().then(|| "reconstructions are not available until there is space".into());
        self.is_full().then(|| full.to_string()).into_iter().chain(queue).collect()
    }

    /// Free and total bytes of the disk.
    fn space(&self) -> [u64; 2] {
        // A disk that cannot be queried does not count as full.
        statvfs(&self.data).map_or([u64::MAX; 2], |disk| {
            // File systems may reserve a part for the administrator.
            let free = if geteuid().is_root() { disk.f_bfree } else { disk.f_bavail };
            [free, disk.f_blocks].map(|blocks| blocks.saturating_mul(disk.f_frsize))
        })
    }

    /// Whether disk space is so short that the trash is kept empty.
    pub fn is_short(&self) -> bool {
        let [free, all] = self.space();
        free < SHORT.min(all / 20).max(ROOM)
    }

    /// Checks whether the disk is full.
    fn look(&self) {
        let [free, _] = self.space();
        let full = free < ROOM;
        if self.full.swap(full, Ordering::Relaxed) != full {
            match full {
                true => {
                    tracing::error!("the disk of the data folder is full: delete sessions or uploads, or free space")
                }
                false => tracing::info!("the disk of the data folder has space again"),
            }
        }
    }

    /// Opens and repairs databases that failed before.
    async fn repair(&self) -> Result<(), Error> {
        if self.full.load(Ordering::Relaxed) {
            return Ok(());
        }
        for folder in FOLDERS.map(|name| self.data.join(name)) {
            std::fs::create_dir_all(&folder).map_err(|e| Error::output(&folder, e))?;
        }
        if self.jobs.get().is_none() {
            self.open_jobs().await?;
            tracing::info!("the job queue is open");
        }
        // An entry that goes missing meanwhile sets the flag again.
        if self.stale.swap(false, Ordering::Relaxed) {
            let repaired = self.repair_catalogue().await;
            self.stale.fetch_or(repaired.is_err(), Ordering::Relaxed);
            repaired?;
        }
        Ok(())
    }

    async fn repair_catalogue(&self) -> Result<(), Error> {
        if self.in_memory.load(Ordering::Relaxed) {
            let opened = catalogue(&self.data).await?;
            *self.catalogue.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(opened);
            self.in_memory.store(false, Ordering::Relaxed);
            // Once more, for sessions that were entered into the catalogue in memory meanwhile.
        }
        self.catalogue().rebuild(&[self.data.join("sessions")], &Silent).await?;
        tracing::info!("the catalogue is repaired");
        Ok(())
    }

    /// Writes all changes and closes the databases.
    pub async fn close(&self) {
        if let Some(jobs) = self.jobs.get() {
            jobs.shutdown().await;
        }
        self.catalogue().close().await;
    }
}

/// The catalogue of the data folder, rebuilt from the sessions.
async fn catalogue(data: &Path) -> Result<Catalogue, Error> {
    rebuilt(Catalogue::open(&data.join("catalogue.db")).await?, data).await
}

async fn rebuilt(catalogue: Catalogue, data: &Path) -> Result<Catalogue, Error> {
    let sessions = data.join("sessions");
    // A full disk may have no room for the folder.
    if sessions.is_dir() {
        let rebuilt = catalogue.rebuild(&[sessions], &Silent).await?;
        tracing::info!(sessions = rebuilt.sessions, "catalogue rebuilt");
    }
    Ok(catalogue)
}

/// Whether an error says that the disk is full.
pub fn is_full(error: &Error) -> bool {
    let full = |kind| matches!(kind, ErrorKind::StorageFull | ErrorKind::QuotaExceeded);
    matches!(error, Error::Output { source, .. } if full(source.kind()))
}

/// Removes incomplete results and uploads of killed processes.
fn sweep(data: &Path) {
    let sessions = std::fs::read_dir(data.join("sessions")).into_iter().flatten().flatten();
    sessions.for_each(|session| sweep_all(&session.path()));
    FOLDERS.iter().for_each(|name| sweep_all(&data.join(name)));
    sweep_all(data);
}

/// Maintains the data folder until the service ends.
pub async fn keep(app: Arc<App>) {
    let mut stop = app.stopping.subscribe();
    let (mut failed, mut expired): (Option<Instant>, Option<Instant>) = (None, None);
    loop {
        app.stores.look();
        if failed.is_none_or(|then| then.elapsed() >= LATER) {
            let repaired = app.stores.repair().await;
            failed = repaired.is_err().then(Instant::now);
            if let Err(error) = repaired {
                tracing::warn!("not repaired yet: {error}");
            }
        }
        if app.stores.is_short()
            && let Err(problem) = trash::make_room(&app).await
        {
            tracing::warn!("the trash is not emptied: {problem}");
        }
        app.heavy.forget_idle();
        if expired.is_none_or(|then| then.elapsed() >= SELDOM) && app.stores.jobs().is_some() {
            expired = Some(Instant::now());
            if let Err(problem) = trash::expire(&app).await {
                tracing::warn!("the trash is not emptied: {problem}");
            }
            if let Err(problem) = stored_uploads::expire(&app).await {
                tracing::warn!("expired uploads stay: {problem}");
            }
        }
        tokio::select! {
            () = tokio::time::sleep(OFTEN) => {}
            _ = stop.wait_for(|stopping| *stopping) => return,
        }
    }
}
