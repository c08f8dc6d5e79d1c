//! One file per command.

pub mod attach;
pub mod bench;
pub mod capture;
pub mod catalogue;
pub mod chart;
pub mod check;
pub mod demo;
pub mod devices;
pub mod doctor;
pub mod import;
pub mod init;
pub mod manual;
pub mod photograph;
pub mod plan;
pub mod reconstruct;
pub mod schema;
pub mod serve;
pub mod sim;
