//! The full integral for surfaces that face the viewer. The kernel of a result row does not depend on azimuth, so each
//! pair of rows is one circular correlation along the rows.

use super::{Environment, Table};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_fourier::{FftError, real_forward, real_inverse};
use num_complex::Complex32;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Resolution of the sum over the environment: a subpixel spans at most this many table cells.
const CELLS: f64 = 1.5;

/// Maximum number of subpixels along a pixel side.
const PARTS: usize = 15;

/// Reflection of an environment by surfaces that face each direction of a sphere, with the table's direction `meridian`
/// (radians) towards +z. The table may be non-separable. The sum covers all pixels, or subpixels where the table is
/// finer.
///
/// # Errors
/// `Input` if a transform fails; `Cancelled`.
pub fn facing(
    environment: &Environment,
    table: &Table,
    meridian: f64,
    progress: &dyn Progress,
) -> Result<Vec<[f32; 3]>> {
    let (width, height) = (environment.width, environment.height);
    // An odd number, so that the centre of a pixel is the centre of a subpixel.
    let fine = (PI / height as f64 / (CELLS * table.cell())).ceil().max(1.0) as usize;
    let fine = (fine + 1 - fine % 2).min(PARTS);
    let columns = width * fine;
    let (forward, inverse) = (real_forward(columns), real_inverse(columns));
    let failed = |e: FftError| Error::input("environment", e, "give one of another width");
    let bins = columns / 2 + 1;
    let edge = |y: usize| (PI * y as f64 / (height * fine) as f64).cos();
    let spectra = |y: usize| -> Result<[Vec<Complex32>; 3]> {
        // The mean height of a row is that of its centroid.
        let polar = (0.5 * (edge(y) + edge(y + 1))).acos() / PI * height as f64;
        let light = |x: usize| environment.radiance(environment.direction((x as f64 + 0.5) / fine as f64, polar));
        let row: Vec<[f32; 3]> = (0..columns).map(light).collect();
        let mut spectra = [const { vec![] }; 3];
        for (c, spectrum) in spectra.iter_mut().enumerate() {
            let mut row: Vec<f32> = row.iter().map(|p| p[c]).collect();
            *spectrum = vec![Complex32::default(); bins];
            forward.process(&mut row, spectrum).map_err(failed)?;
        }
        Ok(spectra)
    };
    let sky = (0..height * fine).into_par_iter().map(spectra).collect::<Result<Vec<_>>>()?;
    let azimuths: Vec<[f64; 2]> = (0..columns).map(|d| (-TAU * d as f64 / columns as f64).sin_cos().into()).collect();
    let polar = |y: usize| (PI * (y as f64 + 0.5) / height as f64).sin_cos();
    let (s, c) = meridian.sin_cos();
    let row = |y: usize| -> Result<Vec<[f32; 3]>> {
        progress.check()?;
        let (sin, cos) = polar(y);
        let mut sums = [const { vec![] }; 3].map(|_: Vec<Complex32>| vec![Complex32::default(); bins]);
        let mut kernel = [const { vec![] }; 3].map(|_: Vec<f32>| vec![0.0_f32; columns]);
        let mut spectrum = vec![Complex32::default(); bins];
        for (from, spectra) in sky.iter().enumerate() {
            let up = 0.5 * (edge(from) + edge(from + 1));
            let across = (1.0 - up * up).sqrt();
            // Directions on the same meridian are closest to the centre.
            if cos * up + sin * across <= 0.0 {
                continue;
            }
            let solid = TAU / columns as f64 * (edge(from) - edge(from + 1));
            let mut any = false;
            for (d, [east, ahead]) in azimuths.iter().enumerate() {
                let (x, flat) = (across * east, across * ahead);
                let (north, z) = (up * sin - flat * cos, flat * sin + up * cos);
                let h = [x * s + north * c, north * s - x * c];
                let inside = z > 0.0 && h.iter().all(|v| v.abs() <= table.extent);
                any |= inside;
                let value = if inside { table.at(h) } else { [0.0; 3] };
                let factor = ((1.0 + z).powi(2) * solid) as f32;
                (0..3).for_each(|c| kernel[c][d] = value[c] * factor);
            }
            for c in 0..3 {
                if any {
                    forward.process(&mut kernel[c], &mut spectrum).map_err(failed)?;
                    let pairs = spectrum.iter().zip(&spectra[c]);
                    sums[c].iter_mut().zip(pairs).for_each(|(sum, (k, e))| *sum += k.conj() * e);
                }
            }
        }
        let mut out = vec![[0.0_f32; 3]; width];
        for (c, sum) in sums.iter_mut().enumerate() {
            // Both coefficients are real for a real row; rounding leaves small imaginary parts.
            sum[0].im = 0.0;
            if columns.is_multiple_of(2) {
                sum[bins - 1].im = 0.0;
            }
            inverse.process(sum, &mut kernel[c]).map_err(failed)?;
            // The central subpixel of each pixel.
            let middles = kernel[c].iter().skip(fine / 2).step_by(fine);
            out.iter_mut().zip(middles).for_each(|(pixel, v)| pixel[c] = v / columns as f32);
        }
        progress.step();
        Ok(out)
    };
    let rows = (0..height).into_par_iter().map(row).collect::<Result<Vec<_>>>()?;
    Ok(rows.concat())
}
