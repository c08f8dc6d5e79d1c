//! Patch prepared for power densities of any pair of directions and any wavelength within a range.

use super::bank::{Bank, Limits, Scratch};
use super::geometry::Window;
use super::lattice::Lattice;
use super::pq::Pq;
use super::reference::Reference;

/// Range of densities that a product needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Request {
    /// Minimum and maximum of `2π/λ · (cos θi + cos θr)`, in 1/µm.
    pub q: [f64; 2],
    /// Largest spatial frequencies to the right and up, in 1/µm.
    pub frequency: [f64; 2],
    /// Largest magnitude of a spatial frequency, |ωi + ωr|/λ in the plane, in 1/µm; at most 2/λ.
    pub length: f64,
    /// Number of densities.
    pub densities: f64,
}

impl Request {
    /// Largest spatial frequencies with the margin of the window.
    pub(super) fn wide(&self, radius: f64) -> Limits {
        Limits { frequency: self.frequency.map(|f| f + radius), length: self.length + radius }
    }
}

/// Working memory of a thread.
#[derive(Default)]
pub(super) struct Memory {
    single: Scratch<f32>,
    double: Scratch<f64>,
}

/// Representation of the patch by which densities are computed.
pub(super) enum Engine<'a> {
    Reference(Reference<'a>),
    Single(Bank<f32>),
    Double(Bank<f64>),
    Pq(Box<Pq>),
}

/// Engine with its window.
pub(super) struct Model<'a> {
    pub engine: Engine<'a>,
    pub window: Window,
    /// Radius at which the window is truncated, in 1/µm.
    pub radius: f64,
    /// Frequencies of one grating, if only those have light (`nmm`).
    pub lattice: Option<Lattice>,
}

impl Model<'_> {
    /// Power density in µm² at a spatial frequency in 1/µm (y up), for `q = 2π/λ · (cos θi + cos θr)` in 1/µm.
    pub(super) fn density(&self, place: [f64; 2], q: f64, memory: &mut Memory) -> f64 {
        match &self.engine {
            Engine::Reference(reference) => reference.density(place, q, self.window),
            Engine::Single(bank) => bank.density(place, q, self.window, self.radius, &mut memory.single),
            Engine::Double(bank) => bank.density(place, q, self.window, self.radius, &mut memory.double),
            Engine::Pq(pq) => pq.density(place, q, &mut memory.double),
        }
    }

    /// Power density of a flat mirror in its mirror direction, in µm².
    pub(super) fn mirror(&self) -> f64 {
        match &self.engine {
            Engine::Pq(pq) => pq.area_um2(),
            _ => self.window.peak(),
        }
    }
}
