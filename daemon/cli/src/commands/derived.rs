//! Commands derived from the registry of operations: arguments, help and values follow from an operation's options.

use super::flags::{arguments, flagged, given};
use crate::console::Console;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches, Subcommand};
use nacre_base::fields::{EXAMPLES, INPUT};
use nacre_base::operation::{Entry, Operation, Registered};
use nacre_capture::Failure;
use nacre_processing::operations::{OPERATIONS, operation};
use std::marker::PhantomData;
use std::path::PathBuf;

/// Operations whose command is not a subcommand of `nacre reconstruct`.
const ELSEWHERE: [&str; 12] = [
    "brdf",
    "map",
    "calibrate",
    "camera",
    "flat",
    "analyser",
    "retarder",
    "orientation",
    "render",
    "factor",
    "synthesize",
    "inspect",
];

/// An operation and its parsed command line.
#[derive(Clone)]
pub struct Derived {
    operation: &'static dyn Registered,
    matches: ArgMatches,
}

fn derived() -> impl Iterator<Item = &'static dyn Registered> {
    OPERATIONS.iter().copied().filter(|o| !ELSEWHERE.contains(&o.name()))
}

impl Subcommand for Derived {
    fn augment_subcommands(command: Command) -> Command {
        command.subcommands(derived().map(command_of))
    }

    fn augment_subcommands_for_update(command: Command) -> Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        derived().any(|o| o.name() == name)
    }
}

impl FromArgMatches for Derived {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let found = matches.subcommand().and_then(|(name, inner)| Some((operation(name)?, inner)));
        let (operation, matches) = found.ok_or_else(|| clap::Error::new(clap::error::ErrorKind::InvalidSubcommand))?;
        Ok(Self { operation, matches: matches.clone() })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The command of an operation. Its arguments are built on demand, because the schemas of all operations would dominate
/// the program's start time.
fn command_of(operation: &dyn Registered) -> Command {
    Command::new(operation.name()).about(operation.title()).defer(with_arguments)
}

fn with_arguments(command: Command) -> Command {
    let Some(operation) = operation(command.get_name()) else { return command };
    arguments_of(command, operation)
}

fn arguments_of(command: Command, operation: &dyn Registered) -> Command {
    let fields = operation.fields();
    let path = || clap::value_parser!(PathBuf);
    let flag = |id: &'static str, help: &'static str| Arg::new(id).long(id).action(ArgAction::SetTrue).help(help);
    let input = Arg::new("input").value_name("INPUT").required(true).value_parser(path());
    let out = Arg::new("out").long("out").value_name("DIR").required(true).value_parser(path());
    command
        .after_help(fields.text(EXAMPLES).to_owned())
        .arg(input.help(fields.text(INPUT).to_owned()))
        .arg(out.help("Folder for the results"))
        .args(arguments(&fields))
        .arg(flag("force", "Replace results that are already in the folder").visible_alias("overwrite"))
        .arg(flag("estimate", "Only say how long it would take, and how much memory and disk"))
}

impl Derived {
    /// Runs the operation.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let fields = self.operation.fields();
        let options = given(&fields, &self.matches)?;
        let named = |error| flagged(error, &fields);
        let ready = self.operation.with(&options).map_err(named)?;
        let path = |id: &str| self.matches.get_one::<PathBuf>(id).cloned().unwrap_or_default();
        let (input, out) = (path("input"), path("out"));
        let done = ready.perform(&input, &out, self.matches.get_flag("force"), console).map_err(named)?;
        console.result(&format!("{}\nresults   {}", done.summary, out.display()), &done);
        done.missed.map_or(Ok(()), |why| Err(Failure::Bound(why)))
    }
}

/// Complete command of an operation outside of `nacre reconstruct`, such as `nacre map edit`.
pub struct Whole<O> {
    derived: Derived,
    operation: PhantomData<fn() -> O>,
}

impl<O: Operation> Whole<O> {
    const OPERATION: &'static dyn Registered = &Entry::<O>::NEW;

    /// Runs the operation.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        self.derived.run(console)
    }
}

impl<O: Operation> Args for Whole<O> {
    fn augment_args(command: Command) -> Command {
        command.defer(|command| arguments_of(command, Self::OPERATION))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<O: Operation> FromArgMatches for Whole<O> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let derived = Derived { operation: Self::OPERATION, matches: matches.clone() };
        Ok(Self { derived, operation: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
