//! Commands that are derived from the registry: arguments, help and values come from an operation's options.

use crate::console::Console;
use clap::builder::PossibleValuesParser;
use clap::{Arg, ArgAction, ArgMatches, Command, FromArgMatches, Subcommand};
use nacre_base::Error;
use nacre_base::fields::{EXAMPLES, Field, Fields, INPUT};
use nacre_base::operation::{Registered, SCHEMA};
use nacre_base::text::{from_json, from_toml, read_text};
use nacre_capture::Failure;
use nacre_processing::operations::{OPERATIONS, operation};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Operations that have a command written by hand.
const BY_HAND: [&str; 5] = ["bokeh", "brdf", "map", "calibrate", "render"];

/// Largest file that stands for an option.
const MOST_BYTES: u64 = 1 << 20;

/// An operation and its command line.
#[derive(Clone)]
pub struct Derived {
    operation: &'static dyn Registered,
    matches: ArgMatches,
}

fn derived() -> impl Iterator<Item = &'static dyn Registered> {
    OPERATIONS.iter().copied().filter(|o| !BY_HAND.contains(&o.name()))
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

/// The command of an operation. Its arguments are made once it is called: schemas of all operations would be most of the program's start.
fn command_of(operation: &dyn Registered) -> Command {
    Command::new(operation.name()).about(operation.title()).defer(with_arguments)
}

fn with_arguments(command: Command) -> Command {
    let Some(operation) = operation(command.get_name()) else { return command };
    let fields = operation.fields();
    let path = || clap::value_parser!(PathBuf);
    let flag = |id: &'static str, help: &'static str| Arg::new(id).long(id).action(ArgAction::SetTrue).help(help);
    let input = Arg::new("input").value_name("INPUT").required(true).value_parser(path());
    let out = Arg::new("out").long("out").value_name("DIR").required(true).value_parser(path());
    command
        .after_help(fields.text(EXAMPLES).to_owned())
        .arg(input.help(fields.text(INPUT).to_owned()))
        .arg(out.help("Folder for the results"))
        .args(fields.list.iter().map(argument))
        .arg(flag("force", "Replace results that are already in the folder").visible_alias("overwrite"))
        .arg(flag("estimate", "Only say how long it would take, and how much memory and disk"))
}

/// The flag of an option.
fn argument(field: &Field) -> Arg {
    let text = field.text("description").unwrap_or_default();
    let (first, rest) = text.split_once("\n\n").unwrap_or((text, ""));
    let flat = |text: &str| text.replace('\n', " ");
    let default = match field.default() {
        Some(value) if !field.is_flag() && !value.is_object() => format!(" [default: {}]", shown(value)),
        _ => String::new(),
    };
    let help = flat(first).trim_end_matches('.').to_owned() + &default;
    let arg = Arg::new(field.path.join(".")).long(field.name()).aliases(field.aliases()).help(help.clone());
    let arg = if rest.is_empty() { arg } else { arg.long_help(format!("{help}\n\n{}", flat(rest))) };
    let arg = if field.is_advanced() { arg.help_heading("More options") } else { arg };
    if field.is_flag() {
        return arg.action(ArgAction::SetTrue);
    }
    let arg = arg.value_name(field.placeholder()).required(field.required);
    // -1 is a number; lists such as -1,2 are not seen as one.
    let arg = arg.allow_negative_numbers(true).allow_hyphen_values(field.text("type") == Some("array"));
    match field.words() {
        Some(words) => arg.value_parser(PossibleValuesParser::new(words)).hide_possible_values(true),
        None => arg,
    }
}

/// A default as it would be typed.
fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().map_or(number.to_string(), |v| v.to_string()),
        Value::Array(all) => all.iter().map(shown).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

impl Derived {
    /// Does it.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let fields = self.operation.fields();
        let options = self.options(&fields)?;
        let named = |error| flagged(error, &fields);
        let ready = self.operation.with(&options).map_err(named)?;
        let given = |id: &str| self.matches.get_one::<PathBuf>(id).cloned().unwrap_or_default();
        let (input, out) = (given("input"), given("out"));
        let done = ready.perform(&input, &out, self.matches.get_flag("force"), console).map_err(named)?;
        console.result(&format!("{}\nresults   {}", done.summary, out.display()), &done);
        done.missed.map_or(Ok(()), |why| Err(Failure::Bound(why)))
    }

    /// Options that were given.
    fn options(&self, fields: &Fields) -> Result<Value, Failure> {
        let mut options = json!({});
        for field in &fields.list {
            let id = field.path.join(".");
            if field.is_flag() {
                if self.matches.get_flag(&id) {
                    field.put(&mut options, Value::Bool(true));
                }
                continue;
            }
            let Some(text) = self.matches.get_one::<String>(&id) else { continue };
            let value = match field.is_file() && field.is_structure() {
                true => structure(Path::new(text))?,
                false => field.value(text).map_err(|problem| {
                    Error::input(format!("--{}", field.name()), problem, format!("give {}", field.expected()))
                })?,
            };
            field.put(&mut options, value);
        }
        Ok(options)
    }
}

/// A structure from a file: TOML where its name says so, else JSON.
fn structure(path: &Path) -> Result<Value, Error> {
    let remedy = "give a JSON or TOML file as the help shows one";
    let text = read_text(path, MOST_BYTES, remedy)?;
    let toml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let read = if toml { from_toml(&text) } else { from_json(&text) };
    read.map_err(|problem| Error::file(path, problem, remedy))
}

/// Names an option as the flag that it is here.
fn flagged(error: Error, fields: &Fields) -> Error {
    match error {
        Error::Input { subject, problem, remedy } => {
            let own = |f: &&Field| f.path.join(".") == subject || f.path.join(".") == format!("{subject}.path");
            let flag = fields.list.iter().find(own).map(|f| format!("--{}", f.name()));
            match flag {
                Some(flag) => Error::Input { subject: flag, problem, remedy: remedy.replace(SCHEMA, "see --help") },
                None => Error::Input { subject, problem, remedy },
            }
        }
        other => other,
    }
}
