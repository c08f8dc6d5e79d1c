//! Where each device of a bench comes from: how it is opened, and again after its link was lost.

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

/// A lost link may take this long to come back.
const PATIENCE: Duration = Duration::from_secs(2);

/// Makes a new way to the simulated bench.
type Dial = Arc<dyn Fn() -> DeviceResult<Box<dyn Port>> + Send + Sync>;

/// Where the devices of a bench come from.
pub struct Sources {
    /// Which devices of this machine take part.
    pub section: BenchSection,
    /// What the simulated devices are, if there are any.
    pub simulated: Option<Devices>,
    /// The simulated bench, if it is in this process.
    pub bench: Option<SharedBench>,
    dial: Option<Dial>,
    /// The simulated bench's socket, if it has one.
    socket: Option<PathBuf>,
    /// The time that devices of this machine report.
    clock: Arc<dyn Clock>,
    /// The way to the pattern page, where there is a service.
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

    /// Beside a simulated bench in this process.
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

    /// Beside a simulated bench behind a socket.
    ///
    /// # Errors
    /// Nobody listens there.
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

    /// Takes the locks of the simulated devices that are used: others may have the bench's other devices.
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

    /// How long a lost link may take: on the clock on the wall for what is plugged in somewhere, on the bench's otherwise.
    pub fn patience(&self, real: bool) -> Patience {
        let clock: Arc<dyn Clock> = match &self.bench {
            Some(bench) if !real => Arc::new(bench.clone()),
            _ => Arc::new(SystemClock),
        };
        Patience { total: PATIENCE, clock }
    }

    /// What turns the analyser.
    ///
    /// # Errors
    /// None is described.
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

    /// What takes the frames.
    ///
    /// # Errors
    /// None is described.
    pub fn camera(&self) -> DeviceResult<Connect<dyn Camera>> {
        let (config, clock) = (self.section.camera.clone(), self.clock.clone());
        let dial = if self.section.has_real_camera() { None } else { Some(self.dial("camera")?) };
        Ok(Box::new(move || match (config.as_ref().and_then(|c| c.open(&clock)), &dial) {
            (Some(opened), _) => opened,
            (None, Some(dial)) => Ok(Box::new(SimDevice::new(dial()?)?)),
            (None, None) => Err(missing("camera")),
        }))
    }

    /// What lights the sample.
    ///
    /// # Errors
    /// None is described.
    pub fn display(&self) -> DeviceResult<Connect<dyn Display>> {
        let (config, clock, dial) = (self.section.display.clone(), self.clock.clone(), self.dial.clone());
        if let Some(DisplayConfig { driver: DisplayDriver::Page { size_mm }, .. }) = config {
            // Without a service nobody ever opens the page: it is dark, and shows nothing.
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

    /// What lights it too, in its guardian's hands wherever it outlives this process; None for a bench without a flash.
    ///
    /// # Errors
    /// None, so far.
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

    /// The simulated bench's door switch, where anything is simulated.
    pub fn interlock(&self) -> Option<Connect<dyn Interlock>> {
        let dial = self.dial.clone()?;
        Some(Box::new(move || Ok(Box::new(SimDevice::new(dial()?)?) as Box<dyn Interlock>)))
    }

    fn dial(&self, what: &str) -> DeviceResult<Dial> {
        self.dial.clone().ok_or_else(|| missing(what))
    }
}

/// The error of a device that is neither described nor simulated.
pub fn missing(what: &str) -> DeviceError {
    DeviceError::new(what, "open", format!("a {what} in the configuration"), "none")
        .remedy(format!(
            "describe it as [bench.{what}] in nacre.toml (`nacre devices` shows what there is), or add --sim"
        ))
        .class(Class::Setup)
}
