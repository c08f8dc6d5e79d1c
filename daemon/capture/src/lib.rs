#![doc = include_str!("../README.md")]

pub mod calibrations;
pub mod engine;
mod failure;
pub mod fields;
pub mod guardian;
pub mod ids;
pub mod import;
pub mod naming;
pub mod page;
pub mod plan;
pub mod rig;
pub mod run;
pub mod session;
pub mod setup;

pub use failure::Failure;
