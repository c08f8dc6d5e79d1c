//! Surfaces under environment lighting: environments, exact reflection by a lookup table over half vectors, and faster
//! methods.

mod azimuth;
mod correlation;
mod cosines;
pub mod factor;
mod grating;
mod lamps;
mod map;
mod passes;
mod planar;
mod prefilter;
mod reference;
mod sampling;
mod table;
#[cfg(test)]
mod tests;

pub use azimuth::facing;
pub(crate) use correlation::{Entry, Reflected, correlate, entry, light};
pub use grating::{Grating, Steps};
pub use lamps::{Lamp, lamps};
pub use map::Environment;
pub use passes::{clamped, turned_back, turned_to, two_pass};
pub use planar::{Reflection, planar};
pub use prefilter::prefiltered;
pub use reference::{Frame, Lights, geometry, normalized_error};
pub use sampling::{Estimate, Sampler};
pub use table::Table;
pub(crate) use table::{LUT_REMEDY, Lut};
