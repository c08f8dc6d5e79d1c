//! Orientation and absolute period of gratings from photographs under a flash (2018 paper, section 4), for sheets of
//! repeated tiles, whose copies are seen at different half vectors.
//!
//! A position of the tile with grating vector `g = λ/a (cos θ, sin θ)` is bright where the tangential part `h` of ωi +
//! ωo is near ±g, ±2g, …. Each order is a lobe as wide as the light. The paper equates bright pixels with the lobe's
//! peak, which causes a bias (17 % in its own test), and takes the direction towards the highlight as θ. Here, lobes
//! are fitted to all copies under all lights simultaneously, weighted by their noise. Their width is that of the
//! highlight, which is the lobe of the zero order.
//!
//! If polygons share few directions and periods, positions with the same grating are fitted jointly (`shared`), and one
//! photograph suffices. Evidence decides whether they do.
//!
//! Undetermined positions are masked: those without light, with several gratings, with too few copies near a lobe, and
//! with an ambiguous order.

mod corners;
mod fit;
mod highlight;
mod input;
mod lobe;
mod operation;
mod output;
mod paper;
mod period_selection;
mod photographs;
mod reconstruct;
mod regularisation;
mod report;
mod settings;
mod shared;
mod solve;
mod spool;
mod summary;
mod tiling;
mod view;

pub use reconstruct::reconstruct;
pub use report::{DirectionsReport, Masked, PeriodReport, Registration, Report};
pub use settings::{Directions, Orientation, PeriodChoice, Settings};
