//! The databases of the service, and the task that keeps its data folder in order: it opens and repairs databases that a full disk
//! kept shut, deletes uploads that have expired and the trash, and tells when the disk is full.

use super::problem::Problem;
use super::{App, stored_uploads, trash};
use nacre_base::Error;
use nacre_base::progress::Silent;
use nacre_base::temporary::sweep_all;
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

/// How often the disk is looked at, and what failed is tried again.
const OFTEN: Duration = Duration::from_secs(1);

/// How long a repair that failed is not tried again: it reads all sessions.
const LATER: Duration = Duration::from_secs(10);

/// How often uploads and things in the trash that have expired are looked for.
const SELDOM: Duration = Duration::from_secs(3600);

/// A disk with fewer bytes free is full: a database needs as much to be opened.
const ROOM: u64 = 64 << 10;

/// Disk space is short below this many free bytes, or a twentieth of the disk if that is less. The trash then keeps
/// nothing.
const SHORT: u64 = 1 << 30;

/// Folders in the data folder.
const FOLDERS: [&str; 4] = ["sessions", "reconstructions", "uploads", "trash"];

/// The databases. On a full disk the service begins with a catalogue in memory and without a job queue, so that sessions and
/// uploads can be deleted.
pub struct Stores {
    data: PathBuf,
    work: Work,
    catalogue: RwLock<Arc<Catalogue>>,
    /// The catalogue lacks something: it is in memory, or an entry could not be written.
    stale: AtomicBool,
    in_memory: AtomicBool,
    jobs: OnceLock<Jobs>,
    full: AtomicBool,
}

impl Stores {
    /// Opens the databases in the data folder, and makes it where there is none.
    ///
    /// # Errors
    /// Whatever makes the folder unusable, apart from a full disk.
    pub async fn open(data: &Path, work: Work) -> Result<Self, Error> {
        let refused = |path: &Path, error: io::Error| match error.kind() {
            // Tried again later.
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Ok(()),
            ErrorKind::ReadOnlyFilesystem => {
                let problem = "lies on a disk that is mounted read-only";
                Err(Error::file(path, problem, "mount it for writing, or give another --data folder"))
            }
            _ => Err(Error::output(path, error)),
        };
        // Nobody else's business: photographs, names and notes.
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
            // Nobody else works on the folder.
            Ok(()) => stored_uploads::sweep_earlier(&data.join("uploads")),
            Err(error) => return Err(error),
        }
        stores.look();
        Ok(stores)
    }

    async fn open_jobs(&self) -> Result<(), Error> {
        let jobs = Jobs::open(&self.data, self.work.clone()).await?;
        // One task opens them.
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

    /// Brings an entry of the catalogue up to date. One that cannot be written follows later.
    pub async fn note(&self, row: &SessionRow) {
        self.noted(self.catalogue().put(row).await);
    }

    /// Removes an entry of the catalogue, now or later.
    pub async fn forget(&self, row: &SessionRow) {
        self.noted(self.catalogue().remove(&row.id).await);
    }

    fn noted(&self, result: Result<(), Error>) {
        if let Err(error) = result {
            tracing::warn!("the catalogue will be repaired: {error}");
            self.stale.store(true, Ordering::Relaxed);
        }
    }

    /// Whether the disk is full, as it was a moment ago.
    pub fn is_full(&self) -> bool {
        self.full.load(Ordering::Relaxed) || self.jobs.get().is_none()
    }

    /// What is wrong with the data folder, for people; nothing if all is well.
    pub fn problems(&self) -> Vec<String> {
        let full = Problem::full();
        let queue = self.jobs.get().is_none().then(|| "reconstructions are not available until there is space".into());
        self.is_full().then(|| full.to_string()).into_iter().chain(queue).collect()
    }

    /// Bytes of the disk that are free, and all of them.
    fn space(&self) -> [u64; 2] {
        // What cannot be asked is not full.
        statvfs(&self.data).map_or([u64::MAX; 2], |disk| {
            // Part of a disk may be reserved for the administrator.
            let free = if geteuid().is_root() { disk.f_bfree } else { disk.f_bavail };
            [free, disk.f_blocks].map(|blocks| blocks.saturating_mul(disk.f_frsize))
        })
    }

    /// Whether disk space is so short that nothing is kept in the trash.
    pub fn is_short(&self) -> bool {
        let [free, all] = self.space();
        free < SHORT.min(all / 20).max(ROOM)
    }

    /// Looks whether the disk is full.
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

    /// Opens and repairs what failed before.
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
        // Whoever finds something missing meanwhile has it repaired once more.
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
            // Again, for sessions that were noted in memory while it was opened.
        }
        self.catalogue().rebuild(&[self.data.join("sessions")], &Silent).await?;
        tracing::info!("the catalogue is repaired");
        Ok(())
    }

    /// Stores everything and closes the databases.
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
    // There may be no room for the folder.
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

/// Removes what killed processes left: results and uploads that were not complete.
fn sweep(data: &Path) {
    let sessions = std::fs::read_dir(data.join("sessions")).into_iter().flatten().flatten();
    sessions.for_each(|session| sweep_all(&session.path()));
    FOLDERS.iter().for_each(|name| sweep_all(&data.join(name)));
    sweep_all(data);
}

/// Keeps the data folder in order until the service ends.
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
