//! Demodulation of photographs of fringes to responses of each pixel, frame by frame, so that memory is independent of
//! the number of frames.

use super::optics::carrier;
use super::response::Response;
use nacre_base::parallel::sum_in_order;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::NoiseModel;
use nacre_frames::{Frame, LinearFrame, Linearizer, LoadedFrames};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Frames with the same fringe at several phases.
#[derive(Clone, Debug)]
pub struct Carrier {
    /// Spatial frequency in cycles per mm.
    pub cycles_per_mm: [f64; 2],
    /// Indices of its frames, with their factors for (mean, real part, imaginary part).
    pub frames: Vec<(usize, [f64; 3])>,
    /// Variance of a component relative to that of a frame.
    pub variance: f64,
}

/// Responses of all pixels.
pub struct Signals {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Angular frequencies in rad/mm.
    pub carriers: Vec<[f64; 2]>,
    /// Pixel by pixel: real and imaginary part for each fringe.
    pub components: Vec<f32>,
    /// Mean light of each pixel over all fringes, relative to white.
    pub mean: Vec<f32>,
    /// 1 where a pixel is saturated or not a number in any frame.
    pub bad: Vec<u8>,
    /// Noise of a component: standard deviation √(shot · mean + floor) at mean light.
    pub noise: [f64; 2],
    /// Response of the panel.
    pub response: Response,
}

/// Light of every `every`-th pixel of every `every`-th row of a frame.
#[derive(Clone)]
pub struct Sampled {
    light: Vec<f32>,
    bad: Vec<u8>,
    /// Mean over all pixels, or over the sample.
    mean: f64,
}

/// Frames of one frequency, with their phases.
type Group = ([f64; 2], Vec<(usize, f64)>);

/// Minimum number of phases per fringe.
const PHASES: usize = 3;

/// Groups frames by fringe; frames without fringes are omitted.
///
/// # Errors
/// `Input` for too few phases of a fringe, and for too few or too many fringes.
pub fn carriers(frames: &LoadedFrames, most: usize) -> Result<Vec<Carrier>> {
    let mut groups: Vec<Group> = Vec::new();
    let fringed = || frames.set.frames.iter().filter(|f| f.fringes.is_some());
    if fringed().any(|f| Some(f.analyser_deg) != fringed().next().map(|f| f.analyser_deg)) {
        let problem = "has fringes behind an analyser at several angles";
        return Err(Error::file(&frames.path, problem, "take them at one angle, or without an analyser"));
    }
    for (i, frame) in frames.set.frames.iter().enumerate() {
        let Some(fringes) = frame.fringes.filter(|f| f.cycles_per_mm != [0.0; 2]) else { continue };
        match groups.iter_mut().find(|g| g.0 == fringes.cycles_per_mm) {
            Some(group) => group.1.push((i, fringes.phase)),
            None => groups.push((fringes.cycles_per_mm, vec![(i, fringes.phase)])),
        }
    }
    let bad = |problem: String, remedy: &str| Err(Error::file(&frames.path, problem, remedy));
    if !(4..=most).contains(&groups.len()) {
        let problem = format!("has {} different fringes; 4 to {most} are needed", groups.len());
        return bad(problem, "take them with a plan of kind spots and `spots.fringes`");
    }
    let mut all = Vec::new();
    for (cycles_per_mm, shots) in groups {
        let [fx, fy] = cycles_per_mm;
        let rows: Vec<Vector3<f64>> = shots
            .iter()
            .map(|(_, phase)| {
                let (sin, cos) = (TAU * phase).sin_cos();
                Vector3::new(1.0, cos, sin)
            })
            .collect();
        let normal: Matrix3<f64> = rows.iter().map(|r| r * r.transpose()).sum();
        let values = normal.symmetric_eigenvalues();
        let condition = values.max() / values.min().max(1e-12);
        if shots.len() < PHASES || condition > 20.0 {
            let problem = format!(
                "fringes of ({fx}, {fy}) cycles per mm have {} frames whose phases do not tell one",
                shots.len()
            );
            return bad(problem, "give at least three phases, evenly spread over a cycle");
        }
        let Some(inverse) = normal.try_inverse() else {
            return bad(format!("phases of fringes ({fx}, {fy}) are alike"), "spread them over a cycle");
        };
        // A pixel that sees one position x of the panel has I = (1 + cos(k·x + φ)) / 2 = a + b cos φ + c sin φ: b - ic
        // = e^(ik·x) / 2.
        let factors = |row: &Vector3<f64>| {
            let solved = inverse * row;
            [solved[0], 2.0 * solved[1], -2.0 * solved[2]]
        };
        let frames: Vec<_> = shots.iter().zip(&rows).map(|((i, _), row)| (*i, factors(row))).collect();
        let variance = frames.iter().map(|(_, f)| 0.5 * (f[1] * f[1] + f[2] * f[2])).sum();
        all.push(Carrier { cycles_per_mm, frames, variance });
    }
    Ok(all)
}

impl Signals {
    /// Reads each frame once.
    ///
    /// # Errors
    /// `Input` for unreadable frames; `Cancelled`.
    pub fn read(frames: &LoadedFrames, carriers: &[Carrier], progress: &dyn Progress) -> Result<Self> {
        let (width, height) = (frames.info.width, frames.info.height);
        let linearizer = Linearizer::new(frames)?;
        let set = &frames.set;
        let mut new = Self::none(width, height, carriers);
        let mut even = Vec::new();
        progress.stage("reading photographs", set.frames.len() as u64);
        let unit = set.frames.first().map_or(1.0, Frame::scale);
        let used: Vec<usize> = carriers.iter().flat_map(|c| c.frames.iter().map(|f| f.0)).collect();
        for (i, frame) in set.frames.iter().enumerate() {
            progress.check()?;
            let is_even = frame.fringes.filter(|f| f.cycles_per_mm == [0.0; 2]);
            if !used.contains(&i) && is_even.is_none() {
                progress.step();
                continue;
            }
            let decoded = linearizer.frame(frames, frame)?;
            if let Some(fringes) = is_even {
                even.push((fringes.phase, mean_light(&decoded, width, height) / unit));
                progress.step();
                continue;
            }
            new.add(carriers, i, unit, |y, light, bad| decoded.row(y, light, bad));
            progress.step();
        }
        new.noise = noise(frames, carriers, &linearizer);
        new.response = Response::from_even(&even);
        Ok(new)
    }

    /// Demodulates stored samples of `width` × `height` pixels, one per frame of the set.
    pub fn of_samples(
        frames: &LoadedFrames,
        linearizer: &Linearizer,
        carriers: &[Carrier],
        samples: &[Sampled],
        [width, height]: [usize; 2],
    ) -> Self {
        let mut new = Self::none(width, height, carriers);
        let unit = frames.set.frames.first().map_or(1.0, Frame::scale);
        let mut even = Vec::new();
        for (i, (frame, sampled)) in frames.set.frames.iter().zip(samples).enumerate() {
            if let Some(fringes) = frame.fringes.filter(|f| f.cycles_per_mm == [0.0; 2]) {
                even.push((fringes.phase, sampled.mean / unit));
                continue;
            }
            new.add(carriers, i, unit, |y, light, bad| {
                let row = y * width..(y + 1) * width;
                light.copy_from_slice(&sampled.light[row.clone()]);
                bad.iter_mut().zip(&sampled.bad[row]).for_each(|(b, s)| *b |= s);
            });
        }
        new.noise = noise(frames, carriers, linearizer);
        new.response = Response::from_even(&even);
        new
    }

    fn none(width: usize, height: usize, carriers: &[Carrier]) -> Self {
        Self {
            width,
            height,
            carriers: carriers.iter().map(|c| carrier(c.cycles_per_mm)).collect(),
            components: vec![0.0; width * height * 2 * carriers.len()],
            mean: vec![0.0; width * height],
            bad: vec![0; width * height],
            noise: [0.0; 2],
            response: Response::default(),
        }
    }

    /// Adds frame `i`. `read` returns a row's light, and 1 where it is not a number.
    fn add(&mut self, carriers: &[Carrier], i: usize, unit: f64, read: impl Fn(usize, &mut [f32], &mut [u8]) + Sync) {
        let (width, parts) = (self.width, 2 * carriers.len());
        for (j, shared) in carriers.iter().enumerate() {
            let Some((_, factors)) = shared.frames.iter().find(|f| f.0 == i) else { continue };
            // Light of a pixel relative to the first frame's exposure and gain.
            let factors = factors.map(|f| (f / unit) as f32);
            let share = factors[0] / carriers.len() as f32;
            let rows = self.components.par_chunks_mut(width * parts).zip(self.mean.par_chunks_mut(width));
            rows.zip(self.bad.par_chunks_mut(width)).enumerate().for_each(|(y, ((row, mean), bad))| {
                let mut light = vec![0.0_f32; width];
                read(y, &mut light, bad);
                for ((pixel, mean), v) in row.chunks_exact_mut(parts).zip(mean).zip(light) {
                    pixel[2 * j] += factors[1] * v;
                    pixel[2 * j + 1] += factors[2] * v;
                    *mean += share * v;
                }
            });
        }
    }

    /// Standard deviation of a component of a pixel.
    pub fn sigma(&self, pixel: usize) -> f64 {
        (self.noise[0] * f64::from(self.mean[pixel]).max(0.0) + self.noise[1]).sqrt()
    }
}

impl Sampled {
    /// Samples every `every`-th pixel along both axes, from the centre of the first square on.
    pub fn of(decoded: &LinearFrame<'_>, [width, height]: [usize; 2], every: usize) -> Self {
        let [columns, rows] = sampled_size([width, height], every);
        let (mut light, mut bad) = (vec![0.0; columns * rows], vec![0; columns * rows]);
        for (y, (light, bad)) in light.chunks_mut(columns).zip(bad.chunks_mut(columns)).enumerate() {
            decoded.strided(every / 2 + y * every, every / 2, every, light, bad);
        }
        let mean = light.iter().map(|v| f64::from(*v)).sum::<f64>() / (columns * rows) as f64;
        Self { light, bad, mean }
    }
}

/// Width and height of a sample.
pub fn sampled_size(size: [usize; 2], every: usize) -> [usize; 2] {
    size.map(|side| (side - every / 2).div_ceil(every))
}

/// Mean light of a frame over all pixels.
fn mean_light(decoded: &LinearFrame<'_>, width: usize, height: usize) -> f64 {
    let row = |y: usize| {
        let (mut light, mut bad) = (vec![0.0_f32; width], vec![0_u8; width]);
        decoded.row(y, &mut light, &mut bad);
        light.iter().map(|v| f64::from(*v)).sum::<f64>()
    };
    sum_in_order((0..height).into_par_iter().map(row)) / (width * height) as f64
}

/// Variance of a frame's light per light, and at zero light, relative to white.
pub fn frame_noise(frames: &LoadedFrames, linearizer: &Linearizer) -> [f64; 2] {
    let first = frames.set.frames.first();
    // Noise model of a small sensor if none is known, so that σ is rather overestimated.
    let assumed = NoiseModel { full_scale_e: 5000.0, read_noise_e: 10.0 };
    let model = frames.set.noise.unwrap_or(assumed);
    let frame = model.frame(first.and_then(|f| f.gain).unwrap_or(1.0), 1.0, linearizer.step());
    [frame.shot, frame.floor]
}

/// Variance of a component per mean light, and at zero light.
fn noise(frames: &LoadedFrames, carriers: &[Carrier], linearizer: &Linearizer) -> [f64; 2] {
    let variance = carriers.iter().map(|c| c.variance).sum::<f64>() / carriers.len().max(1) as f64;
    // The subtracted dark frame has the floor's variance too, but it is equal for all phases and cancels.
    frame_noise(frames, linearizer).map(|v| variance * v)
}
