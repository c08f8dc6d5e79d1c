//! Bokeh photographs: an out-of-focus highlight on a grating shows the grating's lines (2017 paper, section 5).
//!
//! The photograph is deconvolved with what the lens makes of a point, dark is taken for deep, and lines along a slice are counted and
//! measured as a row of slits. What the lens cannot have shown is refused.

pub mod deconvolution;
mod grain;
mod height;
mod lens;
mod options;
mod outcome;
mod output;
mod period;
mod photograph;
mod reconstruct;
mod report;
mod slice;
mod slits;
mod turn;

pub use height::{Calibration, KnownGrating, Shape};
pub use lens::{Cutoff, Lens};
pub use options::{KnownScale, Options, PsfChoice, SLICE_WIDTH};
pub use period::Lines;
pub use photograph::{Crop, Light};
pub use reconstruct::reconstruct;
pub use report::{Deconvolution, Heights, LinesReport, NoiseReport, Report, Scale, Seconds, SliceReport, SlitsReport};
pub use slice::Line;
pub use slits::Slits;
