//! Study of series that stop at a target orientation error, against series with a fixed number of angles.

use nacre_base::{Error, Result};
use nacre_frames::{Frame, FrameSet, Kind, check};
use nacre_image::write_png16_gray;
use nacre_polarimetry::synthetic::{Synthetic, even_angles};
use nacre_polarimetry::{NoiseModel, Running, UNREACHABLE_FACTOR, orient};
use nacre_studies::polarimetry::judge;
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::path::Path;

/// Stopping criterion of a plan.
#[derive(Clone, Copy)]
enum Wanted {
    /// Target σ in degrees.
    Sigma(f64),
    /// Number of angles.
    Angles(usize),
}

const WAYS: [Wanted; 10] = [
    Wanted::Sigma(3.0),
    Wanted::Sigma(1.0),
    Wanted::Sigma(0.5),
    Wanted::Sigma(0.3),
    Wanted::Sigma(0.2),
    Wanted::Sigma(0.1),
    Wanted::Angles(4),
    Wanted::Angles(8),
    Wanted::Angles(12),
    Wanted::Angles(24),
];

const ELECTRONS: [f64; 7] = [1e6, 160_000.0, 40_000.0, 10_000.0, 3000.0, 1000.0, 300.0];

/// Initial and maximum number of angles of an adaptive series: the defaults of a plan.
const START: usize = 4;
const AT_MOST: usize = 24;

/// Largest code value.
const WHITE: f64 = 65_535.0;

/// Studies of the number of photographs against the error, and of the error against the camera's electrons.
pub(super) fn study(effort: Effort) -> Study {
    let side = effort.pick(64, 40);
    let setting = |way: &Wanted| match way {
        Wanted::Sigma(deg) => {
            let setting = Setting::new("until σ", format!("{deg}°"), *deg);
            if [1.0, 0.3, 0.1].contains(deg) { setting } else { setting.without_sweep() }
        }
        Wanted::Angles(n) => {
            let setting = Setting::new("number of angles", format!("{n} angles"), *n as f64);
            if *n == 12 { setting.as_default() } else { setting.without_sweep() }
        }
    };
    Study {
        name: "series",
        group: "bench",
        title: "Series that end when σ is reached".into(),
        question: format!(
            "Plans list angles (12 by default), or name a σ (analyser.until_sigma_deg): {START} angles are taken, then each where it lowers σ most, until nine tenths of the \
             pixels are known so well, {AT_MOST} angles are taken, or no {AT_MOST} would do. A grating of all orientations without a film (r 1.1, ζ 45°), {side} × {side} \
             pixels, sinusoid. The horizontal axis counts photographs, which cost far more than their evaluation. The error is the mean, \
             {:.2} of σ; the dashed line is what the map's σ promises. Masked: the series ended because the σ asked for is out of reach.",
            (2.0 / std::f64::consts::PI).sqrt()
        ),
        knob: Axis::log("σ asked for", "°"),
        stress: Axis::log("electrons at white", "e⁻"),
        error: Axis::log("mean orientation error", "°"),
        time: Axis::log("photographs", ""),
        predicted: "the error that σ promises",
        settings: WAYS.iter().map(setting).collect(),
        scenes: ELECTRONS.map(Scene::new).to_vec(),
        reference: 2,
        run: Box::new(move |setting, scene, seed| run(side, WAYS[setting], ELECTRONS[scene], seed)),
    }
}

/// Simulated bench: takes photographs at given angles and writes them as the engine does.
struct Bench<'a> {
    folder: &'a Path,
    side: usize,
    scene: Synthetic,
    seed: u64,
    angles: Vec<f64>,
}

impl Bench<'_> {
    fn photograph(&mut self, psi: f64) -> Result<Frame> {
        self.angles.push(psi);
        // Noise is seeded by the photograph's number. A design needs three angles, so two others replace missing ones.
        let mut angles = self.angles.clone();
        angles.extend([psi + 1.0, psi + 2.0]);
        let frames = Synthetic { angles, ..self.scene.clone() }.render(self.side * self.side, self.seed)?.frames;
        let number = self.angles.len() - 1;
        let codes: Vec<u16> = frames[number].iter().map(|v| (f64::from(*v) * WHITE).round() as u16).collect();
        let file = format!("{number:02}.png");
        write_png16_gray(&self.folder.join(&file), self.side, self.side, &codes)?;
        Ok(Frame { analyser_deg: Some(psi.to_degrees()), ..Frame::new(file) })
    }
}

fn run(side: usize, wanted: Wanted, electrons: f64, seed: u64) -> Result<Outcome> {
    let folder = tempfile::tempdir().map_err(|e| Error::output(&std::env::temp_dir(), e))?;
    let noise = NoiseModel { full_scale_e: electrons, read_noise_e: 8.0 };
    let scene = Synthetic { noise: Some(noise), ..Synthetic::default() };
    let mut bench = Bench { folder: folder.path(), side, scene, seed, angles: vec![] };
    let first = match wanted {
        Wanted::Sigma(_) => START,
        Wanted::Angles(n) => n,
    };
    let frames: Vec<Frame> = even_angles(first).into_iter().map(|psi| bench.photograph(psi)).collect::<Result<_>>()?;
    let set = FrameSet { white: Some(WHITE), noise: Some(noise), ..FrameSet::new(Kind::Polarization, frames) };
    let mut running = Running::open(check(folder.path().join("frames.json"), set)?)?;
    (0..first).try_for_each(|_| running.add())?;
    let mut out_of_reach = false;
    if let Wanted::Sigma(deg) = wanted {
        let sigma = deg.to_radians();
        loop {
            let precision = running.precision()?;
            if precision.sigma().is_some_and(|s| s <= sigma) || precision.angles() >= AT_MOST {
                break;
            }
            let least = precision.least_sigma_after(AT_MOST);
            if precision.is_certain() && least.is_none_or(|least| least > UNREACHABLE_FACTOR * sigma) {
                out_of_reach = true;
                break;
            }
            // Whole degrees, except for the present angle of the stage.
            let stands = bench.angles.last().copied().unwrap_or_default();
            let degrees = (0..180).map(|d| f64::from(d).to_radians()).filter(|d| (d - stands).abs() > 1e-6);
            let next = precision.best_angle(&degrees.collect::<Vec<_>>());
            let Some(psi) = next else { break };
            let frame = bench.photograph(psi)?;
            running.push(vec![frame])?;
            running.add()?;
        }
    }
    let taken = bench.angles.len();
    let truth = Synthetic { angles: bench.angles.clone(), ..bench.scene.clone() }.render(side * side, seed)?;
    let mut series = nacre_polarimetry::Fit::new(side * side, 1);
    for (psi, frame) in truth.angles.iter().zip(&truth.frames) {
        series.add(*psi, |_, values, _| values.copy_from_slice(frame));
    }
    let map = orient(&mut series.solve(&truth.design), &truth.design, &truth.noise, 0.0);
    let judged = judge(&map.orientation, &map.sigma, &truth.truth, taken as f64);
    let masked = if out_of_reach { 1.0 } else { judged.masked };
    Ok(Outcome { masked, ..judged })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An adaptive series ends near its target error, takes fewer photographs for a larger target, and stops early if
    /// no number of photographs would reach it.
    #[test]
    fn a_series_ends_where_its_sigma_is_reached() {
        let of = |deg: f64, electrons: f64| run(40, Wanted::Sigma(deg), electrons, 3).unwrap();
        let [coarse, fine] = [of(1.0, 10_000.0), of(0.2, 40_000.0)];
        assert!(coarse.seconds < fine.seconds && coarse.error.unwrap() < 1.0, "{coarse:?} {fine:?}");
        // For normal errors the mean absolute error is 0.8 σ, and σ is close to the target.
        assert!((0.5..1.0).contains(&(fine.error.unwrap() / 0.2)), "{fine:?}");
        let dark = of(0.1, 300.0);
        assert!(dark.masked == 1.0 && dark.seconds == START as f64, "{dark:?}");
    }
}
