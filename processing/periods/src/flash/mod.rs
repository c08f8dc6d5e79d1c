//! Orientation and absolute period of gratings from photographs under a flash (2018 paper, section 4): for sheets of repeated tiles, whose
//! copies are seen under half vectors of their own.
//!
//! A place of the tile with the grating vector `g = λ/a (cos θ, sin θ)` is bright where the tangent part `h` of ωi + ωo is near to
//! ±g, ±2g, …: around each lies a lobe as wide as the light. The paper takes bright pixels for the lobe's peak, which they are not
//! (17 % bias in its own test), and the direction towards the highlight for θ. Here the lobes are fitted to all copies under all lights at
//! once, each weighted by its noise; their width is that of the highlight, which is the lobe of the order zero.
//!
//! Where polygons share few directions and periods, places with the same grooves are fitted together (`shared`): one photograph is then enough.
//! Evidence decides whether they do.
//!
//! What a fit cannot tell is masked: places without light, with several gratings, with too few copies near a lobe, and those whose light
//! could as well be of another order.

mod agree;
mod corners;
mod decide;
mod fit;
mod highlight;
mod input;
mod lobe;
mod operation;
mod output;
mod paper;
mod photographs;
mod reconstruct;
mod report;
mod said;
mod settings;
mod shared;
mod solve;
mod spool;
mod tiling;
mod view;

pub use reconstruct::reconstruct;
pub use report::{DirectionsReport, Masked, PeriodReport, Registration, Report};
pub use settings::{Directions, Orientation, PeriodChoice, Settings};
