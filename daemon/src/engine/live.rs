//! The reconstruction that runs while frames arrive, so that the map is complete a moment after the last of them.

use super::Observer;
use super::store::{Arrival, frame_set};
use crate::plan::{Method, Plan, PlanKind, Step};
use crate::session::SessionFile;
use nacre_drivers::CameraInfo;
use nacre_processing::Result;
use nacre_processing::frames::planned;
use nacre_processing::image::{Depth, Info};
use nacre_processing::polarimetry::Running;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::mpsc::Receiver;

/// What it works on.
pub struct Live<'a> {
    /// The session's folder.
    pub folder: &'a Path,
    /// What the session is.
    pub description: &'a SessionFile,
    /// Its steps.
    pub steps: &'a [Step],
    /// What the camera is.
    pub camera: CameraInfo,
    /// Told of the map so far.
    pub observer: &'a dyn Observer,
}

impl Live<'_> {
    /// Takes in stored frames in the order of the series until no more come. None when the plan asks for no
    /// reconstruction, or when it cannot go along: then the finished session is reconstructed as a whole, which says why.
    pub fn follow(&self, arrivals: Receiver<Arrival>) -> Option<Running> {
        let plan = &self.description.plan;
        let wanted = plan.reconstruct.is_some_and(|r| r.method == Method::Polarization);
        let looked_at = plan.kind == PlanKind::Polarization && self.observer.wants_map();
        if !wanted && !looked_at {
            arrivals.iter().for_each(drop);
            return None;
        }
        let mut running: Result<Option<Running>> = Ok(None);
        let mut there = BTreeSet::new();
        for arrival in arrivals {
            there.insert(arrival.index);
            running = running.and_then(|running| {
                // A frame that was taken again may differ from the one taken in, so all is taken in again.
                let mut running = match running.filter(|r| arrival.index >= r.added()) {
                    Some(running) => running,
                    None => self.begin(arrival.controls)?,
                };
                let before = running.added();
                while there.contains(&running.added()) {
                    running.add()?;
                }
                if looked_at && running.added() > before {
                    self.observer.map(&running);
                }
                Ok(Some(running))
            });
        }
        running.ok().flatten().filter(|_| wanted)
    }

    fn begin(&self, controls: (f64, f64)) -> Result<Running> {
        // All frames of a polarization session have one exposure.
        let set = frame_set(self.description, self.steps, &self.camera, &|_| controls);
        Running::new(planned(self.folder, set, info(&self.description.plan, &self.camera))?)
    }
}

fn info(plan: &Plan, camera: &CameraInfo) -> Info {
    let [width, height] =
        plan.camera.roi.map_or([camera.width, camera.height], |[_, _, w, h]| [w as usize, h as usize]);
    Info { width, height, channels: 1, depth: Depth::U16 }
}
