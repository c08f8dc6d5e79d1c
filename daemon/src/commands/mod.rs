//! One file per command.

pub mod demo;
pub mod import;
pub mod reconstruct;
pub mod schema;
pub mod sim;
