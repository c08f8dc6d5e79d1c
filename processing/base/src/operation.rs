//! Common interface of all operations: one structure of options, from which command line, service and page are derived.
//!
//! An operation is a type whose fields are its options. Their documentation is the help text, their `Default` provides
//! the defaults, and their JSON Schema the types. Schema keys that begin with `x-` add properties that JSON Schema
//! cannot express ([`crate::fields`]).

use crate::estimate::Work;
use crate::fields::Fields;
use crate::progress::Progress;
use crate::{Error, OutputFolder, Result};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::DeserializeOwned;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};
use std::marker::PhantomData;
use std::path::Path;

/// Kind of input of an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Photographs: a session, a set described by `frames.json`, or a folder of photographs.
    Photographs,
    /// Maps, such as the results of a session.
    Maps,
    /// Other files.
    Files,
    /// Other files, or no input.
    FilesOrNothing,
}

/// An operation: produces results in a new folder from options and an input.
pub trait Operation: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static {
    /// Name in commands, service paths, plans and jobs.
    const NAME: &'static str;

    /// One-line description of its result; the part before the first comma is its label on the page.
    const TITLE: &'static str;

    /// Kind of input.
    const INPUT: Input = Input::Photographs;

    /// Report of the results, written as `report.json`.
    type Report: Serialize + Summary + JsonSchema + Send + 'static;

    /// Rejects options that are invalid for any input.
    ///
    /// # Errors
    /// `Input`, naming the option.
    fn check_options(&self) -> Result<()> {
        Ok(())
    }

    /// Rejects invalid options and input; otherwise predicts time, memory and disk space.
    ///
    /// # Errors
    /// `Input`, naming the option or the file.
    fn check(&self, input: &Path) -> Result<Work>;

    /// Writes all results except the report into a folder.
    ///
    /// # Errors
    /// `Input`, `Output` or `Cancelled`; the caller then drops the folder.
    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Self::Report>;

    /// Reason why the result exceeds the requested error, with a remedy; `None` if it meets the request.
    fn missed(&self, _: &Self::Report) -> Option<String> {
        None
    }
}

/// Text summary of a report in a few lines, each with a label of at most nine characters: `warning   …`.
pub trait Summary {
    /// The lines, without a trailing line break.
    fn summary(&self) -> String;

    /// Limitations of the results that the user must know.
    fn warnings(&self) -> &[String];
}

/// Runs an operation from `input` into the new folder `out`, which is created atomically. With `overwrite`, files of
/// the same names in an existing folder are replaced.
///
/// # Errors
/// As [`Operation::check`] and [`Operation::run`].
pub fn perform<O: Operation>(
    operation: &O,
    input: &Path,
    out: &Path,
    overwrite: bool,
    progress: &dyn Progress,
) -> Result<O::Report> {
    progress.expect(&operation.check(input)?)?;
    let folder = OutputFolder::begin(out, overwrite)?;
    let report = operation.run(input, &folder, progress)?;
    folder.write_report(&report)?;
    progress.check()?;
    folder.commit()?;
    Ok(report)
}

/// Problem of a required option that is not given.
pub const MISSING: &str = "is missing";

/// Reference to the description of options, for users who send JSON.
pub const SCHEMA: &str = "the schema of the operation lists keys and units";

/// An operation of the registry, with options as JSON.
pub trait Registered: Sync {
    /// [`Operation::NAME`].
    fn name(&self) -> &'static str;

    /// [`Operation::TITLE`].
    fn title(&self) -> &'static str;

    /// [`Operation::INPUT`].
    fn input(&self) -> Input;

    /// JSON Schema of the options. Definitions of other types remain in the generator.
    fn schema(&self, generator: &mut SchemaGenerator) -> Schema;

    /// JSON Schema of the report. Definitions of other types remain in the generator.
    fn report_schema(&self, generator: &mut SchemaGenerator) -> Schema;

    /// All options, including nested ones.
    fn fields(&self) -> Fields;

    /// Reads options; omitted ones take their defaults.
    ///
    /// # Errors
    /// `Input`, naming the key.
    fn with(&self, options: &Value) -> Result<Box<dyn Ready>>;
}

/// An operation with its options.
pub trait Ready: Send {
    /// [`Operation::check_options`].
    ///
    /// # Errors
    /// As there.
    fn check_options(&self) -> Result<()>;

    /// [`Operation::check`].
    ///
    /// # Errors
    /// As there.
    fn check(&self, input: &Path) -> Result<Work>;

    /// [`perform`].
    ///
    /// # Errors
    /// As there.
    fn perform(&self, input: &Path, out: &Path, overwrite: bool, progress: &dyn Progress) -> Result<Done>;
}

/// A result; it serialises as its report.
pub struct Done {
    report: Box<dyn erased_serde::Serialize + Send>,
    /// Text summary of the report.
    pub summary: String,
    /// [`Summary::warnings`].
    pub warnings: Vec<String>,
    /// [`Operation::missed`].
    pub missed: Option<String>,
}

impl Done {
    /// Result of an operation that has run.
    pub fn new<O: Operation>(operation: &O, report: O::Report) -> Self {
        let (summary, warnings, missed) = (report.summary(), report.warnings().to_vec(), operation.missed(&report));
        Self { report: Box::new(report), summary, warnings, missed }
    }
}

impl Serialize for Done {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        erased_serde::serialize(&*self.report, serializer)
    }
}

/// Registry entry of an operation.
pub struct Entry<O>(PhantomData<fn() -> O>);

impl<O> Entry<O> {
    /// The entry.
    pub const NEW: Self = Self(PhantomData);
}

impl<O: Operation> Registered for Entry<O> {
    fn name(&self) -> &'static str {
        O::NAME
    }

    fn title(&self) -> &'static str {
        O::TITLE
    }

    fn input(&self) -> Input {
        O::INPUT
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        generator.subschema_for::<O>()
    }

    fn report_schema(&self, generator: &mut SchemaGenerator) -> Schema {
        generator.subschema_for::<O::Report>()
    }

    fn fields(&self) -> Fields {
        Fields::of(SchemaGenerator::default().into_root_schema_for::<O>().to_value())
    }

    fn with(&self, options: &Value) -> Result<Box<dyn Ready>> {
        read::<O>(options).map(|read| Box::new(read) as Box<dyn Ready>)
    }
}

/// Reads the options of an operation; omitted ones take their defaults.
///
/// # Errors
/// `Input`, naming the key.
pub fn read<O: Operation>(options: &Value) -> Result<O> {
    let none = Value::Object(Map::new());
    let options = if options.is_null() { &none } else { options };
    serde_path_to_error::deserialize(options).map_err(|error| {
        let key = error.path().to_string();
        let problem = error.into_inner().to_string();
        if let Some(name) = problem.strip_prefix("missing field `").and_then(|rest| rest.split('`').next()) {
            let key = if key == "." { name.to_owned() } else { format!("{key}.{name}") };
            return Error::input(key, MISSING, format!("give it; {SCHEMA}"));
        }
        let key = if key == "." { "options".to_owned() } else { key };
        Error::input(key, problem, format!("correct it; {SCHEMA}"))
    })
}

impl<O: Operation> Ready for O {
    fn check_options(&self) -> Result<()> {
        Operation::check_options(self)
    }

    fn check(&self, input: &Path) -> Result<Work> {
        Operation::check(self, input)
    }

    fn perform(&self, input: &Path, out: &Path, overwrite: bool, progress: &dyn Progress) -> Result<Done> {
        perform(self, input, out, overwrite, progress).map(|report| Done::new(self, report))
    }
}

/// Final lines of a summary: assumptions and warnings.
pub fn lines(assumptions: &[String], warnings: &[String]) -> String {
    let assumed = assumptions.iter().map(|a| format!("assumed   {a}\n"));
    assumed.chain(warnings.iter().map(|w| format!("warning   {w}\n"))).collect()
}

/// Message that an error exceeds the requested one, in this unit, or is unknown. `error` is its name, `remedy` reduces
/// it.
pub fn exceeds(wanted: Option<f64>, found: Option<f64>, [error, unit, remedy]: [&str; 3]) -> Option<String> {
    match (wanted?, found) {
        (wanted, Some(found)) if found <= wanted => None,
        (wanted, Some(found)) => {
            Some(format!("{error} is {found:.4}{unit}, more than the {wanted}{unit} asked for; {remedy}"))
        }
        (wanted, None) => Some(format!("no error can be told, so it may exceed the {wanted}{unit} asked for")),
    }
}
