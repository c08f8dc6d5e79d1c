//! Devices of ASCOM Alpaca servers, over HTTP and JSON: rotators, cameras and switches of many makers.
//!
//! Each request has its own connection. The driver connects the device, but does not disconnect it: other programs may
//! use it, and its cooler stays on.

pub mod camera;
pub mod client;
pub mod discovery;
pub mod http;
pub mod image_bytes;
pub mod rotator;
pub mod switch;

/// Port of most servers.
pub const PORT: u16 = 11111;
