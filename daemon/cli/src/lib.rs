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

/// The command line of this process.
#[derive(Parser)]
#[command(
    name = "nacre",
    version,
    about = "Measures how surfaces diffract light: capture, reconstruction and simulation in one program",
    after_help = "\
Examples:
  nacre demo                                            a simulated session, judged
  nacre import photos/ --out series                     describe your photographs
  nacre reconstruct polarization series --out result    orientation map from photographs
  nacre sim render --sample cd --out session            simulated photographs only
  nacre chart all --out charts                          how fast, how exact, where it breaks

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
    /// Run the service: REST, events and the page.
    Serve(commands::serve::Args),
    /// Find the devices and write a configuration.
    Init(commands::init::Args),
    /// Make a token for the service.
    Token(commands::serve::Token),
    /// What devices there are, and who uses them.
    Devices(commands::devices::Args),
    /// Whether this machine is fit for a bench, and what to do if not.
    Doctor(commands::doctor::Args),
    /// Move the analyser by hand.
    #[command(subcommand)]
    Stage(commands::manual::Stage),
    /// Take one picture.
    Snap(commands::manual::Snap),
    /// Switch the flash.
    #[command(subcommand)]
    Flash(commands::manual::FlashCommand),
    /// Show a pattern on the panel until Ctrl-C.
    Show(commands::manual::Show),
    /// Check plans and estimate what they need.
    #[command(subcommand)]
    Plan(commands::plan::PlanCommand),
    /// Verify a session folder.
    Check(commands::check::Args),
    /// Keep the undamaged lines of a session's damaged journal.
    Salvage(commands::salvage::Args),
    /// Find and list session folders.
    Catalogue(commands::catalogue::Args),
    /// Turn photographs into maps.
    #[command(subcommand)]
    Reconstruct(commands::reconstruct::Reconstruct),
    /// From the shape of a surface to the light that it diffracts.
    #[command(subcommand)]
    Brdf(commands::brdf::Brdf),
    /// Render a scene: measured and invented surfaces under any light.
    Render(commands::render::Args),
    /// Factor a lookup table into separable terms for environment lighting.
    Factor(Whole<nacre_render::environment::factor::Options>),
    /// Edit maps of orientation and period, and exchange them.
    #[command(subcommand)]
    Map(commands::map::MapCommand),
    /// Draw maps of new foil from a measured distribution of random dots.
    Synthesize(Whole<nacre_lut::foil::SynthesizeOptions>),
    /// Measure where camera, sample, panel and light are.
    #[command(subcommand)]
    Calibrate(commands::calibrate::Calibrate),
    /// Say which method suits a sample, from one photograph of it.
    Recommend(commands::recommend::Recommend),
    /// Chart speed against accuracy, and where each method breaks.
    Chart(commands::chart::Args),
    /// Describe photographs taken elsewhere in a frames.json.
    Import(commands::import::Args),
    /// The simulated bench.
    #[command(subcommand)]
    Sim(commands::sim::Sim),
    /// Print the JSON Schema of a file format.
    Schema(commands::schema::Args),
    /// Print what makes a shell complete commands, options and their values.
    Completions(commands::shell::Completions),
    /// Write manual pages, one for each command.
    Man(commands::shell::Man),
    /// Hold a flash and see to it that it goes off; started by other commands.
    #[command(hide = true)]
    Guardian(commands::manual::Guardian),
    /// Do a computation that another process of this program asks for on standard input.
    #[command(hide = true, name = nacre_base::contained::COMMAND)]
    Job,
}

/// Arguments that name what a command writes, or reads and goes on with.
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

/// Whether the command has the option `--estimate` ([`commands::Estimating`]), and it was given.
fn only_estimate(matches: &ArgMatches) -> bool {
    let given = |matches: &ArgMatches| matches!(matches.try_get_one::<bool>("estimate"), Ok(Some(true)));
    given(matches) || matches.subcommand().is_some_and(|(_, inner)| only_estimate(inner))
}

/// Features of this build that change what it can do.
fn features() -> String {
    let all = [("v4l2", cfg!(feature = "v4l2")), ("gpu", cfg!(feature = "gpu")), ("raw", cfg!(feature = "raw"))];
    let built: Vec<&str> = all.iter().filter(|(_, built)| *built).map(|(name, _)| *name).collect();
    if built.is_empty() { "none".into() } else { built.join(", ") }
}

/// The command line, which says what it was built from.
fn command(commit: &str, target: &str) -> clap::Command {
    let version = env!("CARGO_PKG_VERSION");
    Cli::command().long_version(format!("{version}\ncommit    {commit}\nfeatures  {}\ntarget    {target}", features()))
}

/// Ends the process with clap's message about the command line (help, version or an error). With `--json` an error is printed as JSON too.
fn refused(error: &clap::Error) -> ! {
    if error.use_stderr() && std::env::args_os().any(|argument| argument == "--json") {
        console::print_problem(&Problem::bad(error.render().to_string().trim_end()), 2);
    }
    error.exit()
}

/// Runs the command line of this process, which was built from this commit for this target.
pub fn main(commit: &str, target: &str) -> ExitCode {
    let mut command = command(commit, target);
    // In place, so that it has the arguments that are made when they are needed.
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
        Command::Map(args) => commands::map::run(&args, &console),
        Command::Synthesize(args) => args.run(&console),
        Command::Calibrate(args) => commands::calibrate::run(&args, &console),
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
