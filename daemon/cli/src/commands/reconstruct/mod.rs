//! `nacre reconstruct`.

mod bokeh;

use super::derived::Derived;
use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// What to reconstruct.
#[derive(Subcommand)]
pub enum Reconstruct {
    #[command(flatten)]
    Derived(Derived),
    /// Height and lines of a grating from a photograph of an out-of-focus highlight on it.
    Bokeh(Box<bokeh::Bokeh>),
}

/// Runs a reconstruction.
pub fn run(command: &Reconstruct, console: &Console) -> Result<(), Failure> {
    match command {
        Reconstruct::Derived(args) => args.run(console),
        Reconstruct::Bokeh(args) => args.run(console),
    }
}
