#![doc = include_str!("../README.md")]
// utoipa's macros write the names of parameter types in full.
#![allow(unused_qualifications)]

mod access;
mod bench;
mod calibrations;
mod charts;
mod clients;
pub mod config;
mod connections;
mod deletion;
mod devices;
mod display;
mod events;
mod extract;
mod files;
mod heavy;
mod keeper;
mod keys;
mod map_list;
mod map_regions;
mod maps;
mod measure;
mod methods;
mod metrics;
mod naming;
mod operations;
mod pace;
mod paths;
mod plans;
mod preview;
pub mod problem;
mod queue;
mod reconstruction_request;
mod reconstructions;
mod renders;
mod results;
mod router;
mod runs;
mod samples;
mod scene_editing;
mod scenes;
mod session_data;
mod session_doc;
mod sessions;
mod settings;
mod settings_text;
mod stored_uploads;
mod supervised;
mod tiles;
mod trash;
mod uploads;
mod used_results;
pub mod view;
pub mod work;

use axum::http::header;
use axum::response::IntoResponse;
use bench::Bench;
use config::{Config, Source};
use heavy::Heavy;
use keeper::Stores;
use keys::Keys;
use metrics::Metrics;
use nacre_base::Error;
use nacre_capture::Failure;
use nacre_capture::ids::is_id;
use nacre_capture::page::Link;
use nacre_capture::plan::Limits;
use nacre_capture::rig::Place;
use nacre_capture::session::{SESSION_FILE, sha256};
use nacre_capture::setup::Setup;
use nacre_drivers::display::DisplayConfig;
use nacre_store::catalogue::SessionRow;
use nacre_store::jobs::Jobs;
use problem::{Answer, Kind, Problem};
use runs::Run;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;
use tokio::sync::{Semaphore, watch};
use ulid::Ulid;

pub use extract::{At, Body, Params};
pub use nacre_capture::ids::new_id;
pub use router::openapi;

/// Most runs that are kept after their end.
const KEPT_RUNS: usize = 1000;

/// Most ended runs that keep their events and last map.
const KEPT_WHOLE: usize = 8;

/// State that all handlers share.
pub struct App {
    /// Configuration of the service. Some keys change while it runs.
    config: RwLock<Arc<Config>>,
    /// Source of the configuration.
    pub settings: settings::Settings,
    /// Limits of the devices.
    pub limits: Limits,
    /// Geometry and light of the bench.
    pub setup: Setup,
    /// Ids of the interlocks.
    pub interlocks: Vec<String>,
    /// The bench.
    pub bench: Bench,
    /// Configuration of the panel.
    pub display: Option<DisplayConfig>,
    /// The newest measurement of the panel.
    pub measurement: Mutex<Option<Arc<measure::Measuring>>>,
    /// Catalogue of sessions, and job queue.
    pub stores: Stores,
    /// The rendering under way.
    pub renders: Arc<renders::Renders>,
    /// Runs of sessions.
    pub runs: Runs,
    /// Session of a simulated sample, beside the bench.
    pub samples: samples::Samples,
    /// The pattern page.
    pub link: Arc<Link>,
    /// Whether the whole bench is simulated.
    pub simulated: bool,
    /// Places for event streams.
    pub subscribers: Arc<Semaphore>,
    /// Places for requests.
    pub requests: Arc<Semaphore>,
    /// Set when the service ends.
    pub stopping: watch::Sender<bool>,
    /// Counters.
    pub metrics: Metrics,
    /// Idempotency keys.
    pub keys: Keys,
    /// Places for work that takes much memory.
    pub heavy: Arc<Heavy>,
    /// Locked while entries are moved into the trash, restored or deleted from it.
    pub trash_turn: tokio::sync::Mutex<()>,
    /// Secret of the deletion tokens, new with each start.
    secret: String,
}

/// The runs of sessions in this process.
#[derive(Default)]
pub struct Runs(Mutex<VecDeque<Arc<Run>>>);

impl Runs {
    fn locked(&self) -> std::sync::MutexGuard<'_, VecDeque<Arc<Run>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a run; returns the run of the same session that it replaces.
    pub fn insert(&self, run: Arc<Run>) -> Option<Arc<Run>> {
        let mut runs = self.locked();
        let before = runs.iter().position(|r| r.id == run.id).and_then(|at| runs.remove(at));
        runs.push_back(run);
        let older = runs.len().saturating_sub(KEPT_WHOLE);
        runs.iter().take(older).filter(|r| r.is_over()).for_each(|r| r.forget());
        if runs.len() > KEPT_RUNS {
            runs.pop_front();
        }
        before
    }

    /// Restores the run that was replaced by one that never began.
    pub fn restore(&self, id: &str, before: Option<Arc<Run>>) {
        self.remove(id);
        if let Some(before) = before {
            self.insert(before);
        }
    }

    /// Removes a run.
    pub fn remove(&self, id: &str) {
        self.locked().retain(|r| r.id != id);
    }
}

impl App {
    async fn open(config: Config, source: Source, place: Place) -> Result<Arc<Self>, Failure> {
        paths::set_data_folder(&config.data);
        if let Some(mib) = config.limits.job_memory_mib {
            nacre_image::budget::allow(mib << 20);
        }
        let simulated = place.simulated.is_some() && !place.section.has_real_device();
        let link = Arc::new(Link::default());
        let place = Place { page: Some(link.clone()), ..place };
        let display = place.section.display.clone();
        let renders = Arc::new(renders::Renders::default());
        let stores = Stores::open(&config.data, work::jobs(config.data.clone(), renders.clone())).await?;
        let bench = Bench::open(place).await?;
        let found = bench
            .work(|owner| {
                Ok((owner.rig.devices.limits(), owner.rig.setup, owner.runtime.block_on(owner.rig.watch.ids())))
            })
            .await;
        let (limits, setup, interlocks) =
            found.map_err(|p| Error::input("bench", p.detail(), "restart the service"))?;
        Ok(Arc::new(Self {
            limits,
            setup,
            interlocks,
            bench,
            display,
            measurement: Mutex::default(),
            stores,
            renders,
            runs: Runs::default(),
            samples: samples::Samples::default(),
            link,
            simulated,
            subscribers: Arc::new(Semaphore::new(config.limits.subscribers)),
            requests: Arc::new(Semaphore::new(config.limits.requests)),
            stopping: watch::Sender::new(false),
            metrics: Metrics::default(),
            keys: Keys::open(&config.data),
            heavy: Arc::default(),
            trash_turn: tokio::sync::Mutex::default(),
            secret: [(); 2].map(|()| Ulid::generate().to_string()).concat(),
            settings: settings::Settings::new(source),
            config: RwLock::new(Arc::new(config)),
        }))
    }

    /// Configuration of the service.
    pub fn config(&self) -> Arc<Config> {
        self.config.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Folder of a session, whether it exists or not.
    ///
    /// # Errors
    /// `not-found` for an invalid id.
    pub fn session_folder(&self, id: &str) -> Answer<PathBuf> {
        check_id(id)?;
        Ok(self.config().data.join("sessions").join(id))
    }

    /// Folder of an existing session.
    ///
    /// # Errors
    /// `not-found` when there is none.
    pub fn existing_session(&self, id: &str) -> Answer<PathBuf> {
        let folder = self.session_folder(id)?;
        match (folder.join(SESSION_FILE).exists(), self.run(id)) {
            (true, _) => Ok(folder),
            (false, Some(_)) => Err(Problem::new(Kind::Conflict, "the session has no files yet")
                .remedy("wait until its first frame is taken")),
            (false, None) => Err(self.missing("session", id)),
        }
    }

    /// The run of a session in this process.
    pub fn run(&self, id: &str) -> Option<Arc<Run>> {
        self.runs.locked().iter().find(|r| r.id == id).cloned()
    }

    /// Updates a session in the catalogue.
    pub async fn note(&self, folder: &Path) {
        let owned = folder.to_path_buf();
        let read = blocking(move || Ok(SessionRow::read(&owned)?)).await;
        match read {
            Ok(row) => self.stores.note(&row).await,
            Err(e) => tracing::debug!("nothing to catalogue: {}", e.detail()),
        }
    }

    /// The job queue.
    ///
    /// # Errors
    /// `full` when a full disk still prevents opening it.
    pub fn jobs(&self) -> Answer<&Jobs> {
        self.stores.jobs().ok_or_else(Problem::full)
    }

    /// Token that confirms the deletion of a session or reconstruction.
    pub fn deletion_token(&self, id: &str) -> String {
        sha256(format!("{}{id}", self.secret).as_bytes()).chars().take(24).collect()
    }
}

/// The service without a network, for tests: its router, which keeps bench and data folder open while it lives.
///
/// # Errors
/// The bench or the data folder cannot be used.
pub async fn in_process(config: Config, place: Place) -> Result<axum::Router, Failure> {
    let activity = Arc::new(connections::Activity::new(Duration::from_secs(config.limits.client_s)));
    let app = App::open(config, Source::default(), place).await?;
    Ok(router::router(&app).layer(axum::Extension(activity)))
}

/// Serves until `stop`; afterwards the light is off and everything is stored. `ready` receives the address and the
/// problems of the data folder, such as a full disk.
///
/// # Errors
/// The bench, the data folder or the address cannot be used.
pub async fn serve(
    mut config: Config,
    source: Source,
    place: Place,
    ready: impl FnOnce(std::net::SocketAddr, &[String]),
    stop: impl Future<Output = ()>,
) -> Result<(), Failure> {
    let listen = config.listen;
    let most = connections::fit(&mut config.limits);
    let patience = Duration::from_secs(config.limits.client_s);
    let app = App::open(config, source, place).await?;
    let bind = |e: std::io::Error| Error::input(listen, format!("cannot be listened on: {e}"), "give another --listen");
    let listener = connections::listen(listen).map_err(bind)?;
    let address = listener.local_addr().map_err(bind)?;
    ready(address, &app.stores.problems());
    supervised::ready(address);
    let keeper = tokio::spawn(keeper::keep(app.clone()));
    let closing = app.clone();
    let graceful = async move {
        stop.await;
        supervised::stopping();
        closing.stopping.send_replace(true);
        // The light goes off first. A session in progress is aborted and can be resumed.
        let _ = tokio::task::spawn_blocking(move || {
            closing.bench.close();
            closing.samples.close();
        })
        .await;
    };
    connections::serve(listener, router::router(&app), most, patience, graceful).await;
    // It may still open databases that are closed below.
    let _ = keeper.await;
    app.stores.close().await;
    Ok(())
}

/// Checks that an id is a ULID, so that it cannot name any other path.
///
/// # Errors
/// `not-found` otherwise.
pub fn check_id(id: &str) -> Answer<()> {
    if is_id(id) { Ok(()) } else { Err(Problem::not_found("entry with this id")) }
}

/// Runs work that computes or reads files on a thread where it may block.
///
/// # Errors
/// Those of the work.
pub async fn blocking<T: Send + 'static>(work: impl FnOnce() -> Answer<T> + Send + 'static) -> Answer<T> {
    let done = tokio::task::spawn_blocking(work).await;
    done.unwrap_or_else(|_| Err(Problem::new(Kind::Internal, "the work ended unexpectedly")))
}

/// Width of a picture in pixels: `asked`, or else `usual`.
///
/// # Errors
/// `bad-request` for a width outside the range of pictures.
pub fn picture_width(asked: Option<usize>, usual: usize) -> Answer<usize> {
    match asked.unwrap_or(usual) {
        width @ 1..=16_384 => Ok(width),
        width => Err(Problem::bad(format!("width is {width}; give 1 to 16384"))),
    }
}

/// A PNG as an answer.
///
/// # Errors
/// `bad-request` if the picture could not be encoded.
pub fn png(encoded: std::io::Result<Vec<u8>>) -> Answer<impl IntoResponse> {
    let bytes = encoded.map_err(|e| Problem::bad(e.to_string()))?;
    Ok(([(header::CONTENT_TYPE, "image/png")], bytes))
}
