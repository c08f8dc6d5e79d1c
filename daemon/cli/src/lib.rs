#![doc = include_str!("../README.md")]

mod commands;
mod console;
mod leaks;

use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};
use commands::derived::Whole;
use console::Console;
use nacre_base::{Error, input};
use nacre_capture::Failure;
use nacre_service::problem::Problem;
use std::ffi::OsString;
use std::process::ExitCode;

/// Command line of this process.
#[derive(Parser)]
#[command(
    name = "nacre",
    version,
    about = "Measures how surfaces diffract light: capture, reconstruction and simulation in one program",
    after_help = "\
Examples:
  nacre demo                                            simulate a session, compare with the truth
  nacre import photos/ --out series                     describe your photographs
  nacre reconstruct polarization series --out result    orientation map from photographs
  nacre sim render --sample cd --out session            simulated photographs only
  nacre chart all --out charts                          speed, accuracy, failure limits

Exit codes: 0 success; 1 failure (disk, device, missed error bound); 2 invalid usage or input;
130 interrupted."
)]
struct Cli {
    /// Print the result as JSON on standard output; all other output goes to standard error.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a polarization session, reconstruct it and compare the result with the truth.
    Demo(commands::demo::Args),
    /// Capture the frames of a session according to a plan.
    Capture(commands::capture::Args),
    /// Run the service: REST interface, events and web page.
    Serve(commands::serve::Args),
    /// Detect the devices and write a configuration.
    Init(commands::init::Args),
    /// Generate an access token for the service.
    Token(commands::serve::Token),
    /// List devices and the processes that use them.
    Devices(commands::devices::Args),
    /// Check that this machine is ready for a bench, and suggest remedies.
    Doctor(commands::doctor::Args),
    /// Control the analyser stage manually.
    #[command(subcommand)]
    Stage(commands::manual::Stage),
    /// Capture one picture.
    Snap(commands::manual::Snap),
    /// Switch the flash.
    #[command(subcommand)]
    Flash(commands::manual::FlashCommand),
    /// Show a pattern on the panel until Ctrl-C.
    Show(commands::manual::Show),
    /// Check plans and estimate their time and disk space.
    #[command(subcommand)]
    Plan(commands::plan::PlanCommand),
    /// Verify a session folder.
    Check(commands::check::Args),
    /// Recover the undamaged lines of a session's damaged journal.
    Salvage(commands::salvage::Args),
    /// Search and list session folders.
    Catalogue(commands::catalogue::Args),
    /// Reconstruct maps from photographs.
    #[command(subcommand)]
    Reconstruct(commands::reconstruct::Reconstruct),
    /// Compute the diffraction of a surface from its height field.
    #[command(subcommand)]
    Brdf(commands::brdf::Brdf),
    /// Render a scene of diffracting surfaces under any lighting.
    Render(commands::render::Args),
    /// Factor a lookup table into separable terms for environment lighting.
    Factor(Whole<nacre_render::environment::factor::Options>),
    /// Edit, compare, import and export maps of orientation and period.
    #[command(subcommand)]
    Map(commands::map::MapCommand),
    /// Synthesize maps of new foil from a measured random-dot distribution.
    Synthesize(Whole<nacre_lut::foil::SynthesizeOptions>),
    /// Inspect sheets against a reference: register, compare and find defects.
    Inspect(Whole<nacre_inspect::Options>),
    /// Calibrate camera, geometry and panel.
    #[command(subcommand)]
    Calibrate(commands::calibrate::Calibrate),
    /// List, show and remove stored calibrations.
    Calibrations(commands::calibrations::Args),
    /// Recommend a reconstruction method from one photograph of the sample.
    Recommend(commands::recommend::Recommend),
    /// Chart speed, accuracy and failure limits of each method.
    Chart(commands::chart::Args),
    /// Describe existing photographs in a frames.json.
    Import(commands::import::Args),
    /// Export maps for other programs, or a session with checksums.
    Export(commands::export::Args),
    /// Run and use the simulated bench.
    #[command(subcommand)]
    Sim(commands::sim::Sim),
    /// Print the JSON Schema of a file format.
    Schema(commands::schema::Args),
    /// Print a shell completion script for commands, options and values.
    Completions(commands::shell::Completions),
    /// Write manual pages, one per command.
    Man(commands::shell::Man),
    /// Hold a flash and guarantee that it is switched off; started by other commands.
    #[command(hide = true)]
    Guardian(commands::manual::Guardian),
    /// Run a computation requested by another process of this program on standard input.
    #[command(hide = true, name = nacre_base::contained::COMMAND)]
    Job,
}

/// Arguments that name outputs, including those that the command reads to resume.
const OUTPUTS: [&str; 4] = ["out", "gallery", "keep", "data"];

/// Values of all other arguments: each may be an input.
fn inputs(command: &clap::Command, matches: &ArgMatches) -> Vec<OsString> {
    if let Some((name, inner)) = matches.subcommand() {
        return command.find_subcommand(name).map_or(vec![], |command| inputs(command, inner));
    }
    let arguments = command.get_arguments().filter(|a| a.get_action().takes_values());
    let ids = arguments.map(|a| a.get_id().as_str()).filter(|id| !OUTPUTS.contains(id));
    ids.flat_map(|id| matches.try_get_raw(id).ok().flatten().into_iter().flatten()).map(OsString::from).collect()
}

/// True if the command has the option `--estimate` ([`commands::Estimating`]) and it was given.
fn only_estimate(matches: &ArgMatches) -> bool {
    let given = |matches: &ArgMatches| matches!(matches.try_get_one::<bool>("estimate"), Ok(Some(true)));
    given(matches) || matches.subcommand().is_some_and(|(_, inner)| only_estimate(inner))
}

/// Features that extend this build.
fn features() -> String {
    let all = [("gpu", cfg!(feature = "gpu")), ("raw", cfg!(feature = "raw"))];
    let built: Vec<&str> = all.iter().filter(|(_, built)| *built).map(|(name, _)| *name).collect();
    if built.is_empty() { "none".into() } else { built.join(", ") }
}

/// The clap command, with the build's version, commit and features.
fn command(commit: &str, target: &str) -> clap::Command {
    let version = env!("CARGO_PKG_VERSION");
    Cli::command().long_version(format!("{version}\ncommit    {commit}\nfeatures  {}\ntarget    {target}", features()))
}

/// Ends the process with clap's message (help, version or an error). With `--json`, an error is printed as JSON too.
fn refused(error: &clap::Error) -> ! {
    if error.use_stderr() && std::env::args_os().any(|argument| argument == "--json") {
        console::print_problem(&Problem::bad(error.render().to_string().trim_end()), 2);
    }
    error.exit()
}

/// Runs the command line of this process, which was built from this commit for this target.
pub fn main(commit: &str, target: &str) -> ExitCode {
    let mut command = command(commit, target);
    // Parsed in place, so that the command keeps the arguments that are built on demand.
    let matches = command.try_get_matches_from_mut(std::env::args_os()).unwrap_or_else(|e| refused(&e));
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|e| refused(&e));
    if let Command::Guardian(args) = &cli.command {
        return commands::manual::guardian(args);
    }
    if !matches!(cli.command, Command::Serve(_)) {
        input::remember(inputs(&command, &matches));
    }
    nacre_base::numeric::flush_subnormals();
    nacre_base::contained::register();
    if let Command::Job = cli.command {
        return commands::job::run();
    }
    let console = Console::new(cli.json, only_estimate(&matches));
    let leaks = leaks::Leaks::watch();
    let result = match cli.command {
        Command::Demo(args) => commands::demo::run(&args, &console),
        Command::Capture(args) => commands::capture::run(&args, &console),
        Command::Serve(args) => commands::serve::run(&args, &console),
        Command::Init(args) => commands::init::run(&args, &console),
        Command::Token(args) => commands::serve::token(&args, &console),
        Command::Devices(args) => commands::devices::run(&args, &console),
        Command::Doctor(args) => commands::doctor::run(&args, &console),
        Command::Stage(args) => commands::manual::stage(&args, &console),
        Command::Snap(args) => commands::manual::snap(&args, &console),
        Command::Flash(args) => commands::manual::flash(&args, &console),
        Command::Show(args) => commands::manual::show(&args, &console),
        Command::Plan(args) => commands::plan::run(&args, &console),
        Command::Check(args) => commands::check::run(&args, &console),
        Command::Salvage(args) => commands::salvage::run(&args, &console),
        Command::Catalogue(args) => commands::catalogue::run(&args, &console),
        Command::Reconstruct(args) => commands::reconstruct::run(&args, &console),
        Command::Brdf(args) => commands::brdf::run(&args, &console),
        Command::Render(args) => commands::render::run(&args, &console),
        Command::Factor(args) => args.run(&console),
        Command::Export(args) => commands::export::run(&args, &console),
        Command::Map(args) => commands::map::run(&args, &console),
        Command::Synthesize(args) => args.run(&console),
        Command::Inspect(args) => args.run(&console),
        Command::Calibrate(args) => commands::calibrate::run(&args, &console),
        Command::Calibrations(args) => commands::calibrations::run(&args, &console),
        Command::Recommend(args) => commands::recommend::run(&args, &console),
        Command::Chart(args) => commands::chart::run(&args, &console),
        Command::Import(args) => commands::import::run(&args, &console),
        Command::Sim(args) => commands::sim::run(&args, &console),
        Command::Schema(args) => commands::schema::run(&args, &console),
        Command::Completions(args) => commands::shell::completions(&args, command),
        Command::Man(args) => commands::shell::man(&args, command, &console),
        Command::Guardian(_) | Command::Job => Ok(()),
    };
    if let Some(found) = leaks.found() {
        console.note(&format!("nacre: left behind: {found}"));
        return ExitCode::from(70);
    }
    match result {
        Err(Failure::Processing(Error::Cancelled)) if console.estimated() => ExitCode::SUCCESS,
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let code = failure.exit_code();
            console.error(failure);
            ExitCode::from(code)
        }
    }
}
