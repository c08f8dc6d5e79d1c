//! One file per command.

pub mod attach;
pub mod bench;
pub mod brdf;
pub mod calibrate;
pub mod calibrations;
pub mod capture;
mod care;
pub mod catalogue;
pub mod chart;
pub mod check;
pub mod demo;
pub mod derived;
pub mod devices;
pub mod doctor;
pub mod export;
pub mod flags;
pub mod import;
pub mod init;
pub mod job;
pub mod manual;
pub mod map;
pub mod photograph;
pub mod plan;
pub mod recommend;
pub mod reconstruct;
pub mod render;
pub mod salvage;
pub mod schema;
pub mod serve;
pub mod shell;
pub mod sim;
mod values;

use nacre_base::Error;
use nacre_base::text::{from_toml, read_text};
use std::path::Path;

/// Option of commands whose operation predicts its time, memory and disk ([`nacre_base::progress::Progress::expect`]).
#[derive(clap::Args)]
pub struct Estimating {
    /// Only print the predicted time, memory and disk space.
    #[arg(long)]
    estimate: bool,
}

/// Maximum size of a description file.
const MAX_BYTES: u64 = 1 << 20;

/// Reads a small TOML file.
///
/// # Errors
/// `Input` with this remedy for an unreadable or invalid file.
fn toml_file<T: serde::de::DeserializeOwned>(path: &Path, remedy: &str) -> Result<T, Error> {
    let text = read_text(path, MAX_BYTES, remedy)?;
    from_toml(&text).map_err(|problem| Error::file(path, problem, remedy))
}
