//! First registration of a sample to its reference: turn and shift by correlation.

use crate::image::{Image, phasor};
use crate::transform::Transform;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_fourier::Fourier;
use num_complex::Complex32;
use rayon::prelude::*;

/// Longest side of the correlated images in pixels.
const LONGEST: usize = 112;

/// Step of the turn: at the longest distance from the middle it is one pixel of the correlated images.
const STEP_RAD: f64 = 2.0 / LONGEST as f64;

/// Smallest overlap, as a share of the reference.
const OVERLAP: f32 = 0.4;

/// Power of the overlap in the score: of two equal correlations, the one over more of the sheet wins.
const PREFER_OVERLAP: f32 = 0.25;

/// Correlation below which the sample is not the sheet of the reference.
const UNLIKE: f32 = 0.3;

/// A field for correlation, 0 where unknown, with its energy and mask.
struct Spectra {
    value: Vec<Complex32>,
    energy: Vec<Complex32>,
    mask: Vec<Complex32>,
}

/// The turn and shift that correlate best, among turns up to `most_turn` (rad), with the correlation.
///
/// The magnitude of the complex correlation counts: a common offset of all orientations, whether unknown or by the turn
/// itself, changes its phase alone.
///
/// # Errors
/// `Input` for images that are nowhere alike; `Cancelled`.
pub fn coarse(
    reference: &Image,
    sample: &Image,
    scale: f64,
    most_turn: f64,
    progress: &dyn Progress,
) -> Result<(Transform, f64)> {
    let longest = [reference.width, reference.height, sample.width, sample.height].into_iter().max().unwrap_or(1);
    let step = longest.div_ceil(LONGEST);
    let (small, other) = (reference.reduced(step), sample.reduced(step));
    let side = [0, 1].map(|k| {
        let of = |image: &Image| if k == 0 { image.width } else { image.height };
        (of(&small) + of(&other).max(of(&small))).next_power_of_two()
    });
    let fourier = Fourier::new(side);
    let fixed = spectra(&fourier, side, [small.width, small.height], &|i| Some(small.phasor(i)));
    let count = (most_turn / STEP_RAD).ceil() as i64;
    let turns: Vec<f64> = (-count..=count).map(|k| most_turn * k as f64 / count.max(1) as f64).collect();
    progress.stage("registering", turns.len() as u64);
    let enough = OVERLAP * (small.width * small.height) as f32;
    let sizes = [[small.width, small.height], [other.width, other.height]];
    let try_turn = |turn: &f64| {
        progress.check()?;
        let transform = Transform::similarity(sizes, *turn, scale, [0.0; 2]);
        let turned = |i: usize| other.at(transform.at((i % small.width) as f64, (i / small.width) as f64)).map(phasor);
        let moving = spectra(&fourier, side, [small.width, small.height], &turned);
        progress.step();
        Ok(best_shift(&fourier, side, &fixed, &moving, enough)
            .map(|(score, likeness, shift)| (score, likeness, *turn, shift)))
    };
    let tried: Vec<_> = turns.par_iter().map(try_turn).collect::<Result<_>>()?;
    let best = tried.into_iter().flatten().max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, likeness, turn, shift)) = best.filter(|b| b.1 >= UNLIKE) else {
        let remedy = "give a sample of the same sheet, raise --max-turn-deg, or check the photographs";
        return Err(Error::input("sample", "is nowhere like the reference", remedy));
    };
    // The correlated image was moved by `shift` after the turn about the middle of the reference.
    let sizes = [[reference.width, reference.height], [sample.width, sample.height]];
    let (sin, cos) = (-turn).sin_cos();
    let moved = shift.map(|s| -(s as f64) * step as f64 * scale);
    let shift = [moved[0] * cos - moved[1] * sin, moved[0] * sin + moved[1] * cos];
    Ok((Transform::similarity(sizes, turn, scale, shift), f64::from(likeness)))
}

fn spectra(
    fourier: &Fourier<f32>,
    [width, height]: [usize; 2],
    [columns, rows]: [usize; 2],
    value: &dyn Fn(usize) -> Option<Complex32>,
) -> Spectra {
    let empty = || vec![Complex32::default(); width * height];
    let mut planes = [empty(), empty(), empty()];
    for i in 0..columns * rows {
        let Some(value) = value(i) else { continue };
        let at = i / columns * width + i % columns;
        planes[0][at] = value;
        planes[1][at] = value.norm_sqr().into();
        planes[2][at] = 1.0.into();
    }
    let [value, energy, mask] = planes.map(|plane| fourier.forward(plane));
    Spectra { value, energy, mask }
}

/// Score, correlation and shift of the best overlap.
fn best_shift(
    fourier: &Fourier<f32>,
    [width, height]: [usize; 2],
    a: &Spectra,
    b: &Spectra,
    enough: f32,
) -> Option<(f32, f32, [i64; 2])> {
    let product =
        |p: &[Complex32], q: &[Complex32]| fourier.inverse(p.iter().zip(q).map(|(p, q)| p * q.conj()).collect());
    let scale = 1.0 / (width * height) as f32;
    let same = product(&a.value, &b.value);
    let (of_a, of_b, overlap) = (product(&a.energy, &b.mask), product(&a.mask, &b.energy), product(&a.mask, &b.mask));
    let score = |i: usize| {
        let pixels = overlap[i].re * scale;
        let energy = of_a[i].re.max(0.0).sqrt() * of_b[i].re.max(0.0).sqrt() * scale;
        if pixels < enough || energy < 1e-6 * pixels {
            return None;
        }
        let likeness = same[i].norm() * scale / energy;
        Some((likeness * (pixels / enough).powf(PREFER_OVERLAP), likeness, i))
    };
    let (score, likeness, i) = (0..width * height).filter_map(score).max_by(|p, q| p.0.total_cmp(&q.0))?;
    let wrapped = |k: usize, n: usize| if k > n / 2 { k as i64 - n as i64 } else { k as i64 };
    Some((score, likeness, [wrapped(i % width, width), wrapped(i / width, height)]))
}
