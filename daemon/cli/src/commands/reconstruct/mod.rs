//! `nacre reconstruct`.

mod bokeh;
mod flash;
mod polarization;

pub use polarization::Polarization;

use super::derived::Derived;
use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// What to reconstruct.
#[derive(Subcommand)]
pub enum Reconstruct {
    /// Orientation of gratings from photographs behind a turning analyser, or from a polarization sensor.
    Polarization(Polarization),
    /// Height and lines of a grating from a photograph of an out-of-focus highlight on it.
    Bokeh(Box<bokeh::Bokeh>),
    /// Orientation and absolute period of gratings on a sheet of repeated tiles, from photographs under a flash.
    Flash(Box<flash::Flash>),
    #[command(flatten)]
    Derived(Derived),
}

/// Runs a reconstruction.
pub fn run(command: &Reconstruct, console: &Console) -> Result<(), Failure> {
    match command {
        Reconstruct::Polarization(args) => args.run(console),
        Reconstruct::Bokeh(args) => args.run(console),
        Reconstruct::Flash(args) => args.run(console),
        Reconstruct::Derived(args) => args.run(console),
    }
}
