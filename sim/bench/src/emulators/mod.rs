//! Emulators that speak the bytes of real devices, so that drivers are tested down to the wire. They act on the simulated bench
//! through its [`Port`](crate::Port), and share no encoding or decoding with the drivers: both are written from the protocols.

mod axis;
mod blink1;
mod bulk;
pub mod elliptec;
mod fault;
pub mod grbl;
mod lamp;
mod pty;
mod relay;
mod reports;
mod response_queue;

pub use blink1::Blink1Emulator;
pub use bulk::BulkEmulator;
pub use fault::{ByteFault, ByteFaultKind, Strikes};
pub use pty::Pty;
pub use relay::RelayEmulator;
pub use reports::{Outcome, Peripheral, Served, Transfer};

/// A device on the other end of a serial line.
pub trait Emulator: Send {
    /// Takes bytes from the host.
    fn receive(&mut self, bytes: &[u8]) -> Vec<Action>;
    /// Called every few milliseconds.
    fn tick(&mut self) -> Vec<Action>;
}

/// What an emulated device does with its line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Sends bytes to the host.
    Send(Vec<u8>),
    /// The line is cut for a moment.
    Close,
}
