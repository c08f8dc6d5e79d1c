#![doc = include_str!("../README.md")]

pub mod calendar;
pub mod contained;
pub mod error;
pub mod estimate;
pub mod fields;
mod folder;
pub mod guard;
pub mod input;
pub mod least_squares;
pub mod memory;
pub mod numeric;
pub mod operation;
pub mod parallel;
pub mod progress;
pub mod random;
pub mod statistics;
pub mod temporary;
pub mod text;
pub mod vector_atan;
pub mod vectors;
mod version;
mod whole;

pub use error::{Error, Result};
pub use folder::{OutputFolder, sweep_unfinished};
pub use version::Version;
pub use whole::{json, rewrite, vacant, writable, write_whole, write_whole_with};
