//! Solution of all pixels of a session.

use super::answer::{Answer, Demands, Grating, Solution, Verdict};
use super::carriers::Search;
use super::optics::{Optics, Place};
use super::signals::Signals;
use super::solve::Solver;
use nacre_base::Result;
use nacre_base::progress::Progress;
use rayon::prelude::*;

/// Number of pixels correlated together.
const BLOCK: usize = 16;
/// Number of pixels for the estimate of the aperture.
const SAMPLED: usize = 400;

/// Mapping from pixels to points on the sample.
pub type Points<'a> = &'a (dyn Fn(usize, usize) -> Option<[f64; 3]> + Sync);

/// Results, row by row.
pub struct Found {
    /// Classification of each pixel.
    pub verdicts: Vec<Verdict>,
    /// Grating of each resolved pixel.
    pub gratings: Vec<Option<Grating>>,
    /// The two gratings of each ambiguous pixel.
    pub rivals: Vec<Option<[Grating; 2]>>,
}

/// Solves all pixels.
///
/// # Errors
/// `Cancelled`.
pub fn scan(
    signals: &Signals,
    optics: &Optics,
    points: Points<'_>,
    demands: Demands,
    progress: &dyn Progress,
) -> Result<Found> {
    let search = Search::new(optics, &signals.carriers);
    let solver = Solver { optics, carriers: &signals.carriers, search: &search, demands };
    progress.stage("finding orders", signals.height as u64);
    let rows: Vec<Vec<Solution>> = (0..signals.height)
        .into_par_iter()
        .map(|y| {
            progress.check()?;
            let pixels: Vec<(usize, usize)> = (0..signals.width).map(|x| (x, y)).collect();
            let row = solved(&solver, signals, points, &pixels);
            progress.step();
            Ok(row)
        })
        .collect::<Result<_>>()?;
    let mut found = Found { verdicts: vec![], gratings: vec![], rivals: vec![] };
    for (verdict, grating, rivals) in rows.into_iter().flatten() {
        found.verdicts.push(verdict);
        found.gratings.push(grating);
        found.rivals.push(rivals);
    }
    Ok(found)
}

/// Solves a set of pixels.
fn solved(solver: &Solver<'_>, signals: &Signals, points: Points<'_>, pixels: &[(usize, usize)]) -> Vec<Solution> {
    let parts = 2 * signals.carriers.len();
    let mut all = Vec::with_capacity(pixels.len());
    let (mut responses, mut own) = (Vec::new(), vec![0.0_f32; solver.search.places()]);
    for block in pixels.chunks(BLOCK) {
        let mut answers = vec![[0.0_f32; BLOCK]; parts];
        let places: Vec<Option<Place>> =
            block.iter().map(|(x, y)| points(*x, *y).map(|p| solver.optics.place(p))).collect();
        for (lane, ((x, y), place)) in block.iter().zip(&places).enumerate() {
            let Some(place) = place else { continue };
            let components = &signals.components[(y * signals.width + x) * parts..][..parts];
            let rest = solver.without_mirror(place, components);
            answers.iter_mut().zip(rest).for_each(|(a, v)| a[lane] = v);
        }
        solver.search.correlate(&answers, &mut responses);
        for (lane, ((x, y), place)) in block.iter().zip(&places).enumerate() {
            let i = y * signals.width + x;
            let Some(place) = place.as_ref().filter(|_| signals.bad[i] == 0) else {
                all.push((Verdict::Unusable, None, None));
                continue;
            };
            own.iter_mut().zip(&responses).for_each(|(o, r)| *o = r[lane]);
            let components = &signals.components[i * parts..][..parts];
            let answer = Answer { components, sigma: signals.sigma(i), mean: signals.mean[i].into() };
            all.push(solver.solve(place, &answer, &own));
        }
    }
    all
}

/// Aperture in mm that minimises the residual of a sample of pixels.
pub fn aperture(signals: &Signals, optics: &Optics, points: Points<'_>, demands: Demands) -> f64 {
    const TRIED: [f64; 9] = [0.5, 4.0, 7.0, 10.0, 13.0, 16.0, 20.0, 25.0, 32.0];
    let count = signals.width * signals.height;
    let step = (count / SAMPLED).max(1);
    // Spread over rows and columns.
    let pixels: Vec<(usize, usize)> =
        (step / 2..count).step_by(step).map(|i| (i % signals.width, i / signals.width)).collect();
    let search = Search::new(optics, &signals.carriers);
    let left = |aperture_mm: f64| {
        let optics = Optics { aperture_mm, ..optics.clone() };
        let solver = Solver { optics: &optics, carriers: &signals.carriers, search: &search, demands };
        let each: Vec<f64> = pixels
            .par_chunks(BLOCK)
            .flat_map(|block| solved(&solver, signals, points, block))
            // Limits the influence of pixels that no aperture explains.
            .map(|(_, grating, _)| grating.map_or(30.0, |g| g.residual.min(30.0)))
            .collect();
        each.iter().sum::<f64>()
    };
    let sums = TRIED.map(left);
    let best = (0..TRIED.len()).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap_or(0);
    // Two refinements between neighbouring values.
    let (mut low, mut here, mut high) =
        (TRIED[best.saturating_sub(1)], (TRIED[best], sums[best]), TRIED[(best + 1).min(TRIED.len() - 1)]);
    for _ in 0..3 {
        for tried in [0.5 * (low + here.0), 0.5 * (here.0 + high)] {
            let sum = left(tried);
            if sum < here.1 {
                if tried < here.0 {
                    high = here.0
                } else {
                    low = here.0
                }
                here = (tried, sum);
            } else if tried < here.0 {
                low = tried;
            } else {
                high = tried;
            }
        }
    }
    here.0
}
