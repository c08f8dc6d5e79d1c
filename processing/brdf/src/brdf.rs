//! BRDFs from power densities: maps over viewing directions in X, Y, Z, and spectra along a slice.

use super::choose::{Choice, STEP, WINDOW, check_pitch, prepare};
use super::engine::{Memory, Model, Request};
use super::geometry::{Direction, Pair, Window};
use super::height::{HeightField, Quality};
use super::settings::{Method, Normalisation, SIZES, Settings};
use super::spectral::{RANGE_NM, Samples, Wavelengths};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_optics::color::Illuminant;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;

/// Smallest cosine of a direction. Beyond, 1/cos θr of the BRDF diverges.
const GRAZING: f64 = 1e-3;

/// Viewing directions of a map: a square of `(x, y) = sin θ (cos φ, sin φ)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Views {
    /// Pixels per side.
    pub size: usize,
    /// Centre of the square.
    pub center: [f64; 2],
    /// Half of its side; 1 for all directions.
    pub half: f64,
}

impl Views {
    /// All directions.
    pub fn all(size: usize) -> Self {
        Self { size, center: [0.0; 2], half: 1.0 }
    }

    /// Checks size, centre and extent.
    ///
    /// # Errors
    /// `Input` for values out of range.
    pub fn check(&self) -> Result<()> {
        if !SIZES.contains(&self.size) {
            return Err(Error::input("size", format!("is {}", self.size), "give 8 to 4096"));
        }
        if !(1e-4..=1.0).contains(&self.half) {
            return Err(Error::input("zoom", format!("is {}", 1.0 / self.half), "give 1 to 10000"));
        }
        if !self.center.iter().all(|c| c.abs() <= 1.0) {
            let problem = format!("is at {}, {}", self.center[0], self.center[1]);
            return Err(Error::input("center", problem, "give two sines of -1 to 1"));
        }
        Ok(())
    }

    /// Direction of a pixel's centre; `None` outside of the hemisphere.
    pub(super) fn direction(&self, x: usize, y: usize) -> Option<Direction> {
        let at = |k: usize| ((2.0 * k as f64 + 1.0) / self.size as f64 - 1.0) * self.half;
        Direction::of(self.center[0] + at(x), self.center[1] - at(y)).filter(|d| d.z >= GRAZING)
    }
}

/// Map of one direction of light.
pub struct Map {
    /// Viewing directions of the map.
    pub views: Views,
    /// Pixels per side.
    pub size: usize,
    /// X, Y, Z row by row from the top, y up; NaN outside of the hemisphere.
    pub xyz: Vec<[f32; 3]>,
    /// Method of computation.
    pub choice: Choice,
    /// Largest relative error of lobes that hold at least 0.1 % of the light, from all sources together.
    pub error_estimate: f64,
    /// Number of evaluated densities.
    pub densities: f64,
}

/// Spectra along a half circle of directions.
pub struct Slice {
    /// Wavelengths in nm.
    pub wavelengths_nm: Vec<f64>,
    /// Angles from the normal in degrees, positive towards the azimuth.
    pub theta_deg: Vec<f64>,
    /// BRDF (1/sr) or relative reflectance, wavelength by wavelength; NaN at grazing angles.
    pub values: Vec<f64>,
    /// Method of computation.
    pub choice: Choice,
    /// Largest relative error of lobes that hold at least 0.1 % of the light.
    pub error_estimate: f64,
}

/// Factors from a power density to a result.
pub(super) struct Factors<'a> {
    settings: &'a Settings,
    light: Direction,
    mirror: f64,
}

impl<'a> Factors<'a> {
    pub(super) fn new(settings: &'a Settings, light: Direction, mirror: f64) -> Self {
        Self { settings, light, mirror }
    }

    /// Factor of a pair of directions that does not depend on the wavelength.
    pub(super) fn of(&self, pair: &Pair, view: Direction) -> f64 {
        let shadow = if self.settings.shadowing { Pair::v_grooves(self.light, view) } else { 1.0 };
        let scale = match self.settings.normalisation {
            Normalisation::Brdf => 1.0,
            Normalisation::Relative => 1.0 / self.mirror,
        };
        pair.gain * shadow * scale
    }

    /// Factor that depends on the wavelength: reflectance and, for a BRDF, 1/λ².
    pub(super) fn spectral(&self, pair: &Pair, number: f64) -> f64 {
        let nm = 1e3 / number;
        let r = self.settings.reflectance.at(pair.half_cos, nm);
        match self.settings.normalisation {
            Normalisation::Brdf => r * number * number,
            Normalisation::Relative => r / self.settings.reflectance.at(self.light.z, nm).max(1e-12),
        }
    }
}

/// Sum over wavelengths for one viewing direction.
struct Summing<'a> {
    model: &'a Model<'a>,
    factors: Factors<'a>,
    wavelengths: &'a Wavelengths,
    window: Window,
    step_error: f64,
    /// Wavelengths in the requested steps.
    stepped: Option<&'a Samples>,
}

impl Summing<'_> {
    fn samples(&self, pair: &Pair) -> &Samples {
        if let Some(stepped) = self.stepped {
            return stepped;
        }
        self.wavelengths.of(pair.tangent[0].hypot(pair.tangent[1]), self.window, self.step_error)
    }

    fn xyz(&self, view: Direction, memory: &mut Memory) -> [f64; 3] {
        let pair = Pair::new(self.factors.light, view);
        let samples = self.samples(&pair);
        let mut sum = [0.0; 3];
        let mut add = |k: usize, memory: &mut Memory| {
            let number = samples.numbers[k];
            let density = self.model.density(pair.tangent.map(|t| t * number), TAU * number * pair.w, memory);
            if density > 0.0 {
                let value = density * self.factors.spectral(&pair, number);
                sum.iter_mut().zip(samples.weights[k]).for_each(|(s, w)| *s += w * value);
            }
        };
        let count = samples.numbers.len();
        if let Some(lattice) = self.model.lattice.as_ref().filter(|_| self.stepped.is_none()) {
            let first = samples.numbers[0];
            let (step, last) = ((samples.numbers[count - 1] - first) / (count - 1) as f64, count - 1);
            let mut next = 0;
            for [low, high] in lattice.ranges(pair.tangent, [first, samples.numbers[last]], self.model.radius) {
                // The range is slightly widened, so that rounding loses no sample; no sample is counted twice.
                let from = (((low - first) / step - 1e-6).ceil().max(0.0) as usize).max(next);
                let to = (((high - first) / step + 1e-6).floor().max(-1.0) as isize).min(last as isize);
                for k in from as isize..=to {
                    add(k as usize, memory);
                    next = k as usize + 1;
                }
            }
        } else {
            (0..count).for_each(|k| add(k, memory));
        }
        sum.map(|s| s * self.factors.of(&pair, view))
    }
}

/// Computes a map of reflected X, Y, Z over viewing directions.
///
/// A BRDF of 1 (or a relative reflectance of 1) at all wavelengths gives Y = 1 in the colour of the illuminant.
///
/// # Errors
/// `Input` for invalid settings, a pixel pitch that is too coarse, and methods that do not apply to the surface.
pub fn map(
    field: &HeightField,
    quality: &Quality,
    settings: &Settings,
    views: Views,
    progress: &dyn Progress,
) -> Result<Map> {
    let (light, window) = settings.check()?;
    views.check()?;
    let size = views.size;
    settings.reflectance.check(RANGE_NM)?;
    let illuminant = Illuminant::of(&settings.illuminant)?;
    let step_error = STEP * settings.max_error;
    let edge = 1.0 + light.x.hypot(light.y);
    let wavelengths =
        Wavelengths::new(&illuminant, settings.observer, window.step(edge, step_error), 0.1 * settings.max_error)?;
    let mut request = Request {
        q: [TAU * 1e3 / RANGE_NM[1] * light.z, TAU * 1e3 / RANGE_NM[0] * (1.0 + light.z)],
        frequency: [light.x, light.y].map(|c| (1.0 + c.abs()) * 1e3 / RANGE_NM[0]),
        length: edge * 1e3 / RANGE_NM[0],
        densities: 0.0,
    };
    check_pitch(field, &request)?;
    // A coarse grid of directions estimates the number of wavelengths.
    const LOOK: usize = 48;
    let mut looked = 0.0;
    for k in 0..LOOK * LOOK {
        if let Some(view) = (Views { size: LOOK, ..views }).direction(k % LOOK, k / LOOK) {
            let tangent = Pair::new(light, view).tangent;
            looked += wavelengths.of(tangent[0].hypot(tangent[1]), window, step_error).numbers.len() as f64;
        }
    }
    request.densities = looked * (size * size) as f64 / (LOOK * LOOK) as f64;
    let (model, mut choice) = prepare(field, quality, request, settings, progress)?;
    let stepped = settings.wavelength_step_nm.map(|nm| Samples::in_steps(nm, &illuminant, settings.observer));
    let summing = |stepped| {
        let factors = Factors::new(settings, light, model.mirror());
        Summing { model: &model, factors, wavelengths: &wavelengths, window, step_error, stepped }
    };
    let (exact, summing) = (summing(None), summing(stepped.as_ref()));
    progress.stage("directions of view", size as u64);
    let mut xyz = vec![[f32::NAN; 3]; size * size];
    xyz.par_chunks_mut(size).enumerate().for_each_init(Memory::default, |memory, (y, row)| {
        if progress.cancelled() {
            return;
        }
        for (x, out) in row.iter_mut().enumerate() {
            if let Some(view) = views.direction(x, y) {
                *out = summing.xyz(view, memory).map(|v| v as f32);
            }
        }
        progress.step();
    });
    progress.check()?;
    let mut of_wavelengths = step_error + wavelengths.color_error;
    if let Some(nm) = settings.wavelength_step_nm {
        of_wavelengths = compared(&exact, &xyz, views);
        choice.why += &format!(
            "; wavelengths in steps of {nm} nm, as asked for: {:.3} % off (root mean square, measured)",
            100.0 * of_wavelengths
        );
    }
    let error_estimate = choice.predicted_error.max(choice.measured_error.unwrap_or(0.0))
        + if settings.method == Method::Reference { 0.0 } else { WINDOW * settings.max_error }
        + of_wavelengths;
    Ok(Map { views, size, xyz, choice, error_estimate, densities: request.densities })
}

/// Relative root mean square difference of a map from a sum over wavelengths with the steps that each direction needs.
/// It covers all directions of small maps, and about 4096 of large ones.
fn compared(exact: &Summing<'_>, xyz: &[[f32; 3]], views: Views) -> f64 {
    const SIDE: usize = 64;
    let step = (views.size / SIDE).max(1);
    let places = (0..views.size).step_by(step).flat_map(|y| (0..views.size).step_by(step).map(move |x| [x, y]));
    let squares = |memory: &mut Memory, [x, y]: [usize; 2]| -> [f64; 2] {
        let Some(view) = views.direction(x, y) else { return [0.0; 2] };
        let (truth, found) = (exact.xyz(view, memory), xyz[y * views.size + x]);
        let all = truth.iter().zip(found).map(|(t, f)| [(t - f64::from(f)).powi(2), t * t]);
        all.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d])
    };
    let places: Vec<[usize; 2]> = places.collect();
    let sums = places.par_iter().map_init(Memory::default, |memory, place| squares(memory, *place));
    let [off, all] = sums.reduce(|| [0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    (off / all.max(f64::MIN_POSITIVE)).sqrt()
}

/// Computes spectra along a half circle of viewing directions in the plane of an azimuth (degrees; default: that of the
/// light).
///
/// # Errors
/// As [`map`].
pub fn slice(
    field: &HeightField,
    quality: &Quality,
    settings: &Settings,
    [wavelengths_nm, theta_deg]: [&[f64]; 2],
    azimuth_deg: Option<f64>,
    progress: &dyn Progress,
) -> Result<Slice> {
    let (light, _) = settings.check()?;
    let [shortest, longest] = ends("wavelengths", wavelengths_nm, [200.0, 2000.0])?;
    ends("views", theta_deg, [-90.0, 90.0])?;
    settings.reflectance.check([shortest, longest])?;
    let phi = azimuth_deg.unwrap_or(settings.light_deg[1]).to_radians();
    let views: Vec<Option<Direction>> =
        theta_deg.iter().map(|t| Some(Direction::new(t.to_radians(), phi)).filter(|d| d.z >= GRAZING)).collect();
    let pairs: Vec<Option<Pair>> = views.iter().map(|v| v.map(|v| Pair::new(light, v))).collect();
    let known = || pairs.iter().flatten();
    let [least, most] = known().fold([f64::INFINITY, 0.0_f64], |[a, b], p| [a.min(p.w), b.max(p.w)]);
    let request = Request {
        q: [TAU * 1e3 / longest * least.min(most), TAU * 1e3 / shortest * most],
        frequency: [0, 1].map(|k| known().map(|p| p.tangent[k].abs()).fold(0.0, f64::max) * 1e3 / shortest),
        length: known().map(|p| p.tangent[0].hypot(p.tangent[1])).fold(0.0, f64::max) * 1e3 / shortest,
        densities: (wavelengths_nm.len() * known().count()) as f64,
    };
    if known().next().is_none() {
        return Err(Error::input("views", "are all grazing", "give angles between -90 and 90 degrees"));
    }
    let (model, choice) = prepare(field, quality, request, settings, progress)?;
    let factors = Factors::new(settings, light, model.mirror());
    progress.stage("wavelengths", wavelengths_nm.len() as u64);
    let mut values = vec![f64::NAN; wavelengths_nm.len() * theta_deg.len()];
    values.par_chunks_mut(theta_deg.len()).zip(wavelengths_nm).for_each_init(Memory::default, |memory, (row, nm)| {
        if progress.cancelled() {
            return;
        }
        let number = 1e3 / nm;
        for (out, (pair, view)) in row.iter_mut().zip(pairs.iter().zip(&views)) {
            if let (Some(pair), Some(view)) = (pair, view) {
                let density = model.density(pair.tangent.map(|t| t * number), TAU * number * pair.w, memory);
                *out = density * factors.of(pair, *view) * factors.spectral(pair, number);
            }
        }
        progress.step();
    });
    progress.check()?;
    let error_estimate = choice.predicted_error.max(choice.measured_error.unwrap_or(0.0));
    Ok(Slice { wavelengths_nm: wavelengths_nm.to_vec(), theta_deg: theta_deg.to_vec(), values, choice, error_estimate })
}

/// Minimum and maximum of a list, all of whose numbers must be within limits.
pub(super) fn ends(what: &str, values: &[f64], [low, high]: [f64; 2]) -> Result<[f64; 2]> {
    if let Some(bad) = values.iter().find(|v| !(low..=high).contains(*v)) {
        return Err(Error::input(what, format!("hold {bad}"), format!("give numbers from {low} to {high}")));
    }
    if values.is_empty() || values.len() > 1_000_000 {
        return Err(Error::input(what, format!("are {} numbers", values.len()), "give 1 to 1000000"));
    }
    Ok(values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)]))
}
