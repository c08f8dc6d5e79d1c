//! Detection of candidates for chessboard corners.

use nacre_image::Gray;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Radius in pixels, and number, of the samples on a circle around a corner.
const RADIUS: f64 = 5.0;
const SAMPLES: usize = 16;

/// Minimum distance of corners in pixels.
const APART: usize = 4;

/// Minimum response relative to the strongest; lower ones are noise.
const WEAKEST: f32 = 0.03;

/// Maximum number of candidates. A board has far fewer; a photograph of leaves has far more.
const MOST: usize = 6000;

/// A candidate corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// Position in pixels from the left and the top.
    pub place: [f64; 2],
    /// Detector response.
    pub strength: f32,
    /// Direction of the bright squares, [0, π), clockwise from the right, because rows grow downwards.
    pub bright: f64,
}

/// Candidates, strongest first.
///
/// Samples on a circle around a corner have a period of half a turn, and opposite sign after a quarter turn. Those of
/// edges and lines do not, and their mean equals the value at the centre (Bennett and Lasenby 2014, ChESS).
pub(super) fn candidates(image: &Gray) -> Vec<Candidate> {
    let margin = RADIUS as usize + 2;
    if image.width <= 2 * margin || image.height <= 2 * margin {
        return vec![];
    }
    let soft = image.softened();
    let circle: [[f64; 2]; SAMPLES] = std::array::from_fn(|k| {
        let (sin, cos) = (TAU * k as f64 / SAMPLES as f64).sin_cos();
        [RADIUS * cos, RADIUS * sin]
    });
    let taps = Taps::new(&circle, soft.width);
    let mut strength = vec![0.0_f32; soft.values.len()];
    strength.par_chunks_mut(soft.width).enumerate().for_each(|(y, row)| {
        if y < margin || y + margin >= soft.height {
            return;
        }
        for (x, out) in row.iter_mut().enumerate().take(soft.width - margin).skip(margin) {
            *out = taps.response(&soft.values, y * soft.width + x);
        }
    });
    let top = strength.iter().copied().fold(0.0, f32::max);
    let mut found: Vec<Candidate> = (0..strength.len())
        .into_par_iter()
        .filter(|i| strength[*i] > WEAKEST * top && strongest(&strength, soft.width, *i))
        .map(|i| {
            let place = [(i % soft.width) as f64, (i / soft.width) as f64];
            Candidate { place, strength: strength[i], bright: bright(&soft, place, &circle) }
        })
        .collect();
    found.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    found.truncate(MOST);
    found
}

/// Interpolation of the circle's samples around a pixel: index of the upper left of four pixels, and their weights.
struct Taps {
    circle: [(i64, [f32; 4]); SAMPLES],
    width: i64,
}

impl Taps {
    fn new(circle: &[[f64; 2]; SAMPLES], width: usize) -> Self {
        let width = width as i64;
        let tap = |[x, y]: [f64; 2]| {
            let (left, above) = (x.floor(), y.floor());
            let (fx, fy) = ((x - left) as f32, (y - above) as f32);
            let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
            (above as i64 * width + left as i64, weights)
        };
        Self { circle: circle.map(tap), width }
    }

    fn response(&self, values: &[f32], at: usize) -> f32 {
        let down = self.width as usize;
        let ring: [f32; SAMPLES] = std::array::from_fn(|k| {
            let (offset, [a, b, c, d]) = self.circle[k];
            let i = (at as i64 + offset) as usize;
            a * values[i] + b * values[i + 1] + c * values[i + down] + d * values[i + down + 1]
        });
        let (mut sum, mut difference) = (0.0, 0.0);
        for k in 0..4 {
            sum += (ring[k] + ring[k + 8] - ring[k + 4] - ring[k + 12]).abs();
        }
        for k in 0..8 {
            difference += (ring[k] - ring[k + 8]).abs();
        }
        let middle = (values[at] + values[at - 1] + values[at + 1] + values[at - down] + values[at + down]) / 5.0;
        let mean = ring.iter().sum::<f32>() / SAMPLES as f32;
        sum - difference - SAMPLES as f32 * (mean - middle).abs()
    }
}

fn strongest(strength: &[f32], width: usize, i: usize) -> bool {
    let (x, y) = (i % width, i / width);
    // The margin without candidates is wider than this window.
    (y - APART..=y + APART).all(|row| {
        (x - APART..=x + APART).all(|column| {
            let other = row * width + column;
            // Among equal responses, the first one wins.
            strength[other] < strength[i] || strength[other] == strength[i] && other >= i
        })
    })
}

/// Direction of the second harmonic of brightness on the circle.
fn bright(image: &Gray, [x, y]: [f64; 2], circle: &[[f64; 2]; SAMPLES]) -> f64 {
    let (mut cos2, mut sin2) = (0.0, 0.0);
    for [dx, dy] in circle {
        let value = f64::from(image.at([x + dx, y + dy]));
        let (sin, cos) = (2.0 * dy.atan2(*dx)).sin_cos();
        cos2 += value * cos;
        sin2 += value * sin;
    }
    (0.5 * sin2.atan2(cos2)).rem_euclid(PI)
}

/// Angle between two undirected lines, 0 to π/2.
pub(super) fn apart(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(PI);
    d.min(PI - d)
}
