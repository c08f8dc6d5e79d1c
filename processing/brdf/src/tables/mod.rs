//! Tables of a height field's BRDF over pairs of directions, in formats of other programs.
//!
//! - [`measured`]: tensor of Mitsuba's `measured` material (Dupuy and Jakob 2018).
//! - [`half_vector`]: table over half vectors, as `lut.exr`.
//! - [`merl`]: isotropic table in the format of the MERL set (Matusik et al. 2003).
//!
//! A table cannot hold lobes that are narrower than its cells. Its coherence width is therefore reduced until lobes are
//! as wide as a cell. This preserves their light, but not their width.

mod half_vector;
mod measured;
mod merl;
#[cfg(test)]
mod tests;

use super::brdf::Factors;
use super::choose::{Choice, prepare};
use super::engine::{Memory, Model, Request};
use super::geometry::{Direction, Pair, Window};
use super::height::{HeightField, Quality};
use super::settings::Settings;
use super::spectral::{RANGE_NM, Samples};
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_optics::color::Illuminant;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};

pub use half_vector::half_vector;
pub use measured::measured;
pub use merl::merl;

/// Wavelength in µm for which cells and lobes are compared.
const MIDDLE_UM: f64 = 0.55;

/// Smallest standard deviation of a lobe in cells. Between two entries, linear interpolation of such a lobe is wrong by
/// up to 1/8 of its peak, and by more for narrower ones.
const LOBE_CELLS: f64 = 1.0;

/// Smallest cosine of a direction: the BRDF diverges at grazing angles.
const GRAZING: f64 = 0.02;

/// Pairs of directions at which a table is compared with the BRDF.
const COMPARED: usize = 4000;

/// Written table.
pub struct Table {
    /// Method of computation.
    pub choice: Choice,
    /// Number of entries along each axis.
    pub shape: Vec<usize>,
    /// Coherence width in µm: the given one, or that of lobes as wide as a cell.
    pub coherence_um: f64,
    /// Largest magnitude, in the plane, of the half vector ωi + ωr that the pixels of the height field carry. The table
    /// is dark beyond.
    pub extent: f64,
    /// Root mean square difference between table and BRDF at random pairs of directions, over the root mean square of
    /// the BRDF there (measured).
    pub error: f64,
    /// Pairs of directions that `error` is of.
    pub error_of: &'static str,
    /// Warnings about the table.
    pub warnings: Vec<String>,
}

/// Height field prepared for all pairs of directions.
struct Prepared<'a> {
    model: Model<'a>,
    settings: &'a Settings,
    choice: Choice,
    extent: f64,
}

/// Largest magnitude of the half vector in the plane that pixels carry at all wavelengths, up to 2.
fn extent(field: &HeightField) -> f64 {
    (0.5 / field.pixel_um * RANGE_NM[0] / 1e3).min(2.0)
}

/// `error_of` of tables that are compared everywhere, and of those that leave the mirror direction out: its lobe
/// outshines all others.
const EVERYWHERE: &str = "all directions";
const OUTSIDE: &str = "outside of the lobe in the mirror direction";

/// Coherence width in µm: the given one, or that of lobes as wide as cells of this size in the half vector. Warns of
/// narrower lobes.
fn coherence(given_um: Option<f64>, cell: f64) -> (f64, Vec<String>) {
    // Inverse of `Window::new`.
    let sigma = LOBE_CELLS * cell / MIDDLE_UM;
    let resolved_um = (4.0 / (8_f64.sqrt() * std::f64::consts::PI * sigma)).clamp(1.0, 1e4);
    let narrow = given_um.is_some_and(|given| given > 1.01 * resolved_um);
    let warning =
        || format!("lobes are narrower than the table's cells, which resolve a coherence of {resolved_um:.1} µm");
    (given_um.unwrap_or(resolved_um), narrow.then(warning).into_iter().collect())
}

impl<'a> Prepared<'a> {
    fn new(
        field: &'a HeightField,
        quality: &Quality,
        settings: &'a Settings,
        densities: usize,
        progress: &dyn Progress,
    ) -> Result<Self> {
        settings.check()?;
        settings.reflectance.check(RANGE_NM)?;
        let extent = extent(field);
        let length = extent * 1e3 / RANGE_NM[0];
        let request =
            Request { q: [0.0, TAU * 2e3 / RANGE_NM[0]], frequency: [length; 2], length, densities: densities as f64 };
        let (model, choice) = prepare(field, quality, request, settings, progress)?;
        Ok(Self { model, settings, choice, extent })
    }

    fn window(&self) -> Window {
        self.model.window
    }

    /// BRDF in 1/sr at a wave number in 1/µm; dark where the pixels of the height field carry no order.
    fn at(&self, light: Direction, view: Direction, number: f64, memory: &mut Memory) -> f64 {
        let pair = Pair::new(light, view);
        if light.z < GRAZING || view.z < GRAZING || pair.tangent[0].hypot(pair.tangent[1]) > self.extent {
            return 0.0;
        }
        let density = self.model.density(pair.tangent.map(|t| t * number), TAU * number * pair.w, memory).max(0.0);
        let factors = Factors::new(self.settings, light, self.model.mirror());
        density * factors.of(&pair, view) * factors.spectral(&pair, number)
    }

    /// BRDF in X, Y, Z of an illuminant; 1 at all wavelengths has Y = 1.
    fn xyz(&self, pair: [Direction; 2], samples: &Samples, memory: &mut Memory) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (number, weights) in samples.numbers.iter().zip(&samples.weights) {
            let value = self.at(pair[0], pair[1], *number, memory);
            sum.iter_mut().zip(weights).for_each(|(s, w)| *s += w * value);
        }
        sum
    }

    /// Wavelengths in steps over which a lobe of this window moves by less than its width.
    fn samples(&self) -> Result<Samples> {
        let light = Illuminant::of(&self.settings.illuminant)?;
        // Relative change of the wavelength that moves an order at the extent by one standard deviation of its lobe.
        let moved = self.window().sigma * MIDDLE_UM / self.extent.min(1.0);
        Ok(Samples::in_steps((1e3 * MIDDLE_UM * moved).clamp(1.0, 20.0), &light, self.settings.observer))
    }

    /// Error of a table: `table` interpolates its BRDF times the cosine of view, in Y, at a pair of directions.
    ///
    /// Pairs are drawn with the density of a table's entries: directions of light evenly in angle, half vectors densest
    /// near the normal. Half vectors within a radius, in the plane, are left out.
    fn compared(&self, samples: &Samples, radius: f64, table: &(dyn Fn([Direction; 2]) -> f64 + Sync)) -> f64 {
        let squares = |memory: &mut Memory, k: usize| {
            let mut stream = Stream::new(k, 0);
            let mut angle = |most: f64| most * stream.next();
            let light = Direction::new(angle(80_f64.to_radians()), angle(TAU));
            let (u, phi) = (angle(1.0), angle(TAU));
            let half = Direction::new(u * u * FRAC_PI_2, phi);
            let view = mirrored(light, half);
            if view.z < GRAZING || (light.x + view.x).hypot(light.y + view.y) < radius {
                return [0.0; 2];
            }
            let truth = self.xyz([light, view], samples, memory)[1] * view.z;
            let found = table([light, view]);
            [(found - truth).powi(2), truth * truth]
        };
        let sums = (0..COMPARED).into_par_iter().map_init(Memory::default, squares);
        let [off, all] = sums.reduce(|| [0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
        (off / all.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Radius in the half vector of the lobe in the mirror direction.
    fn mirror_lobe(&self) -> f64 {
        self.window().radius(1e-4) * RANGE_NM[1] / 1e3
    }

    /// Warning about directions that the pixels of the height field do not carry.
    fn warning(&self) -> Option<String> {
        let problem = "the pixels of the height field carry half vectors up to";
        (self.extent < 2.0).then(|| format!("{problem} {:.2}; beyond, the table is dark", self.extent))
    }
}

/// A direction mirrored at another.
fn mirrored(light: Direction, half: Direction) -> Direction {
    let twice = 2.0 * light.dot(half);
    Direction { x: twice * half.x - light.x, y: twice * half.y - light.y, z: twice * half.z - light.z }
}

/// Unit half vector of two directions, as angle from the normal and azimuth in rad.
fn half_angles([light, view]: [Direction; 2]) -> [f64; 2] {
    let (x, y, z) = (light.x + view.x, light.y + view.y, light.z + view.z);
    [x.hypot(y).atan2(z), y.atan2(x)]
}

/// Checks a number of entries.
///
/// # Errors
/// `Input` for a number out of range.
fn check_size(name: &str, value: usize, range: std::ops::RangeInclusive<usize>) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(Error::input(name, format!("is {value}"), format!("give {} to {}", range.start(), range.end())))
}
