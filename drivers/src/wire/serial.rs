//! Serial ports: built-in, on USB, and pseudo-terminals.

use super::Wire;
use crate::{Class, DeviceError, DeviceResult};
use serialport::{ClearBuffer, DataBits, ErrorKind, FlowControl, Parity, SerialPort, StopBits, TTYPort};
use std::io::{self, Read, Write};
use std::path::Path;
use std::time::Duration;

/// Time limit for sending, after which the port counts as gone.
const SENDING: Duration = Duration::from_secs(2);

/// A serial port, exclusive to this process: 8 data bits, no parity, 1 stop bit.
pub struct SerialWire(TTYPort);

impl SerialWire {
    /// Opens a port. `device` is the name of the connected device in error messages.
    ///
    /// # Errors
    /// `Setup` if the port is missing, in use, or may not be opened.
    pub fn open(device: &str, path: &Path, baud: u32) -> DeviceResult<Self> {
        let port = serialport::new(path.to_string_lossy(), baud)
            .data_bits(DataBits::Eight)
            .parity(Parity::None)
            .stop_bits(StopBits::One)
            .flow_control(FlowControl::None)
            .timeout(SENDING)
            .exclusive(true);
        let opened = TTYPort::open(&port).and_then(|port| port.clear(ClearBuffer::All).map(|()| Self(port)));
        opened.map_err(|e| refused(device, path, &e))
    }
}

fn refused(device: &str, path: &Path, e: &serialport::Error) -> DeviceError {
    let remedy = match e.kind() {
        ErrorKind::Io(io::ErrorKind::NotFound) => "plug it in, or correct the port in the configuration",
        ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
            "add yourself to the group that owns the port (usually dialout), then log in again"
        }
        ErrorKind::NoDevice => "close the program that uses the port",
        _ => "correct the port in the configuration: it must be a serial port, such as /dev/ttyUSB0",
    };
    DeviceError::new(device, format!("open {}", path.display()), "a free serial port", e.description.as_str())
        .remedy(remedy)
        .class(Class::Setup)
}

impl Wire for SerialWire {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.set_timeout(SENDING)?;
        self.0.write_all(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], limit: Duration) -> io::Result<usize> {
        self.0.set_timeout(limit)?;
        match self.0.read(buffer) {
            // Bytes were announced, but the link is closed.
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Err(e) if matches!(e.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => Ok(0),
            other => other,
        }
    }

    fn clear(&mut self) -> io::Result<()> {
        Ok(self.0.clear(ClearBuffer::Input)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_to_open_have_a_remedy() {
        for (path, word) in [("/dev/there-is-no-such-port", "plug it in"), ("/dev/null", "serial port")] {
            let error = SerialWire::open("stage", Path::new(path), 9600).err().unwrap();
            assert!(error.class == Class::Setup && error.remedy.contains(word), "{error}");
        }
    }

    #[test]
    fn a_port_in_use_is_refused() {
        let (_master, slave) = TTYPort::pair().unwrap();
        let path = slave.name().unwrap();
        drop(slave);
        let first = SerialWire::open("stage", Path::new(&path), 9600).unwrap();
        let error = SerialWire::open("stage", Path::new(&path), 9600).err().unwrap();
        assert!(error.remedy.contains("close the program"), "{error}");
        drop(first);
        SerialWire::open("stage", Path::new(&path), 9600).unwrap();
    }
}
