//! Options of operations as command-line flags: arguments, help and values follow from the options' JSON Schema.

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use nacre_base::Error;
use nacre_base::fields::{Field, Fields, TABLE};
use nacre_base::operation::{Entry, MISSING, Operation, Registered, SCHEMA, read};
use nacre_base::text::{from_json, from_toml, read_text};
use nacre_capture::Failure;
use serde_json::{Value, json};
use std::marker::PhantomData;
use std::path::Path;

/// Maximum size of a file given as an option's value.
const MOST_BYTES: u64 = 1 << 20;

/// Maximum number of rows of a table given as an option's value.
const MOST_ROWS: usize = 20_000;

/// Options of an operation as flags of a command that has other arguments too.
pub struct Flags<O> {
    matches: ArgMatches,
    operation: PhantomData<fn() -> O>,
}

impl<O: Operation> Flags<O> {
    /// Parses the options.
    ///
    /// # Errors
    /// `Input`, naming the flag.
    pub fn options(&self) -> Result<O, Failure> {
        let fields = Entry::<O>::NEW.fields();
        let options = given(&fields, &self.matches)?;
        Ok(read(&options).map_err(|error| flagged(error, &fields))?)
    }

    /// True if an option was given on the command line.
    pub fn is_given(&self, id: &str) -> bool {
        self.matches.value_source(id) == Some(ValueSource::CommandLine)
    }
}

impl<O: Operation> Args for Flags<O> {
    fn augment_args(command: Command) -> Command {
        command.args(arguments(&Entry::<O>::NEW.fields()))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<O> FromArgMatches for Flags<O> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self { matches: matches.clone(), operation: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The flags of all options.
pub fn arguments(fields: &Fields) -> Vec<Arg> {
    let others = |field: &Field| {
        let others = fields.list.iter().filter(|other| field.excludes(other));
        others.map(id).collect::<Vec<_>>()
    };
    fields.list.iter().map(|field| argument(field).conflicts_with_all(others(field))).collect()
}

fn id(field: &Field) -> String {
    field.path.join(".")
}

/// Builds the flag of an option.
fn argument(field: &Field) -> Arg {
    let text = field.text("description").unwrap_or_default();
    let (first, rest) = text.split_once("\n\n").unwrap_or((text, ""));
    let flat = |text: &str| text.replace('\n', " ");
    let default = match field.default() {
        Some(value) if !field.is_flag() && !value.is_object() => format!(" [default: {}]", shown(value)),
        _ => String::new(),
    };
    let help = flat(first).trim_end_matches('.').to_owned() + &default;
    let help = if field.is_on() { format!("Do not {}", decapitalized(&help)) } else { help };
    let arg = Arg::new(id(field)).long(field.name()).aliases(field.aliases()).help(help.clone());
    let arg = if rest.is_empty() { arg } else { arg.long_help(format!("{help}\n\n{}", flat(rest))) };
    let arg = if field.is_advanced() { arg.help_heading("More options") } else { arg };
    if field.is_flag() {
        return arg.action(ArgAction::SetTrue);
    }
    let arg = arg.value_name(field.placeholder()).required(field.required);
    // -1 is accepted as a number, but a list such as -1,2 needs its own permission.
    let arg = arg.allow_negative_numbers(true).allow_hyphen_values(field.text("type") == Some("array"));
    match field.words() {
        Some(words) => {
            // JSON keys use underscores, command-line words dashes.
            let word = |word: String| PossibleValue::new(word.replace('_', "-")).alias(word);
            arg.value_parser(PossibleValuesParser::new(words.into_iter().map(word))).hide_possible_values(true)
        }
        None => arg,
    }
}

fn decapitalized(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// A default value in command-line syntax.
fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().map_or(number.to_string(), |v| v.to_string()),
        Value::Array(all) => all.iter().map(shown).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

/// Collects the given options as JSON.
///
/// # Errors
/// `Input`, naming the flag.
pub fn given(fields: &Fields, matches: &ArgMatches) -> Result<Value, Failure> {
    let mut options = json!({});
    for field in &fields.list {
        if field.is_flag() {
            if matches.get_flag(&id(field)) {
                field.put(&mut options, Value::Bool(!field.is_on()));
            }
            continue;
        }
        let Some(text) = matches.get_one::<String>(&id(field)) else { continue };
        let value = match (field.value(text), field.text(TABLE)) {
            _ if field.is_file() && field.is_structure() => structure(Path::new(text))?,
            (Err(_), Some(variant)) if Path::new(text).is_file() => json!({ variant: table(Path::new(text))? }),
            (value, _) => value.map_err(|problem| {
                Error::input(format!("--{}", field.name()), problem, format!("give {}", field.expected()))
            })?,
        };
        field.put(&mut options, value);
    }
    Ok(options)
}

/// Reads a structure from a file: TOML by extension, otherwise JSON.
fn structure(path: &Path) -> Result<Value, Error> {
    let remedy = "give a JSON or TOML file as the help shows one";
    let text = read_text(path, MOST_BYTES, remedy)?;
    let toml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let read = if toml { from_toml(&text) } else { from_json(&text) };
    read.map_err(|problem| Error::file(path, problem, remedy))
}

/// Reads rows of numbers from a CSV file; its first line may be a header.
fn table(path: &Path) -> Result<Vec<Vec<f64>>, Error> {
    let remedy = "give rows of numbers with commas between";
    let mut rows = vec![];
    let text = read_text(path, MOST_BYTES, remedy)?;
    for (k, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let numbers: Option<Vec<f64>> = line.split(',').map(|v| v.trim().parse().ok()).collect();
        match numbers {
            Some(numbers) => rows.push(numbers),
            None if k == 0 => {}
            None => return Err(Error::file(path, format!("line {} is {line:.60}", k + 1), remedy)),
        }
        if rows.len() > MOST_ROWS {
            return Err(Error::file(path, format!("has more than {MOST_ROWS} rows"), remedy));
        }
    }
    Ok(rows)
}

/// Rewrites an error about an option so that it names the flag.
pub fn flagged(error: Error, fields: &Fields) -> Error {
    match error {
        Error::Input { subject, problem, remedy } => {
            let missing = problem == MISSING;
            let own = |f: &&Field| {
                // Any flag of a missing structure may be given.
                id(f) == subject || (!missing && (f.name() == subject || id(f) == format!("{subject}.path")))
            };
            let within = |f: &&Field| id(f).starts_with(&format!("{subject}."));
            let flag = |f: &Field| format!("--{}", f.name());
            let all = || fields.list.iter().filter(within).map(flag).collect::<Vec<_>>().join(" or ");
            // A key of a structure that a file holds.
            let inner = |f: &&Field| f.is_structure() && subject.starts_with(&format!("{}.", id(f)));
            if let Some(field) = fields.list.iter().find(inner) {
                let key = subject[id(field).len() + 1..].to_owned();
                return Error::input(flag(field), format!("{key} {problem}"), "correct the file; see --help");
            }
            let flag = fields.list.iter().find(own).map(flag).or_else(|| Some(all()).filter(|all| !all.is_empty()));
            match flag {
                Some(flag) => Error::Input { subject: flag, problem, remedy: remedy.replace(SCHEMA, "see --help") },
                None => Error::Input { subject, problem, remedy },
            }
        }
        other => other,
    }
}
