//! Studies of the registration of photographs behind a rotating analyser: number of angles, noise, and parallel edges.

use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::Result;
use nacre_image::registration::{Registrar, Registration};
use nacre_polarimetry::synthetic::{even_angles, normal, uniform};
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::time::Instant;

/// Number of angles, and whether the scene's model is Malus' law.
const WAYS: [(usize, bool); 7] = [(4, true), (6, true), (8, true), (12, true), (24, true), (12, false), (24, false)];

const ELECTRONS: [f64; 7] = [40_000.0, 3000.0, 300.0, 30.0, 10.0, 3.0, 1.0];
const SPREAD_DEG: [f64; 7] = [180.0, 90.0, 30.0, 10.0, 3.0, 1.0, 0.0];

/// Radius in pixels of the circular image shift over a turn of the analyser.
const RADIUS_PX: f64 = 1.0;

/// Waves of each texture.
const WAVES: usize = 24;

/// Studies against the noise, and against the angular spread of the edges.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let noise = study(
        effort,
        "registration",
        "Registration of photographs, and noise",
        (Axis::log("electrons at white", "e⁻"), ELECTRONS.map(|e| [e, 180.0]).to_vec(), 1),
        |[electrons, _]| electrons,
    );
    let parallel = study(
        effort,
        "registration-parallel",
        "Registration of photographs whose edges run alike",
        (Axis::linear("directions of edges span", "°"), SPREAD_DEG.map(|s| [3000.0, s]).to_vec(), 2),
        |[_, spread]| spread,
    );
    vec![noise, parallel]
}

fn study(
    effort: Effort,
    name: &'static str,
    title: &str,
    (stress, scenes, reference): (Axis, Vec<[f64; 2]>, usize),
    value: fn([f64; 2]) -> f64,
) -> Study {
    let side = effort.pick(256, 160);
    let setting = |(frames, malus): &(usize, bool)| {
        let method = if *malus { "Malus' law" } else { "one brightness" };
        let setting = Setting::new(method, format!("{frames} angles"), *frames as f64);
        match (frames, malus) {
            (12, true) => setting.as_default(),
            (6 | 8, true) | (24, false) => setting.without_sweep(),
            _ => setting,
        }
    };
    Study {
        name,
        group: "polarimetry",
        title: title.into(),
        question: format!(
            "Photographs of {side} × {side} pixels run around a circle of {RADIUS_PX} px while a wedged analyser turns by 180°. Brightness and \
             polarization are three unrelated textures of waves of 6 to 40 px. Shifts are those under which Malus' law leaves least \
             over; or the scene is taken to keep its brightness. Twelve angles are the plan's default. The error is the root mean square over photographs and both \
             directions, and the dashed line what the registration says of itself. Masked: it says that it cannot tell. Wrong and confident: \
             photographs that are more than five of their σ off."
        ),
        knob: Axis::linear("angles", ""),
        stress,
        error: Axis::log("error of the shifts (RMS)", "px"),
        time: Axis::log(&format!("time of the registration, {side} × {side} pixels"), "s"),
        predicted: "σ of the shifts",
        settings: WAYS.iter().map(setting).collect(),
        scenes: scenes.iter().map(|s| Scene::new(value(*s))).collect(),
        reference,
        run: Box::new(move |setting, scene, seed| run(side, WAYS[setting], scenes[scene], seed)),
    }
}

/// A sum of waves whose directions span an angle.
struct Texture([[f64; 4]; WAVES]);

impl Texture {
    fn new(seed: u64, spread_deg: f64) -> Self {
        let amplitude = (2.0 / WAVES as f64).sqrt();
        Self(std::array::from_fn(|k| {
            let random = |i: u64| uniform(seed, 4 * k as u64 + i);
            let number = TAU / (6.0 * (40.0_f64 / 6.0).powf(random(0)));
            let (sin, cos) = (0.4 + spread_deg.to_radians() * random(1)).sin_cos();
            [number * cos, number * sin, TAU * random(2), amplitude]
        }))
    }

    /// Values of a row from `x` on; the phase of each wave advances by a rotation from pixel to pixel.
    fn row(&self, [x, y]: [f64; 2], width: usize) -> Vec<f64> {
        let mut sum = vec![0.0; width];
        for [a, b, phase, amplitude] in self.0 {
            let mut wave = Complex::from_polar(amplitude, a * x + b * y + phase);
            let turn = Complex::from_polar(1.0, a);
            for value in &mut sum {
                *value += wave.re;
                wave *= turn;
            }
        }
        sum
    }
}

/// Photographs with values between 0 and 1, and the shifts of their contents relative to the mean shift.
fn photographs(
    side: usize,
    angles: &[f64],
    [electrons, spread]: [f64; 2],
    seed: u64,
) -> (Vec<Vec<f32>>, Vec<[f64; 2]>) {
    let textures: [Texture; 3] = std::array::from_fn(|k| Texture::new(seed ^ (k as u64 + 1) << 32, spread));
    let shifts: Vec<[f64; 2]> = angles.iter().map(|psi| [RADIUS_PX * psi.cos(), RADIUS_PX * psi.sin()]).collect();
    let frame = |(k, psi): (usize, &f64)| -> Vec<f32> {
        let [dx, dy] = shifts[k];
        let (sin, cos) = (2.0 * psi).sin_cos();
        let row = |y: usize| -> Vec<f32> {
            let [s0, s1, s2] = [0, 1, 2].map(|t| textures[t].row([-dx, y as f64 - dy], side));
            let pixel = |x: usize| {
                let light = (0.5 + 0.1 * s0[x] + 0.06 * (s1[x] * cos + s2[x] * sin)).clamp(0.0, 1.0);
                (light + (light / electrons).sqrt() * normal(seed ^ (k as u64 + 9) << 40, (y * side + x) as u64)) as f32
            };
            (0..side).map(pixel).collect()
        };
        (0..side).into_par_iter().flat_map_iter(row).collect()
    };
    let frames = angles.iter().enumerate().map(frame).collect();
    let mean = [0, 1].map(|c| shifts.iter().map(|s| s[c]).sum::<f64>() / shifts.len() as f64);
    (frames, shifts.iter().map(|s| [s[0] - mean[0], s[1] - mean[1]]).collect())
}

fn run(side: usize, (count, malus): (usize, bool), scene: [f64; 2], seed: u64) -> Result<Outcome> {
    let angles = even_angles(count);
    let (frames, truth) = photographs(side, &angles, scene, seed);
    let begun = Instant::now();
    let mut registrar = Registrar::new(side, side);
    for frame in &frames {
        registrar.add(|y, left, values, _| values.copy_from_slice(&frame[y * side + left..][..values.len()]));
    }
    let found = if malus { registrar.polarized(&angles) } else { registrar.still() };
    let seconds = begun.elapsed().as_secs_f64();
    let Registration::Told(shifts) = found else {
        return Ok(Outcome { error: None, seconds, masked: 1.0, wrong: 0.0, predicted: None });
    };
    let n = shifts.len() as f64;
    let off: Vec<f64> = shifts.iter().zip(&truth).map(|(s, t)| (s.dx - t[0]).hypot(s.dy - t[1])).collect();
    let wrong = off.iter().zip(&shifts).filter(|(off, s)| **off > 5.0 * s.sigma).count() as f64 / n;
    let error = Some((off.iter().map(|o| 0.5 * o * o).sum::<f64>() / n).sqrt());
    let predicted = Some((shifts.iter().map(|s| s.sigma * s.sigma).sum::<f64>() / n).sqrt());
    Ok(Outcome { error, seconds, masked: 0.0, wrong, predicted })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Malus' law determines shifts to a few hundredths of a pixel, with a matching σ; textures of parallel edges are
    /// refused.
    #[test]
    fn shifts_are_measured_or_refused() {
        let good = run(160, (12, true), [3000.0, 180.0], 3).unwrap();
        assert!(good.error.unwrap() < 0.03 && good.wrong == 0.0, "{good:?}");
        let alike = run(160, (12, true), [3000.0, 0.0], 3).unwrap();
        assert_eq!(alike.masked, 1.0, "{alike:?}");
    }
}
