//! Studies of the spot scan: patterns, noise, and what the geometry and the sample do to it.

mod job;

pub use job::{Judged, Shown, bench, judged, photograph};
