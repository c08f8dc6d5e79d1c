//! One file per command.

pub mod bench;
pub mod capture;
pub mod catalogue;
pub mod chart;
pub mod check;
pub mod demo;
pub mod devices;
pub mod import;
pub mod init;
pub mod manual;
pub mod plan;
pub mod reconstruct;
pub mod schema;
pub mod serve;
pub mod sim;
