//! Gaps of height fields: refused, or filled by interpolation on request.

use super::Scale;
use nacre_base::{Error, Result};
use std::path::Path;

/// Largest fraction of gaps that may be filled.
pub(super) const MOST: f64 = 0.5;

/// Relaxation rounds per grid. The coarser grid gives the start values, so few are needed.
const ROUNDS: usize = 16;

/// Fills NaN and infinite heights if their fraction is at most `scale.fill_gaps`; returns a note. `word` is the file's
/// term for gaps, such as "are bad points".
///
/// Inside a gap, each height becomes the mean of its neighbours (Laplace's equation).
///
/// # Errors
/// `Input` for gaps that `scale` does not allow.
pub(super) fn fill(path: &Path, width: usize, values: &mut [f64], word: &str, scale: &Scale) -> Result<Option<String>> {
    let Some(at) = values.iter().position(|v| !v.is_finite()) else { return Ok(None) };
    let count = values.iter().filter(|v| !v.is_finite()).count();
    let share = count as f64 / values.len() as f64;
    let (x, y) = (at % width, at / width);
    let problem = format!("{count} heights {word} ({:.2} %), the first at column {x}, row {y}", 100.0 * share);
    // Rounded up, so that the stated fraction suffices.
    let enough = (share * 1e4).ceil() / 1e4;
    match scale.fill_gaps {
        _ if share > MOST => Err(Error::file(path, problem, "crop the patch to where heights are known")),
        Some(allowed) if share <= allowed => {
            values.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = f64::NAN);
            interpolate(values, width);
            Ok(Some(format!("{count} gaps ({:.2} %) filled by interpolation", 100.0 * share)))
        }
        _ => {
            let remedy = format!("fill them by interpolation with --fill-gaps {enough}, or crop the patch");
            Err(Error::file(path, problem, remedy))
        }
    }
}

/// Fills NaN from a grid of half the size, then relaxes. At least one value is known.
fn interpolate(values: &mut [f64], width: usize) {
    let rows = values.len() / width;
    let gaps: Vec<usize> = (0..values.len()).filter(|i| values[*i].is_nan()).collect();
    if gaps.is_empty() {
        return;
    }
    let (half, half_rows) = (width.div_ceil(2), rows.div_ceil(2));
    let mut coarse = vec![0.0; half * half_rows];
    let mut known = vec![0.0; half * half_rows];
    for (i, value) in values.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
        let cell = i / width / 2 * half + i % width / 2;
        coarse[cell] += value;
        known[cell] += 1.0;
    }
    // 0 over 0 is NaN, a gap of the coarser grid.
    coarse.iter_mut().zip(&known).for_each(|(sum, count)| *sum /= count);
    interpolate(&mut coarse, half);
    for i in &gaps {
        values[*i] = coarse[i / width / 2 * half + i % width / 2];
    }
    let mut relax = |i: usize| {
        let (x, y) = (i % width, i / width);
        let neighbours = [
            (x > 0).then(|| values[i - 1]),
            (x + 1 < width).then(|| values[i + 1]),
            (y > 0).then(|| values[i - width]),
            (y + 1 < rows).then(|| values[i + width]),
        ];
        let (sum, count) = neighbours.into_iter().flatten().fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        values[i] = sum / count;
    };
    for _ in 0..ROUNDS {
        gaps.iter().for_each(|i| relax(*i));
        gaps.iter().rev().for_each(|i| relax(*i));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 40;

    fn plane() -> Vec<f64> {
        (0..WIDTH * 30).map(|i| 0.02 * (i % WIDTH) as f64 - 0.03 * (i / WIDTH) as f64 + 5.0).collect()
    }

    fn with_hole(side: usize) -> Vec<f64> {
        let mut values = plane();
        for i in 0..side * side {
            values[(8 + i / side) * WIDTH + 12 + i % side] = f64::NAN;
        }
        values
    }

    fn allowed(share: f64) -> Scale {
        Scale { fill_gaps: Some(share), ..Scale::default() }
    }

    #[test]
    fn holes_in_a_plane_are_filled_with_the_plane() {
        let path = Path::new("x.asc");
        // Heights differ by up to 0.5 across the largest hole, where relaxation stops before convergence.
        for (side, most) in [(1, 1e-12), (3, 1e-9), (11, 0.005)] {
            let mut values = with_hole(side);
            let note = fill(path, WIDTH, &mut values, "are gaps", &allowed(0.2)).unwrap().unwrap();
            assert!(note.starts_with(&format!("{} gaps", side * side)), "{note}");
            let off = values.iter().zip(plane()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < most, "{side}: {off}");
        }
    }

    #[test]
    fn gaps_are_refused_with_the_share_that_would_do() {
        let path = Path::new("x.asc");
        let refused = |scale: &Scale| {
            let mut values = with_hole(6);
            fill(path, WIDTH, &mut values, "are gaps", scale).unwrap_err().to_string()
        };
        let said = refused(&Scale::default());
        assert!(said.contains("36 heights are gaps (3.00 %), the first at column 12, row 8"), "{said}");
        assert!(said.contains("--fill-gaps 0.03"), "{said}");
        assert!(refused(&allowed(0.02)).contains("--fill-gaps 0.03"));
        let mut all = vec![f64::NAN; 8];
        all[0] = 1.0;
        let said = fill(path, 4, &mut all, "are gaps", &allowed(0.5)).unwrap_err().to_string();
        assert!(said.contains("crop") && !said.contains("--fill-gaps"), "{said}");
        assert_eq!(fill(path, 4, &mut [0.0; 8], "are gaps", &allowed(0.5)).unwrap(), None);
    }
}
