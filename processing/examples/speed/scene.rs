//! Simulated photographs for measurements: patches of gratings behind a weakly birefringent film, with a 12-bit camera.

use super::Outcome;
use nacre_processing::frames::{FILE_NAME, Frame, FrameSet, Kind};
use nacre_processing::image::write_png16_gray;
use nacre_processing::polarimetry::synthetic::{Synthetic, even_angles, normal, uniform};
use nacre_processing::polarimetry::{NoiseModel, Stokes};
use rayon::prelude::*;
use std::fs;
use std::path::Path;

/// Width of a patch, and of the blur between two patches, in pixels.
const PATCH: f64 = 64.0;
const BLUR: f64 = 2.0;
const WHITE: f64 = 4095.0;
const CAMERA: NoiseModel = NoiseModel { full_scale_e: 40_000.0, read_noise_e: 8.0 };

/// Generates a set of photographs of `width` × `height` pixels in a new folder.
pub fn make(folder: &Path, [width, height]: [usize; 2], frames: usize) -> Outcome<()> {
    fs::create_dir_all(folder)?;
    let film = Synthetic { retardance: 10f64.to_radians(), axis: 20f64.to_radians(), ..Synthetic::default() };
    let columns = width / PATCH as usize + 2;
    let patch = |i: usize| {
        let [turn, share] = [1, 2].map(|seed| uniform(seed, i as u64));
        film.stokes(std::f64::consts::PI * turn) * (0.3 + 0.2 * share)
    };
    let patches: Vec<Stokes> = (0..columns * (height / PATCH as usize + 2)).map(patch).collect();
    let angles = even_angles(frames);
    let mut names = vec![];
    for (k, psi) in angles.iter().enumerate() {
        let through: Vec<f64> = patches.iter().map(|s| s.through_analyser(*psi)).collect();
        let mut codes = vec![0_u16; width * height];
        codes.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let (down, v) = blended(y);
            for (x, code) in row.iter_mut().enumerate() {
                let (right, u) = blended(x);
                let at = |i: usize, j: usize| through[(down + j) * columns + right + i];
                let light =
                    (1.0 - v) * ((1.0 - u) * at(0, 0) + u * at(1, 0)) + v * ((1.0 - u) * at(0, 1) + u * at(1, 1));
                let sigma = (light * CAMERA.full_scale_e + CAMERA.read_noise_e.powi(2)).sqrt() / CAMERA.full_scale_e;
                let seen = light + sigma * normal(k as u64 + 9, (y * width + x) as u64);
                *code = (seen * WHITE).round().clamp(0.0, WHITE) as u16;
            }
        });
        let name = format!("{k:03}.png");
        write_png16_gray(&folder.join(&name), width, height, &codes)?;
        let frame = serde_json::json!({ "file": name, "analyser_deg": psi.to_degrees() });
        names.push(serde_json::from_value::<Frame>(frame)?);
    }
    let set = FrameSet { white: Some(WHITE), noise: Some(CAMERA), ..FrameSet::new(Kind::Polarization, names) };
    Ok(fs::write(folder.join(FILE_NAME), serde_json::to_string_pretty(&set)?)?)
}

/// Patch at a pixel, or the one before a nearby edge, and the fraction of the next patch.
fn blended(at: usize) -> (usize, f64) {
    let place = at as f64 / PATCH;
    (place as usize, ((place.fract() - 1.0) * PATCH / BLUR + 1.0).max(0.0))
}
