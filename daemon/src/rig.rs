//! Opens the devices of a bench, each on its own thread, locked against other processes.

use crate::Failure;
use crate::engine::{Devices, Watch};
use crate::guardian::GuardedFlash;
use crate::plan::Limits;
use crate::session::Setup;
use nacre_drivers::{
    Camera, CameraHandle, Clock, DeviceLock, DeviceResult, Display, DisplayHandle, Flash, FlashHandle, HandStage,
    Interlock, InterlockHandle, Patience, Prompt, Stage, StageHandle, SystemClock,
};
use nacre_processing::frames::Geometry;
use nacre_processing::progress::Progress;
use nacre_sim::socket::RemoteBench;
use nacre_sim::{Bench, BenchConfig, Port, SharedBench, SimDevice, describe};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;
use tokio::runtime::Runtime;

/// A lost link may take this long to come back.
const PATIENCE: Duration = Duration::from_secs(2);

/// How often somebody asked for the end.
pub type Stop = Arc<AtomicU32>;

/// Where the simulated bench is.
#[derive(Clone, Debug)]
pub enum Place {
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
    /// The simulated bench as it is configured.
    pub config: BenchConfig,
    /// The simulated bench itself, if it is in this process.
    pub bench: Option<SharedBench>,
    #[allow(dead_code, reason = "held until the rig is dropped")]
    locks: Vec<DeviceLock>,
}

impl Place {
    /// A bench in this process whose time is virtual.
    pub fn here(config: BenchConfig) -> Self {
        Self::Here { config: Box::new(config), real_time: false }
    }

    /// What the devices can do, without opening them.
    ///
    /// # Errors
    /// Nobody listens at the socket.
    pub fn limits(&self) -> DeviceResult<Limits> {
        let devices = match self {
            Self::Here { config, .. } => describe(config),
            Self::Socket(path) => SimDevice::new(Box::new(RemoteBench::connect(path)?))?.devices().clone(),
        };
        Ok(Limits {
            stage: devices.stage,
            camera: devices.camera,
            display: devices.display,
            flash: Some(devices.flash),
        })
    }
}

impl Rig {
    /// Opens all devices; with `hand` the analyser is turned by hand, and the person is asked until `stop` counts.
    ///
    /// # Errors
    /// A device cannot be opened or belongs to another process; `Cancelled` while a bench is built.
    pub fn open(
        runtime: &Runtime,
        place: &Place,
        hand: bool,
        progress: &dyn Progress,
        stop: &Stop,
    ) -> Result<Self, Failure> {
        match place {
            Place::Here { config, real_time } => {
                let bench = Bench::new(config, progress)?;
                let bench = if *real_time { SharedBench::real_time(bench) } else { SharedBench::new(bench) };
                let shared = bench.clone();
                let port = move || -> DeviceResult<Box<dyn Port>> { Ok(Box::new(shared.clone())) };
                let mut rig = runtime.block_on(open(port, Arc::new(bench.clone()), hand, stop, None))?;
                rig.bench = Some(bench);
                Ok(rig)
            }
            Place::Socket(path) => {
                let owned = path.clone();
                let port = move || -> DeviceResult<Box<dyn Port>> { Ok(Box::new(RemoteBench::connect(&owned)?)) };
                Ok(runtime.block_on(open(port, Arc::new(SystemClock), hand, stop, Some(path)))?)
            }
        }
    }
}

/// Opens the devices behind a port; those behind a socket are locked, and their flash is guarded.
async fn open(
    port: impl Fn() -> DeviceResult<Box<dyn Port>> + Clone + Send + 'static,
    clock: Arc<dyn Clock>,
    hand: bool,
    stop: &Stop,
    socket: Option<&Path>,
) -> DeviceResult<Rig> {
    let all = SimDevice::new(port()?)?.devices().clone();
    let ids = [&all.stage.id, &all.camera.id, &all.display.id, &all.flash.id].map(String::clone).to_vec();
    let locks = match socket {
        Some(path) => {
            let place = path.canonicalize().unwrap_or_else(|_| path.to_path_buf()).to_string_lossy().into_owned();
            ids.iter().map(|id| DeviceLock::take(id, &place)).collect::<DeviceResult<_>>()?
        }
        None => vec![],
    };
    let patience = Patience { total: PATIENCE, clock: clock.clone() };
    let device = {
        let port = port.clone();
        move || SimDevice::new(port()?)
    };
    let (stage, camera, display, interlock) = (device.clone(), device.clone(), device.clone(), device.clone());
    let flash: nacre_drivers::Connect<dyn Flash> = match socket.map(Path::to_path_buf) {
        Some(path) => Box::new(move || Ok(Box::new(GuardedFlash::start(&path)?) as Box<dyn Flash>)),
        None => Box::new(move || Ok(Box::new(device()?) as Box<dyn Flash>)),
    };
    let stop = stop.clone();
    let stage: nacre_drivers::Connect<dyn Stage> = if hand {
        Box::new(move || {
            let prompt = Box::new(Terminal { stop: stop.clone() });
            Ok(Box::new(HandStage::new(prompt, clock.clone(), Some(Box::new(stage()?)))) as Box<dyn Stage>)
        })
    } else {
        Box::new(move || Ok(Box::new(stage()?) as Box<dyn Stage>))
    };
    let devices = Devices {
        stage: Box::new(StageHandle::start(stage, patience.clone()).await?),
        camera: Box::new(
            CameraHandle::start(Box::new(move || Ok(Box::new(camera()?) as Box<dyn Camera>)), patience.clone()).await?,
        ),
        display: Box::new(
            DisplayHandle::start(Box::new(move || Ok(Box::new(display()?) as Box<dyn Display>)), patience.clone())
                .await?,
        ),
        flash: Some(Box::new(FlashHandle::start(flash, patience.clone()).await?)),
    };
    let door = Box::new(move || Ok(Box::new(interlock()?) as Box<dyn Interlock>));
    let watch = Watch::new(vec![Box::new(InterlockHandle::start(door, patience).await?)]);
    let bench = &all.bench;
    let setup = Setup {
        wavelength_nm: Some(bench.filter.wavelength_nm),
        band_nm: Some(bench.filter.band_nm).filter(|b| *b > 0.0),
        geometry: Some(Geometry {
            distance_mm: bench.geometry.distance_mm,
            baseline_mm: bench.geometry.baseline_mm,
            pixel_um: Some(all.pixel_um),
            camera_px: None,
        }),
    };
    let mut ids = ids;
    ids[0] = devices.stage.describe().id;
    Ok(Rig { devices, watch, ids, setup, config: all.bench, bench: None, locks })
}

/// Asks the person at the terminal; gives up when the program is to stop.
struct Terminal {
    stop: Stop,
}

impl Prompt for Terminal {
    fn ask(&mut self, request: &str) -> std::io::Result<()> {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        use std::io::{Error, ErrorKind, Write};
        writeln!(std::io::stderr().lock(), "{request}")?;
        let stdin = std::io::stdin();
        let wait = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
        loop {
            if self.stop.load(Ordering::Relaxed) > 0 {
                return Err(ErrorKind::Interrupted.into());
            }
            if !poll(&mut [PollFd::new(&stdin, PollFlags::IN)], Some(&wait)).is_ok_and(|ready| ready > 0) {
                continue;
            }
            // Byte by byte, since what is read ahead is not seen by the next poll.
            let mut byte = [0];
            match rustix::io::read(&stdin, &mut byte)? {
                0 => return Err(Error::new(ErrorKind::UnexpectedEof, "the end of the terminal's input")),
                _ if byte == *b"\n" => return Ok(()),
                _ => {}
            }
        }
    }
}
