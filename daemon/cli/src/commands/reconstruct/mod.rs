//! `nacre reconstruct`.

mod bokeh;
mod flash;
mod foil;
mod hdr;
mod lut;
mod polarization;
mod spots;

pub use polarization::{Polarization, summary};

use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// What to reconstruct.
#[derive(Subcommand)]
pub enum Reconstruct {
    /// Orientation of gratings from photographs behind a turning analyser, or from a polarization sensor.
    Polarization(Polarization),
    /// One photograph of high dynamic range from several exposures.
    Hdr(hdr::Hdr),
    /// A table of a diffraction pattern under any light, from one photograph in narrow-band light.
    Lut(lut::Lut),
    /// Height and lines of a grating from a photograph of an out-of-focus highlight on it.
    Bokeh(Box<bokeh::Bokeh>),
    /// How orientations and periods of a foil's random dots are distributed, from one photograph under a flash.
    Foil(foil::Foil),
    /// Orientation and absolute period of gratings from fringes on the panel.
    Spots(spots::Spots),
    /// Orientation and absolute period of gratings on a sheet of repeated tiles, from photographs under a flash.
    Flash(Box<flash::Flash>),
}

/// Runs a reconstruction.
pub fn run(command: &Reconstruct, console: &Console) -> Result<(), Failure> {
    match command {
        Reconstruct::Polarization(args) => args.run(console),
        Reconstruct::Hdr(args) => args.run(console),
        Reconstruct::Lut(args) => args.run(console),
        Reconstruct::Bokeh(args) => args.run(console),
        Reconstruct::Foil(args) => args.run(console),
        Reconstruct::Spots(args) => args.run(console),
        Reconstruct::Flash(args) => args.run(console),
    }
}
