//! The capture engine: takes a plan's frames one by one, each fresh, each committed before the next.
//!
//! Whatever stops it, going on later gives the same data set: settings are sent again, the stage is homed and every angle
//! approached from below, and frames that are committed are not taken twice.

use crate::Failure;
use crate::plan::{Plan, Step};
use crate::session::{Commit, Disk, Session};
use nacre_drivers::{Camera, CameraInfo, Controls, DeviceError, Display, Frame, Freshness, Pattern, Settled, Stage};
use nacre_processing::Error;
use nacre_processing::frames::{self, FrameSet, Kind, Transfer};
use nacre_processing::image::encode_png16_gray;
use nacre_processing::polarimetry::{Design, Fit, NoiseModel};
use nacre_processing::progress::Progress;
use std::path::PathBuf;
use std::time::Duration;

/// Angles are approached from this far below, so that backlash has no say.
const APPROACH_DEG: f64 = 5.0;

/// A camera this many frames behind is broken.
const MAX_STALE: u32 = 200;

/// Metering aims at this share of white for the brightest pixels.
const METER_TARGET: f64 = 0.85;

/// The devices of a polarization session.
pub struct Bench<'a> {
    /// Turns the analyser.
    pub stage: &'a mut dyn Stage,
    /// Takes the frames.
    pub camera: &'a mut dyn Camera,
    /// Lights the sample.
    pub display: &'a mut dyn Display,
}

/// Stops on the way to `to` from `from`: one, or two when the angle does not lie above.
pub fn approach(from: f64, to: f64) -> Vec<f64> {
    if to <= from { vec![to - APPROACH_DEG, to] } else { vec![to] }
}

impl Bench<'_> {
    /// Takes all frames that the session does not have yet. The panel is black afterwards, come what may.
    ///
    /// # Errors
    /// A device error, a full disk, an interruption; the session can be resumed.
    pub async fn run<D: Disk>(
        &mut self,
        plan: &Plan,
        exposure: Duration,
        session: &mut Session<D>,
        progress: &dyn Progress,
    ) -> Result<(), Failure> {
        let result = self.take_all(plan, exposure, session, progress).await;
        let dark = self.display.show(Pattern::Black).await;
        if let Err(failure) = &result {
            // The first failure is the one to report; a journal that cannot be written adds nothing to it.
            let _ = session.stopped(&failure.to_string());
        }
        result?;
        dark?;
        Ok(())
    }

    async fn take_all<D: Disk>(
        &mut self,
        plan: &Plan,
        exposure: Duration,
        session: &mut Session<D>,
        progress: &dyn Progress,
    ) -> Result<(), Failure> {
        let steps = plan.steps();
        progress.stage("capturing", steps.len() as u64);
        let (controls, first) = self.prepare(plan, exposure).await?;
        let mut angle = 0.0;
        for step in &steps {
            progress.check()?;
            if !session.has(&step.file) {
                let settled = self.set(step, angle).await?;
                angle = step.analyser_deg;
                let (bytes, evidence) = self
                    .fresh(plan, &controls, Freshness { steady_since: settled.since, first_sequence: first })
                    .await?;
                let path = session.folder().join(&step.file);
                session.store(&step.file, &bytes, evidence).map_err(|e| Error::output(&path, e))?;
            }
            progress.step();
        }
        let set = frames::save(&self.describe(plan, exposure, &steps));
        let path = session.folder().join(frames::FILE_NAME);
        session.finish(&set).map_err(|e| Error::output(&path, e))?;
        Ok(())
    }

    /// Homes the stage, sends the camera's settings and waits until they are in force.
    /// Returns the controls and the first frame that has them.
    async fn prepare(&mut self, plan: &Plan, exposure: Duration) -> Result<(Controls, u64), Failure> {
        let info = self.camera.describe();
        let controls = self.camera.configure(exposure, plan.camera.gain).await?;
        self.stage.home().await?;
        for _ in 0..MAX_STALE {
            let stamp = self.camera.next_frame().await?.stamp;
            if let Some(first) = Freshness::first_with_controls(stamp, controls.set_at, info.control_lag_frames) {
                return Ok((controls, first));
            }
        }
        Err(only_stale(info).into())
    }

    async fn set(&mut self, step: &Step, angle: f64) -> Result<Settled, Failure> {
        let shown = self.display.show(step.pattern).await?;
        let mut settled = shown;
        for stop in approach(angle, step.analyser_deg) {
            settled = self.stage.move_to(stop).await?;
        }
        Ok(Settled { since: settled.since.max(shown.since) })
    }

    /// The step's frame (mean of several when the plan averages) as a PNG, with its evidence.
    async fn fresh(
        &mut self,
        plan: &Plan,
        controls: &Controls,
        freshness: Freshness,
    ) -> Result<(Vec<u8>, Commit), Failure> {
        let (frame, dropped) = self.until_fresh(&freshness, controls).await?;
        let count = plan.camera.average;
        let mut sum: Vec<u32> = frame.codes.iter().map(|&c| c.into()).collect();
        let mut last = frame;
        for _ in 1..count {
            last = self.next_frame().await?;
            sum.iter_mut().zip(&last.codes).for_each(|(s, &c)| *s += u32::from(c));
        }
        let factor = stored_factor(&self.camera.describe(), count);
        let mean = |s: u32| ((s * factor + count / 2) / count) as u16;
        let [left, top, width, height] =
            plan.camera.roi.map_or([0, 0, last.width, last.height], |roi| roi.map(|v| v as usize));
        let rows = sum.chunks(last.width).skip(top).take(height);
        let codes: Vec<u16> = rows.flat_map(|row| row[left..left + width].iter().map(|&s| mean(s))).collect();
        let evidence = Commit {
            sequence: last.stamp.sequence,
            timestamp_ns: last.stamp.timestamp.as_nanos() as u64,
            steady_since_ns: freshness.steady_since.as_nanos() as u64,
            dropped,
            ..Commit::default()
        };
        let png = encode_png16_gray(width, height, &codes).map_err(|e| Error::output(&PathBuf::from("frame"), e))?;
        Ok((png, evidence))
    }

    /// The next frame, of the size that the camera promised.
    async fn next_frame(&mut self) -> Result<Frame, Failure> {
        let (info, frame) = (self.camera.describe(), self.camera.next_frame().await?);
        if frame.codes.len() != info.width * info.height || frame.width != info.width {
            return Err(wrong_size(&info, &frame).into());
        }
        Ok(frame)
    }

    /// Drops frames until one is fresh; also returns how many were dropped.
    async fn until_fresh(&mut self, freshness: &Freshness, controls: &Controls) -> Result<(Frame, u32), Failure> {
        let info = self.camera.describe();
        let readout = Duration::from_secs_f64(info.readout_s);
        for dropped in 0..MAX_STALE {
            let frame = self.next_frame().await?;
            if freshness.accepts(frame.stamp, controls.exposure, readout) {
                return Ok((frame, dropped));
            }
        }
        Err(only_stale(info).into())
    }

    /// Exposure time at which the brightest pixels, at their brightest analyser angle, just stay below white: found from
    /// four frames at 0, 45, 90 and 135 degrees, which tell the whole turn.
    ///
    /// The panel is black afterwards, come what may.
    ///
    /// # Errors
    /// A device error; no light; a sample too bright for the shortest exposure.
    pub async fn meter(&mut self, plan: &Plan) -> Result<Duration, Failure> {
        let exposure = self.metered(plan).await;
        let dark = self.display.show(Pattern::Black).await;
        let exposure = exposure?;
        dark?;
        self.stage.home().await?;
        Ok(exposure)
    }

    async fn metered(&mut self, plan: &Plan) -> Result<Duration, Failure> {
        let info = self.camera.describe();
        let angles = [0.0, 45.0, 90.0, 135.0];
        let design = Design::new(&angles.map(f64::to_radians))?;
        let mut exposure = Duration::from_secs_f64(0.01_f64.clamp(info.exposure_s[0], info.exposure_s[1]));
        for _ in 0..12 {
            let (controls, first) = self.prepare(plan, exposure).await?;
            let mut fit = Fit::new(info.width, info.height);
            let mut angle = 0.0;
            for (k, to) in angles.into_iter().enumerate() {
                let step = Step { analyser_deg: to, ..plan.steps()[0].clone() };
                let settled = self.set(&step, angle).await?;
                angle = to;
                let freshness = Freshness { steady_since: settled.since, first_sequence: first };
                let (frame, _) = self.until_fresh(&freshness, &controls).await?;
                let (black, range) = (f32::from(info.black), f32::from(info.white - info.black));
                fit.add(angles[k].to_radians(), |y, row, _| {
                    let codes = &frame.codes[y * frame.width..];
                    row.iter_mut().zip(codes).for_each(|(v, c)| *v = (f32::from(*c) - black) / range);
                });
            }
            let maps = fit.solve(&design);
            let mut brightest: Vec<f32> =
                (0..maps.s0.len()).map(|i| 0.5 * (maps.s0[i] + maps.s1[i].hypot(maps.s2[i]))).collect();
            // Past the 99.9th percentile are hot pixels and glints.
            let at = (brightest.len() - 1) * 999 / 1000;
            let level = f64::from(*brightest.select_nth_unstable_by(at, f32::total_cmp).1);
            // Near white the level is clipped, and far below it is mostly noise: step, and look again.
            let factor = if level > 0.95 { 0.2 } else { (METER_TARGET / level.max(1e-3)).min(20.0) };
            let next = exposure.mul_f64(factor);
            let clamped = next.as_secs_f64().clamp(info.exposure_s[0], info.exposure_s[1]);
            let settled = (0.2..=0.95).contains(&level);
            exposure = Duration::from_secs_f64(clamped);
            if settled {
                return Ok(exposure);
            }
        }
        Err(DeviceError {
            device: info.id,
            command: "meter the exposure".into(),
            expected: "a level between black and white".into(),
            got: format!("none up to {} s", exposure.as_secs_f64()),
            remedy: "check that the light is on and the lens open, or set camera.exposure_ms".into(),
            class: nacre_drivers::Class::Stop,
        }
        .into())
    }

    fn describe(&self, plan: &Plan, exposure: Duration, steps: &[Step]) -> FrameSet {
        let info = self.camera.describe();
        let count = plan.camera.average;
        let factor = f64::from(stored_factor(&info, count));
        let frames = steps.iter().filter(|s| s.extra.is_none()).map(|s| frames::Frame {
            file: PathBuf::from(&s.file),
            analyser_deg: Some(s.analyser_deg),
            exposure_s: Some(exposure.as_secs_f64()),
            gain: Some(plan.camera.gain),
        });
        // A mean of n frames has n times the electrons and √n times the read noise of one.
        let n = f64::from(count);
        let noise = info.full_scale_e.zip(info.read_noise_e);
        FrameSet {
            kind: Kind::Polarization,
            frames: frames.collect(),
            transfer: Transfer::Linear,
            black: Some(f64::from(info.black) * factor),
            white: Some(f64::from(info.white) * factor),
            channel: None,
            layout: None,
            noise: noise.map(|(full, read)| NoiseModel { full_scale_e: full * n, read_noise_e: read * n.sqrt() }),
            dark: steps.iter().find(|s| s.extra.is_some()).map(|s| PathBuf::from(&s.file)),
            flat: None,
            wavelength_nm: None,
            band_nm: None,
            geometry: None,
        }
    }
}

/// Means are stored with as many extra levels as 16 bits hold.
fn stored_factor(info: &CameraInfo, average: u32) -> u32 {
    if average == 1 { 1 } else { (u32::from(u16::MAX) / u32::from(info.white)).max(1) }
}

fn only_stale(info: CameraInfo) -> DeviceError {
    DeviceError {
        device: info.id,
        command: "take a fresh frame".into(),
        expected: format!("one among {MAX_STALE}"),
        got: "only frames from before the last change".into(),
        remedy: "check the camera's clock and control lag".into(),
        class: nacre_drivers::Class::Stop,
    }
}

fn wrong_size(info: &CameraInfo, frame: &Frame) -> DeviceError {
    DeviceError {
        device: info.id.clone(),
        command: "take a frame".into(),
        expected: format!("{} × {} pixels", info.width, info.height),
        got: format!("{} × {} with {} values", frame.width, frame.height, frame.codes.len()),
        remedy: "check the camera's format".into(),
        class: nacre_drivers::Class::Stop,
    }
}
