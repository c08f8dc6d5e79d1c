//! Emulators that speak the bytes of real devices, so that drivers are tested down to the wire. They act on the simulated bench
//! through its [`Port`](crate::Port), and share no encoding or decoding with the drivers: both are written from the protocols.

mod blink1;
mod bulk;
mod fault;
mod lamp;
mod relay;
mod reports;

pub use blink1::Blink1Emulator;
pub use bulk::BulkEmulator;
pub use fault::{ByteFault, ByteFaultKind, Strikes};
pub use relay::RelayEmulator;
pub use reports::{Outcome, Peripheral, Served, Transfer};
