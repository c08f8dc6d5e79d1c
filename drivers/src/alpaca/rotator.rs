//! Rotators of Alpaca servers.

use super::client::{Device, Role, misconfigured};
use crate::stage::rotator::{Motion, Port, Reading, Rotator};
use crate::{Class, Clock, DeviceError, DeviceResult, Stage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A rotator of an ASCOM Alpaca server.
///
/// The driver uses the rotator's mechanical angle, which other programs cannot offset, and switches its reversal off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Host of the server, or host and port; the default port is 11111.
    pub address: String,
    /// Number of the rotator on the server.
    #[serde(default)]
    pub rotator: u32,
    /// Times, angles and limits.
    #[serde(default)]
    pub motion: Motion,
}

/// Opens a rotator.
///
/// # Errors
/// `Setup` if the server or the rotator cannot be reached, or the settings are wrong.
pub fn open(settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Box<dyn Stage>> {
    settings.motion.check().map_err(|wrong| misconfigured(Role::Rotator, wrong))?;
    let device = Device::open(&settings.address, Role::Rotator, settings.rotator, settings.motion.answer())?;
    let port = AlpacaPort::new(device).map_err(|e| e.class(Class::Setup))?;
    let rotator = Rotator::new(port, settings.motion.clone(), clock).map_err(|e| e.class(Class::Setup))?;
    Ok(Box::new(rotator))
}

struct AlpacaPort {
    device: Device,
    /// Whether the rotator has a mechanical angle (interface version 3).
    mechanical: bool,
}

impl AlpacaPort {
    fn new(mut device: Device) -> DeviceResult<Self> {
        const WHAT: &str = "open";
        let mechanical = device.get_optional::<f64>("mechanicalposition", WHAT)?.is_some();
        let reversible = device.get_optional::<bool>("canreverse", WHAT)?.unwrap_or(false);
        if reversible && device.get::<bool>("reverse", WHAT)? {
            device.put("reverse", "switch its reversal off", &[("Reverse", "False")])?;
            if device.get::<bool>("reverse", WHAT)? {
                let error = DeviceError::new(device.id(), "switch its reversal off", "off", "on");
                return Err(error.remedy("switch it off in the program of the server"));
            }
        }
        Ok(Self { device, mechanical })
    }
}

impl Port for AlpacaPort {
    fn id(&self) -> &str {
        self.device.id()
    }

    fn halts(&self) -> bool {
        true
    }

    fn read(&mut self, what: &str) -> DeviceResult<Reading> {
        // In this order, a rotator that is reported to stand stood when its angle was read.
        let moving = self.device.get("ismoving", what)?;
        let angle_deg = self.device.get(if self.mechanical { "mechanicalposition" } else { "position" }, what)?;
        Ok(Reading { angle_deg, moving })
    }

    fn go(&mut self, what: &str, angle_deg: f64) -> DeviceResult<()> {
        let method = if self.mechanical { "movemechanical" } else { "moveabsolute" };
        self.device.put(method, what, &[("Position", &format!("{angle_deg:.6}"))])
    }

    fn stop(&mut self) -> DeviceResult<()> {
        self.device.put("halt", "halt", &[])
    }
}
