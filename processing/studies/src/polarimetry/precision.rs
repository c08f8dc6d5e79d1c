//! Study of the numerical precision of the fit's sums.

use super::scene::fitted;
use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::Result;
use nacre_polarimetry::synthetic::{Photographs, Synthetic, even_angles};
use nacre_polarimetry::{Design, angle_difference};
use num_complex::Complex;
use rayon::prelude::*;
use std::time::Instant;

const FRAMES: [usize; 5] = [5, 12, 24, 48, 192];
const CONTRASTS: [f64; 9] = [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 0.9];
const REFERENCE: usize = 2;

/// Number format and summation method.
#[derive(Clone, Copy, PartialEq)]
enum Sums {
    /// f32, relative to the first photograph: the method of the program.
    Pivot,
    /// f32 of the original values.
    Plain,
    /// f32 with Kahan's correction.
    Kahan,
    /// f64.
    Double,
}

const KINDS: [(Sums, &str); 4] = [
    (Sums::Pivot, "f32 against the first frame (Nacre)"),
    (Sums::Plain, "f32, plain"),
    (Sums::Kahan, "f32, compensated (Kahan)"),
    (Sums::Double, "f64 sums"),
];

/// Study of streaming f32 sums against an f64 fit of the same photographs, at decreasing modulation.
pub(super) fn study(effort: Effort) -> Study {
    let of_kind = |(kind, name): &(Sums, &str)| {
        let (kind, name) = (*kind, (*name).to_owned());
        FRAMES.map(move |n| {
            let setting = Setting::new(&name, format!("{n} frames"), n as f64);
            match n {
                12 if kind == Sums::Pivot => setting.as_default(),
                12 => setting,
                _ => setting.without_sweep(),
            }
        })
    };
    Study {
        name: "precision",
        group: "polarimetry",
        title: "Precision of the sums".into(),
        question: "The fit folds every photograph into a few sums per pixel. What does it cost to keep them in single precision? \
                   Photographs without noise, in f32, whose modulation is a small share of their mean; reference: an f64 fit of the \
                   very same values. (The program's sums are tuned for speed, the others are written plainly: compare their errors rather than \
                   their times.) For scale: the noise of a pixel of 40,000 electrons turns the orientation by σ = 0.09° at 12 frames \
                   and full modulation, and by 1/modulation times as much below it."
            .into(),
        knob: Axis::linear("frames", ""),
        stress: Axis::log("modulation / mean", ""),
        error: Axis::log("mean deviation of the orientation from f64", "°"),
        time: Axis::log("time per megapixel", "s"),
        predicted: "",
        settings: KINDS.iter().flat_map(of_kind).collect(),
        scenes: CONTRASTS.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: {
            let pixels = effort.pick(16 * 1024, 1024);
            Box::new(move |setting, scene, seed| {
                let (kind, frames) = (KINDS[setting / FRAMES.len()].0, FRAMES[setting % FRAMES.len()]);
                run(kind, frames, CONTRASTS[scene], pixels, seed)
            })
        },
    }
}

fn run(kind: Sums, frames: usize, contrast: f64, pixels: usize, seed: u64) -> Result<Outcome> {
    let photographs = faint(frames, contrast).render(pixels, seed)?;
    let begun = Instant::now();
    let phases = match kind {
        Sums::Pivot => {
            let maps = fitted(&photographs);
            maps.s1.iter().zip(&maps.s2).map(|(c, s)| 0.5 * f64::from(*s).atan2(f64::from(*c))).collect()
        }
        Sums::Plain => phases(&photographs, |sum, _, value| *sum += value),
        Sums::Kahan => phases(&photographs, kahan),
        Sums::Double => {
            phases_of(&double(&photographs).into_iter().map(|p| p.map(|v| f64::from(v as f32))).collect::<Vec<_>>())
        }
    };
    let seconds = begun.elapsed().as_secs_f64() / pixels as f64 * 1e6;
    let truth = phases_of(&double(&photographs));
    let errors = phases.iter().zip(&truth).map(|(a, b)| angle_difference(*a, *b).abs());
    let error = (errors.sum::<f64>() / pixels as f64).to_degrees();
    Ok(Outcome { error: Some(error), seconds, masked: 0.0, wrong: 0.0, predicted: None })
}

/// Gratings with this modulation relative to the mean. For circular light r is 1 and ζ at most a quarter wave (2018
/// paper, Eq. 9: the modulation is sin ζ).
fn faint(frames: usize, contrast: f64) -> Synthetic {
    let ratio = Complex::from_polar(1.0, contrast.asin());
    Synthetic { ratio, noise: None, angles: even_angles(frames), ..Synthetic::default() }
}

/// Kahan summation.
fn kahan(sum: &mut f32, lost: &mut f32, value: f32) {
    let value = value - *lost;
    let next = *sum + value;
    *lost = (next - *sum) - value;
    *sum = next;
}

/// Phases in rad from f32 sums of the original values; `add` receives the sum, a correction and the value.
fn phases(photographs: &Photographs, add: impl Fn(&mut f32, &mut f32, f32) + Sync) -> Vec<f64> {
    let n = photographs.truth.len();
    let mut sums = vec![[[0.0_f32; 2]; 3]; n];
    for (psi, frame) in photographs.angles.iter().zip(&photographs.frames) {
        let (sin, cos) = (2.0 * psi).sin_cos();
        let (sin, cos) = (sin as f32, cos as f32);
        sums.par_iter_mut().zip(frame).for_each(|(sums, v)| {
            for ([sum, lost], term) in sums.iter_mut().zip([*v, cos * v, sin * v]) {
                add(sum, lost, term);
            }
        });
    }
    let inverse = inverse(&photographs.design).map(|row| row.map(|v| v as f32));
    let solve = |sums: &[[f32; 2]; 3]| {
        let row = |m: [f32; 3]| m[0] * sums[0][0] + m[1] * sums[1][0] + m[2] * sums[2][0];
        0.5 * f64::from(row(inverse[2])).atan2(f64::from(row(inverse[1])))
    };
    sums.par_iter().map(solve).collect()
}

/// Phases in rad of pairs (C, S).
fn phases_of(pairs: &[[f64; 2]]) -> Vec<f64> {
    pairs.iter().map(|[c, s]| 0.5 * s.atan2(*c)).collect()
}

/// (C, S) in f64 throughout. Rounded, they are the result of f64 sums; unrounded, they are the reference.
fn double(photographs: &Photographs) -> Vec<[f64; 2]> {
    let n = photographs.truth.len();
    let mut sums = vec![[0.0_f64; 3]; n];
    for (psi, frame) in photographs.angles.iter().zip(&photographs.frames) {
        let (sin, cos) = (2.0 * psi).sin_cos();
        sums.par_iter_mut().zip(frame).for_each(|(sums, v)| {
            let v = f64::from(*v);
            sums[0] += v;
            sums[1] += cos * v;
            sums[2] += sin * v;
        });
    }
    let inverse = inverse(&photographs.design);
    let solve = |sums: &[f64; 3]| {
        let row = |m: [f64; 3]| m[0] * sums[0] + m[1] * sums[1] + m[2] * sums[2];
        [row(inverse[1]), row(inverse[2])]
    };
    sums.par_iter().map(solve).collect()
}

fn inverse(design: &Design) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| design.inverse[(i, j)]))
}
