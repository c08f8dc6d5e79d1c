//! The bench: sample, panel, flash, analyser stage and camera on one clock.

use crate::camera::{Camera, Exposed, Settings};
use crate::config::{BenchConfig, CameraConfig};
use crate::fringes::Fringes;
use crate::random::{electrons, key};
use crate::scene::{Lamp, Scene, Source, StokesImage, Truth};
use crate::stage::Stage;
use nacre_base::Result;
use nacre_base::progress::{Progress, Silent};
use nacre_drivers::Pattern;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Rendered lights that are always kept: pattern, flash, and those just left.
const KEPT_LIGHTS: usize = 4;

/// Bytes of rendered lights that are kept: metering shows some of a scan's patterns beforehand.
const KEPT_BYTES: usize = 64 << 20;

/// Changes of the light that are kept; an exposure that straddles more sees the newest of them.
const KEPT_CHANGES: usize = 16;

/// A simulated bench. Only [`Bench::advance_to`] moves its time.
pub struct Bench {
    config: BenchConfig,
    now: Duration,
    scene: Scene,
    ambient: Vec<f32>,
    truth: Truth,
    /// Newest last.
    lights: VecDeque<(Source, Arc<StokesImage>)>,
    /// What shone since when, newest last.
    changes: VecDeque<(Duration, Shining)>,
    stage: Stage,
    camera: Camera,
    steady_since: Duration,
}

/// What shines on the sample, and whether the camera can see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shining {
    /// What the panel shows.
    pub pattern: Pattern,
    /// The flash is on.
    pub flash: bool,
    /// The camera's shutter is closed.
    pub covered: bool,
}

/// A part of an exposure under one source; none for the dark.
struct Lit {
    share: f64,
    source: Source,
    light: Arc<StokesImage>,
}

impl Bench {
    /// Builds the bench; the panel is black, the flash off, the analyser at 0°.
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
            lights: VecDeque::new(),
            changes: [(Duration::ZERO, dark)].into(),
            steady_since: Duration::ZERO,
            config: config.clone(),
            scene,
            ambient,
            truth,
        })
    }

    /// The configuration it was built from.
    pub fn config(&self) -> &BenchConfig {
        &self.config
    }

    /// What the sample really is.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// What the sample is, seen with the photograph shifted by so many pixels to the right and down.
    ///
    /// # Errors
    /// None but a defect of the program.
    pub fn truth_shifted(&self, shift_px: [f64; 2]) -> Result<Truth> {
        Ok(self.scene.survey(shift_px, &Silent)?.0)
    }

    /// Size of a pixel on the sample in µm.
    pub fn pixel_um(&self) -> f64 {
        1000.0 * self.scene.pixel_mm()
    }

    /// Time now.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Lets time pass; never back.
    pub fn advance_to(&mut self, time: Duration) {
        self.now = self.now.max(time);
        self.camera.advance(self.now);
    }

    /// Readout time of the camera.
    pub fn readout(&self) -> Duration {
        self.camera.readout()
    }

    /// Starts turning the analyser; returns when it has settled.
    pub fn turn_analyser(&mut self, angle_deg: f64) -> Duration {
        let settled = self.stage.move_to(angle_deg, self.now);
        self.steady_since = settled;
        settled
    }

    /// Ends a movement of the analyser where it is.
    pub fn halt_analyser(&mut self) {
        self.stage.halt(self.now);
        self.steady_since = self.now;
    }

    /// Where the analyser really stands.
    pub fn analyser_deg(&self) -> f64 {
        self.stage.angle(self.now)
    }

    /// What shines now.
    pub fn shining(&self) -> Shining {
        self.changes.back().map_or(Shining { pattern: Pattern::Black, flash: false, covered: false }, |c| c.1)
    }

    /// Changes what shines, which is steady after `settling`. Light that was not rendered before is rendered now.
    pub fn shine(&mut self, shining: Shining, settling: Duration) {
        self.steady_since = self.steady_since.max(self.now + settling);
        if shining != self.shining() {
            self.change(shining);
        }
        for source in self.sources(&shining).into_iter().flatten() {
            self.rendered(&source);
        }
    }

    /// Flash and shutter change at once, a panel that lags later.
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

    /// The next frame in the camera's queue, however old; none while the queue is empty.
    pub fn take_frame(&mut self) -> Option<Exposed> {
        self.camera.take()
    }

    /// When the frame that is being exposed will be in the queue.
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
            // Nobody cancels `Silent`.
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

    /// The sources that lit an exposure with their shares of its time, and the share with an open shutter.
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

    /// The same light through a wedge, rendered anew so that no interpolation stands between sample and camera.
    fn shifted(&self, mut lit: Vec<Lit>, shift: [f64; 2]) -> (Vec<Lit>, Option<Vec<f32>>) {
        for lit in &mut lit {
            // Nobody cancels `Silent`.
            if let Ok(light) = self.scene.render(&lit.source, shift, &Silent) {
                lit.light = Arc::new(light);
            }
        }
        (lit, self.scene.survey(shift, &Silent).ok().map(|(_, ambient)| ambient))
    }

    /// Codes of one exposure, row-major: the analyser's angle averaged over it, shot and read noise, converter.
    pub fn codes(&self, frame: &Exposed) -> Vec<u16> {
        let (end, exposure) = (frame.end - self.camera.readout(), frame.settings.exposure_s);
        let (cos2, sin2) = self.analyser_over(frame.start, end);
        let (lit, open) = self.lit(frame.start, end);
        let shift = self.config.shift_px(self.stage.angle(frame.start + (end - frame.start) / 2));
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
                let electrons = electrons(
                    noise ^ (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15),
                    mean.max(0.0),
                    camera.read_noise_e,
                );
                *code = (black + per_electron * electrons.min(camera.well_e)).round().clamp(0.0, white) as u16;
            }
        });
        codes
    }

    /// A frame's noise belongs to the seed, the physical state it shows and its place in the row of frames since
    /// that state was reached, so that repeats differ and a repeated session does not.
    fn noise_key(&self, frame: &Exposed, [cos2, sin2, open]: [f64; 3], lit: &[Lit]) -> u64 {
        let period = Duration::from_secs_f64(frame.settings.exposure_s) + self.camera.readout();
        let reached = self.steady_since.max(frame.adopted);
        let since = frame.start.saturating_sub(reached).as_nanos() / period.as_nanos().max(1);
        // Behind a closed shutter the analyser makes no difference.
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
        key(&[self.config.seed, key(&state), since as u64])
    }

    /// Mean of (cos 2ψ, sin 2ψ) over an exposure, which is all that Malus' law needs.
    fn analyser_over(&self, start: Duration, end: Duration) -> (f64, f64) {
        const STEPS: u32 = 16;
        let (mut cos, mut sin) = (0.0, 0.0);
        for k in 0..STEPS {
            let at = start + (end - start) * (2 * k + 1) / (2 * STEPS);
            let (s, c) = (2.0 * self.stage.angle(at).to_radians()).sin_cos();
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

    /// What a lagging panel, flash and shutter let the camera see, after changes while another is on its way.
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
