//! Descriptions and limits of the bench's devices.

use super::photographs::photography;
use super::sources::missing;
use super::uses::{Use, Uses};
use super::{Place, SimulatedBench, Stop};
use crate::failure::Failure;
use crate::page::PagePanel;
use crate::plan::Limits;
use crate::setup::BenchSection;
use nacre_drivers::display::DisplayDriver;
use nacre_drivers::interlock::InterlockConfig;
use nacre_drivers::{
    CameraInfo, Clock, DeviceResult, DisplayInfo, FlashInfo, HandStage, InterlockInfo, StageInfo, SystemClock,
};
use nacre_sim::socket::RemoteBench;
use nacre_sim::{Devices as Simulated, SimDevice, describe};
use std::sync::Arc;

/// Description and limits of each device, or the error of opening it; `None` for a device that is neither configured
/// nor simulated.
pub struct Described {
    /// Stage of the analyser.
    pub stage: Option<DeviceResult<StageInfo>>,
    /// The camera.
    pub camera: Option<DeviceResult<CameraInfo>>,
    /// The panel.
    pub display: Option<DeviceResult<DisplayInfo>>,
    /// The flash.
    pub flash: Option<DeviceResult<FlashInfo>>,
    /// Configured interlocks: identity, and whether each is closed.
    pub interlocks: Vec<DeviceResult<(InterlockInfo, bool)>>,
}

impl Place {
    /// Limits of the devices. Devices of this machine are opened briefly, one at a time.
    ///
    /// # Errors
    /// No process listens on the socket of the simulated bench.
    pub fn describe(&self) -> DeviceResult<Described> {
        let simulated = match &self.simulated {
            Some(SimulatedBench::Here { config, .. }) => Some(describe(config)),
            Some(SimulatedBench::Socket(path)) => {
                Some(SimDevice::new(Box::new(RemoteBench::connect(path)?))?.devices().clone())
            }
            None => None,
        };
        let simulated = simulated.as_ref();
        let only = |uses: Uses| self.section.only(uses);
        Ok(Described {
            stage: locked(&only(Uses { stage: Use::Always, ..Uses::NONE }), |s| stage(s, simulated)),
            camera: locked(&only(Uses { camera: Use::Always, ..Uses::NONE }), |s| camera(s, simulated)),
            display: locked(&only(Uses { display: Use::Always, ..Uses::NONE }), |s| display(s, simulated)),
            flash: locked(&only(Uses { flash: Use::Always, ..Uses::NONE }), |s| flash(s, simulated)),
            interlocks: self.section.interlocks.iter().map(interlock).collect(),
        })
    }

    /// Limits of the devices of a session. Devices of this machine are opened briefly, one at a time.
    ///
    /// # Errors
    /// The configuration lacks a device; no process listens on the socket; a device cannot be opened or is in use by
    /// another process.
    pub fn limits(&self) -> Result<Limits, Failure> {
        self.require(Uses::SESSION)?;
        let Described { stage, camera, display, flash, .. } = self.describe()?;
        Ok(Limits {
            stage: stage.ok_or_else(|| missing("stage"))??,
            camera: camera.ok_or_else(|| missing("camera"))??,
            display: display.ok_or_else(|| missing("display"))??,
            flash: flash.transpose()?,
        })
    }
}

/// Accesses a device while holding its lock, because opening a flash switches it off even if another process uses it.
fn locked<T>(
    section: &BenchSection,
    look: impl FnOnce(&BenchSection) -> Option<DeviceResult<T>>,
) -> Option<DeviceResult<T>> {
    match section.lock() {
        Ok(_locks) => look(section),
        Err(held) => Some(Err(held)),
    }
}

fn clock() -> Arc<dyn Clock> {
    Arc::new(SystemClock)
}

fn stage(section: &BenchSection, simulated: Option<&Simulated>) -> Option<DeviceResult<StageInfo>> {
    if section.by_hand() {
        return Some(Ok(HandStage::info()));
    }
    let seen = |axis: StageInfo| section.stage.as_ref().map_or(axis.clone(), |config| config.mounting.seen(axis));
    match section.stage.as_ref().and_then(|s| s.open(&clock())) {
        Some(opened) => Some(opened.map(|stage| stage.describe())),
        None => simulated.map(|s| Ok(seen(s.stage.clone()))),
    }
}

fn camera(section: &BenchSection, simulated: Option<&Simulated>) -> Option<DeviceResult<CameraInfo>> {
    match section.camera.as_ref().and_then(|c| c.open(&clock(), &photography(&Stop::default()))) {
        Some(opened) => Some(opened.map(|camera| camera.describe())),
        None => simulated.map(|s| Ok(s.camera.clone())),
    }
}

fn display(section: &BenchSection, simulated: Option<&Simulated>) -> Option<DeviceResult<DisplayInfo>> {
    if let Some(DisplayDriver::Page { size_mm }) = section.display.as_ref().map(|d| &d.driver) {
        return Some(Ok(PagePanel::info(*size_mm)));
    }
    match section.display.as_ref().and_then(|d| d.open(&clock())) {
        Some(opened) => Some(opened.map(|display| display.describe())),
        None => simulated.map(|s| Ok(s.display.clone())),
    }
}

fn flash(section: &BenchSection, simulated: Option<&Simulated>) -> Option<DeviceResult<FlashInfo>> {
    match section.flash.as_ref().and_then(|f| f.open(&clock())) {
        Some(opened) => Some(opened.map(|flash| flash.describe())),
        None => simulated.map(|s| Ok(s.flash.clone())),
    }
}

fn interlock(config: &InterlockConfig) -> DeviceResult<(InterlockInfo, bool)> {
    let mut opened = config.open()?;
    let level = nacre_drivers::wire::wait(opened.level())?;
    Ok((opened.describe(), level.holds))
}

#[cfg(test)]
mod tests {
    use super::super::{Place, Rig, Stop, Uses, runtime};
    use crate::setup::BenchSection;
    use nacre_base::progress::Silent;
    use nacre_sim::BenchConfig;

    #[test]
    fn limits_equal_those_of_the_open_bench() {
        let mut config = BenchConfig::default();
        (config.camera.width, config.camera.height) = (16, 16);
        let mounting = "zero_deg = 90, sense = \"clockwise\", gear = 2, approach_deg = 1, limits_deg = [-100, 100]";
        for stage in [None, Some(mounting), Some("zero_deg = 30")] {
            let text =
                stage.map(|m| format!("stage = {{ driver = {{ kind = \"simulated\" }}, mounting = {{ {m} }} }}"));
            let section: BenchSection = toml::from_str(&text.unwrap_or_default()).unwrap();
            let place = Place { section, ..Place::here(config.clone()) };
            let limits = place.limits().unwrap();
            let runtime = runtime().unwrap();
            let rig = Rig::open(&runtime, &place, Uses::SESSION, &Silent, &Stop::default()).ok().unwrap();
            assert_eq!(limits.stage, rig.devices.stage.describe(), "{stage:?}");
            assert_eq!(limits.display, rig.devices.display.describe());
        }
    }
}
