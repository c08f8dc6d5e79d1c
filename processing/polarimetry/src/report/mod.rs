//! Results for users: expected errors, report.json, maps and pictures.

pub(crate) mod compare;
pub(crate) mod count;
pub(crate) mod disk;
pub(crate) mod errors;
#[cfg(test)]
mod errors_tests;
pub(crate) mod json;
pub(crate) mod model_report;
pub(crate) mod output;
pub(crate) mod reduced;
mod summary;
