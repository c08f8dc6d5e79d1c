//! Bokeh photographs: an out-of-focus highlight on a grating shows the grating's lines (2017 paper, section 5).
//!
//! The photograph is deconvolved with the point spread function of the lens, and light is converted to height (dark is
//! deep). Lines along a slice are counted and measured as a row of slits. Periods below the resolution limit of the
//! lens are rejected.

pub mod deconvolution;
mod height;
mod lens;
mod noise_estimate;
mod options;
mod outcome;
mod output;
mod period;
mod photograph;
mod reconstruct;
mod report;
mod rotation;
mod slice;
mod slits;

pub use height::{Calibration, KnownGrating, Shape};
pub use lens::{Cutoff, Lens};
pub use options::{KnownScale, Options, PsfChoice, SLICE_WIDTH};
pub use period::Lines;
pub use photograph::{Crop, Light};
pub use reconstruct::reconstruct;
pub use report::{Deconvolution, Heights, LinesReport, NoiseReport, Report, Scale, Seconds, SliceReport, SlitsReport};
pub use slice::Line;
pub use slits::Slits;
