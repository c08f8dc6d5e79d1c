//! Merging of several exposures into one high-dynamic-range photograph.
//!
//! Each exposure yields `light = response(value) / (exposure · gain)`, with a variance from shot noise, read noise, and
//! rounding to codes; a steep response amplifies rounding. The merged light is the inverse-variance weighted mean of
//! the unsaturated exposures. Debevec and Malik (1997) use a hat function over the codes as weight instead.
//!
//! An unknown response is recovered from the bracket, as by Debevec and Malik, but with statistical weights and with a
//! smoothness term that does not penalise power laws.

mod align;
mod coding;
mod input;
mod memory;
mod merge;
mod options;
mod outcome;
mod output;
mod reconstruct;
mod recover;
mod report;
mod response;
mod sample;
mod source;
#[cfg(test)]
mod tests;

pub use input::work_of;
pub use memory::{Merged, merge};
pub use options::{Options, ResponseChoice};
pub use reconstruct::reconstruct;
pub use report::{FrameReport, Report};
pub use response::Response;
pub use source::{Source, is_bracket};
