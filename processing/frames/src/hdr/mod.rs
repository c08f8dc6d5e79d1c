//! One photograph of high dynamic range from several exposures.
//!
//! Every exposure says `light = response(value) / (exposure · gain)` with a variance that its noise gives it: shot and read
//! noise of the sensor, and rounding to codes, which a curved response makes larger where it is steep. The merged light is
//! their mean weighted by the inverse variances, over those that are not saturated; Debevec and Malik (1997) weight by a hat
//! over the codes instead.
//!
//! A response that is not known is recovered from the bracket itself, as Debevec and Malik do, but with each value weighted
//! by what it is worth, and with smoothness that costs a power law nothing.

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
