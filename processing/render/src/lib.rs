//! Renders scenes with diffracting surfaces, such as measured materials under any light, with a known error.
//!
//! - [`Scene`]: a camera, shapes, lights and materials (TOML).
//! - [`render`]: renders passes until the target error is met.
//! - [`write_picture`], [`write_png`]: linear EXR with its error, and a PNG for a screen.
//! - [`Options`]: the operation `render`, which reads a folder with a scene and writes a folder with pictures and a
//!   report.
//!
//! Reflected light is computed in closed form where possible. Under small lights, a grating's orders are Gaussian lobes
//! whose width follows from the coherence and the size of the light. They are summed over as many wavelengths as their
//! dispersion requires. Under environments, gratings are sums over orders and wavelengths. Height fields and lookup
//! tables are evaluated directly, and by multiple importance sampling under environments.

// Scene description, as written by users.
mod scene;
mod settings;
mod vector;

// Prepared parts of a scene.
pub mod environment;
mod light;
mod material;
mod shape;

// Rendering of prepared scenes to pictures and files.
pub mod gpu;
mod job;
mod picture;
mod prepared_scene;

// Example scenes.
mod gallery;

#[cfg(test)]
mod tests;

pub use gallery::{GALLERY, gallery, gallery_scene, gallery_skin, scene_of_maps};
pub use job::{
    EnvironmentReport, Options, Prediction, Report, SoFar, SpectralReport, Written, draft, render, render_watched,
    scene_text,
};
pub use material::diffraction::grating::{BalancedOrder, BalancedOrders};
pub use material::{Notes, SAMPLES};
pub use picture::{
    Band, Difference, Picture, Pixel, bytes, difference, exposure, png, read_picture, write_picture, write_png,
};
pub use scene::{
    Base, Blend, Camera, Color, Coverage, Diffraction, Light, Material, Relief, Scene, Shape, Spectrum, Turn, Value,
};
pub use settings::{Method, Settings};
