//! Power densities of a height field for arbitrary directions, one at a time.

use super::choose::{Choice, prepare};
use super::engine::{Engine, Memory, Model, Request};
use super::geometry::Window;
use super::height::{HeightField, Quality};
use super::settings::Settings;
use super::spectral::RANGE_NM;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use std::f64::consts::TAU;

/// Height field prepared for all directions and all visible wavelengths.
pub struct Densities {
    model: Model<'static>,
    /// Method of computation.
    pub choice: Choice,
    /// Window of the light's coherence, the shape of a lobe.
    pub window: Window,
}

/// Working memory of a thread.
#[derive(Default)]
pub struct Workspace(Memory);

impl Densities {
    /// Prepares a height field for a coherence width, with the cheapest method that meets an error for this number of
    /// densities.
    ///
    /// # Errors
    /// `Input` if the pixel pitch is too coarse, and for invalid settings.
    pub fn new(
        field: &HeightField,
        coherence_um: f64,
        max_error: f64,
        densities: f64,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let settings = Settings { coherence_um, max_error, ..Settings::default() };
        let (_, window) = settings.check()?;
        let quality = Quality::of(field, coherence_um);
        let length = 2e3 / RANGE_NM[0];
        let request = Request { q: [0.0, TAU * length], frequency: [length; 2], length, densities };
        let (model, choice) = prepare(field, &quality, request, &settings, progress)?;
        let Model { engine, window: _, radius, lattice } = model;
        let engine = match engine {
            Engine::Single(bank) => Engine::Single(bank),
            Engine::Double(bank) => Engine::Double(bank),
            Engine::Pq(pq) => Engine::Pq(pq),
            Engine::Reference(_) => return Err(Error::input("method", "is none for pictures", "give auto")),
        };
        Ok(Self { model: Model { engine, window, radius, lattice }, choice, window })
    }

    /// Power density in µm² at a spatial frequency in 1/µm, for `q = 2π/λ · (cos θi + cos θr)` in 1/µm.
    pub fn at(&self, place: [f64; 2], q: f64, workspace: &mut Workspace) -> f64 {
        self.model.density(place, q, &mut workspace.0).max(0.0)
    }
}
