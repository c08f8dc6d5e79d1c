//! Photographs rendered without the bench: one camera's view of a diffracting surface.

mod bokeh;
mod bracket;
mod flash;
mod foil;
mod orders;
#[cfg(test)]
mod render_tests;
mod tiles;

pub use bokeh::BokehPhotograph;
pub use flash::FlashPhotograph;
pub use foil::{FoilPattern, FoilPhotograph};
pub use orders::{Profile, Surface};
pub use tiles::{Grooves, Pattern, Periods, Score, TilesPhotograph};
