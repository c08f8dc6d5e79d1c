//! Prediction for a session's results, before the session.

use super::{CalibrationKind, Limits, Plan, Role};
use nacre_base::estimate::Work;
use nacre_frames::hdr;
use nacre_image::budget::{self, Operation};
use nacre_image::{Depth, Info};
use nacre_lut::bokeh;
use nacre_polarimetry::Model;

/// Work of a calibration's operation on this number of photographs, dark ones included: those of a camera read each
/// pixel once, and keep ten planes.
fn calibration_work(operation: &'static str, info: Info, photographs: usize) -> Work {
    let pixels = (info.width * info.height) as u64;
    Work {
        operation: operation.into(),
        seconds: 0.05 + 4e-8 * (pixels * (photographs as u64 + 4)) as f64,
        memory_bytes: 2 * budget::decoded(info) + 40 * pixels,
        disk_bytes: 5 * pixels,
        ..Work::default()
    }
}

impl Plan {
    /// Time, memory and disk space of the plan's reconstruction; `None` for a plan without one.
    pub fn results_work(&self, limits: &Limits) -> Option<Work> {
        let planned = self.reconstruct.as_ref()?;
        let [width, height] = self.frame_size(limits);
        let info = Info { width, height, channels: 1, depth: Depth::U16 };
        let photographs = self.most_steps().iter().filter(|step| step.role == Role::Series).count();
        let merging = hdr::work_of(info, photographs);
        Some(match planned.operation.name() {
            "polarization" => {
                let options = planned.options_of::<nacre_polarimetry::Options>()?.ok()?;
                nacre_polarimetry::work_of(photographs, [width, height], options.model != Some(Model::Plain))
            }
            "hdr" => merging,
            "lut" => {
                let size = planned.options_of::<nacre_lut::Settings>()?.ok()?.size;
                Operation::Table(size * size).work(info).preceded_by(&merging)
            }
            "bokeh" => {
                let options = planned.options_of::<bokeh::Options>()?.ok()?;
                let operation = Operation::Bokeh { part: None, iterations: options.iterations.usual() };
                operation.work(info).preceded_by(&merging)
            }
            "spots" => {
                let fringes = self.spots.as_ref().and_then(|spots| spots.fringes.as_ref());
                let phases = fringes.map_or(4, |fringes| fringes.phases);
                Operation::Fringes(photographs / (phases as usize).max(1)).work(info)
            }
            "flash" => Operation::Flash(photographs).work(info),
            name if CalibrationKind::of(name).is_some() => calibration_work(name, info, self.most_steps().len()),
            // Other operations do not start from a session.
            _ => return None,
        })
    }

    /// Numbers of frames: the minimum and the maximum.
    pub fn frame_counts(&self) -> [usize; 2] {
        let most = self.most_steps().len();
        [if self.is_open() { self.steps().len() } else { most }, most]
    }

    /// Width and height of the frames in pixels.
    pub(super) fn frame_size(&self, limits: &Limits) -> [usize; 2] {
        let camera = &limits.camera;
        self.camera.roi.map_or([camera.width, camera.height], |[_, _, width, height]| [width as usize, height as usize])
    }
}
