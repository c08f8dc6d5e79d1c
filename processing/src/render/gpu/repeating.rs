//! What repeats in two directions, as the shader `field.wgsl` looks it up: height fields by the terms of their expansion.

use super::super::relief::Relief;
use super::super::spectrum::RANGE;
use super::textures::Texture;
use crate::progress::Progress;
use std::f64::consts::TAU;

/// Rows of the terms' functions of X: every card has textures of this height. Their linear interpolation is right to 2e-5 at X = 25.
const ROWS: usize = 2048;

/// Most bytes of the terms' texture.
const MOST_BYTES: usize = 1 << 30;

/// A height field for cards.
pub(super) struct Field {
    /// Amplitudes of pairs of terms over frequencies, from the lowest, in tiles.
    pub terms: Texture,
    /// Functions of X of pairs of terms, row by row.
    pub phases: Texture,
    /// [`super::super::norm::Norm`], in tiles.
    pub norm: Texture,
    /// Frequencies to each side of the middle.
    pub reach: [usize; 2],
    /// Pairs of terms.
    pub pairs: usize,
    /// Rows of `phases` per unit of X.
    pub per_x: f64,
    /// Half the range of heights in µm.
    pub half_um: f64,
}

/// Tiles beside each other, for a picture that is about square.
fn beside(tiles: usize) -> usize {
    (tiles as f64).sqrt().ceil() as usize
}

impl Field {
    /// Of a relief, or why cards do not do it.
    pub(super) fn new(relief: &Relief, error: f64, progress: &dyn Progress) -> Result<Self, String> {
        let set = relief.terms(error, progress).map_err(|e| e.to_string())?;
        let reach = set.about.reach;
        let side = reach.map(|r| 2 * r + 1);
        let pairs = set.about.terms.div_ceil(2);
        let across = beside(pairs);
        let (width, height) = (side[0] * across, side[1] * pairs.div_ceil(across));
        if width * height * 16 > MOST_BYTES {
            let [w, h] = side;
            return Err(format!("its height field takes {pairs} pairs of terms at {w} × {h} frequencies, too much"));
        }
        let mut values = vec![0.0_f32; width * height * 4];
        for n in 0..set.about.terms {
            let tile = [n / 2 % across * side[0], n / 2 / across * side[1]];
            for y in 0..side[1] {
                for x in 0..side[0] {
                    let at = [x as isize - reach[0] as isize, y as isize - reach[1] as isize];
                    let c = set.amplitude(n, at);
                    let k = 4 * ((tile[1] + y) * width + tile[0] + x) + 2 * (n % 2);
                    values[k..k + 2].copy_from_slice(&[c.re, c.im]);
                }
            }
        }
        // No steeper than light and eye along the normal, at the shortest wavelength.
        let half_um = set.about.half_um;
        let most = (2.0 * TAU * RANGE[1] * half_um).min(set.about.x_most);
        let per_x = (ROWS - 2) as f64 / most;
        // Of functions that turn as fast as their phase, linear interpolation misses an eighth of the step squared.
        if 0.125 / (per_x * per_x) > 0.1 * error {
            return Err(format!("its height field is too deep for cards at this error: {most:.0} rad of phase"));
        }
        let row = |k: usize| set.functions((k as f64 / per_x).min(set.about.x_most));
        let texel = |pair: &[f64]| [pair[0] as f32, pair.get(1).map_or(0.0, |v| *v as f32), 0.0, 0.0];
        let phases = (0..ROWS).flat_map(|k| row(k).chunks(2).flat_map(texel).collect::<Vec<f32>>()).collect();
        let [views, numbers] = relief.norm().size();
        let across = beside(numbers);
        let mut norm = vec![0.0_f32; views * across * views * numbers.div_ceil(across)];
        for (k, line) in relief.norm().values().chunks_exact(views).enumerate() {
            let (n, y) = (k / views, k % views);
            let at = (n / across * views + y) * views * across + n % across * views;
            norm[at..at + views].copy_from_slice(line);
        }
        Ok(Self {
            terms: Texture::new("terms", width, 4, values),
            phases: Texture::new("phases", pairs, 4, phases),
            norm: Texture::new("norm", views * across, 1, norm),
            reach,
            pairs,
            per_x,
            half_um,
        })
    }
}
