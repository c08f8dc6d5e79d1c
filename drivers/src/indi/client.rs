//! A connection to one device of an INDI server.

use super::property::{Blob, Properties, State};
use super::xml::{Reader, escaped};
use super::{PORT, discovery};
use crate::net::{Connection, host_and_port};
use crate::{Class, DeviceError, DeviceResult};
use std::io::{Read, Write};
use std::time::{Duration, Instant};

/// Maximum times for a device to connect to its hardware, and to define a property, in answers. The guardian of a flash
/// waits 6 s for both.
const CONNECTING: u32 = 4;
const DEFINING: u32 = 2;
/// Longest wait in one call for messages.
const SLICE: Duration = Duration::from_millis(50);
/// Largest number of readings in one call, so that a flood of messages does not hold it up.
const MAX_READS: usize = 64;

/// A new value of an element.
#[derive(Clone, Copy, Debug)]
pub(crate) enum New<'a> {
    Number(&'a str, f64),
    Switch(&'a str, bool),
}

/// A device of a server.
pub(crate) struct Client {
    connection: Connection,
    reader: Reader,
    device: String,
    address: String,
    id: String,
    limit: Duration,
    /// Properties as last received.
    pub known: Properties,
}

/// Error of an invalid configuration.
pub(crate) fn misconfigured(device: &str, wrong: String) -> DeviceError {
    DeviceError::new(&format!("indi {device}"), "open", "a proper configuration", wrong)
        .remedy("correct the settings of the driver in the configuration")
        .class(Class::Setup)
}

impl Client {
    /// Connects to a device and waits until it has all of the properties.
    ///
    /// # Errors
    /// `Setup` if server or device cannot be reached, or a property is missing.
    pub fn open(address: &str, device: &str, limit: Duration, required: &[&str]) -> DeviceResult<Self> {
        let (host, port) = host_and_port(address, PORT).map_err(|wrong| misconfigured(device, wrong))?;
        if device.trim().is_empty() || device.len() > 256 {
            let wrong = format!("device is {device:?}; give a name as in the server");
            return Err(misconfigured(device, wrong));
        }
        let id = format!("indi {device} at {address}");
        let connection = Connection::open(host, port, limit).map_err(|e| {
            DeviceError::new(&id, "open", "an INDI server", format!("no connection to {address} ({e})"))
                .remedy(format!("start the server (indiserver) at {address}, and check the network"))
                .class(Class::Setup)
        })?;
        let (device, address) = (device.to_owned(), address.to_owned());
        let known = Properties::new(&device);
        let mut client = Self { connection, reader: Reader::default(), device, address, id, limit, known };
        client.connect(required).map_err(|e| e.class(Class::Setup))?;
        Ok(client)
    }

    fn connect(&mut self, required: &[&str]) -> DeviceResult<()> {
        const WHAT: &str = "open";
        self.refresh(WHAT, None)?;
        if self.wait_for(WHAT, self.limit, |known| known.get("CONNECTION").map(drop))?.is_none() {
            let names = discovery::names(&self.address);
            let got = match names.is_empty() {
                true => format!("no answer from {} within {} ms", self.address, self.limit.as_millis()),
                false => format!("only {}", names.join(", ")),
            };
            return Err(self
                .error(WHAT, "the device on the server", got)
                .remedy("correct `device`, or start its driver in the server"));
        }
        if self.known.switch("CONNECTION", "CONNECT") != Some(true) {
            let before = self.known.updates("CONNECTION");
            self.send(WHAT, "CONNECTION", &[New::Switch("CONNECT", true)])?;
            let connected = self.wait_for(WHAT, CONNECTING * self.limit, |known| {
                let state = known.get("CONNECTION").filter(|p| p.updates > before && p.state != State::Busy)?.state;
                Some(state != State::Alert && known.switch("CONNECTION", "CONNECT") == Some(true))
            })?;
            if connected != Some(true) {
                return Err(self
                    .error(WHAT, "a connected device", self.complaint("none"))
                    .remedy("check its power, cable and port in the server"));
            }
        }
        for property in required {
            if self.wait_for(WHAT, DEFINING * self.limit, |known| known.get(property).map(drop))?.is_none() {
                return Err(self
                    .error(WHAT, format!("a property {property}"), "none")
                    .remedy("choose another device, or see its properties with `indi_getprop`"));
            }
        }
        // Its answer follows the definitions of all properties, so that optional ones are known, too.
        self.read(WHAT, "CONNECTION")?;
        let driver = self.known.text("DRIVER_INFO", "DRIVER_EXEC").unwrap_or_default();
        let driver: String = driver.chars().filter(|c| !c.is_control()).take(80).collect();
        self.id = format!("indi {} ({driver}) at {}", self.device, self.address);
        Ok(())
    }

    /// Stable identity.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Permits pictures of this size, and asks for those of a property.
    pub fn want_pictures(&mut self, property: &str, bytes: usize) -> DeviceResult<()> {
        // Base64 needs four characters for three bytes, and line breaks.
        self.reader.permit(bytes.saturating_mul(3) / 2);
        let (device, property) = (escaped(&self.device), escaped(property));
        let text = format!("<enableBLOB device=\"{device}\" name=\"{property}\">Also</enableBLOB>\n");
        self.write("ask for pictures", &text)
    }

    /// Takes the last picture of a property.
    pub fn take_picture(&mut self, property: &str) -> Option<Blob> {
        self.known.blob.take().filter(|blob| blob.property == property)
    }

    /// Error of a command.
    pub fn error(&self, what: &str, expected: impl Into<Box<str>>, got: impl Into<Box<str>>) -> DeviceError {
        DeviceError::new(&self.id, what, expected, got)
    }

    /// A defect with the device's last message.
    pub fn complaint(&self, got: &str) -> String {
        match self.known.message.as_str() {
            "" => got.to_owned(),
            message => format!("{got} (last message: {message})"),
        }
    }

    fn lost(&self, what: &str, got: String) -> DeviceError {
        self.error(what, "an answer", got)
            .remedy(format!("check that the server at {} runs, the network, and the device's power", self.address))
            .class(Class::Lost)
    }

    fn write(&mut self, what: &str, text: &str) -> DeviceResult<()> {
        self.connection.until = Instant::now() + self.limit;
        self.connection.write_all(text.as_bytes()).map_err(|e| self.lost(what, format!("a lost link ({e})")))
    }

    /// Asks the device to send its properties, or one of them, again.
    pub fn refresh(&mut self, what: &str, property: Option<&str>) -> DeviceResult<()> {
        let name = property.map_or_else(String::new, |name| format!(" name=\"{}\"", escaped(name)));
        self.write(what, &format!("<getProperties version=\"1.7\" device=\"{}\"{name}/>\n", escaped(&self.device)))
    }

    /// Sends new values of a property.
    pub fn send(&mut self, what: &str, property: &str, values: &[New<'_>]) -> DeviceResult<()> {
        let one = |value: &New<'_>| match value {
            New::Number(name, value) => format!("<oneNumber name=\"{}\">{value}</oneNumber>", escaped(name)),
            New::Switch(name, on) => {
                format!("<oneSwitch name=\"{}\">{}</oneSwitch>", escaped(name), if *on { "On" } else { "Off" })
            }
        };
        let kind = if matches!(values, [New::Switch(..), ..]) { "Switch" } else { "Number" };
        let values: String = values.iter().map(one).collect();
        let (device, property) = (escaped(&self.device), escaped(property));
        self.write(
            what,
            &format!("<new{kind}Vector device=\"{device}\" name=\"{property}\">{values}</new{kind}Vector>\n"),
        )
    }

    /// Receives messages for at most `limit`; returns whether any arrived.
    pub fn receive(&mut self, what: &str, limit: Duration) -> DeviceResult<bool> {
        let mut buffer = [0; 64 * 1024];
        self.connection.until = Instant::now() + limit;
        match self.connection.read(&mut buffer) {
            Ok(0) => return Err(self.lost(what, "a closed connection".into())),
            Ok(count) => {
                let pushed = self.reader.push(buffer.get(..count).unwrap_or(&buffer));
                pushed.map_err(|wrong| self.lost(what, format!("messages that are not INDI ({wrong})")))?;
            }
            Err(e) if Connection::is_timeout(&e) => return Ok(false),
            Err(e) => return Err(self.lost(what, format!("a lost link ({e})"))),
        }
        while let Some(element) = self.reader.next_element() {
            self.known.take(element);
        }
        Ok(true)
    }

    /// Receives the messages that have arrived.
    pub fn catch_up(&mut self, what: &str) -> DeviceResult<()> {
        for _ in 0..MAX_READS {
            if !self.receive(what, Duration::from_millis(1))? {
                break;
            }
        }
        Ok(())
    }

    /// Receives messages until a condition yields a value; `None` after `limit`.
    pub fn wait_for<T>(
        &mut self,
        what: &str,
        limit: Duration,
        condition: impl Fn(&Properties) -> Option<T>,
    ) -> DeviceResult<Option<T>> {
        let until = Instant::now() + limit;
        loop {
            if let Some(value) = condition(&self.known) {
                return Ok(Some(value));
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            self.receive(what, left.min(SLICE))?;
        }
    }

    /// Waits for the next message about a property; returns its state.
    fn next_state(&mut self, what: &str, property: &str, before: u64, ended: bool) -> DeviceResult<State> {
        let limit = self.limit;
        let state = self.wait_for(what, limit, |known| match known.get(property) {
            None => Some(None),
            Some(p) => (p.updates > before && !(ended && p.state == State::Busy)).then_some(Some(p.state)),
        })?;
        match state {
            Some(Some(State::Alert)) => Err(self
                .error(what, "the command to be accepted", self.complaint("the state `Alert`"))
                .remedy("see the device in a client of INDI, then try again")
                .class(Class::Retry)),
            Some(Some(state)) => Ok(state),
            Some(None) => {
                Err(self.lost(what, format!("a device without {property}: its driver ended or was disconnected")))
            }
            None => Err(self.lost(what, format!("none within {} ms", limit.as_millis()))),
        }
    }

    /// Sends new values, and waits until the device answers.
    pub fn command(&mut self, what: &str, property: &str, values: &[New<'_>]) -> DeviceResult<State> {
        self.catch_up(what)?;
        let before = self.known.updates(property);
        self.send(what, property, values)?;
        self.next_state(what, property, before, false)
    }

    /// Sends new values, and waits until they are set.
    pub fn set(&mut self, what: &str, property: &str, values: &[New<'_>]) -> DeviceResult<()> {
        self.catch_up(what)?;
        let before = self.known.updates(property);
        self.send(what, property, values)?;
        self.next_state(what, property, before, true).map(drop)
    }

    /// Switches one element of a property on, if it is not on.
    pub fn choose(&mut self, what: &str, property: &str, element: &str) -> DeviceResult<()> {
        if self.known.switch(property, element) != Some(true) {
            self.set(what, property, &[New::Switch(element, true)])?;
        }
        match self.known.switch(property, element) {
            Some(true) => Ok(()),
            _ => Err(self
                .error(what, format!("{property} {element}"), self.complaint("another choice"))
                .remedy("see the device in a client of INDI, or correct its settings")
                .class(Class::Setup)),
        }
    }

    /// Reads a property from the device.
    pub fn read(&mut self, what: &str, property: &str) -> DeviceResult<State> {
        self.catch_up(what)?;
        let before = self.known.updates(property);
        self.refresh(what, Some(property))?;
        self.next_state(what, property, before, false)
    }
}
