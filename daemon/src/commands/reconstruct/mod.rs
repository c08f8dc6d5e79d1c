//! `nacre reconstruct`.

mod polarization;

pub use polarization::{Polarization, summary};

use crate::Failure;
use crate::console::Console;
use clap::Subcommand;

/// What to reconstruct.
#[derive(Subcommand)]
pub enum Reconstruct {
    /// Orientation of gratings from photographs behind a turning analyser, or from a polarization sensor.
    Polarization(Polarization),
}

/// Runs a reconstruction.
pub fn run(command: &Reconstruct, console: &Console) -> Result<(), Failure> {
    match command {
        Reconstruct::Polarization(args) => args.run(console),
    }
}
