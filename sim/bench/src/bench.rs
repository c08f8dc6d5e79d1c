//! The bench: sample, panel, flash, analyser stage and camera with a common clock.

use crate::camera::{Camera, Exposed, Settings};
use crate::config::{BenchConfig, CameraConfig};
use crate::fringes::Fringes;
use crate::random::{electrons, key};
use crate::scene::{Lamp, Scene, Source, StokesImage, Truth};
use crate::sensor::Sensor;
use crate::stage::Stage;
use nacre_base::Result;
use nacre_base::progress::{Progress, Silent};
use nacre_drivers::Pattern;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Number of rendered lights that are always cached: pattern, flash, and the previous ones.
const KEPT_LIGHTS: usize = 4;

/// Bytes of cached lights. Metering shows some patterns of a scan before the scan does.
const KEPT_BYTES: usize = 64 << 20;

/// Number of recorded changes of the light. An exposure over more changes uses the newest ones.
const KEPT_CHANGES: usize = 16;

/// A simulated bench. Only [`Bench::advance_to`] advances its time.
pub struct Bench {
    config: BenchConfig,
    now: Duration,
    scene: Scene,
    ambient: Vec<f32>,
    truth: Truth,
    /// Rendered lights, newest last.
    lights: VecDeque<(Source, Arc<StokesImage>)>,
    /// States of the light with their start times, newest last.
    changes: VecDeque<(Duration, Shining)>,
    stage: Stage,
    camera: Camera,
    sensor: Sensor,
    steady_since: Duration,
}

/// State of light sources and shutter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shining {
    /// Pattern on the panel.
    pub pattern: Pattern,
    /// Whether the flash is on.
    pub flash: bool,
    /// Whether the camera's shutter is closed.
    pub covered: bool,
}

/// Part of an exposure under one source; darkness has no entry.
struct Lit {
    share: f64,
    source: Source,
    light: Arc<StokesImage>,
}

impl Bench {
    /// Builds the bench: the panel is black, the flash off, the analyser at 0°.
    ///
    /// # Errors
    /// `Cancelled`; a rigorous R (`[grating.rigorous]`) that cannot be computed to the requested error.
    pub fn new(config: &BenchConfig, progress: &dyn Progress) -> Result<Self> {
        let scene = Scene::new(config)?;
        let (truth, ambient) = scene.survey([0.0; 2], progress)?;
        let dark = Shining { pattern: Pattern::Black, flash: false, covered: false };
        Ok(Self {
            now: Duration::ZERO,
            stage: Stage::new(&config.stage, config.seed),
            camera: Camera::new(&config.camera),
            sensor: Sensor::new(&config.camera, config.seed),
            lights: VecDeque::new(),
            changes: [(Duration::ZERO, dark)].into(),
            steady_since: Duration::ZERO,
            config: config.clone(),
            scene,
            ambient,
            truth,
        })
    }

    /// The bench's configuration.
    pub fn config(&self) -> &BenchConfig {
        &self.config
    }

    /// Ground truth of the sample.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// Ground truth of the sample in a photograph shifted by `shift_px` pixels, right and down.
    ///
    /// # Errors
    /// Never, except for a defect of the program.
    pub fn truth_shifted(&self, shift_px: [f64; 2]) -> Result<Truth> {
        Ok(self.scene.survey(shift_px, &Silent)?.0)
    }

    /// Size of a pixel on the sample in µm.
    pub fn pixel_um(&self) -> f64 {
        1000.0 * self.scene.pixel_mm()
    }

    /// Current time.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Advances the time; earlier times have no effect.
    pub fn advance_to(&mut self, time: Duration) {
        self.now = self.now.max(time);
        self.camera.advance(self.now);
    }

    /// Readout time of the camera.
    pub fn readout(&self) -> Duration {
        self.camera.readout()
    }

    /// Starts turning the analyser; returns the time at which it has settled.
    pub fn turn_analyser(&mut self, angle_deg: f64) -> Duration {
        let settled = self.stage.move_to(angle_deg, self.now);
        self.steady_since = settled;
        settled
    }

    /// Stops a movement of the analyser.
    pub fn halt_analyser(&mut self) {
        self.stage.halt(self.now);
        self.steady_since = self.now;
    }

    /// True angle of the analyser.
    pub fn analyser_deg(&self) -> f64 {
        self.stage.angle(self.now)
    }

    /// Current state of the light.
    pub fn shining(&self) -> Shining {
        self.changes.back().map_or(Shining { pattern: Pattern::Black, flash: false, covered: false }, |c| c.1)
    }

    /// Changes the light, which is steady after `settling`. Light that is not cached is rendered now.
    pub fn shine(&mut self, shining: Shining, settling: Duration) {
        self.steady_since = self.steady_since.max(self.now + settling);
        if shining != self.shining() {
            self.change(shining);
        }
        for source in self.sources(&shining).into_iter().flatten() {
            self.rendered(&source);
        }
    }

    /// Records a change. Flash and shutter change at once, a lagging panel later.
    fn change(&mut self, shining: Shining) {
        let lag = Duration::from_secs_f64(self.config.panel.lag_ms / 1000.0);
        let asked = self.shining().pattern;
        let to_come = self.changes.partition_point(|c| c.0 <= self.now);
        let seen = self.changes.get(to_come.saturating_sub(1)).map_or(asked, |c| c.1.pattern);
        self.changes.range_mut(to_come..).for_each(|c| c.1 = Shining { pattern: c.1.pattern, ..shining });
        let pattern = if lag.is_zero() { shining.pattern } else { seen };
        self.changes.insert(to_come, (self.now, Shining { pattern, ..shining }));
        if !lag.is_zero() && asked != shining.pattern {
            self.changes.push_back((self.now + lag, shining));
        }
        while self.changes.len() > KEPT_CHANGES {
            self.changes.pop_front();
        }
    }

    /// Sets exposure (s) and gain.
    pub fn set_camera(&mut self, exposure_s: f64, gain: f64) {
        self.camera.set(Settings { exposure_s, gain });
    }

    /// The oldest frame in the camera's queue; `None` if the queue is empty.
    pub fn take_frame(&mut self) -> Option<Exposed> {
        self.camera.take()
    }

    /// Time at which the current exposure will be in the queue.
    pub fn next_frame_at(&self) -> Duration {
        self.camera.next_end()
    }

    fn sources(&self, shining: &Shining) -> [Option<Source>; 2] {
        let panel = match shining.pattern {
            Pattern::Black => None,
            Pattern::Disc { center_mm, diameter_mm } => {
                let middle = self.scene.panel_middle_mm();
                let center_mm = [middle[0] + center_mm[0], middle[1] + center_mm[1]];
                Some(Source { lamp: Lamp::Panel, center_mm, diameter_mm, fringes: None })
            }
            Pattern::Fringes { cycles_per_mm, phase, gamma } => Some(self.scene.fringes(cycles_per_mm, phase, gamma)),
        };
        let f = &self.config.flash;
        let flash =
            Source { lamp: Lamp::Flash, center_mm: [f.x_mm, f.y_mm], diameter_mm: f.diameter_mm, fringes: None };
        [panel, shining.flash.then_some(flash)]
    }

    fn rendered(&mut self, source: &Source) {
        let light = match self.lights.iter().position(|(s, _)| s == source).and_then(|at| self.lights.remove(at)) {
            Some((_, light)) => light,
            // Rendering can only be cancelled, which `Silent` never does.
            None => match self.scene.render(source, [0.0; 2], &Silent) {
                Ok(light) => Arc::new(light),
                Err(_) => return,
            },
        };
        self.lights.push_back((*source, light));
        let bytes = |light: &StokesImage| light.planes.iter().map(|p| size_of_val(p.as_slice())).sum::<usize>();
        let all: usize = self.lights.iter().map(|(_, light)| bytes(light)).sum();
        if self.lights.len() > KEPT_LIGHTS && all > KEPT_BYTES {
            self.lights.pop_front();
        }
    }

    /// The sources during an exposure with their fractions of its time, and the fraction with an open shutter.
    fn lit(&self, start: Duration, end: Duration) -> (Vec<Lit>, f64) {
        let length = end.saturating_sub(start).as_secs_f64();
        let ends = self.changes.iter().skip(1).map(|c| c.0).chain([Duration::MAX]);
        let (mut lit, mut open): (Vec<Lit>, f64) = (Vec::new(), 0.0);
        for ((from, shining), until) in self.changes.iter().zip(ends) {
            let overlap = until.min(end).saturating_sub(start.max(*from)).as_secs_f64();
            if overlap == 0.0 || shining.covered {
                continue;
            }
            let share = overlap / length;
            open += share;
            for source in self.sources(shining).into_iter().flatten() {
                if let Some(same) = lit.iter_mut().find(|l| l.source == source) {
                    same.share += share;
                } else if let Some((_, light)) = self.lights.iter().find(|(s, _)| *s == source) {
                    lit.push(Lit { share, source, light: light.clone() });
                }
            }
        }
        (lit, open)
    }

    /// The same light through a wedge, rendered again so that no interpolation blurs the sample.
    fn shifted(&self, mut lit: Vec<Lit>, shift: [f64; 2]) -> (Vec<Lit>, Option<Vec<f32>>) {
        for lit in &mut lit {
            // Rendering can only be cancelled, which `Silent` never does.
            if let Ok(light) = self.scene.render(&lit.source, shift, &Silent) {
                lit.light = Arc::new(light);
            }
        }
        (lit, self.scene.survey(shift, &Silent).ok().map(|(_, ambient)| ambient))
    }

    /// Sensor codes of an exposure, row-major: mean over the analyser angles, shot noise, read noise, quantization.
    pub fn codes(&self, frame: &Exposed) -> Vec<u16> {
        let (end, exposure) = (frame.end - self.camera.readout(), frame.settings.exposure_s);
        let (cos2, sin2) = self.analyser_over(frame.start, end);
        let (lit, open) = self.lit(frame.start, end);
        let shift = self.config.shift_px(self.stage.axis(frame.start + (end - frame.start) / 2));
        let (lit, ambient) = if shift == [0.0; 2] { (lit, None) } else { self.shifted(lit, shift) };
        let ambient = ambient.as_ref().unwrap_or(&self.ambient);
        let (camera, extinction) = (&self.config.camera, 1.0 / self.config.stage.extinction_ratio);
        let electrons_per_unit = camera.sensitivity_e_ms * exposure * 1000.0;
        let noise = self.noise_key(frame, [cos2, sin2, open], &lit);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let white = f64::from((1u32 << camera.bits) - 1);
        let black = f64::from(camera.black_level);
        let per_electron = frame.settings.gain * (white - black) / camera.well_e;
        let light = |i: usize| {
            let mut sum = open * (1.0 + extinction) * f64::from(ambient[i]);
            for Lit { share, light, .. } in &lit {
                let [s0, s1, s2] = [0, 1, 2].map(|p| f64::from(light.planes[p][i]));
                sum += share * (s0 * (1.0 + extinction) + (1.0 - extinction) * (s1 * cos2 + s2 * sin2));
            }
            0.5 * sum
        };
        let mut codes = vec![0_u16; width * height];
        codes.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, code) in row.iter_mut().enumerate() {
                let i = y * width + x;
                let mean = electrons_per_unit * light(i) * vignetting(camera, x, y);
                let key = noise ^ (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                let electrons = electrons(key, self.sensor.mean(i, mean.max(0.0), exposure), camera.read_noise_e);
                let read = self.sensor.read(i, electrons);
                *code = (black + per_electron * read.min(camera.well_e)).round().clamp(0.0, white) as u16;
            }
        });
        codes
    }

    /// Key of a frame's noise: seed, physical state, and number of frames since that state began. Repeated frames
    /// differ, but a repeated session is identical.
    fn noise_key(&self, frame: &Exposed, [cos2, sin2, open]: [f64; 3], lit: &[Lit]) -> u64 {
        let period = Duration::from_secs_f64(frame.settings.exposure_s) + self.camera.readout();
        let reached = self.steady_since.max(frame.adopted);
        let since = frame.start.saturating_sub(reached).as_nanos() / period.as_nanos().max(1);
        // Behind a closed shutter the analyser has no effect.
        let [cos2, sin2] = if open > 0.0 { [cos2, sin2] } else { [0.0; 2] };
        let mut state = vec![cos2, sin2, open, frame.settings.exposure_s, frame.settings.gain];
        for Lit { share, source, .. } in lit {
            let lamp = if source.lamp == Lamp::Flash { 1.0 } else { 0.0 };
            state.extend([*share, lamp, source.center_mm[0], source.center_mm[1], source.diameter_mm]);
            if let Some(Fringes { cycles_per_mm: [x, y], phase, gamma }) = source.fringes {
                state.extend([x, y, phase, gamma]);
            }
        }
        let state: Vec<u64> = state.into_iter().map(f64::to_bits).collect();
        key(&[self.config.noise_seed.unwrap_or(self.config.seed), key(&state), since as u64])
    }

    /// Mean of (cos 2ψ, sin 2ψ) over an exposure, which suffices for Malus' law.
    fn analyser_over(&self, start: Duration, end: Duration) -> (f64, f64) {
        const STEPS: u32 = 16;
        let (mut cos, mut sin) = (0.0, 0.0);
        for k in 0..STEPS {
            let at = start + (end - start) * (2 * k + 1) / (2 * STEPS);
            let (s, c) = (2.0 * self.stage.axis(at).to_radians()).sin_cos();
            cos += c / f64::from(STEPS);
            sin += s / f64::from(STEPS);
        }
        (cos, sin)
    }
}

fn vignetting(camera: &CameraConfig, x: usize, y: usize) -> f64 {
    let half = [f64::from(camera.width) / 2.0, f64::from(camera.height) / 2.0];
    let (u, v) = ((x as f64 + 0.5) / half[0] - 1.0, (y as f64 + 0.5) / half[1] - 1.0);
    1.0 - camera.vignetting * 0.5 * (u * u + v * v)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light that the camera sees with a lagging panel, flash and shutter, when changes follow each other.
    #[test]
    fn a_panel_that_lags_holds_nothing_else_up() {
        let mut config = BenchConfig::default();
        (config.camera.width, config.camera.height, config.panel.lag_ms) = (8, 6, 100.0);
        let mut bench = Bench::new(&config, &Silent).unwrap();
        let disc = Pattern::Disc { center_mm: [0.0; 2], diameter_mm: 50.0 };
        let at = |ms| Duration::from_millis(ms);
        for (ms, pattern, flash) in
            [(10, disc, false), (50, disc, true), (80, Pattern::Black, true), (120, Pattern::Black, false)]
        {
            bench.advance_to(at(ms));
            bench.shine(Shining { pattern, flash, covered: false }, Duration::ZERO);
        }
        let seen: Vec<(Duration, bool, bool)> =
            bench.changes.iter().map(|(t, s)| (*t, s.pattern == disc, s.flash)).collect();
        let expected = [(0, false, false), (10, false, false), (50, false, true), (80, false, true), (110, true, true)];
        let later = [(120, true, false), (180, false, false)];
        assert_eq!(seen, expected.into_iter().chain(later).map(|(ms, p, f)| (at(ms), p, f)).collect::<Vec<_>>());
    }
}
