//! Sources of a bench's devices: how to open each, and how to reopen it after a lost connection.

use super::photographs::photography;
use super::terminal::Terminal;
use super::{Stop, Use, Uses};
use crate::guardian::{Guarded, GuardedFlash};
use crate::page::{Link, PagePanel};
use crate::setup::BenchSection;
use nacre_drivers::display::{DisplayConfig, DisplayDriver};
use nacre_drivers::stage::{Mounted, StageDriver};
use nacre_drivers::{
    Camera, Class, Clock, Connect, DeviceError, DeviceLock, DeviceResult, Display, Flash, HandStage, Interlock,
    Patience, Stage, SystemClock,
};
use nacre_sim::socket::{RemoteBench, RemoteClock};
use nacre_sim::{Devices, Port, SharedBench, SimDevice};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Time limit for restoring a lost connection.
const PATIENCE: Duration = Duration::from_secs(2);

/// Opens a new connection to the simulated bench.
type Dial = Arc<dyn Fn() -> DeviceResult<Box<dyn Port>> + Send + Sync>;

/// Sources of the devices of a bench.
pub struct Sources {
    /// Configured devices of this machine.
    pub section: BenchSection,
    /// Descriptions of the simulated devices, if any.
    pub simulated: Option<Devices>,
    /// The simulated bench, if it is in this process.
    pub bench: Option<SharedBench>,
    dial: Option<Dial>,
    /// Socket of the simulated bench, if any.
    socket: Option<PathBuf>,
    /// Clock for devices of this machine.
    clock: Arc<dyn Clock>,
    /// Connection to the pattern page, if a service runs.
    pub page: Option<Arc<Link>>,
    stop: Stop,
}

impl Sources {
    /// Devices of this machine only.
    pub fn real(section: &BenchSection, stop: &Stop) -> Self {
        let section = section.clone();
        Self {
            section,
            simulated: None,
            bench: None,
            dial: None,
            socket: None,
            clock: Arc::new(SystemClock),
            page: None,
            stop: stop.clone(),
        }
    }

    /// In addition to a simulated bench in this process.
    pub fn beside(section: &BenchSection, bench: SharedBench, stop: &Stop) -> Self {
        let (simulated, shared) = (bench.look(|b| nacre_sim::describe(b.config())), bench.clone());
        let dial: Dial = Arc::new(move || Ok(Box::new(shared.clone()) as Box<dyn Port>));
        Self {
            simulated: Some(simulated),
            dial: Some(dial),
            clock: Arc::new(bench.clone()),
            bench: Some(bench),
            ..Self::real(section, stop)
        }
    }

    /// In addition to a simulated bench behind a socket.
    ///
    /// # Errors
    /// No process listens on the socket.
    pub fn with_socket(section: &BenchSection, path: &Path, stop: &Stop) -> DeviceResult<Self> {
        let owned = path.to_path_buf();
        let dial: Dial = Arc::new(move || Ok(Box::new(RemoteBench::connect(&owned)?) as Box<dyn Port>));
        let simulated = SimDevice::new(dial()?)?.devices().clone();
        Ok(Self {
            simulated: Some(simulated),
            dial: Some(dial),
            socket: Some(path.to_path_buf()),
            clock: Arc::new(RemoteClock::connect(path)?),
            ..Self::real(section, stop)
        })
    }

    /// Locks the simulated devices in use; other processes may use the other devices of the bench.
    ///
    /// # Errors
    /// `Setup`, naming the holder.
    pub fn lock_simulated(&self, socket: &Path, uses: Uses) -> DeviceResult<Vec<DeviceLock>> {
        let Some(all) = &self.simulated else { return Ok(vec![]) };
        let place = socket.canonicalize().unwrap_or_else(|_| socket.to_path_buf()).to_string_lossy().into_owned();
        let parts = [
            (&all.stage.id, uses.stage, self.section.stage.is_none() || self.section.by_hand()),
            (&all.camera.id, uses.camera, self.section.camera.is_none()),
            (&all.display.id, uses.display, self.section.display.is_none()),
            (&all.flash.id, uses.flash, self.section.flash.is_none()),
        ];
        let used = parts.into_iter().filter(|(_, used, simulated)| *used != Use::Never && *simulated);
        used.map(|(id, ..)| DeviceLock::take(id, &place)).collect()
    }

    /// Time limit for a lost connection: on the wall clock for real devices, otherwise on the bench's clock.
    pub fn patience(&self, real: bool) -> Patience {
        let clock: Arc<dyn Clock> = match &self.bench {
            Some(bench) if !real => Arc::new(bench.clone()),
            _ => Arc::new(SystemClock),
        };
        Patience { total: PATIENCE, clock }
    }

    /// Stage of the analyser.
    ///
    /// # Errors
    /// None is configured.
    pub fn stage(&self) -> DeviceResult<Connect<dyn Stage>> {
        let Some(config) = self.section.stage.clone() else {
            let dial = self.dial("stage")?;
            return Ok(Box::new(move || Ok(Box::new(SimDevice::new(dial()?)?) as Box<dyn Stage>)));
        };
        let (clock, dial, stop) = (self.clock.clone(), self.dial.clone(), self.stop.clone());
        Ok(Box::new(move || {
            let simulated = || -> DeviceResult<Option<Box<dyn Stage>>> {
                dial.as_ref().map(|dial| Ok(Box::new(SimDevice::new(dial()?)?) as Box<dyn Stage>)).transpose()
            };
            match (&config.driver, config.open(&clock)) {
                (_, Some(opened)) => opened,
                (StageDriver::Hand {}, _) => {
                    let prompt = Box::new(Terminal { stop: stop.clone() });
                    Ok(Box::new(HandStage::new(prompt, clock.clone(), simulated()?)))
                }
                _ => {
                    let axis = simulated()?.ok_or_else(|| missing("stage"))?;
                    Ok(Box::new(Mounted::new(axis, config.mounting)))
                }
            }
        }))
    }

    /// Camera.
    ///
    /// # Errors
    /// None is configured.
    pub fn camera(&self) -> DeviceResult<Connect<dyn Camera>> {
        let (config, clock, program) = (self.section.camera.clone(), self.clock.clone(), photography(&self.stop));
        let dial = if self.section.has_real_camera() { None } else { Some(self.dial("camera")?) };
        Ok(Box::new(move || match (config.as_ref().and_then(|c| c.open(&clock, &program)), &dial) {
            (Some(opened), _) => opened,
            (None, Some(dial)) => Ok(Box::new(SimDevice::new(dial()?)?)),
            (None, None) => Err(missing("camera")),
        }))
    }

    /// Panel.
    ///
    /// # Errors
    /// None is configured.
    pub fn display(&self) -> DeviceResult<Connect<dyn Display>> {
        let (config, clock, dial) = (self.section.display.clone(), self.clock.clone(), self.dial.clone());
        if let Some(DisplayConfig { driver: DisplayDriver::Page { size_mm }, .. }) = config {
            // Without a service, no page is ever open: the panel is dark, and shows nothing.
            let link = self.page.clone().unwrap_or_default();
            let response = config.as_ref().map_or(Duration::ZERO, DisplayConfig::response);
            let panel = move || PagePanel { link: link.clone(), size_mm, response, clock: clock.clone() };
            return Ok(Box::new(move || Ok(Box::new(panel()) as Box<dyn Display>)));
        }
        if config.is_none() {
            self.dial("display")?;
        }
        Ok(Box::new(move || match (config.as_ref().and_then(|c| c.open(&clock)), &dial) {
            (Some(opened), _) => opened,
            (None, Some(dial)) => Ok(Box::new(SimDevice::new(dial()?)?)),
            (None, None) => Err(missing("display")),
        }))
    }

    /// Flash, controlled through a guardian if it outlives this process; `None` for a bench without a flash.
    ///
    /// # Errors
    /// None at present.
    pub fn flash(&self) -> DeviceResult<Option<Connect<dyn Flash>>> {
        let guarded = match (&self.section.flash, &self.socket, &self.dial) {
            (Some(config), _, _) if !config.is_simulated() => Guarded::Device(config.clone()),
            (_, Some(socket), _) => Guarded::Bench(socket.clone()),
            (_, None, Some(dial)) => {
                let dial = dial.clone();
                return Ok(Some(Box::new(move || Ok(Box::new(SimDevice::new(dial()?)?) as Box<dyn Flash>))));
            }
            (Some(_), None, None) => return Err(missing("flash")),
            (None, None, None) => return Ok(None),
        };
        let clock = self.clock.clone();
        Ok(Some(Box::new(move || Ok(Box::new(GuardedFlash::start(&guarded, clock.clone())?) as Box<dyn Flash>))))
    }

    /// Door switch of the simulated bench, if any device is simulated, and the configured interlocks.
    pub fn interlocks(&self) -> Vec<Connect<dyn Interlock>> {
        let mut interlocks: Vec<Connect<dyn Interlock>> = vec![];
        if let Some(dial) = self.dial.clone() {
            interlocks.push(Box::new(move || Ok(Box::new(SimDevice::new(dial()?)?) as Box<dyn Interlock>)));
        }
        for config in self.section.interlocks.clone() {
            interlocks.push(Box::new(move || config.open()));
        }
        interlocks
    }

    fn dial(&self, what: &str) -> DeviceResult<Dial> {
        self.dial.clone().ok_or_else(|| missing(what))
    }
}

/// Error of a device that is neither configured nor simulated.
pub fn missing(what: &str) -> DeviceError {
    DeviceError::new(what, "open", format!("a {what} in the configuration"), "none")
        .remedy(format!(
            "describe it as [bench.{what}] in nacre.toml (`nacre devices` shows what there is), or add --sim"
        ))
        .class(Class::Setup)
}
