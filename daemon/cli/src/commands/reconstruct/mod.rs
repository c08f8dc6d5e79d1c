//! `nacre reconstruct`.

use super::derived::Derived;
use crate::console::Console;
use clap::Subcommand;
use nacre_capture::Failure;

/// Operations on photographs.
#[derive(Subcommand)]
pub enum Reconstruct {
    #[command(flatten)]
    Derived(Derived),
}

/// Runs the selected operation.
pub fn run(command: &Reconstruct, console: &Console) -> Result<(), Failure> {
    let Reconstruct::Derived(args) = command;
    args.run(console)
}
