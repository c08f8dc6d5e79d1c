//! Pictures of scenes with surfaces that diffract: what was measured under any light, at an error that is known.
//!
//! - [`Scene`]: a camera, shapes, lights and materials (TOML).
//! - [`render`]: passes over a picture until its error is met.
//! - [`write_picture`], [`write_png`]: linear EXR with its error, and a picture for a screen.
//! - [`Options`]: the whole as an operation, for the service: from a folder with a scene to one with pictures and a report.
//!
//! A material's light is computed exactly where it can be: under small lights, a grating's orders are Gaussians as wide as coherence and light
//! make them, summed up over as many wavelengths as their displacement needs; under environments, they are sums over orders and wavelengths.
//! Height fields and tables are evaluated as they are, and under environments drawn by multiple importance sampling.

// Description of a scene, as users write it.
mod scene;
mod settings;
mod vector;

// Parts of a scene, ready for rays.
pub mod environment;
mod light;
mod material;
mod shape;

// From a prepared scene to pictures and files.
pub mod gpu;
mod job;
mod picture;
mod prepared_scene;

// Example scenes.
mod gallery;

#[cfg(test)]
mod tests;

pub use gallery::{GALLERY, gallery, gallery_scene, gallery_skin, scene_of_maps};
pub use job::{EnvironmentReport, Options, Prediction, Report, SoFar, SpectralReport, Written, render, render_watched};
pub use material::diffraction::grating::{BalancedOrder, BalancedOrders};
pub use material::{Notes, SAMPLES};
pub use picture::{
    Band, Difference, Picture, Pixel, bytes, difference, exposure, png, read_picture, write_picture, write_png,
};
pub use scene::{
    Base, Blend, Camera, Color, Coverage, Diffraction, Light, Material, Relief, Scene, Shape, Spectrum, Turn, Value,
};
pub use settings::{Method, Settings};
