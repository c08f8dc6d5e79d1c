//! Isotropic table in the format of the MERL set (Matusik et al., "A data-driven reflectance model", 2003).
//!
//! It has 90 × 90 × 180 entries over the half vector's angle, and the difference vector's angle and azimuth.

use super::{GRAZING, OUTSIDE, Prepared, Table, coherence};
use crate::brdf::Factors;
use crate::engine::Memory;
use crate::geometry::{Direction, Pair};
use crate::height::{HeightField, Quality};
use crate::settings::Settings;
use crate::spectral::{RANGE_NM, Samples};
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_image::write_whole;
use nacre_optics::color::{Illuminant, linear_srgb};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

/// Entries over the half vector's angle, the difference vector's angle, and its azimuth up to 180°.
pub(super) const SHAPE: [usize; 3] = [90, 90, 180];

/// Units of red, green and blue in the set's files.
pub(super) const UNITS: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

/// Entry of directions below the surface.
const BELOW: f64 = -1.0;

/// Azimuths over which the power density is averaged.
const AZIMUTHS: usize = 90;

/// Largest deviation of an isotropic BRDF from its mean over azimuths (root mean square over that of the mean). Speckle
/// of a patch of some 100 µm² reaches 0.35; gratings deviate by more than 1.
const ISOTROPIC: f64 = 0.5;

/// Pairs of directions at which isotropy is tested.
const TESTED: usize = 300;

/// Computes the table as a mean over azimuths.
///
/// # Errors
/// `Input` for a surface that is not isotropic, and in the cases of [`map`](crate::map). `Output` if the file cannot be
/// written.
pub fn merl(
    field: &HeightField,
    quality: &Quality,
    settings: &Settings,
    coherence_um: Option<f64>,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Table> {
    // A half vector that is tilted by a degree has twice its sine in the plane.
    let (coherence_um, mut warnings) = coherence(coherence_um, 2.0 * PI / 180.0);
    let settings = Settings { coherence_um, ..settings.clone() };
    let prepared = Prepared::new(field, quality, &settings, 100_000 * AZIMUTHS, progress)?;
    let samples = prepared.samples()?;
    progress.stage("mean over azimuths", 1);
    let rings = Rings::new(&prepared, quality.range_um);
    progress.check()?;
    let mean = |pair: [Direction; 2]| rings.xyz(&prepared, pair, &samples);
    let off = deviation(&prepared, &samples, &mean);
    if off > ISOTROPIC {
        let problem = format!("is not isotropic: its BRDF is {:.0} % off its mean over azimuths", 100.0 * off);
        return Err(Error::input(&field.name, problem, "give --format mitsuba, which holds azimuths"));
    }
    let white = Illuminant::of(&settings.illuminant)?.white(settings.observer).unwrap_or([1.0; 3]);
    let white = linear_srgb(white.map(|v| v as f32));
    let rgb = |xyz: [f64; 3]| {
        let linear = linear_srgb(xyz.map(|v| v as f32));
        [0, 1, 2].map(|c| f64::from((linear[c] / white[c]).max(0.0)))
    };
    progress.stage("half vectors", SHAPE[0] as u64);
    let rows: Vec<Vec<[f64; 3]>> = (0..SHAPE[0])
        .into_par_iter()
        .map(|h| {
            let row = (0..SHAPE[1] * SHAPE[2]).map(|k| match pair_of(h, k / SHAPE[2], k % SHAPE[2]) {
                Some(pair) if !progress.cancelled() => rgb(mean(pair)),
                _ => [BELOW; 3],
            });
            let row = row.collect();
            progress.step();
            row
        })
        .collect();
    progress.check()?;
    let table: Vec<[f64; 3]> = rows.into_iter().flatten().collect();
    let mut bytes: Vec<u8> = SHAPE.iter().flat_map(|n| (*n as i32).to_le_bytes()).collect();
    for (c, unit) in UNITS.iter().enumerate() {
        bytes.extend(table.iter().flat_map(|v| if v[c] < 0.0 { v[c] } else { v[c] / unit }.to_le_bytes()));
    }
    write_whole(out, &bytes)?;
    warnings.extend(prepared.warning());
    warnings.push(format!(
        "a mean over azimuths: the BRDF differs from it by {:.0} % (speckle of the patch, and anisotropy)",
        100.0 * off
    ));
    let (choice, extent) = (prepared.choice, prepared.extent);
    Ok(Table { choice, shape: SHAPE.to_vec(), coherence_um, extent, error: off, error_of: OUTSIDE, warnings })
}

/// Power density averaged over azimuths. It depends on the magnitude of the spatial frequency and on q = 2πw/λ only, so
/// that a small table serves all pairs of directions.
struct Rings {
    /// Steps of the magnitude of the frequency and of q, both in 1/µm.
    steps: [f64; 2],
    /// Number of values of q.
    along: usize,
    values: Vec<f64>,
}

impl Rings {
    /// `relief_um` is the range of heights: power densities oscillate with q times a height.
    fn new(prepared: &Prepared<'_>, relief_um: f64) -> Self {
        let steps = [0.5 * prepared.window().sigma, 0.5 / relief_um.max(0.01)];
        let most = [prepared.extent, 2.0 * TAU].map(|v| v * 1e3 / RANGE_NM[0]);
        let [rings, along] = [0, 1].map(|k| (most[k] / steps[k]) as usize + 2);
        let value = |memory: &mut Memory, k: usize| {
            let [frequency, q] = [k / along, k % along].map(|n| n as f64);
            let [frequency, q] = [(frequency * steps[0]).min(most[0]), (q * steps[1]).min(most[1])];
            let at = |k: usize| {
                let (sin, cos) = (TAU * k as f64 / AZIMUTHS as f64).sin_cos();
                [frequency * cos, frequency * sin]
            };
            (0..AZIMUTHS).map(|k| prepared.model.density(at(k), q, memory).max(0.0)).sum::<f64>() / AZIMUTHS as f64
        };
        let values = (0..rings * along).into_par_iter().map_init(Memory::default, value).collect();
        Self { steps, along, values }
    }

    /// Interpolated density.
    fn at(&self, frequency: f64, q: f64) -> f64 {
        let last = [self.values.len() / self.along, self.along].map(|n| n - 2);
        let place = |value: f64, k: usize| {
            let at = value / self.steps[k];
            let low = (at as usize).min(last[k]);
            (low, (at - low as f64).min(1.0))
        };
        let ((i, u), (j, v)) = (place(frequency, 0), place(q, 1));
        let row = |i: usize| self.values[i * self.along + j] * (1.0 - v) + self.values[i * self.along + j + 1] * v;
        row(i) * (1.0 - u) + row(i + 1) * u
    }

    /// BRDF in X, Y, Z, averaged over azimuths.
    fn xyz(&self, prepared: &Prepared<'_>, [light, view]: [Direction; 2], samples: &Samples) -> [f64; 3] {
        let pair = Pair::new(light, view);
        let length = pair.tangent[0].hypot(pair.tangent[1]);
        if light.z < GRAZING || view.z < GRAZING || length > prepared.extent {
            return [0.0; 3];
        }
        let factors = Factors::new(prepared.settings, light, prepared.model.mirror());
        let mut sum = [0.0; 3];
        for (number, weights) in samples.numbers.iter().zip(&samples.weights) {
            let value = self.at(length * number, TAU * pair.w * number) * factors.spectral(&pair, *number);
            sum.iter_mut().zip(weights).for_each(|(s, w)| *s += w * value);
        }
        sum.map(|s| s * factors.of(&pair, view))
    }
}

/// Root mean square deviation of the BRDF from its mean over azimuths.
fn deviation(prepared: &Prepared<'_>, samples: &Samples, mean: &(dyn Fn([Direction; 2]) -> [f64; 3] + Sync)) -> f64 {
    let squares = |memory: &mut Memory, k: usize| {
        let mut stream = Stream::new(k, 1);
        let index = SHAPE.map(|n| stream.below(n));
        let Some(pair) = pair_of(index[0], index[1], index[2]) else { return [0.0; 2] };
        if (pair[0].x + pair[1].x).hypot(pair[0].y + pair[1].y) < prepared.mirror_lobe() {
            return [0.0; 2];
        }
        let angle = TAU * stream.next();
        let pair = pair.map(|d| turned(d, angle));
        let (one, all) = (prepared.xyz(pair, samples, memory)[1], mean(pair)[1]);
        let cosines = (pair[0].z * pair[1].z).powi(2);
        [(one - all).powi(2) * cosines, all * all * cosines]
    };
    let sums = (0..TESTED).into_par_iter().map_init(Memory::default, squares);
    let [off, all] = sums.reduce(|| [0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    (off / all.max(f64::MIN_POSITIVE)).sqrt()
}

/// Directions of an entry's middle; `None` if one is below the surface.
pub(super) fn pair_of(h: usize, d: usize, p: usize) -> Option<[Direction; 2]> {
    // Angles of half vectors are square roots, to resolve highlights.
    let theta_h = ((h as f64 + 0.5) / SHAPE[0] as f64).powi(2) * FRAC_PI_2;
    let theta_d = (d as f64 + 0.5) / SHAPE[1] as f64 * FRAC_PI_2;
    let phi_d = (p as f64 + 0.5) / SHAPE[2] as f64 * PI;
    let difference = Direction::new(theta_d, phi_d);
    let tilted = |d: Direction| {
        let (sin, cos) = theta_h.sin_cos();
        Direction { x: d.x * cos + d.z * sin, y: d.y, z: d.z * cos - d.x * sin }
    };
    let pair = [difference, Direction { x: -difference.x, y: -difference.y, z: difference.z }].map(tilted);
    pair.iter().all(|d| d.z > 0.0).then_some(pair)
}

/// A direction turned around the normal by an angle in rad.
pub(super) fn turned(d: Direction, angle: f64) -> Direction {
    let (sin, cos) = angle.sin_cos();
    Direction { x: d.x * cos - d.y * sin, y: d.x * sin + d.y * cos, z: d.z }
}
