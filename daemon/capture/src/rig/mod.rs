//! Opens the devices of a bench, each on its own thread, locked against other processes.

mod sources;
mod terminal;

use crate::engine::{Devices, Watch};
use crate::failure::Failure;
use crate::page::Link;
use crate::plan::Limits;
use crate::setup::{BenchSection, Setup};
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_drivers::{
    Camera, CameraHandle, DeviceLock, DeviceResult, Display, DisplayHandle, Flash, FlashHandle, InterlockHandle, Stage,
    StageHandle,
};
use nacre_frames::Distances;
use nacre_sim::socket::RemoteBench;
use nacre_sim::{Bench, BenchConfig, Devices as Simulated, SharedBench, SimDevice, describe};
use sources::Sources;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use tokio::runtime::Runtime;

/// How often somebody asked for the end.
pub type Stop = Arc<AtomicU32>;

/// Where the bench is.
#[derive(Clone)]
pub struct Place {
    /// The simulated bench, whose devices stand in for those that are not described.
    pub simulated: Option<SimulatedBench>,
    /// Which devices of this machine take part.
    pub section: BenchSection,
    /// The way to the pattern page, where there is a service.
    pub page: Option<Arc<Link>>,
}

/// Where the simulated bench is.
#[derive(Clone, Debug)]
pub enum SimulatedBench {
    /// In this process, on its own time.
    Here {
        /// How it is configured.
        config: Box<BenchConfig>,
        /// It takes as long as a real one.
        real_time: bool,
    },
    /// In a process of its own, behind this socket.
    Socket(PathBuf),
}

/// An open bench.
pub struct Rig {
    /// Its devices.
    pub devices: Devices,
    /// Its interlocks.
    pub watch: Watch,
    /// Identities of everything that shapes the frames.
    pub ids: Vec<String>,
    /// Optics and distances.
    pub setup: Setup,
    /// Which devices of this machine take part, if any.
    pub section: Option<BenchSection>,
    /// The simulated bench as it is configured, if the frames are its.
    pub config: Option<BenchConfig>,
    /// The simulated bench itself, if it is in this process.
    pub bench: Option<SharedBench>,
    #[allow(dead_code, reason = "held until the rig is dropped")]
    locks: Vec<DeviceLock>,
}

impl Place {
    /// A bench in this process whose time is virtual.
    pub fn here(config: BenchConfig) -> Self {
        SimulatedBench::Here { config: Box::new(config), real_time: false }.into()
    }

    /// What the devices can do. Those of this machine are opened for it, for a moment.
    ///
    /// # Errors
    /// Nobody listens at the socket; a device cannot be opened or belongs to another process.
    pub fn limits(&self) -> DeviceResult<Limits> {
        let simulated = match &self.simulated {
            Some(SimulatedBench::Here { config, .. }) => Some(describe(config)),
            Some(SimulatedBench::Socket(path)) => {
                Some(SimDevice::new(Box::new(RemoteBench::connect(path)?))?.devices().clone())
            }
            None => None,
        };
        let _locks = self.section.lock()?;
        sources::limits(&self.section, simulated)
    }
}

impl Place {
    /// Optics and distances, as far as they are known without opening anything.
    pub fn setup(&self) -> Setup {
        match &self.simulated {
            Some(SimulatedBench::Here { config, .. }) if !self.section.has_real_device() => Setup {
                wavelength_nm: Some(config.filter.wavelength_nm),
                band_nm: Some(config.filter.band_nm).filter(|b| *b > 0.0),
                geometry: Some(Distances {
                    distance_mm: config.geometry.distance_mm,
                    baseline_mm: config.geometry.baseline_mm,
                    pixel_um: None,
                    camera_px: None,
                }),
                panel_mm: Some(config.panel.size_mm),
            },
            _ => self.section.optics.setup(),
        }
    }
}

impl From<SimulatedBench> for Place {
    fn from(simulated: SimulatedBench) -> Self {
        Self { simulated: Some(simulated), section: BenchSection::default(), page: None }
    }
}

impl Rig {
    /// Opens all devices; a person who turns the analyser is asked until `stop` counts.
    ///
    /// # Errors
    /// A device cannot be opened or belongs to another process; `Cancelled` while a bench is built.
    pub fn open(runtime: &Runtime, place: &Place, progress: &dyn Progress, stop: &Stop) -> Result<Self, Failure> {
        let mut locks = place.section.lock()?;
        let mut sources = match &place.simulated {
            Some(SimulatedBench::Here { config, real_time }) => {
                let bench = Bench::new(config, progress)?;
                let bench = if *real_time { SharedBench::real_time(bench) } else { SharedBench::new(bench) };
                Sources::beside(&place.section, bench, stop)
            }
            Some(SimulatedBench::Socket(path)) => {
                let sources = Sources::with_socket(&place.section, path, stop)?;
                locks.extend(sources.lock_simulated(path)?);
                sources
            }
            None => Sources::real(&place.section, stop),
        };
        sources.page = place.page.clone();
        Ok(runtime.block_on(open(sources, locks))?)
    }
}

async fn open(sources: Sources, locks: Vec<DeviceLock>) -> DeviceResult<Rig> {
    let stage = StageHandle::start(sources.stage()?, sources.patience(sources.section.stage.is_some())).await?;
    let camera = CameraHandle::start(sources.camera()?, sources.patience(sources.section.camera.is_some())).await?;
    let display = DisplayHandle::start(sources.display()?, sources.patience(sources.section.display.is_some())).await?;
    let panel_mm = display.describe().size_mm;
    let flash = match sources.flash()? {
        Some(flash) => Some(FlashHandle::start(flash, sources.patience(sources.section.flash.is_some())).await?),
        None => None,
    };
    let mut ids = vec![stage.describe().id, camera.describe().id, display.describe().id];
    ids.extend(flash.as_ref().map(|f| f.describe().id));
    let watch = match sources.interlock() {
        Some(door) => Watch::new(vec![Box::new(InterlockHandle::start(door, sources.patience(false)).await?)]),
        None => Watch::default(),
    };
    let devices = Devices {
        stage: Box::new(stage),
        camera: Box::new(camera),
        display: Box::new(display),
        flash: flash.map(|f| Box::new(f) as Box<dyn Flash>),
    };
    let simulated = sources.simulated.as_ref().filter(|_| !sources.section.has_real_camera());
    Ok(Rig {
        devices,
        watch,
        ids,
        setup: Setup { panel_mm: Some(panel_mm), ..simulated.map_or_else(|| sources.section.optics.setup(), setup) },
        config: simulated.map(|s| s.bench.clone()),
        section: sources.section.has_real_device().then(|| sources.section.clone()),
        bench: sources.bench,
        locks,
    })
}

/// Optics and distances of a simulated bench.
fn setup(simulated: &Simulated) -> Setup {
    let bench = &simulated.bench;
    Setup {
        wavelength_nm: Some(bench.filter.wavelength_nm),
        band_nm: Some(bench.filter.band_nm).filter(|b| *b > 0.0),
        geometry: Some(Distances {
            distance_mm: bench.geometry.distance_mm,
            baseline_mm: bench.geometry.baseline_mm,
            pixel_um: Some(simulated.pixel_um),
            camera_px: None,
        }),
        panel_mm: None,
    }
}

/// A runtime on the calling thread, for the device calls of a command.
///
/// # Errors
/// The system refuses it its descriptors.
pub fn runtime() -> Result<Runtime, Failure> {
    let built = tokio::runtime::Builder::new_current_thread().enable_all().build();
    Ok(built.map_err(|e| Error::input("tokio", format!("cannot start: {e}"), "free some memory"))?)
}
