//! Native part of the Python package `nacre`: operations by name, and image files as NumPy arrays.
//!
//! Options and reports pass as JSON text. The package's Python part turns them into keyword arguments and dictionaries.

#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over")]

mod arrays;
mod running;

use nacre_base::Error;
use nacre_processing::operations::{OPERATIONS, operation};
use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyValueError};
use pyo3::prelude::*;
use serde_json::Value;

create_exception!(nacre, InputError, PyValueError, "Invalid input: a file or an option. Nothing was written.");
create_exception!(nacre, OutputError, PyOSError, "A result could not be written. Partial output was removed.");

/// The Python exception of an error.
fn raised(error: Error) -> PyErr {
    let text = in_python(&error.to_string());
    match error {
        Error::Cancelled => PyKeyboardInterrupt::new_err("interrupted"),
        Error::Input { .. } => InputError::new_err(text),
        Error::Output { .. } => OutputError::new_err(text),
    }
}

/// A message with options as keywords: `pixel_um` in place of `--pixel-um`.
fn in_python(message: &str) -> String {
    let mut text = String::with_capacity(message.len());
    let mut rest = message;
    while let Some((before, after)) = rest.split_once("--") {
        // Names of files may contain two hyphens, too.
        let begins = before.chars().next_back().map_or(text.is_empty(), |c| !c.is_alphanumeric() && c != '-');
        if !begins {
            text += before;
            text += "--";
            rest = after;
            continue;
        }
        let end = after.find(|c: char| !c.is_ascii_lowercase() && c != '-').unwrap_or(after.len());
        let (option, following) = after.split_at(end);
        text += before;
        text += &if option.is_empty() { "--".to_owned() } else { option.replace('-', "_") };
        rest = following;
    }
    text + rest
}

/// Options of an operation from JSON text.
fn ready(name: &str, options: &str) -> PyResult<Box<dyn nacre_base::operation::Ready>> {
    let options: Value = serde_json::from_str(options).map_err(|e| PyValueError::new_err(e.to_string()))?;
    let known = || OPERATIONS.iter().map(|o| o.name()).collect::<Vec<_>>().join(", ");
    let found = operation(name).ok_or_else(|| PyValueError::new_err(format!("{name}: operations are {}", known())))?;
    found.with(&options).map_err(raised)
}

/// Names of all operations.
#[pyfunction]
fn operations() -> Vec<&'static str> {
    OPERATIONS.iter().map(|o| o.name()).collect()
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("InputError", module.py().get_type::<InputError>())?;
    module.add("OutputError", module.py().get_type::<OutputError>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(operations, module)?)?;
    module.add_function(wrap_pyfunction!(running::run, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::read_maps, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::write_maps, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::read_photograph, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::write_photograph, module)?)
}
