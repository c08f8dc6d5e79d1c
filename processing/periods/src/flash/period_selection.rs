//! Model selection: one common period, or one period per pixel.

use super::fit::{Found, Grating};
use super::report::PeriodReport;
use super::settings::PeriodChoice;

/// Relative systematic error of a period from non-Gaussian lobes, common to a polygon.
const COMMON: f64 = 0.004;

/// Number of parts of a tile along each axis that are compared.
const PARTS: usize = 6;

/// Distance from the common length, in standard deviations, above which a grating is an outlier.
const OUTLIER_SIGMAS: f64 = 4.0;

/// Minimum number of gratings for a decision.
const MIN_GRATINGS: usize = 12;

/// Common length of grating vectors, and the evidence for it.
pub(super) struct PeriodSelection {
    /// λ/a and its σ; `None` for one length per pixel.
    pub shared: Option<[f64; 2]>,
    pub report: PeriodReport,
}

/// Weighted mean length and its σ, without outliers.
fn mean(all: &[(&Grating, usize)], geometry_error: f64) -> Option<[f64; 2]> {
    let mut lengths: Vec<f64> = all.iter().map(|(g, _)| g.length).collect();
    lengths.sort_by(f64::total_cmp);
    let mut middle = *lengths.get(lengths.len() / 2)?;
    let mut sigma = f64::NAN;
    for _ in 0..6 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (g, _) in all {
            let variance = g.length_sigma.powi(2) + (geometry_error * g.length).powi(2);
            if (g.length - middle).powi(2) < OUTLIER_SIGMAS * OUTLIER_SIGMAS * variance {
                sum += g.length / variance;
                weights += 1.0 / variance;
            }
        }
        if weights == 0.0 {
            return None;
        }
        (middle, sigma) = (sum / weights, weights.powf(-0.5));
    }
    Some([middle, sigma])
}

/// χ² of the lengths about a common length.
fn chi2(all: &[(&Grating, usize)], length: f64, geometry_error: f64) -> f64 {
    let one = |g: &Grating| {
        let variance = g.length_sigma.powi(2) + (geometry_error * g.length).powi(2);
        (g.length - length).powi(2) / variance
    };
    all.iter().map(|(g, _)| one(g)).sum()
}

/// Selects by the Bayesian information criterion: one period, one for each of 6 × 6 parts of the tile (which suffices
/// to detect gradual change), or one per pixel. `geometry_error` is the relative error of periods due to the geometry.
pub(super) fn select_periods(
    found: &[Found],
    width: usize,
    choice: PeriodChoice,
    geometry_error: f64,
) -> PeriodSelection {
    let geometry_error = COMMON.hypot(geometry_error);
    let height = found.len() / width.max(1);
    let part = |i: usize| i / width * PARTS / height.max(1) * PARTS + i % width * PARTS / width;
    let all: Vec<(&Grating, usize)> = found
        .iter()
        .enumerate()
        .filter_map(|(i, f)| if let Found::Grating(g) = f { Some((g, part(i))) } else { None })
        .collect();
    let n = all.len();
    let Some([length, sigma]) = mean(&all, geometry_error).filter(|_| n > 0) else {
        let why = "no pixel has a period".to_owned();
        return PeriodSelection {
            shared: None,
            report: PeriodReport { choice: PeriodChoice::Pixel, why, ..PeriodReport::default() },
        };
    };
    let cost = (n as f64).ln();
    let one = chi2(&all, length, geometry_error) + cost;
    let mut parts = 0.0;
    let mut spread: f64 = 0.0;
    for k in 0..PARTS * PARTS {
        let of: Vec<(&Grating, usize)> = all.iter().copied().filter(|(_, p)| *p == k).collect();
        if let Some([own, own_sigma]) = mean(&of, geometry_error) {
            parts += chi2(&of, own, geometry_error) + cost;
            let variance = own_sigma.powi(2) + (geometry_error * own).powi(2);
            spread = spread.max((own - length).powi(2) / variance);
        }
    }
    let pixels = n as f64 * cost;
    let least = parts.min(pixels);
    let by_evidence = one <= least || n < MIN_GRATINGS;
    let sample = match choice {
        PeriodChoice::Auto => by_evidence,
        PeriodChoice::Sample => true,
        PeriodChoice::Pixel => false,
    };
    let why = match (choice, sample) {
        (PeriodChoice::Auto, true) if n < MIN_GRATINGS => format!("only {n} pixels have a period of their own"),
        (PeriodChoice::Auto, true) => "one period explains all pixels; more would not be worth their number".into(),
        (PeriodChoice::Auto, false) if parts < pixels => "periods differ between parts of the tile".into(),
        (PeriodChoice::Auto, false) => "periods differ from pixel to pixel by more than they are uncertain".into(),
        _ => "as asked for".into(),
    };
    // Errors common to a polygon do not average out beyond the parts of the tile.
    let common = sigma.max(geometry_error * length / (PARTS as f64))
        * (chi2(&all, length, geometry_error) / n as f64).max(1.0).sqrt();
    let chosen = if sample { PeriodChoice::Sample } else { PeriodChoice::Pixel };
    let report = PeriodReport {
        choice: chosen,
        why,
        bic_one: one,
        bic_parts: parts,
        bic_pixels: pixels,
        pixels: n,
        largest_part_sigmas: spread.sqrt(),
        ..PeriodReport::default()
    };
    PeriodSelection { shared: sample.then_some([length, common]), report }
}

/// Shared gratings grouped by period.
pub(super) struct Groups {
    /// Length of each grating vector and its σ: those of its group.
    pub lengths: Vec<[f64; 2]>,
    /// Common length, if all share one.
    pub shared: Option<[f64; 2]>,
    pub report: PeriodReport,
}

/// Merges the closest lengths as long as the Bayesian information criterion decreases. `pixels` is the number of pixels
/// with any of them.
pub(super) fn groups(
    lengths: &[f64],
    sigmas: &[f64],
    choice: PeriodChoice,
    geometry_error: f64,
    pixels: usize,
) -> Groups {
    let geometry_error = COMMON.hypot(geometry_error);
    let variance = |k: usize| sigmas[k].powi(2) + (geometry_error * lengths[k]).powi(2);
    let mean = |of: &[usize]| {
        let weights: f64 = of.iter().map(|k| 1.0 / variance(*k)).sum();
        let mean = of.iter().map(|k| lengths[*k] / variance(*k)).sum::<f64>() / weights;
        [mean, weights.powf(-0.5).max(geometry_error * mean / PARTS as f64)]
    };
    let chi2 = |of: &[usize]| {
        let [mean, _] = mean(of);
        of.iter().map(|k| (lengths[*k] - mean).powi(2) / variance(*k)).sum::<f64>()
    };
    let cost = (pixels.max(2) as f64).ln();
    let mut order: Vec<usize> = (0..lengths.len()).collect();
    order.sort_by(|a, b| lengths[*a].total_cmp(&lengths[*b]));
    let one = chi2(&order) + cost;
    let each = lengths.len() as f64 * cost;
    let mut groups: Vec<Vec<usize>> = order.iter().map(|k| vec![*k]).collect();
    while groups.len() > 1 && choice != PeriodChoice::Pixel {
        let more = |k: usize| {
            let both = [&groups[k][..], &groups[k + 1][..]].concat();
            chi2(&both) - chi2(&groups[k]) - chi2(&groups[k + 1])
        };
        let Some(next) = (0..groups.len() - 1).min_by(|a, b| more(*a).total_cmp(&more(*b))) else { break };
        if choice == PeriodChoice::Auto && more(next) > cost {
            break;
        }
        let other = groups.remove(next + 1);
        groups[next].extend(other);
    }
    let mut of = vec![[0.0; 2]; lengths.len()];
    groups.iter().for_each(|g| g.iter().for_each(|k| of[*k] = mean(g)));
    let shared = (groups.len() == 1 && choice != PeriodChoice::Pixel).then(|| mean(&order));
    let why = match (choice, groups.len()) {
        (PeriodChoice::Auto, 1) => {
            "one period explains all shared gratings; more would not be worth their number".into()
        }
        (PeriodChoice::Auto, n) => format!("{} shared gratings have {n} periods between them", lengths.len()),
        _ => "as asked for".into(),
    };
    let choice = if shared.is_some() { PeriodChoice::Sample } else { PeriodChoice::Pixel };
    let report =
        PeriodReport { choice, why, bic_one: one, bic_parts: each, bic_pixels: each, ..PeriodReport::default() };
    Groups { lengths: of, shared, report }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths of 40 × 40 pixels with pseudo-random deviations.
    fn field(length: impl Fn(usize, usize) -> f64, sigma: f64) -> Vec<Found> {
        let at = |i: usize| {
            let deviate: f64 = (0..12)
                .map(|k| f64::from(((i * 12 + k) as u32).wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24))
                .sum::<f64>()
                - 6.0;
            let length = length(i % 40, i / 40) * (1.0 + sigma * deviate);
            Found::Grating(Grating { orientation: 0.3, length, orientation_sigma: 0.01, length_sigma: sigma * length })
        };
        (0..1600).map(at).collect()
    }

    #[test]
    fn one_period_is_distinguished_from_several_and_from_a_gradual_change() {
        let selected = |found: &[Found]| select_periods(found, 40, PeriodChoice::Auto, 0.0);
        let one = selected(&field(|_, _| 0.34, 0.03));
        let [length, sigma] = one.shared.unwrap();
        assert!((length / 0.34 - 1.0).abs() < 0.003 && sigma / length < 0.003, "{length} {sigma}");
        // A change by 8 % from left to right, with 3 % uncertainty per pixel.
        assert!(selected(&field(|x, _| 0.34 * (1.0 + 0.002 * x as f64), 0.03)).shared.is_none());
        // Two periods, alternating between pixels.
        assert!(selected(&field(|x, y| if (x * 7 + y * 3) % 5 == 0 { 0.4 } else { 0.34 }, 0.01)).shared.is_none());
        assert!(
            select_periods(&[Found::Masked(super::super::fit::MaskReason::Dark)], 1, PeriodChoice::Auto, 0.0)
                .shared
                .is_none()
        );
    }
}
