//! One file per command.

pub mod capture;
pub mod catalogue;
pub mod check;
pub mod demo;
pub mod import;
pub mod plan;
pub mod reconstruct;
pub mod schema;
pub mod sim;
