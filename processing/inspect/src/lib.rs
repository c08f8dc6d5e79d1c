#![doc = include_str!("../README.md")]

mod coarse;
mod compare;
mod content;
mod defect;
mod font;
mod image;
mod inspection;
mod limits;
mod operation;
mod output;
mod page;
mod paper;
mod pdf;
mod pictures;
mod refine;
mod report;
mod robust;
mod sheet;
#[cfg(test)]
mod tests;
mod transform;

pub use compare::{BLUR_PX, Difference, Differences};
pub use defect::{Class, Defect, Regions};
pub use image::Image;
pub use inspection::{Inspection, Parameters, Registration, inspect};
pub use limits::{ClassLimits, Limits, SheetLimits};
pub use operation::Options;
pub use report::{AllDiffers, Differs, Report, SheetReport, Verdict};
pub use sheet::{Origin, Periods, Sheet, Signature};
pub use transform::{Freedom, Transform};
