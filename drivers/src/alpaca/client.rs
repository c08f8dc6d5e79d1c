//! Requests to one device of an Alpaca server.

use super::http::{Answer, Failure, Request, encoded, exchange};
use super::{PORT, image_bytes};
use crate::net::host_and_port;
use crate::{Class, DeviceError, DeviceResult};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::time::{Duration, Instant};

/// Largest answer with a value, in bytes.
const MOST: usize = 64 * 1024;
/// Largest list of devices, in bytes.
const MOST_LISTED: usize = 1024 * 1024;
/// Longest text of a server in a message.
const MAX_TEXT: usize = 300;
/// Maximum time for a device to connect to its hardware, in answers. The guardian of a flash waits 6 s for it.
const CONNECTING: u32 = 5;
/// Interval of queries during that time.
const POLL: Duration = Duration::from_millis(100);

/// Type of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A rotator.
    Rotator,
    /// A camera.
    Camera,
    /// A set of switches.
    Switch,
}

impl Role {
    /// Name in paths of the interface.
    pub fn word(self) -> &'static str {
        match self {
            Self::Rotator => "rotator",
            Self::Camera => "camera",
            Self::Switch => "switch",
        }
    }
}

/// A device of a server's list.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct Listed {
    /// Name for people.
    #[serde(default)]
    pub device_name: String,
    /// Type, such as `Rotator`.
    pub device_type: String,
    /// Number among the devices of this type.
    pub device_number: u32,
    /// Identifier that no other device has.
    #[serde(default, rename = "UniqueID")]
    pub unique_id: String,
}

/// Fields of every answer.
#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Reply<T> {
    #[serde(default = "none")]
    value: Option<T>,
    #[serde(default)]
    error_number: i32,
    #[serde(default)]
    error_message: String,
}

fn none<T>() -> Option<T> {
    None
}

/// Reason of a failed request.
#[derive(Debug)]
pub(crate) enum Fault {
    /// No complete answer.
    Http(Failure),
    /// An answer without the value.
    Nonsense(String),
    /// Status of the server other than 200.
    Status(u16, String),
    /// Error of the device.
    Refused(i32, String),
}

/// Error number of a property or method that a device lacks.
const NOT_IMPLEMENTED: i32 = 0x400;
const INVALID_VALUE: i32 = 0x401;
const VALUE_NOT_SET: i32 = 0x402;
const NOT_CONNECTED: i32 = 0x407;
const INVALID_OPERATION: i32 = 0x40B;
const NO_SUCH_ACTION: i32 = 0x40C;

/// One device of a server.
pub struct Device {
    address: String,
    host: String,
    port: u16,
    role: Role,
    number: u32,
    id: String,
    limit: Duration,
    transaction: u32,
}

impl Device {
    /// Connects a device.
    ///
    /// # Errors
    /// `Setup` if the server or the device cannot be reached.
    pub fn open(address: &str, role: Role, number: u32, limit: Duration) -> DeviceResult<Self> {
        let (host, port) = host_and_port(address, PORT).map_err(|wrong| misconfigured(role, wrong))?;
        let id = format!("alpaca {} {number} at {address}", role.word());
        let (address, host) = (address.to_owned(), host.to_owned());
        let mut device = Self { address, host, port, role, number, id, limit, transaction: 0 };
        device.connect().map_err(|e| e.class(Class::Setup))?;
        Ok(device)
    }

    fn connect(&mut self) -> DeviceResult<()> {
        // Also shows whether the server answers at all. Older servers have no list.
        let listed = match self.list() {
            Ok(listed) => listed,
            Err(fault @ Fault::Http(_)) => return Err(self.error("open", "an Alpaca server", &fault)),
            Err(_) => vec![],
        };
        let number = self.number;
        self.put("connected", "connect", &[("Connected", "True")])?;
        let begun = Instant::now();
        while !self.get::<bool>("connected", "connect")? {
            if begun.elapsed() > CONNECTING * self.limit {
                let got = format!("none after {:.1} s", begun.elapsed().as_secs_f64());
                return Err(DeviceError::new(&self.id, "connect", "a connected device", got)
                    .remedy("check the device's power and cable, and its settings in the server"));
            }
            std::thread::sleep(POLL);
        }
        let mine = |d: &&Listed| d.device_type.eq_ignore_ascii_case(self.role.word()) && d.device_number == number;
        let (name, unique_id) = match listed.iter().find(mine) {
            Some(listed) => (listed.device_name.clone(), Some(listed.unique_id.clone())),
            None => (self.get::<String>("name", "report its name")?, None),
        };
        self.id = match unique_id.filter(|id| !id.is_empty()) {
            Some(unique_id) => format!("alpaca {} id {}", short(&name), short(&unique_id)),
            None => format!("alpaca {} at {} {} {number}", short(&name), self.address, self.role.word()),
        };
        Ok(())
    }

    /// Stable identity.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Devices of the server.
    fn list(&mut self) -> Result<Vec<Listed>, Fault> {
        let ids = self.ids();
        list(&self.host, self.port, &ids, self.limit)
    }

    /// Identifiers of this client and request.
    fn ids(&mut self) -> String {
        self.transaction = self.transaction.wrapping_add(1);
        format!("ClientID={}&ClientTransactionID={}", std::process::id() & 0xffff, self.transaction)
    }

    fn target(&self, member: &str) -> String {
        format!("/api/v1/{}/{}/{member}", self.role.word(), self.number)
    }

    /// Reads a property.
    ///
    /// # Errors
    /// As the device; `what` is the command in the message.
    pub fn get<T: DeserializeOwned>(&mut self, property: &str, what: &str) -> DeviceResult<T> {
        self.get_of(property, what, &[])
    }

    /// Reads a property with parameters.
    ///
    /// # Errors
    /// As the device.
    pub fn get_of<T: DeserializeOwned>(
        &mut self,
        property: &str,
        what: &str,
        parameters: &[(&str, &str)],
    ) -> DeviceResult<T> {
        self.try_get(property, parameters).map_err(|fault| self.error(what, property, &fault))
    }

    /// Reads a property; `None` if the device lacks it.
    ///
    /// # Errors
    /// As the device.
    pub fn get_optional<T: DeserializeOwned>(&mut self, property: &str, what: &str) -> DeviceResult<Option<T>> {
        match self.try_get(property, &[]) {
            Ok(value) => Ok(Some(value)),
            Err(
                Fault::Refused(NOT_IMPLEMENTED | INVALID_OPERATION | VALUE_NOT_SET, _) | Fault::Status(400 | 404, _),
            ) => Ok(None),
            Err(fault) => Err(self.error(what, property, &fault)),
        }
    }

    fn try_get<T: DeserializeOwned>(&mut self, property: &str, parameters: &[(&str, &str)]) -> Result<T, Fault> {
        let ids = self.ids();
        let target = format!("{}?{}{ids}", self.target(property), joined(parameters));
        let answer = self.send(&target, None, "application/json", MOST).map_err(Fault::Http)?;
        read_reply(&answer)?.ok_or_else(|| Fault::Nonsense("an answer without a value".into()))
    }

    /// Calls a method, or sets a property.
    ///
    /// # Errors
    /// As the device.
    pub fn put(&mut self, method: &str, what: &str, parameters: &[(&str, &str)]) -> DeviceResult<()> {
        let form = format!("{}{}", joined(parameters), self.ids());
        let answer = self.send(&self.target(method), Some(&form), "application/json", MOST).map_err(Fault::Http);
        let done = answer.and_then(|answer| read_reply::<serde::de::IgnoredAny>(&answer));
        done.map(drop).map_err(|fault| self.error(what, "the command to be accepted", &fault))
    }

    /// Fetches the picture of a camera.
    pub(crate) fn image(&mut self, width: usize, height: usize, limit: Duration) -> DeviceResult<image_bytes::Image> {
        const WHAT: &str = "fetch the picture";
        let ids = self.ids();
        let target = format!("{}?{ids}", self.target("imagearray"));
        let request = Request {
            host: &self.host,
            port: self.port,
            target: &target,
            form: None,
            accept: image_bytes::MEDIA_TYPE,
            most: image_bytes::most(width, height),
            limit,
        };
        let answer = exchange(&request).map_err(|e| self.error(WHAT, "a picture", &Fault::Http(e)))?;
        if answer.content_type != image_bytes::MEDIA_TYPE {
            // Errors are sent as JSON.
            let refused = read_reply::<serde::de::IgnoredAny>(&answer).map(|_| Fault::Nonsense("one in JSON".into()));
            let fault = refused.unwrap_or_else(|fault| fault);
            let error = self.error(WHAT, "a picture in the format ImageBytes", &fault);
            return Err(match fault {
                Fault::Nonsense(_) => error.remedy("update the server or the camera's driver").class(Class::Setup),
                _ => error,
            });
        }
        image_bytes::read(&answer.body)
            .map_err(|wrong| self.error(WHAT, "a picture in the format ImageBytes", &Fault::Nonsense(wrong)))
    }

    fn send(&self, target: &str, form: Option<&str>, accept: &str, most: usize) -> Result<Answer, Failure> {
        exchange(&Request { host: &self.host, port: self.port, target, form, accept, most, limit: self.limit })
    }

    /// Error of a request.
    pub(crate) fn error(&self, what: &str, expected: &str, fault: &Fault) -> DeviceError {
        let error = |got: String| DeviceError::new(&self.id, what, expected, got);
        let server = &self.address;
        let reach = format!("check that the server at {server} runs, the network, and the device's power");
        match fault {
            Fault::Http(Failure::Unreachable(e)) => {
                error(format!("no connection to {server} ({e})")).remedy(reach).class(Class::Lost)
            }
            Fault::Http(Failure::Slow(limit)) => {
                error(format!("no answer from {server} within {} ms", limit.as_millis()))
                    .remedy(reach)
                    .class(Class::Lost)
            }
            Fault::Http(Failure::Invalid(e)) | Fault::Nonsense(e) => error(e.clone())
                .remedy(format!("check that {server} is an Alpaca server and fits the device, then try again"))
                .class(Class::Retry),
            Fault::Status(status, text) => error(format!("status {status}: {}", short(text)))
                .remedy(format!("correct the device number: {server} may lack {} {}", self.role.word(), self.number))
                .class(Class::Setup),
            Fault::Refused(number, text) => refused(error(format!("error {number:#X}: {}", short(text))), *number),
        }
    }
}

/// Class and remedy of a device's error number.
fn refused(error: DeviceError, number: i32) -> DeviceError {
    match number {
        NOT_IMPLEMENTED | INVALID_VALUE | VALUE_NOT_SET | NO_SUCH_ACTION => error
            .remedy("the device cannot do this: correct its settings, or choose another device")
            .class(Class::Setup),
        NOT_CONNECTED => error.remedy("check the device's power and cable, then resume the session").class(Class::Lost),
        _ => error.remedy("see the program of the server, then try again").class(Class::Retry),
    }
}

/// Error of an invalid configuration.
pub(crate) fn misconfigured(role: Role, wrong: String) -> DeviceError {
    DeviceError::new(&format!("alpaca {}", role.word()), "open", "a proper configuration", wrong)
        .remedy("correct the settings of the driver in the configuration")
        .class(Class::Setup)
}

/// Devices of a server.
pub(crate) fn list(host: &str, port: u16, ids: &str, limit: Duration) -> Result<Vec<Listed>, Fault> {
    let target = format!("/management/v1/configureddevices?{ids}");
    let request =
        Request { host, port, target: &target, form: None, accept: "application/json", most: MOST_LISTED, limit };
    let answer = exchange(&request).map_err(Fault::Http)?;
    Ok(read_reply(&answer)?.unwrap_or_default())
}

/// Parameters of a form or query, each followed by `&`.
fn joined(parameters: &[(&str, &str)]) -> String {
    parameters.iter().map(|(name, value)| format!("{name}={}&", encoded(value))).collect()
}

/// Value of an answer in JSON.
pub(crate) fn read_reply<T: DeserializeOwned>(answer: &Answer) -> Result<Option<T>, Fault> {
    let text = || String::from_utf8_lossy(answer.body.get(..MAX_TEXT).unwrap_or(&answer.body)).into_owned();
    if answer.status != 200 {
        return Err(Fault::Status(answer.status, text()));
    }
    let reply: Reply<T> =
        serde_json::from_slice(&answer.body).map_err(|e| Fault::Nonsense(format!("an unreadable answer ({e})")))?;
    match reply.error_number {
        0 => Ok(reply.value),
        number => Err(Fault::Refused(number, reply.error_message)),
    }
}

/// Reads the lists of devices and values that a server sends.
///
/// # Errors
/// A description of the defect.
pub fn read_list(body: &[u8]) -> Result<Vec<Listed>, String> {
    let answer = Answer { status: 200, content_type: String::new(), body: body.to_vec() };
    read_reply(&answer).map(Option::unwrap_or_default).map_err(|fault| format!("{fault:?}"))
}

/// A text of a server on one line, of limited length.
pub(crate) fn short(text: &str) -> String {
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(MAX_TEXT).collect();
    clean.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn answer(status: u16, body: &str) -> Answer {
        Answer { status, content_type: "application/json".into(), body: body.as_bytes().to_vec() }
    }

    #[test]
    fn answers_have_a_value_or_an_error() {
        let read = |status, body| read_reply::<f64>(&answer(status, body));
        assert_eq!(
            read(200, r#"{"Value":1.5,"ErrorNumber":0,"ErrorMessage":"","ServerTransactionID":3}"#).unwrap(),
            Some(1.5)
        );
        assert_eq!(read(200, r#"{"ErrorNumber":0}"#).unwrap(), None);
        assert!(matches!(
            read(200, r#"{"Value":0,"ErrorNumber":1024,"ErrorMessage":"no"}"#),
            Err(Fault::Refused(1024, _))
        ));
        assert!(matches!(read(400, "bad"), Err(Fault::Status(400, _))));
        assert!(matches!(read(200, r#"{"Value":"x"}"#), Err(Fault::Nonsense(_))));
        assert!(matches!(read(200, "<html>"), Err(Fault::Nonsense(_))));
        let listed = r#"{"Value":[{"DeviceName":"R","DeviceType":"Rotator","DeviceNumber":0,"UniqueID":"u"}]}"#;
        assert_eq!(read_list(listed.as_bytes()).unwrap()[0].unique_id, "u");
    }

    #[test]
    fn every_fault_has_its_class() {
        let device = Device {
            address: "a".into(),
            host: "a".into(),
            port: 1,
            role: Role::Rotator,
            number: 3,
            id: "r".into(),
            limit: Duration::from_secs(1),
            transaction: 0,
        };
        for (fault, class, word) in [
            (Fault::Http(Failure::Unreachable("refused".into())), Class::Lost, "no connection to a (refused)"),
            (Fault::Http(Failure::Slow(Duration::from_secs(1))), Class::Lost, "within 1000 ms"),
            (Fault::Http(Failure::Invalid("x".into())), Class::Retry, "x"),
            (Fault::Status(404, "no\r\nsuch".into()), Class::Setup, "status 404: no such"),
            (Fault::Refused(NOT_CONNECTED, String::new()), Class::Lost, "0x407"),
            (Fault::Refused(INVALID_VALUE, "v".into()), Class::Setup, "0x401: v"),
            (Fault::Refused(0x500, "motor".into()), Class::Retry, "motor"),
        ] {
            let error = device.error("x", "y", &fault);
            assert!(error.class == class && error.got.contains(word), "{error}");
        }
    }

    proptest! {
        #[test]
        fn any_body_is_read_or_refused(body: Vec<u8>, text in r#"\{"Value":.{0,20}\}"#) {
            let _ = read_list(&body);
            let _ = read_list(text.as_bytes());
            let _ = read_reply::<bool>(&answer(200, &text));
        }
    }
}
