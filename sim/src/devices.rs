//! The bench as devices: what the capture engine drives in place of real ones.

use crate::bench::Bench;
use crate::config::BenchConfig;
use async_trait::async_trait;
use nacre_drivers::{
    Camera, CameraInfo, Class, Clock, Controls, DeviceError, DeviceResult, Display, DisplayInfo, Frame, Pattern,
    Settled, Stage, StageInfo,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A bench that several devices share.
#[derive(Clone)]
pub struct SharedBench(Arc<Mutex<Bench>>);

impl SharedBench {
    /// Shares a bench.
    pub fn new(bench: Bench) -> Self {
        Self(Arc::new(Mutex::new(bench)))
    }

    /// The bench, for as long as the guard lives.
    pub fn lock(&self) -> MutexGuard<'_, Bench> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The three devices of a polarization session.
    pub fn devices(&self) -> (SimStage, SimCamera, SimDisplay) {
        (SimStage(self.clone()), SimCamera(self.clone()), SimDisplay(self.clone()))
    }
}

/// Height of the simulated panel, a common 24-inch one.
const PANEL_MM: f64 = 320.0;

/// What the devices of a bench are and can do, without building it.
pub fn describe(bench: &BenchConfig) -> (StageInfo, CameraInfo, DisplayInfo) {
    let (stage, camera) = (&bench.stage, &bench.camera);
    let stage = StageInfo {
        id: "simulated stage".into(),
        speed_deg_s: stage.speed_deg_s,
        settling_s: stage.settle_ms / 1000.0,
    };
    let camera = CameraInfo {
        id: "simulated camera".into(),
        width: camera.width as usize,
        height: camera.height as usize,
        exposure_s: [1e-5, 60.0],
        exposure_now_s: camera.power_on_exposure_s(),
        gain: [1.0, 100.0],
        black: camera.black_level as u16,
        white: ((1u32 << camera.bits) - 1) as u16,
        readout_s: camera.readout_ms / 1000.0,
        control_lag_frames: camera.lag_frames,
        full_scale_e: Some(camera.well_e),
        read_noise_e: Some(camera.read_noise_e),
    };
    (stage, camera, DisplayInfo { id: "simulated panel".into(), largest_disc_mm: PANEL_MM })
}

/// The simulated rotation stage.
pub struct SimStage(SharedBench);

/// The simulated camera.
pub struct SimCamera(SharedBench);

/// The simulated panel.
pub struct SimDisplay(SharedBench);

#[async_trait]
impl Stage for SimStage {
    fn describe(&self) -> StageInfo {
        describe(self.0.lock().config()).0
    }

    async fn home(&mut self) -> DeviceResult<Settled> {
        self.move_to(0.0).await
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Settled> {
        let mut bench = self.0.lock();
        let since = bench.turn_analyser(angle_deg);
        let wait = since.saturating_sub(bench.now());
        bench.wait(wait);
        Ok(Settled { since })
    }
}

#[async_trait]
impl Camera for SimCamera {
    fn describe(&self) -> CameraInfo {
        describe(self.0.lock().config()).1
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        let mut bench = self.0.lock();
        bench.set_camera(exposure.as_secs_f64(), gain);
        Ok(Controls { exposure, gain, set_at: bench.now() })
    }

    async fn next_frame(&mut self) -> DeviceResult<Frame> {
        let mut bench = self.0.lock();
        let exposed = bench.next_frame();
        let (width, height) = (bench.config().camera.width as usize, bench.config().camera.height as usize);
        Ok(Frame { stamp: exposed.stamp(), width, height, codes: bench.codes(&exposed) })
    }
}

#[async_trait]
impl Display for SimDisplay {
    fn describe(&self) -> DisplayInfo {
        describe(self.0.lock().config()).2
    }

    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Settled> {
        let mut bench = self.0.lock();
        let rendered = bench.config().disc_mm();
        if let Pattern::Disc(mm) = pattern
            && mm != rendered
        {
            return Err(DeviceError {
                device: "simulated panel".into(),
                command: format!("show a disc of {mm} mm"),
                expected: format!("the {rendered} mm that this bench was rendered with"),
                got: format!("{mm} mm"),
                remedy: "build the bench with panel.disc_mm set to it".into(),
                class: Class::Setup,
            });
        }
        bench.show_disc(pattern != Pattern::Black);
        Ok(Settled { since: bench.now() })
    }
}
