//! Tables on a flat sample under far environments: what the sample reflects depends on the direction of view alone, so that it is summed up once
//! for all directions instead of drawn by chance for each pixel, where that is cheaper and as exact as asked for.

use super::diffraction::Diffraction;
use super::light::Sky;
use super::picture::{Pilot, SAMPLES};
use super::ready::Ready;
use super::shape::{Form, Hit};
use super::vector::V3;
use crate::environment::{Reflected, correlate, light};
use nacre_base::Result;
use nacre_base::progress::Progress;
use std::f64::consts::PI;

/// Cells along a side of the disc of direction cosines: tried first, and at most.
const SIZES: [usize; 2] = [32, 512];

/// Cost of a cell in samples drawn by chance (8 and 0.7 µs on two cores). Counted rather than timed, so that a scene always becomes the same picture.
const CELL: f64 = 12.0;

/// Part of the work of drawing by chance that summing up may take: at worst, where the sample's base is as noisy, it is done in vain.
const SHARE: f64 = 0.4;

/// What a flat sample reflects of each sky.
pub(super) struct Flat {
    frame: [V3; 3],
    skies: Vec<Reflected>,
}

impl Flat {
    /// Whether a place is seen from the side that it is for.
    pub(super) fn is_of(&self, hit: &Hit) -> bool {
        self.frame == hit.frame
    }

    /// Radiance of a sky that the table reflects towards a direction of view, times that direction's cosine, before it is divided by what the table
    /// gives back.
    pub(super) fn at(&self, sky: usize, view: [f64; 3]) -> [f64; 3] {
        self.skies[sky].at(view)
    }

    /// Of a shape, if its material is a table, it is flat and nothing hides the sky from it.
    pub(super) fn new(ready: &Ready, shape: usize, size: usize, progress: &dyn Progress) -> Result<Option<Self>> {
        let placed = &ready.shapes[shape];
        let material = &ready.materials[placed.material];
        let (Form::Flat { center, frame, .. }, Some(Diffraction::Table(table)), None, 1) =
            (&placed.form, &material.diffraction, &material.normals, ready.shapes.len())
        else {
            return Ok(None);
        };
        let side = (ready.camera.at - center).dot(&frame[2]);
        let frame = if side < 0.0 { [frame[0], frame[1], -frame[2]] } else { *frame };
        let around = |h: [f64; 2]| table.around(h, 2.0 / size as f64);
        let sum = |sky: &Sky| {
            let radiance = |[x, y, z]: [f64; 3]| sky.radiance(frame[0] * x + frame[1] * y + frame[2] * z);
            let apart = PI / sky.map.height as f64;
            correlate(size, around, |channel| light(size, apart, |towards| radiance(towards)[channel]), progress)
        };
        let skies = ready.skies.iter().map(sum).collect::<Result<_>>()?;
        Ok(Some(Self { frame, skies }))
    }

    /// Root mean square difference of two over the mean, in directions of view.
    fn differs(&self, other: &Self, views: &[[f64; 3]]) -> f64 {
        let (mut square, mut mean, mut count) = (0.0, 0.0, 0.0_f64);
        for view in views {
            for sky in 0..self.skies.len() {
                for (a, b) in self.at(sky, *view).into_iter().zip(other.at(sky, *view)) {
                    square += (a - b).powi(2);
                    mean += b;
                    count += 1.0;
                }
            }
        }
        if mean > 0.0 { (square * count).sqrt() / mean } else { 0.0 }
    }
}

/// Sums up what flat tables reflect, where that takes less than drawing by chance to an error; nothing where it does not.
///
/// Cells are halved until they differ from those before by less than `allowed`, or at the finest ones by less than `better`: what is then still less than
/// what drawing by chance would leave. Returns what they are off by in directions that are in view: root mean square over the mean, at most.
///
/// # Errors
/// `Cancelled`.
pub(super) fn sum_up(
    ready: &mut Ready,
    pilot: &Pilot,
    passes: usize,
    (allowed, better): (f64, f64),
    progress: &dyn Progress,
) -> Result<Option<f64>> {
    let by_chance = pilot.lit_pixels(ready.size()) * (passes * SAMPLES) as f64;
    let mut summed: Option<f64> = None;
    if ready.skies.is_empty() {
        return Ok(None);
    }
    for shape in 0..ready.shapes.len() {
        let views = ready.views_of(shape);
        if views.is_empty() {
            continue;
        }
        let cost = |size: usize| CELL * (size * size) as f64;
        let (mut size, mut spent, mut before) = (SIZES[0], 0.0, None::<Flat>);
        while size <= SIZES[1] && spent + cost(size) <= SHARE * by_chance {
            let Some(flat) = Flat::new(ready, shape, size, progress)? else { break };
            spent += cost(size);
            let differs = before.map(|before| before.differs(&flat, &views));
            let enough = if size == SIZES[1] { allowed.max(better) } else { allowed };
            if let Some(error) = differs.filter(|d| *d <= enough) {
                summed = Some(summed.unwrap_or(0.0).max(error));
                ready.note_flat(shape, size, error);
                ready.flats[shape] = Some(flat);
                break;
            }
            (before, size) = (Some(flat), 2 * size);
        }
    }
    Ok(summed)
}

/// Does the same for another reading of a scene, with cells half as wide, to compare.
///
/// # Errors
/// `Cancelled`.
pub(super) fn sum_up_finer(ready: &mut Ready, than: &Ready, progress: &dyn Progress) -> Result<()> {
    for (shape, flat) in than.flats.iter().enumerate() {
        let Some(size) = flat.as_ref().and_then(|flat| flat.skies.first()).map(Reflected::size) else { continue };
        ready.flats[shape] = Flat::new(ready, shape, 2 * size, progress)?;
    }
    Ok(())
}
