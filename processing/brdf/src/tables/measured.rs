//! Tensor of Mitsuba's `measured` material (Dupuy and Jakob, "An adaptive parameterization for efficient material
//! acquisition and rendering", 2018).
//!
//! Entries lie at half vectors: θ = u²π/2 and φ = (2v - 1)π. The paper's warp by visible normals is the identity here,
//! as it would gather entries around one mirror-like lobe; `luminance` alone directs the samples.

use super::{EVERYWHERE, Prepared, Table, check_size, coherence, half_angles, mirrored};
use crate::engine::Memory;
use crate::geometry::Direction;
use crate::height::{HeightField, Quality};
use crate::settings::Settings;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::write_whole;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

/// Largest angle of incidence in rad; beyond it, Mitsuba repeats the last entries.
const STEEPEST: f64 = 80.0 / 180.0 * PI;

/// Part of the mean density that every direction gets, also dark ones: between entries, there may be light.
const FLOOR: f64 = 0.02;

/// Largest size of the tensor in bytes.
const MOST_BYTES: usize = 1 << 30;

/// Type codes of the tensor file.
const UINT8: u8 = 1;
const FLOAT32: u8 = 10;

/// Grid of the tensor.
struct Grid {
    /// Angles of incidence and azimuths in rad; the last azimuth repeats the first.
    theta: Vec<f64>,
    phi: Vec<f64>,
    /// Entries along a side of the half vectors.
    size: usize,
    /// Wave numbers in 1/µm from short to long wavelengths, and their weights in Y.
    numbers: Vec<f64>,
    weights: Vec<f64>,
}

impl Grid {
    /// Half vector of an entry.
    fn half(&self, x: usize, y: usize) -> Direction {
        let at = |k: usize| k as f64 / (self.size - 1) as f64;
        Direction::new(at(x) * at(x) * FRAC_PI_2, (2.0 * at(y) - 1.0) * PI)
    }

    /// Number of values for one direction of light.
    fn slice(&self) -> usize {
        self.numbers.len() * self.size * self.size
    }
}

/// Computes the tensor with `size` × `size` half vectors, for `angles` polar angles and azimuths of the light.
///
/// # Errors
/// `Input` for sizes out of range, and as [`map`](crate::map); `Output` if the file cannot be written.
pub fn measured(
    field: &HeightField,
    quality: &Quality,
    settings: &Settings,
    coherence_um: Option<f64>,
    (size, angles): (usize, [usize; 2]),
    out: &Path,
    progress: &dyn Progress,
) -> Result<Table> {
    check_size("size", size, 8..=512)?;
    check_size("angles", angles[0], 2..=90)?;
    check_size("angles", angles[1], 4..=360)?;
    // Cells are widest along the azimuth. Most of the light is within this magnitude of the half vector.
    const MIDDLE: f64 = 0.75;
    let (coherence_um, mut warnings) = coherence(coherence_um, MIDDLE * TAU / size as f64);
    let settings = Settings { coherence_um, ..settings.clone() };
    let densities = 20 * size * size * angles[0] * angles[1];
    let prepared = Prepared::new(field, quality, &settings, densities, progress)?;
    let samples = prepared.samples()?;
    let grid = Grid {
        theta: (0..angles[0]).map(|k| STEEPEST * k as f64 / (angles[0] - 1) as f64).collect(),
        phi: (0..=angles[1]).map(|k| (2.0 * k as f64 / angles[1] as f64 - 1.0) * PI).collect(),
        size,
        numbers: samples.numbers.iter().rev().copied().collect(),
        weights: samples.weights.iter().rev().map(|w| w[1]).collect(),
    };
    let bytes = 4 * (grid.slice() + size * size) * grid.theta.len() * grid.phi.len();
    if bytes > MOST_BYTES {
        let problem = format!("would have {:.1} GB", bytes as f64 / 1e9);
        return Err(Error::input(
            "size",
            problem,
            "give a smaller --size, fewer --angles, or a smaller --coherence-um",
        ));
    }
    let spectra = spectra(&prepared, &grid, progress)?;
    let error = prepared.compared(&samples, 0.0, &|pair| interpolated(&grid, &spectra, pair));
    let luminance = luminance(&grid, &spectra);
    write_whole(out, &tensor(&grid, &spectra, &luminance, &field.name))?;
    warnings.extend(prepared.warning());
    Ok(Table {
        choice: prepared.choice,
        shape: vec![grid.phi.len(), grid.theta.len(), grid.numbers.len(), size, size],
        coherence_um,
        extent: prepared.extent,
        error,
        error_of: EVERYWHERE,
        warnings,
    })
}

/// BRDF times the cosine of view, for azimuth, angle, wavelength, and rows of half vectors.
fn spectra(prepared: &Prepared<'_>, grid: &Grid, progress: &dyn Progress) -> Result<Vec<f32>> {
    let (slice, cells) = (grid.slice(), grid.size * grid.size);
    let mut spectra = vec![0.0; slice * grid.theta.len() * grid.phi.len()];
    let distinct = grid.theta.len() * (grid.phi.len() - 1);
    progress.stage("directions of light", distinct as u64);
    spectra[..slice * distinct].par_chunks_mut(slice).enumerate().for_each_init(Memory::default, |memory, (k, out)| {
        if progress.cancelled() {
            return;
        }
        let light = Direction::new(grid.theta[k % grid.theta.len()], grid.phi[k / grid.theta.len()]);
        for place in 0..cells {
            let view = mirrored(light, grid.half(place % grid.size, place / grid.size));
            for (w, number) in grid.numbers.iter().enumerate() {
                let value = prepared.at(light, view, *number, memory) * view.z;
                out[w * cells + place] = value as f32;
            }
        }
        progress.step();
    });
    progress.check()?;
    spectra.copy_within(..slice * grid.theta.len(), slice * distinct);
    Ok(spectra)
}

/// Densities by which Mitsuba draws half vectors: luminance times the Jacobian of the parameters.
fn luminance(grid: &Grid, spectra: &[f32]) -> Vec<f32> {
    let cells = grid.size * grid.size;
    let of_light = |(k, slice): (usize, &[f32])| {
        let light = Direction::new(grid.theta[k % grid.theta.len()], grid.phi[k / grid.theta.len()]);
        let mut values: Vec<f64> = (0..cells)
            .map(|place| {
                let y: f64 =
                    (0..grid.numbers.len()).map(|w| grid.weights[w] * f64::from(slice[w * cells + place])).sum();
                let half = grid.half(place % grid.size, place / grid.size);
                let u = (place % grid.size) as f64 / (grid.size - 1) as f64;
                y * u * half.x.hypot(half.y) * light.dot(half).max(0.0)
            })
            .collect();
        let floor = FLOOR * values.iter().sum::<f64>() / cells as f64;
        values.iter_mut().for_each(|v| *v += floor);
        values.into_iter().map(|v| v as f32).collect::<Vec<f32>>()
    };
    spectra.par_chunks(grid.slice()).enumerate().flat_map_iter(of_light).collect()
}

/// Linear interpolation, as in Mitsuba: Y of the BRDF times the cosine of view.
fn interpolated(grid: &Grid, spectra: &[f32], [light, view]: [Direction; 2]) -> f64 {
    let [theta_m, phi_m] = half_angles([light, view]);
    let place = |value: f64, last: usize| {
        let at = (value * last as f64).clamp(0.0, last as f64);
        let low = (at as usize).min(last - 1);
        (low, at - low as f64)
    };
    let phi = place((light.y.atan2(light.x) / PI + 1.0) / 2.0, grid.phi.len() - 1);
    let theta = place(light.z.acos() / STEEPEST, grid.theta.len() - 1);
    let x = place((theta_m / FRAC_PI_2).sqrt(), grid.size - 1);
    let y = place((phi_m / PI + 1.0) / 2.0, grid.size - 1);
    let mut sum = 0.0;
    for corner in 0..16 {
        let axis = |k: usize, (low, part): (usize, f64)| {
            if corner >> k & 1 == 1 { (low + 1, part) } else { (low, 1.0 - part) }
        };
        let corners = [axis(0, phi), axis(1, theta), axis(2, y), axis(3, x)];
        let weight: f64 = corners.iter().map(|c| c.1).product();
        let [p, t, y, x] = corners.map(|c| c.0);
        let first = (p * grid.theta.len() + t) * grid.slice() + y * grid.size + x;
        for (w, of_y) in grid.weights.iter().enumerate() {
            sum += weight * of_y * f64::from(spectra[first + w * grid.size * grid.size]);
        }
    }
    sum
}

/// The file: a header, the fields' names, types, places and shapes, and their data.
fn tensor(grid: &Grid, spectra: &[f32], luminance: &[f32], name: &str) -> Vec<u8> {
    let (phi, theta, size) = (grid.phi.len(), grid.theta.len(), grid.size);
    let ones = vec![1.0_f32; 4 * phi * theta];
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let doubles = |values: &[f64]| floats(&values.iter().map(|v| *v as f32).collect::<Vec<_>>());
    let nm: Vec<f64> = grid.numbers.iter().map(|n| 1e3 / n).collect();
    let description = format!("{name}, computed by Nacre").into_bytes();
    let fields: Vec<(&str, u8, Vec<usize>, Vec<u8>)> = vec![
        ("description", UINT8, vec![description.len()], description),
        ("jacobian", UINT8, vec![1], vec![0]),
        ("theta_i", FLOAT32, vec![theta], doubles(&grid.theta)),
        ("phi_i", FLOAT32, vec![phi], doubles(&grid.phi)),
        ("wavelengths", FLOAT32, vec![nm.len()], doubles(&nm)),
        ("ndf", FLOAT32, vec![2, 2], floats(&ones[..4])),
        ("sigma", FLOAT32, vec![2, 2], floats(&ones[..4])),
        ("vndf", FLOAT32, vec![phi, theta, 2, 2], floats(&ones)),
        ("luminance", FLOAT32, vec![phi, theta, size, size], floats(luminance)),
        ("spectra", FLOAT32, vec![phi, theta, nm.len(), size, size], floats(spectra)),
    ];
    let head = 18 + fields.iter().map(|f| 2 + f.0.len() + 2 + 1 + 8 + 8 * f.2.len()).sum::<usize>();
    let mut bytes = b"tensor_file\0\x01\0".to_vec();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let mut place = head.next_multiple_of(8);
    for (name, kind, shape, data) in &fields {
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend((shape.len() as u16).to_le_bytes());
        bytes.push(*kind);
        bytes.extend((place as u64).to_le_bytes());
        shape.iter().for_each(|n| bytes.extend((*n as u64).to_le_bytes()));
        place = (place + data.len()).next_multiple_of(8);
    }
    for (.., data) in &fields {
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes.extend(data);
    }
    bytes
}
