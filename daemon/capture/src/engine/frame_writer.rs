//! Storage thread of a run: averages, encodes and stores frames while the bench continues.

use super::Observer;
use crate::failure::Failure;
use crate::plan::{Added, CalibrationKind, Plan, PlanKind, Role, Step};
use crate::session::{self, Commit, Disk, Entry, Journal, Session, SessionFile, Timing};
use nacre_base::Error;
use nacre_drivers::CameraInfo;
use nacre_frames::{Distances, FrameSet, Fringes, Kind, Spot, Transfer};
use nacre_image::{Averaging, encode_png16_gray};
use nacre_polarimetry::NoiseModel;
use std::path::PathBuf;
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// Largest relative difference of equal gains; cameras round the requested one.
const SAME_GAIN: f64 = 0.01;

/// Message from the engine to the storage thread.
pub enum Message {
    /// A frame.
    Shot(Shot),
    /// An entry for the journal.
    Note(Entry),
    /// Requests an answer once all earlier messages are stored.
    Flush(oneshot::Sender<()>),
    /// All frames are captured.
    Finish(Timing),
}

/// A captured frame.
pub struct Shot {
    /// Index of the step.
    pub index: usize,
    /// Sum of the camera's frames.
    pub sum: Averaging,
    /// File name, and evidence of freshness.
    pub evidence: Commit,
}

/// A durably stored frame of the series, for immediate processing.
pub struct Arrival {
    /// Index in the series.
    pub index: usize,
    /// Description as in `frames.json`, with exposure and gain as set by the camera.
    pub frame: nacre_frames::Frame,
}

/// State of the storage thread.
pub struct FrameWriter<'a, D: Disk> {
    /// Session that receives the frames.
    pub session: Session<D>,
    /// Description of the session.
    pub description: &'a SessionFile,
    /// Steps known so far.
    pub steps: Vec<Step>,
    /// Additions to the series.
    pub chosen: Vec<Added>,
    /// Description of the camera.
    pub camera: CameraInfo,
    /// Observer, informed of every stored frame.
    pub observer: &'a dyn Observer,
    /// Receives every stored frame of the series.
    pub arrivals: std::sync::mpsc::Sender<Arrival>,
}

impl<D: Disk> FrameWriter<'_, D> {
    /// Stores messages until the channel closes.
    ///
    /// # Errors
    /// `Output` if the disk refuses; earlier frames are stored, and the session can be resumed.
    pub fn run(mut self, mut queue: mpsc::Receiver<Message>) -> Result<(), Failure> {
        while let Some(message) = queue.blocking_recv() {
            let result = match message {
                Message::Shot(shot) => self.shot(shot),
                Message::Note(entry) => self.note(entry),
                Message::Finish(timing) => self.finish(timing),
                Message::Flush(done) => {
                    let _ = done.send(());
                    Ok(())
                }
            };
            if let Err(failure) = result {
                // A failing disk may also refuse this entry; the original failure is returned.
                let _ = self.session.record(Entry::stopped(&failure));
                return Err(failure);
            }
        }
        Ok(())
    }

    fn note(&mut self, entry: Entry) -> Result<(), Failure> {
        self.session.record(entry).map_err(|e| self.output_error(Journal::NAME, e))?;
        let Some((time, entry)) = self.session.journal().timed().next_back() else { return Ok(()) };
        self.observer.noted(entry, time);
        if let Entry::Chosen { added, .. } = entry {
            self.chosen.push(*added);
            self.steps = self.description.plan.steps_with(&self.chosen);
        }
        Ok(())
    }

    /// Announces frames stored by an earlier run.
    pub fn announce_stored(&self, missing: &[bool]) {
        for (i, _) in missing.iter().enumerate().filter(|(_, missing)| !**missing) {
            self.observer.step();
            if let Some(commit) = self.session.journal().commit(&self.steps[i].file) {
                self.announce(i, commit);
            }
        }
    }

    fn announce(&self, index: usize, commit: &Commit) {
        if self.steps[index].role == Role::Series {
            let extras = self.steps.iter().take_while(|s| s.role != Role::Series).count();
            // The receiver may be gone.
            let frame = described(&self.description.plan, &self.steps, &self.steps[index], commit.controls());
            let _ = self.arrivals.send(Arrival { index: index - extras, frame });
        }
    }

    fn shot(&mut self, shot: Shot) -> Result<(), Failure> {
        let plan = &self.description.plan;
        let part = plan.camera.roi.map(|roi| roi.map(|v| v as usize));
        let (width, height, codes) = shot.sum.means(part, stored_factor(&self.camera, plan.camera.average));
        let file = shot.evidence.file.clone();
        let png = encode_png16_gray(width, height, &codes).map_err(|e| self.output_error(&file, e))?;
        self.session.store(&file, &png, shot.evidence.clone()).map_err(|e| self.output_error(&file, e))?;
        self.announce(shot.index, &shot.evidence);
        if let Some((time, Entry::Committed(commit))) = self.session.journal().timed().next_back() {
            self.observer.stored(&self.steps[shot.index], commit, time);
        }
        self.observer.step();
        Ok(())
    }

    fn finish(&mut self, timing: Timing) -> Result<(), Failure> {
        let controls = |file: &str| self.session.journal().commit(file).map_or((1.0, 1.0), Commit::controls);
        let series = self.steps.iter().filter(|s| s.role == Role::Series);
        let described = |s: &Step| described(&self.description.plan, &self.steps, s, controls(&s.file));
        let set = frame_set(self.description, &self.camera, series.map(described).collect());
        self.session
            .finish(&nacre_frames::save(&set), timing)
            .map_err(|e| self.output_error(nacre_frames::FILE_NAME, e))
    }

    fn output_error(&self, file: &str, error: std::io::Error) -> Failure {
        Error::output(&self.session.folder().join(file), error).into()
    }
}

/// Factor on the values of stored means, which uses the full range of 16 bits to preserve extra levels.
fn stored_factor(camera: &CameraInfo, average: u32) -> u32 {
    if average == 1 { 1 } else { (u32::from(u16::MAX) / u32::from(camera.white).max(1)).max(1) }
}

/// Description of one frame of the series as in `frames.json`; `steps` are those of the plan.
fn described(plan: &Plan, steps: &[Step], step: &Step, (exposure, gain): (f64, f64)) -> nacre_frames::Frame {
    let kind = session::frames_kind(plan);
    let free = kind == Kind::Free;
    let spot = match step.state.pattern {
        nacre_drivers::Pattern::Disc { center_mm, diameter_mm } if free || kind == Kind::Spots => {
            Some(Spot { center_mm, diameter_mm })
        }
        _ => None,
    };
    let fringes = match step.state.pattern {
        nacre_drivers::Pattern::Fringes { cycles_per_mm, phase, .. } => Some(Fringes { cycles_per_mm, phase }),
        _ => None,
    };
    let dark = plan.subtracted_from(steps, step).filter(|_| !has_one_exposure(plan));
    nacre_frames::Frame {
        file: PathBuf::from(&step.file),
        analyser_deg: step.state.analyser_deg,
        exposure_s: Some(exposure),
        gain: Some(gain),
        spot,
        fringes,
        flash: free.then_some(step.state.flash),
        light_mm: None,
        dark: dark.map(PathBuf::from),
    }
}

/// True if one dark photograph applies to all frames.
fn has_one_exposure(plan: &Plan) -> bool {
    let one = match plan.kind {
        PlanKind::Polarization => true,
        PlanKind::Calibration => plan.measures() != Some(CalibrationKind::Camera),
        _ => false,
    };
    one && plan.exposures_ms.is_empty()
}

/// The session's `frames.json` with these frames.
pub fn frame_set(description: &SessionFile, camera: &CameraInfo, frames: Vec<nacre_frames::Frame>) -> FrameSet {
    let (plan, setup) = (&description.plan, &description.setup);
    let count = plan.camera.average;
    let factor = f64::from(stored_factor(camera, count));
    // A mean of n frames corresponds to n times the electrons and √n times the read noise.
    let n = f64::from(count);
    let calibration = description.calibration.as_ref();
    let measured = calibration.and_then(|c| c.camera.as_ref());
    let stated = camera.full_scale_e.zip(camera.read_noise_e);
    let stated = stated.map(|(full_scale_e, read_noise_e)| NoiseModel { full_scale_e, read_noise_e });
    let noise = measured.map(|c| c.noise).or(stated);
    // Levels of another gain differ.
    let levels = measured.filter(|c| (c.gain / plan.camera.gain - 1.0).abs() < SAME_GAIN);
    let [black, white] = levels.map_or([camera.black, camera.white].map(f64::from), |c| [c.black, c.white]);
    FrameSet {
        illumination: plan.light(),
        transfer: levels.and_then(|c| c.response).map_or(Transfer::Linear, Transfer::Polynomial),
        black: Some(black * factor),
        white: Some(white * factor),
        noise: noise.map(|e| NoiseModel { full_scale_e: e.full_scale_e * n, read_noise_e: e.read_noise_e * n.sqrt() }),
        flat: calibration.and_then(|c| c.flat.as_ref()).map(|flat| flat.file.clone()),
        calibration: description.calibration.clone(),
        dark: plan.subtracted(&plan.steps(), None).filter(|_| has_one_exposure(plan)).map(PathBuf::from),
        wavelength_nm: setup.wavelength_nm,
        band_nm: setup.band_nm,
        geometry: setup.geometry.map(|geometry| relative_to_roi(geometry, plan, camera)),
        panel_mm: setup.panel_mm,
        ..FrameSet::new(session::frames_kind(plan), frames)
    }
}

/// The distances, with the camera position relative to the region of interest.
fn relative_to_roi(geometry: Distances, plan: &Plan, camera: &CameraInfo) -> Distances {
    let (Some([left, top, ..]), Some(pixel_um)) = (plan.camera.roi, geometry.pixel_um) else { return geometry };
    let middle = [camera.width, camera.height].map(|side| 0.5 * side as f64);
    let nadir_x = middle[0] - 500.0 * geometry.baseline_mm / pixel_um;
    Distances { camera_px: Some([nadir_x - f64::from(left), middle[1] - f64::from(top)]), ..geometry }
}

impl Commit {
    /// Exposure in seconds and gain.
    pub fn controls(&self) -> (f64, f64) {
        (Duration::from_nanos(self.exposure_ns).as_secs_f64(), self.gain)
    }
}
