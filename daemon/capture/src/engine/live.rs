//! Reconstruction during capture, so that the map is complete shortly after the last frame, unless another process
//! computes it.

use super::Observer;
use super::crossed::crossed;
use super::frame_writer::{Arrival, frame_set};
use super::series::{Decision, decide, decide_fringes};
use crate::plan::{Plan, PlanKind};
use crate::session::SessionFile;
use nacre_base::Result;
use nacre_drivers::CameraInfo;
use nacre_frames::{FILE_NAME, Frame, LoadedFrames, planned};
use nacre_image::{Depth, Info};
use nacre_periods::fringes::{self, Survey};
use nacre_polarimetry::Running;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::Receiver;
use tokio::sync::mpsc::UnboundedSender;

/// Input of the live reconstruction.
pub struct Live<'a> {
    /// Session folder.
    pub folder: &'a Path,
    /// Description of the session.
    pub description: &'a SessionFile,
    /// Description of the camera.
    pub camera: CameraInfo,
    /// Observer, which receives intermediate maps.
    pub observer: &'a dyn Observer,
    /// For an adaptive series that has not ended yet.
    pub deciding: Option<Deciding>,
}

/// Decisions about an adaptive series.
pub struct Deciding {
    /// Number of frames of the series decided so far; the next decision follows when all have arrived.
    pub known: usize,
    /// Range of the stage in degrees.
    pub limits_deg: [f64; 2],
    /// Receives the decisions.
    pub decisions: UnboundedSender<Result<Decision>>,
}

impl Live<'_> {
    /// Adds stored frames in the order of the series until the channel closes. `None` if the plan requests no
    /// reconstruction, or if live reconstruction is impossible: the finished session is then reconstructed as a whole,
    /// which reports the reason.
    pub fn follow(mut self, arrivals: Receiver<Arrival>) -> Option<Running> {
        let plan = &self.description.plan;
        if plan.until_decided().is_some() && self.deciding.is_some() {
            self.follow_fringes(arrivals);
            return None;
        }
        if self.deciding.is_some() && !plan.crossed_offsets_deg().is_empty() {
            self.follow_turn(arrivals);
            return None;
        }
        let wanted = plan.reconstruct.as_ref().is_some_and(|r| r.operation.is("polarization"));
        let looked_at = plan.kind == PlanKind::Polarization && self.observer.wants_map();
        if !wanted && !looked_at && self.deciding.is_none() {
            arrivals.iter().for_each(drop);
            return None;
        }
        let mut running: Option<Running> = None;
        let mut there = BTreeMap::new();
        let mut failed = false;
        for Arrival { index, frame } in arrivals {
            there.insert(index, frame);
            if failed {
                continue;
            }
            // A frame captured again may differ from the added one, so the reconstruction restarts.
            running = running.filter(|r| index >= r.added());
            if let Err(error) = self.take_in(&mut running, &there) {
                failed = true;
                if let Some(deciding) = self.deciding.take() {
                    // The receiver may be gone.
                    let _ = deciding.decisions.send(Err(error));
                }
            }
        }
        running.filter(|r| wanted && !failed && r.added() == there.len())
    }

    /// Adds the frames of a fringe series in order, and decides its continuation.
    fn follow_fringes(&mut self, arrivals: Receiver<Arrival>) {
        let mut survey = None;
        let mut there = BTreeMap::new();
        for Arrival { index, frame } in arrivals {
            there.insert(index, frame);
            // A frame captured again may differ from the added one, so the survey restarts.
            survey = survey.filter(|s: &Survey| index >= s.added());
            if let Err(error) = self.take_in_fringes(&mut survey, &there)
                && let Some(deciding) = self.deciding.take()
            {
                // The receiver may be gone.
                let _ = deciding.decisions.send(Err(error));
            }
        }
    }

    /// Decides the angles around the crossed direction once the full turn has arrived.
    fn follow_turn(&mut self, arrivals: Receiver<Arrival>) {
        let mut there = BTreeMap::new();
        for Arrival { index, frame } in arrivals {
            there.insert(index, frame);
            if let Some(Deciding { limits_deg, decisions, .. }) = self.deciding.take_if(|d| there.len() == d.known) {
                let turn: Vec<&Frame> = there.values().collect();
                let decision = crossed(self.folder, &turn, &self.description.plan, limits_deg).map(Decision::Last);
                // The receiver may be gone.
                let _ = decisions.send(decision);
            }
        }
    }

    fn take_in_fringes(&mut self, survey: &mut Option<Survey>, there: &BTreeMap<usize, Frame>) -> Result<()> {
        let plan = &self.description.plan;
        let (Some(wanted), Some(deciding)) = (plan.until_decided(), &mut self.deciding) else { return Ok(()) };
        let survey = match survey {
            Some(survey) => survey,
            None => survey.insert(begin_survey(self.folder, self.description, &self.camera)?),
        };
        while let Some(frame) = there.get(&survey.added()) {
            survey.push(frame.clone())?;
        }
        if survey.added() != deciding.known {
            return Ok(());
        }
        let (so_far, decision) = decide_fringes(survey, wanted, plan.frames_before_fringes())?;
        self.observer.so_far(&so_far);
        let _ = deciding.decisions.send(Ok(decision));
        match decision {
            Decision::Next { added, .. } => deciding.known += plan.frames_of(added, survey.added()),
            Decision::Last(_) | Decision::End(_) => self.deciding = None,
        }
        Ok(())
    }

    /// Adds all angles with complete frames, then decides if due.
    fn take_in(&mut self, running: &mut Option<Running>, there: &BTreeMap<usize, Frame>) -> Result<()> {
        let per_angle = self.description.plan.frames_per_angle();
        loop {
            let added = running.as_ref().map_or(0, Running::added);
            let next: Vec<Frame> = (added..added + per_angle).map_while(|i| there.get(&i).cloned()).collect();
            if next.len() < per_angle {
                return Ok(());
            }
            let running = match running {
                Some(running) => {
                    running.push(next)?;
                    running
                }
                None => running.insert(self.begin(next)?),
            };
            while running.added() < running.frames().len() {
                running.add()?;
            }
            if self.observer.wants_map() {
                self.observer.map(running);
            }
            self.decide(running)?;
        }
    }

    fn begin(&self, frames: Vec<Frame>) -> Result<Running> {
        let set = frame_set(self.description, &self.camera, frames);
        Running::open(planned(self.folder, set, info(&self.description.plan, &self.camera))?)
    }

    /// Decides the continuation of the series once all frames decided so far are added.
    fn decide(&mut self, running: &Running) -> Result<()> {
        let plan = &self.description.plan;
        let (Some(wanted), Some(deciding)) = (plan.until_sigma(), &mut self.deciding) else { return Ok(()) };
        if running.added() != deciding.known {
            return Ok(());
        }
        let (so_far, decision) = decide(running, wanted, deciding.limits_deg)?;
        self.observer.so_far(&so_far);
        let _ = deciding.decisions.send(Ok(decision));
        match decision {
            Decision::Next { added, .. } => deciding.known += plan.frames_of(added, running.added()),
            Decision::Last(_) | Decision::End(_) => self.deciding = None,
        }
        Ok(())
    }
}

/// Survey of a fringe series whose frames are still to come.
///
/// # Errors
/// `Input` if bench and plan do not determine periods.
pub fn begin_survey(folder: &Path, description: &SessionFile, camera: &CameraInfo) -> Result<Survey> {
    let plan = &description.plan;
    let settings =
        plan.reconstruct.as_ref().and_then(|r| r.options_of::<fringes::Settings>()).transpose()?.unwrap_or_default();
    let set = frame_set(description, camera, vec![]);
    let path = folder.join(FILE_NAME);
    let (folder, info) = (folder.to_path_buf(), info(plan, camera));
    Survey::begin(LoadedFrames { path, folder, set, info, warnings: vec![], from_session: true }, &settings)
}

fn info(plan: &Plan, camera: &CameraInfo) -> Info {
    let [width, height] =
        plan.camera.roi.map_or([camera.width, camera.height], |[_, _, w, h]| [w as usize, h as usize]);
    Info { width, height, channels: 1, depth: Depth::U16 }
}
