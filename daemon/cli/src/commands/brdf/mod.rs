//! `nacre brdf`.

mod check;
mod common;
mod gems;
mod heights;
mod map;
mod orders;
mod slice;
mod surface;
mod tables;
mod terms;

use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// BRDF products of a surface.
#[derive(Subcommand)]
pub enum Brdf {
    /// Compute colours over all viewing directions for one direction of incidence.
    Map(Box<map::Map>),
    /// Compute spectra along a half circle of viewing directions.
    Slice(Box<slice::Slice>),
    /// Compute colours with the GPU Gems diffraction shader, from the period alone, for comparison.
    Gems(gems::Gems),
    /// Compute the light in each diffraction order of a grating from its cross-section.
    Orders(orders::Orders),
    /// Compare peaks of the first order with the grating equation.
    Check(Box<check::Check>),
    /// Write Fourier terms of a height field for real-time rendering.
    Terms(Box<terms::Terms>),
    /// Write the BRDF over pairs of directions, for Mitsuba and other renderers.
    Tables(Box<tables::Tables>),
    /// Convert a height field of any supported format to an EXR map.
    Heights(Box<heights::Heights>),
    /// Generate a height field from a formula.
    Surface(surface::Surface),
}

/// Runs the selected command.
pub fn run(command: &Brdf, console: &Console) -> Result<(), Failure> {
    match command {
        Brdf::Map(args) => args.run(console),
        Brdf::Slice(args) => args.run(console),
        Brdf::Gems(args) => args.run(console),
        Brdf::Orders(args) => args.run(console),
        Brdf::Check(args) => args.run(console),
        Brdf::Terms(args) => args.run(console),
        Brdf::Tables(args) => args.run(console),
        Brdf::Heights(args) => args.run(console),
        Brdf::Surface(args) => args.run(console),
    }
}
