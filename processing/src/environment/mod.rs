//! Surfaces under light from all around: environments, the exact reflection of a table over half vectors, and faster ways to it.

pub mod factor;
mod map;
mod passes;
mod planar;
mod reference;
mod table;
#[cfg(test)]
mod tests;

pub use map::Environment;
pub use passes::{clamped, turned_back, turned_to, two_pass};
pub use planar::{Reflection, planar};
pub use reference::{Frame, Lights, geometry, normalized_error};
pub use table::Table;
