//! Pictures of scenes with surfaces that diffract: what was measured under any light, at an error that is known.
//!
//! - [`Scene`]: a camera, shapes, lights and materials (TOML).
//! - [`render`]: passes over a picture until its error is met.
//! - [`write_picture`], [`write_png`]: linear EXR with its error, and a picture for a screen.
//! - [`render_folder`]: the whole as a job, for the service: from a folder with a scene to one with pictures and a report.
//!
//! A material's light is computed exactly where it can be: under small lights, a grating's orders are Gaussians as wide as coherence and light
//! make them, summed up over as many wavelengths as their displacement needs; under environments, they are sums over orders and wavelengths.
//! Height fields and tables are evaluated as they are, and under environments drawn by multiple importance sampling.

mod allot;
mod base;
mod compare;
mod describe;
mod diffraction;
pub mod environment;
mod eye;
mod files;
mod flat;
mod folder;
mod gallery;
mod gallery_patterns;
mod gallery_shapes;
pub mod gpu;
mod grating;
mod job;
mod light;
mod lobes;
mod material;
mod mesh;
mod mesh_file;
mod norm;
mod output;
mod picture;
mod ready;
mod relief;
mod scene;
mod shape;
mod slits;
mod spectral;
mod spectrum;
mod sums;
mod table;
#[cfg(test)]
mod tests;
mod texture;
mod vector;

pub use compare::{Difference, difference};
pub use folder::{Glimpse, Options, check_folder, render_folder};
pub use gallery::{GALLERY, gallery, gallery_scene, gallery_skin, scene_of_maps};
pub use grating::{BalancedOrder, BalancedOrders};
pub use job::{Prediction, Report, Settings, SoFar, render, render_watched};
pub use material::Notes;
pub use output::{bytes, exposure, png, read_picture, write_picture, write_png};
pub use picture::{Band, Picture, Pixel, SAMPLES};
pub use scene::{
    Base, Blend, Camera, Color, Diffraction, Light, Material, Relief, Scene, Shape, Spectrum, Turn, Value,
};
pub use spectral::SpectralReport;
