//! Devices of INDI servers: rotators, cameras, light boxes and switches, as properties in a stream of XML.
//!
//! The driver connects the device in the server, but does not disconnect it: other programs may use it.

pub mod camera;
pub mod client;
pub mod discovery;
pub mod fits;
pub mod lamp;
pub mod property;
pub mod rotator;
pub mod xml;

/// Port of most servers.
pub const PORT: u16 = 7624;
