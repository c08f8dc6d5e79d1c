//! Emulators of real devices at byte level, which test drivers down to the wire.
//!
//! They act on the simulated bench through its [`Port`](crate::Port). They share no encoding or decoding with the
//! drivers: both were written from the protocols.

mod axis;
mod blink1;
mod bulk;
pub mod elliptec;
mod fault;
pub mod grbl;
mod interlock;
mod lamp;
mod pty;
mod relay;
mod reports;
mod response_queue;

pub use blink1::Blink1Emulator;
pub use bulk::BulkEmulator;
pub use fault::{ByteFault, ByteFaultKind, Strikes};
pub use interlock::InterlockEmulator;
pub use pty::Pty;
pub use relay::RelayEmulator;
pub use reports::{Outcome, Peripheral, Served, Transfer};

/// A device at the other end of a serial line.
pub trait Emulator: Send {
    /// Receives bytes from the host.
    fn receive(&mut self, bytes: &[u8]) -> Vec<Action>;
    /// Called every few milliseconds.
    fn tick(&mut self) -> Vec<Action>;
}

/// An action of an emulated device on its line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Sends bytes to the host.
    Send(Vec<u8>),
    /// Interrupts the line for a moment.
    Close,
}
