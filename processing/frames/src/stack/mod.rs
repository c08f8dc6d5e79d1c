//! Mean, median and standard deviation of a series of photographs of one view, without outliers.

mod combine;
mod operation;
#[cfg(test)]
mod tests;

pub use operation::{Options, Report};
