//! Precomputes the reflection of environments by flat lookup tables, where that is cheaper than Monte Carlo sampling.

use crate::material::SAMPLES;
use crate::picture::Pilot;
use crate::prepared_scene::PreparedScene;
use crate::prepared_scene::flat::Flat;
use nacre_base::Result;
use nacre_base::progress::Progress;

/// Initial and largest number of cells along a side of the disc of direction cosines.
const SIZES: [usize; 2] = [32, 512];

/// Cost of a cell in Monte Carlo samples (8 µs and 0.7 µs on two cores). A fixed ratio instead of a measurement, so
/// that a scene always gives the same picture.
const CELL: f64 = 12.0;

/// Largest cost of the precomputation, relative to Monte Carlo sampling. If the sample's base is equally noisy, the
/// precomputation gains nothing.
const SHARE: f64 = 0.4;

/// Precomputes the reflection of flat tables, where that is cheaper than Monte Carlo sampling with `passes` passes to
/// the target error. Returns `None` where it is not.
///
/// Cells are halved until the change is below `allowed`, or below `better`, the residual Monte Carlo noise, at the
/// finest cells. The result is the largest error in visible directions: root mean square relative to the mean.
///
/// # Errors
/// `Cancelled`.
pub(crate) fn sum_up(
    prepared: &mut PreparedScene,
    pilot: &Pilot,
    passes: usize,
    (allowed, better): (f64, f64),
    progress: &dyn Progress,
) -> Result<Option<f64>> {
    let monte_carlo_samples = pilot.lit_pixels(prepared.size()) * (passes * SAMPLES) as f64;
    let mut summed: Option<f64> = None;
    if prepared.skies.is_empty() {
        return Ok(None);
    }
    for shape in 0..prepared.shapes.len() {
        let views = prepared.views_of(shape);
        if views.is_empty() {
            continue;
        }
        let cost = |size: usize| CELL * (size * size) as f64;
        let (mut size, mut spent, mut before) = (SIZES[0], 0.0, None::<Flat>);
        while size <= SIZES[1] && spent + cost(size) <= SHARE * monte_carlo_samples {
            let Some(flat) = prepared.flat(shape, size, progress)? else { break };
            spent += cost(size);
            let differs = before.map(|before| before.differs(&flat, &views));
            let enough = if size == SIZES[1] { allowed.max(better) } else { allowed };
            if let Some(error) = differs.filter(|d| *d <= enough) {
                summed = Some(summed.unwrap_or(0.0).max(error));
                prepared.note_flat(shape, size, error);
                prepared.flats[shape] = Some(flat);
                break;
            }
            (before, size) = (Some(flat), 2 * size);
        }
    }
    Ok(summed)
}

/// Precomputes the same shapes for another preparation of the scene with half the cell width, for comparison.
///
/// # Errors
/// `Cancelled`.
pub(crate) fn sum_up_finer(prepared: &mut PreparedScene, than: &PreparedScene, progress: &dyn Progress) -> Result<()> {
    for (shape, flat) in than.flats.iter().enumerate() {
        let Some(size) = flat.as_ref().and_then(Flat::size) else { continue };
        prepared.flats[shape] = prepared.flat(shape, 2 * size, progress)?;
    }
    Ok(())
}
