//! Emulators that speak the bytes of real devices, so that drivers are tested down to the wire. They act on the simulated bench
//! through its [`Port`](crate::Port), and share no encoding or decoding with the drivers: both are written from the protocols.

mod fault;

pub use fault::{ByteFault, ByteFaultKind, Strikes};
