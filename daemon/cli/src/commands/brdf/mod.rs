//! `nacre brdf`.

mod check;
mod common;
mod gems;
mod heights;
mod map;
mod orders;
mod slice;
mod surface;
mod terms;

use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// What to compute of a surface's diffraction.
#[derive(Subcommand)]
pub enum Brdf {
    /// Colours over all directions of view, for one direction of light.
    Map(Box<map::Map>),
    /// Spectra along a half circle of directions of view.
    Slice(Box<slice::Slice>),
    /// Colours by the shader of GPU Gems, from a period alone, for comparison.
    Gems(gems::Gems),
    /// Light in each order of a grating, from its cross-section.
    Orders(orders::Orders),
    /// Peaks of the first order against the grating equation.
    Check(Box<check::Check>),
    /// Transforms of a height field for all directions, for programs that draw in real time.
    Terms(Box<terms::Terms>),
    /// Read a height field of any format and write it as EXR map.
    Heights(Box<heights::Heights>),
    /// Make a height field from a formula.
    Surface(surface::Surface),
}

/// Runs it.
pub fn run(command: &Brdf, console: &Console) -> Result<(), Failure> {
    match command {
        Brdf::Map(args) => args.run(console),
        Brdf::Slice(args) => args.run(console),
        Brdf::Gems(args) => args.run(console),
        Brdf::Orders(args) => args.run(console),
        Brdf::Check(args) => args.run(console),
        Brdf::Terms(args) => args.run(console),
        Brdf::Heights(args) => args.run(console),
        Brdf::Surface(args) => args.run(console),
    }
}
