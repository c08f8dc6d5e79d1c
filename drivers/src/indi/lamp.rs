//! Lamps of INDI servers: light boxes, and outputs as switches.
//!
//! The state is read back from the device after each command. The device keeps it when this computer fails.

use super::client::{Client, New};
use super::rotator::localhost;
use crate::flash::{Lamp, Switchable, Timing};
use crate::{Class, Clock, DeviceResult, Flash};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// Maximum time for an answer. The guardian of the flash waits 6 s for three attempts to switch off.
const ANSWER: Duration = Duration::from_millis(900);
const BRIGHTNESS: &str = "FLAT_LIGHT_INTENSITY";
const BRIGHTNESS_VALUE: &str = "FLAT_LIGHT_INTENSITY_VALUE";

/// A light box or switch of an INDI server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Host of the server, or host and port; the default port is 7624.
    #[serde(default = "localhost")]
    pub address: String,
    /// Name of the device on the server.
    pub device: String,
    /// Property with the switch.
    #[serde(default = "property")]
    pub property: String,
    /// Element of the property that is on while the lamp is on.
    #[serde(default = "on")]
    pub on: String,
    /// Element that is on while the lamp is off. An empty name is for properties without one.
    #[serde(default = "off")]
    pub off: String,
    /// Brightness of a light box in its own unit; default: as set in the server.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub brightness: Option<f64>,
}

fn property() -> String {
    "FLAT_LIGHT_CONTROL".into()
}

fn on() -> String {
    "FLAT_LIGHT_ON".into()
}

fn off() -> String {
    "FLAT_LIGHT_OFF".into()
}

/// Opens a lamp and switches it off.
///
/// # Errors
/// `Setup` if the server or the lamp cannot be reached, or the settings are wrong.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    let lamp = IndiLamp::open(settings).map_err(|e| e.class(Class::Setup))?;
    Ok(Box::new(Switchable::new(lamp, timing, clock.clone())?))
}

struct IndiLamp {
    client: Client,
    settings: Settings,
}

impl IndiLamp {
    fn open(settings: &Settings) -> DeviceResult<Self> {
        let brightness = settings.brightness.map(|_| BRIGHTNESS);
        let required: Vec<&str> = [&*settings.property].into_iter().chain(brightness).collect();
        let client = Client::open(&settings.address, &settings.device, ANSWER, &required)?;
        let lamp = Self { client, settings: settings.clone() };
        let Settings { property, on, off, .. } = settings;
        for element in [on, off].into_iter().filter(|name| !name.is_empty()) {
            if lamp.client.known.switch(property, element).is_none() {
                let got = lamp.client.known.get(property).map(|p| p.values.keys().cloned().collect::<Vec<_>>());
                let got = format!("only {}", got.unwrap_or_default().join(", "));
                let error = lamp.client.error("open", format!("a switch {element} in {property}"), got);
                return Err(error.remedy("correct `property`, `on` and `off` in the flash's settings"));
            }
        }
        lamp.check_brightness()?;
        Ok(lamp)
    }

    /// Light boxes accept a brightness only while they are on, so that it is sent with each switching on.
    fn check_brightness(&self) -> DeviceResult<()> {
        let range = self.client.known.number(BRIGHTNESS, BRIGHTNESS_VALUE).map(|(_, range)| range);
        match (self.settings.brightness, range) {
            (Some(value), Some([low, high])) if !(value >= low && value <= high) => Err(self
                .client
                .error("open", format!("a brightness of {low} to {high}"), value.to_string())
                .remedy("correct `brightness` in the flash's settings")),
            _ => Ok(()),
        }
    }
}

impl Lamp for IndiLamp {
    fn id(&self) -> String {
        format!("{} {}.{}", self.client.id(), self.settings.property, self.settings.on)
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        let what = if on { "switch on" } else { "switch off" };
        let Settings { property, on: element, off, brightness, .. } = &self.settings;
        let new = match (on, off.is_empty()) {
            (true, _) => New::Switch(element, true),
            (false, false) => New::Switch(off, true),
            (false, true) => New::Switch(element, false),
        };
        self.client.set(what, property, &[new])?;
        if let Some(brightness) = brightness.filter(|_| on) {
            self.client.set("set the brightness", BRIGHTNESS, &[New::Number(BRIGHTNESS_VALUE, brightness)])?;
        }
        Ok(())
    }

    fn state(&mut self) -> DeviceResult<bool> {
        const WHAT: &str = "report its state";
        let Settings { property, on, .. } = &self.settings;
        self.client.read(WHAT, property)?;
        self.client.known.switch(property, on).ok_or_else(|| {
            self.client.error(WHAT, format!("a switch {on} in {property}"), self.client.complaint("none"))
        })
    }
}
