//! Surfaces under light from all around: environments, the exact reflection of a table over half vectors, and faster ways to it.

mod map;
#[cfg(test)]
mod tests;

pub use map::Environment;
