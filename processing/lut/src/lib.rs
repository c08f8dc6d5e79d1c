//! Lookup tables for arbitrary illumination from one narrow-band photograph of a diffraction pattern (2017 paper,
//! section 4.3).

pub mod bokeh;
mod choose;
mod figure;
pub mod foil;
mod geometry;
mod input;
mod kernel;
mod light;
mod lookup;
mod output;
mod photograph;
mod plane;
mod rays;
mod reconstruct;
mod report;
mod settings;
mod sharpness;
mod table;
#[cfg(test)]
mod tests;

pub use choose::Choice;
pub use geometry::{Arrangement, Placement};
pub use light::{Light, LightReport};
pub use lookup::{Table, lookup};
pub use photograph::Photograph;
pub use reconstruct::reconstruct;
pub use report::{Coverage, Report};
pub use settings::{LightPhotograph, MethodChoice, SIZES, Settings, Wavelength};
