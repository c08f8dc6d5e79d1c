//! From intensities to orientations, under a given or the selected model.

use crate::angles::angle_error::distorted;
use crate::film::choose::{Choice, is_ring};
use crate::film::classes::Classes;
use crate::film::cloud::{CloudPoint, cloud};
use crate::film::correction::{Corrected, choose_corrected};
use crate::film::invert_curve::{Inversion, invert_curve};
use crate::film::solve_options::{SAMPLE_PIXELS, SolveOptions};
use crate::orientation::edges::{widen_at_edges, widen_where_apart};
use crate::orientation::orient::phases;
use crate::orientation::polarizers::PolarizerPositions;
use crate::{
    CircleCheck, Design, FrameNoise, MASK_SNR, Model, ObliqueReport, OrientationMaps, StokesMaps, check_circle,
};
use nacre_base::vectors::vectorised;
use rayon::prelude::*;

/// Orientations under the selected model.
pub(crate) struct Solved {
    pub map: OrientationMaps,
    /// Number of pixels of metal without a grating.
    pub without_grating: usize,
    pub circle: Option<CircleCheck>,
    pub choice: Option<Choice>,
    /// Gratings that differ in the strength of their modulation, if there are several.
    pub classes: Option<Classes>,
    /// For plain polarimetry: whether the points lie on a circle, as for a grating under circular light.
    pub grating_like: bool,
    /// Correction of oblique incidence.
    pub oblique: Option<ObliqueReport>,
}

/// Relative positions of the views of a pixel.
#[derive(Default)]
pub(crate) struct ViewDisplacement {
    /// Root mean square of the remaining shifts between photographs, in pixels.
    pub apart_px: f64,
    /// Positions of the polarizers, for a polarization sensor.
    pub polarizers: Option<PolarizerPositions>,
}

/// Pixels per task of a thread.
const CHUNK: usize = 1 << 14;

impl Solved {
    /// A map whose orientations are phases.
    fn without_model(map: OrientationMaps) -> Self {
        Self { map, without_grating: 0, circle: None, choice: None, classes: None, grating_like: false, oblique: None }
    }

    /// Adds systematic errors to the σ of noise: of the model, of mixed pixels at edges, and of photographs or
    /// polarizers that see different points. Plain polarimetry has no model error, and light mixed by the lens has the
    /// polarization of the mixture.
    pub fn add_systematic(&mut self, maps: &StokesMaps, model: Model, displacement: &ViewDisplacement) {
        widen_where_apart(&mut self.map, displacement.apart_px as f32);
        if let Some(polarizers) = &displacement.polarizers {
            polarizers.widen(maps, &mut self.map);
        }
        if model == Model::Plain {
            return;
        }
        let systematic = self.choice.as_ref().map_or(0.0, |c| c.systematic) as f32;
        let square = systematic * systematic;
        self.map.sigma.par_chunks_mut(CHUNK).for_each(|sigma| {
            vectorised(
                #[inline(always)]
                || {
                    for s in &mut *sigma {
                        *s = (*s * *s + square).sqrt().min(std::f32::consts::FRAC_PI_2);
                    }
                },
            );
        });
        if let Some(classes) = &self.classes {
            classes.widen(maps, &mut self.map.sigma);
        }
        widen_at_edges(&mut self.map);
    }
}

/// Orientations only, for charts.
pub fn orient_with(
    maps: &mut StokesMaps,
    design: &Design,
    noise: &[FrameNoise],
    options: &SolveOptions,
) -> OrientationMaps {
    let mut solved = solve_model(maps, design, noise, options);
    solved.add_systematic(maps, options.model, &ViewDisplacement::default());
    solved.map
}

/// Solves orientations from intensities. Consumes the residual map, whose memory σ reuses.
pub(crate) fn solve_model(
    maps: &mut StokesMaps,
    design: &Design,
    noise: &[FrameNoise],
    options: &SolveOptions,
) -> Solved {
    let residual = std::mem::take(&mut maps.residual);
    solve_with(maps, residual, design, noise, options)
}

/// As [`solve_model`], without mutable access to the maps.
pub(crate) fn solve_with(
    maps: &StokesMaps,
    residual: Vec<f32>,
    design: &Design,
    noise: &[FrameNoise],
    options: &SolveOptions,
) -> Solved {
    if options.model == Model::Plain {
        let map = phases(maps, residual, design, noise, 0.0);
        let grating_like = is_ring(&modulated(maps, design, noise, SAMPLE_PIXELS));
        return Solved { grating_like, ..Solved::without_model(map) };
    }
    let points = modulated(maps, design, noise, options.pixels);
    let (points, classes) = of_one_grating(points, options);
    let distorted = distorted(&points, maps, design, options.angle_sigma);
    let Some(Corrected { choice, correction, report }) = choose_corrected(&points, options, distorted) else {
        let map = phases(maps, residual, design, noise, options.offset);
        let circle = check_circle(maps, &map);
        return Solved { circle, ..Solved::without_model(map) };
    };
    let chosen = &choice.candidates[choice.chosen];
    let inversion = Inversion { design, noise, model: chosen, correction: correction.as_ref(), offset: options.offset };
    let (map, without_grating) = invert_curve(maps, residual, &inversion);
    // The test uses uncorrected points.
    let circle = if correction.is_none() { check_circle(maps, &map) } else { None };
    Solved { without_grating, circle, choice: Some(choice), classes, oblique: report, ..Solved::without_model(map) }
}

/// Points with modulation, from a sample of the pixels.
fn modulated(maps: &StokesMaps, design: &Design, noise: &[FrameNoise], count: usize) -> Vec<CloudPoint> {
    let mut points = cloud(maps, design, noise, count);
    points.retain(|p| p.snr >= f64::from(MASK_SNR));
    points
}

/// The points of the largest class of gratings, whose model is used for all, and the classes; all points if there is
/// only one.
fn of_one_grating(points: Vec<CloudPoint>, options: &SolveOptions) -> (Vec<CloudPoint>, Option<Classes>) {
    let classes = if options.model == Model::Auto { Classes::find(&points) } else { None };
    match classes {
        Some(classes) => (classes.largest(&points), Some(classes)),
        None => (points, None),
    }
}
