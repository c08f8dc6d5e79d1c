//! Light from all around.

mod map;

pub use map::Environment;
