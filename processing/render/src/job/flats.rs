//! Precomputes the light that flat lookup tables reflect of environments, where that is cheaper than Monte Carlo sampling.

use crate::material::SAMPLES;
use crate::picture::Pilot;
use crate::prepared_scene::PreparedScene;
use crate::prepared_scene::flat::Flat;
use nacre_base::Result;
use nacre_base::progress::Progress;

/// Cells along a side of the disc of direction cosines: tried first, and at most.
const SIZES: [usize; 2] = [32, 512];

/// Cost of a cell in samples drawn by chance (8 and 0.7 µs on two cores). Counted rather than timed, so that a scene always becomes the same picture.
const CELL: f64 = 12.0;

/// Part of the work of drawing by chance that summing up may take: at worst, where the sample's base is as noisy, it is done in vain.
const SHARE: f64 = 0.4;

/// Sums up what flat tables reflect, where that takes less than drawing by chance to the error asked for, in `passes` passes; nothing where it does not.
///
/// Cells are halved until they differ from those before by less than `allowed`, or at the finest ones by less than `better`: what is then still less than
/// what drawing by chance would leave. Returns what they are off by in directions that are in view: root mean square over the mean, at most.
///
/// # Errors
/// `Cancelled`.
pub(crate) fn sum_up(
    ready: &mut PreparedScene,
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
            let Some(flat) = ready.flat(shape, size, progress)? else { break };
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
pub(crate) fn sum_up_finer(ready: &mut PreparedScene, than: &PreparedScene, progress: &dyn Progress) -> Result<()> {
    for (shape, flat) in than.flats.iter().enumerate() {
        let Some(size) = flat.as_ref().and_then(Flat::size) else { continue };
        ready.flats[shape] = ready.flat(shape, 2 * size, progress)?;
    }
    Ok(())
}
