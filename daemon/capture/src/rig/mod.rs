//! Opens the devices of a bench, each on a separate thread, with locks against other processes.

mod absent;
mod describe;
mod photographs;
mod sources;
mod terminal;
mod uses;

use crate::engine::{Devices, Watch};
use crate::failure::Failure;
use crate::page::Link;
use crate::setup::{BenchSection, Setup};
use absent::Absent;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_drivers::interlock::InterlockConfig;
use nacre_drivers::stage::Mounting;
use nacre_drivers::{
    Camera, CameraHandle, DeviceLock, DeviceResult, Display, DisplayHandle, Flash, FlashHandle, Interlock,
    InterlockHandle, Stage, StageHandle,
};
use nacre_frames::Distances;
use nacre_sim::{Bench, BenchConfig, Devices as Simulated, SharedBench};
use sources::Sources;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use tokio::runtime::Runtime;

pub use describe::Described;
pub use photographs::photography;
pub use uses::{Use, Uses};

/// Number of requests to stop.
pub type Stop = Arc<AtomicU32>;

/// Location of the bench.
#[derive(Clone)]
pub struct Place {
    /// Simulated bench, whose devices replace those that are not configured.
    pub simulated: Option<SimulatedBench>,
    /// Configured devices of this machine.
    pub section: BenchSection,
    /// Connection to the pattern page, if a service runs.
    pub page: Option<Arc<Link>>,
}

/// Location of the simulated bench.
#[derive(Clone, Debug)]
pub enum SimulatedBench {
    /// In this process, with simulated time.
    Here {
        /// Configuration.
        config: Box<BenchConfig>,
        /// True to run at the pace of a real bench.
        real_time: bool,
    },
    /// In another process, behind this socket.
    Socket(PathBuf),
}

/// An open bench.
pub struct Rig {
    /// Devices.
    pub devices: Devices,
    /// Interlocks.
    pub watch: Watch,
    /// Identities of all devices that affect the frames.
    pub ids: Vec<String>,
    /// Optics and distances.
    pub setup: Setup,
    /// Configured devices of this machine, if any.
    pub section: Option<BenchSection>,
    /// Mounting of the analyser, if it is not the default.
    pub mounting: Option<Mounting>,
    /// Configuration of the simulated bench, if it provides the frames.
    pub config: Option<BenchConfig>,
    /// The simulated bench, if it is in this process.
    pub bench: Option<SharedBench>,
    #[allow(dead_code, reason = "held until the rig is dropped")]
    locks: Vec<DeviceLock>,
}

impl Place {
    /// A bench in this process with virtual time.
    pub fn here(config: BenchConfig) -> Self {
        SimulatedBench::Here { config: Box::new(config), real_time: false }.into()
    }

    /// Optics and distances, as far as known without opening devices.
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
    /// Opens the devices in use. A person who rotates the analyser is prompted until `stop` is set. Commands to the
    /// other devices fail.
    ///
    /// # Errors
    /// The configuration lacks a required device; a device cannot be opened or is in use by another process;
    /// `Cancelled` while a bench is built.
    pub fn open(
        runtime: &Runtime,
        place: &Place,
        uses: Uses,
        progress: &dyn Progress,
        stop: &Stop,
    ) -> Result<Self, Failure> {
        place.require(uses)?;
        let section = place.section.only(uses);
        let mut locks = section.lock()?;
        let mut sources = match &place.simulated {
            Some(SimulatedBench::Here { config, real_time }) => {
                let bench = Bench::new(config, progress)?;
                let bench = if *real_time { SharedBench::real_time(bench) } else { SharedBench::new(bench) };
                Sources::beside(&section, bench, stop)
            }
            Some(SimulatedBench::Socket(path)) => {
                let sources = Sources::with_socket(&section, path, stop)?;
                locks.extend(sources.lock_simulated(path, uses)?);
                sources
            }
            None => Sources::real(&section, stop),
        };
        sources.page = place.page.clone();
        let has = place.has();
        let used = [uses.stage, uses.camera, uses.display, uses.flash].map(|used| used != Use::Never);
        let opens = std::array::from_fn(|k| used[k] && has[k]);
        Ok(runtime.block_on(open(sources, opens, locks))?)
    }
}

/// Opens stage, camera, display and flash as selected by `opens`, in this order.
async fn open(sources: Sources, opens: [bool; 4], locks: Vec<DeviceLock>) -> DeviceResult<Rig> {
    let mut rig = Rig {
        devices: Devices { stage: Box::new(Absent), camera: Box::new(Absent), display: Box::new(Absent), flash: None },
        watch: Watch::default(),
        ids: vec![],
        setup: Setup::default(),
        section: sources.section.has_real_device().then(|| sources.section.clone()),
        mounting: sources.section.mounting(),
        config: None,
        bench: None,
        locks,
    };
    let section = &sources.section;
    let [stage, camera, display, flash] = opens;
    if stage {
        let stage = StageHandle::start(sources.stage()?, sources.patience(section.stage.is_some())).await?;
        rig.ids.push(stage.describe().id);
        rig.devices.stage = Box::new(stage);
    }
    if camera {
        let camera = CameraHandle::start(sources.camera()?, sources.patience(section.camera.is_some())).await?;
        rig.ids.push(camera.describe().id);
        rig.devices.camera = Box::new(camera);
    }
    let simulated = sources.simulated.as_ref().filter(|_| !section.has_real_camera());
    rig.setup = simulated.map_or_else(|| section.optics.setup(), setup);
    rig.config = simulated.map(|s| s.bench.clone());
    if display {
        let display = DisplayHandle::start(sources.display()?, sources.patience(section.display.is_some())).await?;
        rig.ids.push(display.describe().id);
        rig.setup.panel_mm = Some(display.describe().size_mm);
        rig.devices.display = Box::new(display);
    }
    if flash && let Some(connect) = sources.flash()? {
        let flash = FlashHandle::start(connect, sources.patience(section.flash.is_some())).await?;
        rig.ids.push(flash.describe().id);
        rig.devices.flash = Some(Box::new(flash));
    }
    // Interlocks are opened last: opening a flash switches it off, even if an interlock is missing.
    let mut interlocks: Vec<Box<dyn Interlock>> = vec![];
    for connect in sources.interlocks() {
        interlocks.push(Box::new(InterlockHandle::start(connect, sources.patience(false)).await?));
    }
    rig.watch = Watch::new(interlocks);
    rig.bench = sources.bench;
    Ok(rig)
}

/// Opens the interlocks of a section, for a task that drives a device directly.
///
/// # Errors
/// `Setup` if one cannot be opened.
pub fn interlocks(section: &BenchSection) -> DeviceResult<Watch> {
    let opened: DeviceResult<Vec<_>> = section.interlocks.iter().map(InterlockConfig::open).collect();
    Ok(Watch::new(opened?))
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

/// A runtime on the calling thread, for device calls.
///
/// # Errors
/// The system has no file descriptors left.
pub fn runtime() -> Result<Runtime, Failure> {
    let built = tokio::runtime::Builder::new_current_thread().enable_all().build();
    Ok(built.map_err(|e| Error::input("tokio", format!("cannot start: {e}"), "free some memory"))?)
}
