//! Bulk transfers, over libusb or over the socket of an emulated device (see [`crate::socket_transport`]).

use super::{DEVICE, NAME, PRODUCT, VENDOR};
use crate::discovery::{Access, Root, Usb, check, usb_devices};
use crate::hid;
use crate::socket_transport::{self, SocketTransport, Transfer};
use crate::{Class, DeviceError, DeviceResult};
use rusb::UsbContext;
use std::io;
use std::path::Path;
use std::time::Duration;

/// Time limit of a transfer.
const SILENCE: Duration = Duration::from_millis(500);

const INTERFACE: u8 = 0;
const OUT: u8 = 0x01;
const IN: u8 = 0x81;

/// A device with one bulk endpoint per direction.
pub trait Bulk: Send {
    /// Sends bytes.
    ///
    /// # Errors
    /// `Lost` if the device is gone or silent, `Retry` if it refuses.
    fn send(&mut self, bytes: &[u8]) -> DeviceResult<()>;

    /// Receives the bytes of one transfer; returns their number.
    ///
    /// # Errors
    /// As [`Bulk::send`].
    fn receive(&mut self, bytes: &mut [u8]) -> DeviceResult<usize>;
}

/// Opens the device at a socket.
pub(super) fn socket(path: &str) -> DeviceResult<Box<dyn Bulk>> {
    let wrong = |got: String| DeviceError::new(DEVICE, format!("open {path}"), "a device", got).class(Class::Setup);
    let socket = path.strip_prefix(socket_transport::PREFIX).ok_or_else(|| {
        wrong("no socket".into()).remedy("give `serial` for a device on USB, `path = \"unix:…\"` for an emulated one")
    })?;
    let opened = SocketTransport::open(Path::new(socket));
    let remedy = "start the emulated device that this path belongs to";
    opened.map(|transport| Box::new(Socket(transport)) as _).map_err(|e| wrong(e.to_string()).remedy(remedy))
}

/// Opens the USB device; also returns its identity.
pub(super) fn usb(root: &Root, serial: Option<&str>) -> DeviceResult<(Box<dyn Bulk>, String)> {
    let mut found = usb_devices(root);
    found.retain(|usb| (usb.vendor, usb.product) == (VENDOR, PRODUCT));
    // The IDs are free for experiments, so only the name identifies the device.
    found.retain(|usb| usb.name.as_deref() == Some(NAME));
    found.retain(|usb| serial.is_none() || usb.serial.as_deref() == serial);
    let named = |usb: &Usb| format!("serial = \"{}\"", usb.serial.as_deref().unwrap_or("none"));
    let usb = hid::only(DEVICE, found, named)?;
    let node = usb.node(root);
    let cannot = |got: String| {
        let command = format!("open {}", node.display());
        DeviceError::new(DEVICE, command, "a device that may be opened", got).class(Class::Setup)
    };
    if let Access::Denied { remedy } | Access::NoNode { remedy } = check(root, &node) {
        return Err(cannot("no permission".into()).remedy(remedy));
    }
    let remedy = "end other programs that use it, or unplug it and plug it in again";
    let handle = open(&usb).map_err(|e| cannot(e.to_string()).remedy(remedy))?;
    Ok((Box::new(Libusb(handle)), usb.identity()))
}

/// If libusb does not work at all, no device is found either.
fn open(usb: &Usb) -> rusb::Result<rusb::DeviceHandle<rusb::Context>> {
    let context = rusb::Context::new().map_err(|_| rusb::Error::NoDevice)?;
    let devices = context.devices()?;
    let is_it = |d: &rusb::Device<_>| (u16::from(d.bus_number()), u16::from(d.address())) == (usb.bus, usb.address);
    let device = devices.iter().find(is_it).ok_or(rusb::Error::NoDevice)?;
    let handle = device.open()?;
    // Not all systems support this; a failure shows when claiming the interface.
    let _ = handle.set_auto_detach_kernel_driver(true);
    handle.claim_interface(INTERFACE)?;
    Ok(handle)
}

struct Libusb(rusb::DeviceHandle<rusb::Context>);

fn failed(command: &str, error: rusb::Error) -> DeviceError {
    let kind = match error {
        rusb::Error::Timeout => io::ErrorKind::TimedOut,
        rusb::Error::Pipe => io::ErrorKind::InvalidInput,
        _ => io::ErrorKind::Other,
    };
    socket_transport::failed(DEVICE, command, &io::Error::new(kind, error))
}

impl Bulk for Libusb {
    fn send(&mut self, bytes: &[u8]) -> DeviceResult<()> {
        let sent = self.0.write_bulk(OUT, bytes, SILENCE).map_err(|e| failed("take bytes", e))?;
        if sent == bytes.len() { Ok(()) } else { Err(failed("take bytes", rusb::Error::Timeout)) }
    }

    fn receive(&mut self, bytes: &mut [u8]) -> DeviceResult<usize> {
        self.0.read_bulk(IN, bytes, SILENCE).map_err(|e| failed("answer", e))
    }
}

struct Socket(SocketTransport);

impl Bulk for Socket {
    fn send(&mut self, bytes: &[u8]) -> DeviceResult<()> {
        self.0
            .transfer(Transfer::BulkOut, bytes)
            .map(drop)
            .map_err(|e| socket_transport::failed(DEVICE, "take bytes", &e))
    }

    fn receive(&mut self, bytes: &mut [u8]) -> DeviceResult<usize> {
        let wanted = u16::try_from(bytes.len().min(socket_transport::MAX_PAYLOAD)).unwrap_or(u16::MAX).to_le_bytes();
        let got =
            self.0.transfer(Transfer::BulkIn, &wanted).map_err(|e| socket_transport::failed(DEVICE, "answer", &e))?;
        let length = got.len().min(bytes.len());
        bytes[..length].copy_from_slice(&got[..length]);
        Ok(length)
    }
}
