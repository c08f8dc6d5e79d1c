//! The program `nacre`: its command line, and what each command does.

pub mod catalogue;
pub mod commands;
pub mod console;
pub mod engine;
pub mod plan;
pub mod session;

use clap::{Parser, Subcommand};
use console::Console;
use nacre_processing::Error;
use std::process::ExitCode;

/// Measures how surfaces diffract light: orientation maps of holographic surfaces from polarization photographs, on a
/// real or a simulated bench.
#[derive(Parser)]
#[command(
    version,
    about,
    after_help = "\
Examples:
  nacre demo                                            a simulated session, judged
  nacre import photos/ --out series                     describe your photographs
  nacre reconstruct polarization series --out result    orientation map from photographs
  nacre sim render --sample cd --out session            simulated photographs only

Exit codes: 0 done; 1 failed (disk, device, a missed bound); 2 bad usage or bad input;
130 interrupted."
)]
struct Cli {
    /// Print the result as JSON on standard output; everything else goes to standard error.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a polarization session, reconstruct it and compare with the truth.
    Demo(commands::demo::Args),
    /// Take a session's frames as a plan says.
    Capture(commands::capture::Args),
    /// Check plans and estimate what they need.
    #[command(subcommand)]
    Plan(commands::plan::PlanCommand),
    /// Verify a session folder.
    Check(commands::check::Args),
    /// Find and list session folders.
    Catalogue(commands::catalogue::Args),
    /// Turn photographs into maps.
    #[command(subcommand)]
    Reconstruct(commands::reconstruct::Reconstruct),
    /// Describe photographs taken elsewhere in a frames.json.
    Import(commands::import::Args),
    /// The simulated bench.
    #[command(subcommand)]
    Sim(commands::sim::Sim),
    /// Print the JSON Schema of a file format.
    Schema(commands::schema::Args),
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let console = Console::new(cli.json);
    let result = match cli.command {
        Command::Demo(args) => commands::demo::run(&args, &console),
        Command::Capture(args) => commands::capture::run(&args, &console),
        Command::Plan(args) => commands::plan::run(&args, &console),
        Command::Check(args) => commands::check::run(&args, &console),
        Command::Catalogue(args) => commands::catalogue::run(&args, &console),
        Command::Reconstruct(args) => commands::reconstruct::run(&args, &console),
        Command::Import(args) => commands::import::run(&args, &console),
        Command::Sim(args) => commands::sim::run(&args, &console),
        Command::Schema(args) => commands::schema::run(&args, &console),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            console.error(&failure);
            ExitCode::from(failure.exit_code())
        }
    }
}

/// Why a command did not succeed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Something in the computation, its input or its output.
    #[error(transparent)]
    Processing(#[from] Error),
    /// A device.
    #[error(transparent)]
    Device(Box<nacre_drivers::DeviceError>),
    /// Everything ran, but the result misses its stated bound.
    #[error("{0}")]
    Bound(String),
}

impl From<nacre_drivers::DeviceError> for Failure {
    fn from(error: nacre_drivers::DeviceError) -> Self {
        Self::Device(Box::new(error))
    }
}

impl Failure {
    /// The exit code of the contract.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Processing(Error::Input { .. }) => 2,
            Self::Processing(Error::Cancelled) => 130,
            Self::Processing(Error::Output { .. }) | Self::Device(_) | Self::Bound(_) => 1,
        }
    }
}
