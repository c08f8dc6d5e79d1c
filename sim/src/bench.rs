//! The bench: sample, panel, analyser stage and camera on one virtual clock.

use crate::camera::{Camera, Exposed, Settings};
use crate::config::{BenchConfig, CameraConfig};
use crate::random::{electrons, key};
use crate::scene::{Scene, StokesImage, Truth};
use crate::stage::Stage;
use nacre_drivers::Clock;
use nacre_processing::Result;
use nacre_processing::progress::Progress;
use rayon::prelude::*;
use std::time::Duration;

/// A simulated bench. Only waiting and device calls advance its time.
pub struct Bench {
    config: BenchConfig,
    now: Duration,
    scene: Scene,
    light: StokesImage,
    truth: Truth,
    exposure_ms: f64,
    display: Vec<(Duration, bool)>,
    stage: Stage,
    camera: Camera,
    steady_since: Duration,
}

impl Bench {
    /// Builds the bench and renders its light; the panel is black, the analyser at 0°.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn new(config: &BenchConfig, progress: &dyn Progress) -> Result<Self> {
        let scene = Scene::new(config);
        let (light, truth) = scene.render(config.disc_mm(), progress)?;
        let exposure_ms = config.camera.exposure_ms.unwrap_or_else(|| metered_ms(config, &light));
        Ok(Self {
            now: Duration::ZERO,
            stage: Stage::new(&config.stage, config.seed),
            camera: Camera::new(&config.camera),
            display: vec![(Duration::ZERO, false)],
            steady_since: Duration::ZERO,
            exposure_ms,
            config: config.clone(),
            scene,
            light,
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

    /// Size of a pixel on the sample in µm.
    pub fn pixel_um(&self) -> f64 {
        1000.0 * self.scene.pixel_mm()
    }

    /// Exposure time in ms: as configured, or such that no pixel saturates at any analyser angle.
    pub fn exposure_ms(&self) -> f64 {
        self.exposure_ms
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

    /// Shows the white disc, or black.
    pub fn show_disc(&mut self, on: bool) {
        if self.display.last().is_none_or(|(_, was)| *was != on) {
            self.display.push((self.now, on));
        }
        self.steady_since = self.steady_since.max(self.now);
    }

    /// Sets exposure (s) and gain.
    pub fn set_camera(&mut self, exposure_s: f64, gain: f64) {
        self.camera.set(Settings { exposure_s, gain });
    }

    /// The next frame in the camera's queue, however old; waits for one if there is none.
    pub fn next_frame(&mut self) -> Exposed {
        loop {
            if let Some(exposed) = self.camera.take() {
                return exposed;
            }
            let wait = self.camera.next_end().saturating_sub(self.now);
            self.wait(wait);
        }
    }

    /// Codes of one exposure, row-major: the analyser's angle averaged over it, shot and read noise, converter.
    pub fn codes(&self, frame: &Exposed) -> Vec<u16> {
        let (end, exposure) = (frame.end - self.camera.readout(), frame.settings.exposure_s);
        let (cos2, sin2) = self.analyser_over(frame.start, end);
        let lit = self.lit_share(frame.start, end);
        let (camera, extinction) = (&self.config.camera, 1.0 / self.config.stage.extinction_ratio);
        let electrons_per_unit = camera.sensitivity_e_ms * exposure * 1000.0;
        let noise = self.noise_key(frame, cos2, sin2, lit);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let white = f64::from((1u32 << camera.bits) - 1);
        let black = f64::from(camera.black_level);
        let per_electron = frame.settings.gain * (white - black) / camera.well_e;
        let light = |i: usize| {
            let [s0, s1, s2] = [0, 1, 2].map(|p| f64::from(self.light.planes[p][i]));
            let disc = s0 * (1.0 + extinction) + (1.0 - extinction) * (s1 * cos2 + s2 * sin2);
            0.5 * (lit * disc + (1.0 + extinction) * f64::from(self.light.ambient[i]))
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
    fn noise_key(&self, frame: &Exposed, cos2: f64, sin2: f64, lit: f64) -> u64 {
        let period = Duration::from_secs_f64(frame.settings.exposure_s) + self.camera.readout();
        let since = frame.start.saturating_sub(self.steady_since).as_nanos() / period.as_nanos().max(1);
        let state = [cos2, sin2, lit, frame.settings.exposure_s, frame.settings.gain].map(f64::to_bits);
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

    /// Share of an exposure during which the disc was white.
    fn lit_share(&self, start: Duration, end: Duration) -> f64 {
        let ends = self.display.iter().skip(1).map(|d| d.0).chain([Duration::MAX]);
        let on: Duration = self
            .display
            .iter()
            .zip(ends)
            .filter(|((_, on), _)| *on)
            .map(|((from, _), until)| until.min(end).saturating_sub(start.max(*from)))
            .sum();
        if end > start { on.as_secs_f64() / (end - start).as_secs_f64() } else { 0.0 }
    }
}

/// Exposure (ms) that fills the brightest pixel to 85 % of well and converter at its brightest analyser angle.
fn metered_ms(config: &BenchConfig, light: &StokesImage) -> f64 {
    let [s0, s1, s2] = &light.planes;
    let camera = &config.camera;
    let width = camera.width as usize;
    let brightest = (0..s0.len())
        .map(|i| {
            let disc = 0.5 * f64::from(s0[i] + s1[i].hypot(s2[i]) + light.ambient[i]);
            disc * vignetting(camera, i % width, i / width)
        })
        .fold(0.0, f64::max);
    let electrons = 0.85 * camera.well_e / camera.gain.max(1.0);
    (electrons / (camera.sensitivity_e_ms * brightest.max(1e-9))).clamp(1e-3, 1e6)
}

fn vignetting(camera: &CameraConfig, x: usize, y: usize) -> f64 {
    let half = [f64::from(camera.width) / 2.0, f64::from(camera.height) / 2.0];
    let (u, v) = ((x as f64 + 0.5) / half[0] - 1.0, (y as f64 + 0.5) / half[1] - 1.0);
    1.0 - camera.vignetting * 0.5 * (u * u + v * v)
}

impl Clock for Bench {
    fn now(&self) -> Duration {
        self.now
    }

    fn wait(&mut self, duration: Duration) {
        self.now += duration;
        self.camera.advance(self.now);
    }
}
