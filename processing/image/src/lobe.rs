//! Sub-pixel position of the zero order.

use nacre_base::{Error, Result};
use nalgebra::{Matrix4, Vector4};

/// Threshold of the lobe, relative to its brightest pixel.
const LOBE: f32 = 0.2;

/// Largest radius of a lobe, relative to the shorter side of the photograph.
const LARGEST: f64 = 0.2;

/// Relative brightness from which another maximum may be the zero order.
const RIVAL: f64 = 0.5;

/// Smallest number of pixels of a lobe, and largest scatter of ln light about a Gaussian.
const FEWEST: usize = 9;
const SCATTER: f64 = 0.5;

/// Lower bound of the standard deviation in pixels, from the unknown shape of the lobe.
const LEAST_SIGMA: f64 = 0.01;

/// Zero-order lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Position in pixels from the left and from the top.
    pub center: [f64; 2],
    /// Standard deviation of either coordinate, in pixels.
    pub sigma_px: f64,
    /// Whether pixels are saturated; the position then follows from the flanks.
    pub saturated: bool,
    /// Radius of the fitted region, in pixels.
    radius: usize,
}

/// Finds the brightest lobe, or the lobe at a given position.
///
/// A Gaussian is a paraboloid in ln light. Linear least squares fits it, weighted by the precision of ln light.
/// Saturated pixels are not needed.
///
/// # Errors
/// A description of the problem for messages.
pub fn find(light: &[f32], width: usize, height: usize, near: Option<[f64; 2]>) -> std::result::Result<Lobe, String> {
    let reach = (LARGEST * width.min(height) as f64).max(4.0);
    let around = |[x, y]: [f64; 2]| {
        let pixel = [(x.round() as usize).min(width - 1), (y.round() as usize).min(height - 1)];
        fit(light, [width, height], pixel, reach)
    };
    let start = match near {
        Some(place) => place,
        None => brightest(light, width, height).ok_or("there is no light in it")?,
    };
    // A second fit in a window centred on the first result.
    let first = around(start)?;
    around(around(first.center)?.center)
}

/// Error for a zero order that is not found, with a remedy.
pub fn not_found(problem: &str) -> Error {
    Error::input("zero order", problem, "say where it is with --center X,Y (pixels from the left and the top)")
}

/// As [`find`], with an error for users.
pub fn require(light: &[f32], width: usize, height: usize) -> Result<Lobe> {
    find(light, width, height, None).map_err(|problem| not_found(&problem))
}

/// Sums over 5 × 5 pixels; saturated pixels count as brighter than all others. Empty without light.
fn sums(light: &[f32], width: usize, height: usize) -> Vec<f32> {
    let top = light.iter().copied().filter(|l| l.is_finite()).fold(0.0, f32::max);
    if top <= 0.0 {
        return vec![];
    }
    let value = |i: usize| if light[i].is_finite() { light[i] } else { 2.0 * top };
    // Rows first, then columns: 10 additions per pixel rather than 25.
    let around = |k: usize, n: usize| k.saturating_sub(2)..(k + 3).min(n);
    let rows: Vec<f32> = (0..width * height)
        .map(|i| around(i % width, width).map(|x| value(i / width * width + x)).sum::<f32>())
        .collect();
    (0..width * height).map(|i| around(i / width, height).map(|y| rows[y * width + i % width]).sum::<f32>()).collect()
}

/// Centre of the brightest 5 × 5 pixels.
fn brightest(light: &[f32], width: usize, height: usize) -> Option<[f64; 2]> {
    let best = sums(light, width, height).into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some([(best.0 % width) as f64, (best.0 / width) as f64])
}

impl Lobe {
    /// Position and relative brightness of another maximum that may be the zero order.
    pub fn rival(&self, light: &[f32], width: usize, height: usize) -> Option<([f64; 2], f64)> {
        let sums = sums(light, width, height);
        let away = |i: &usize| {
            let off = [(i % width) as f64 - self.center[0], (i / width) as f64 - self.center[1]];
            off[0].hypot(off[1]) > 2.0 * self.radius as f64 + 3.0
        };
        let other = (0..sums.len()).filter(away).max_by(|a, b| sums[*a].total_cmp(&sums[*b]))?;
        let at = self.center.map(|c| c.round().max(0.0) as usize);
        let share = f64::from(sums[other]) / f64::from(*sums.get(at[1] * width + at[0])?);
        (share > RIVAL).then_some(([(other % width) as f64, (other / width) as f64], share))
    }

    /// Radius of the fitted region, in pixels.
    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Lobe with a given position.
    pub fn given(center: [f64; 2], sigma_px: f64, saturated: bool) -> Self {
        Self { center, sigma_px, saturated, radius: 0 }
    }
}

/// Pixels in a square around a pixel.
fn square(size: [usize; 2], [x, y]: [usize; 2], radius: usize) -> impl Iterator<Item = (usize, usize)> {
    let range = move |k: usize, n: usize| k.saturating_sub(radius)..(k + radius + 1).min(n);
    range(y, size[1]).flat_map(move |row| range(x, size[0]).map(move |column| (column, row)))
}

/// Fits a lobe around a pixel.
fn fit(light: &[f32], size: [usize; 2], at: [usize; 2], reach: f64) -> std::result::Result<Lobe, String> {
    let value = |(x, y): (usize, usize)| light[y * size[0] + x];
    // Radius of the lobe: the window grows until most of its border is dark.
    let mut radius = 2;
    let mut top;
    loop {
        top = square(size, at, radius).map(value).filter(|l| l.is_finite()).fold(0.0, f32::max);
        let edge = square(size, at, radius).filter(|(x, y)| x.abs_diff(at[0]).max(y.abs_diff(at[1])) == radius);
        let (bright, all) =
            edge.map(value).fold((0, 0), |(b, n), l| (b + usize::from(l.is_nan() || l >= LOBE * top), n + 1));
        if 10 * bright <= all && top > 0.0 {
            break;
        }
        if radius as f64 > reach {
            return Err(format!("no lobe ends within {reach:.0} pixels of {}, {}", at[0], at[1]));
        }
        radius += 1;
    }
    let (mut matrix, mut right, mut count) = (Matrix4::<f64>::zeros(), Vector4::<f64>::zeros(), 0);
    let inside = |(x, y): (usize, usize)| {
        let [dx, dy] = [x as f64 - at[0] as f64, y as f64 - at[1] as f64];
        (dx, dy, f64::from(light[y * size[0] + x]))
    };
    let lobe: Vec<(f64, f64, f64)> =
        square(size, at, radius).filter(|p| value(*p) > LOBE * top).map(inside).filter(|p| p.2.is_finite()).collect();
    for (dx, dy, l) in &lobe {
        let row = Vector4::new(1.0, *dx, *dy, dx * dx + dy * dy);
        let weight = (l / f64::from(top)).powi(2);
        matrix += weight * row * row.transpose();
        right += weight * row * l.ln();
        count += 1;
    }
    let solved = (count >= FEWEST).then(|| matrix.cholesky()).flatten();
    let Some(solved) = solved else {
        return Err(format!("the lobe at {}, {} has only {count} known pixels", at[0], at[1]));
    };
    let p = solved.solve(&right);
    let (mut squares, mut weights) = (0.0, 0.0);
    for (dx, dy, l) in &lobe {
        let weight = (l / f64::from(top)).powi(2);
        squares += weight * (l.ln() - p[0] - p[1] * dx - p[2] * dy - p[3] * (dx * dx + dy * dy)).powi(2);
        weights += weight;
    }
    let scatter = (squares / weights * count as f64 / (count - 4) as f64).sqrt();
    let offset = [-0.5 * p[1] / p[3], -0.5 * p[2] / p[3]];
    if p[3] >= 0.0 || offset[0].hypot(offset[1]) > radius as f64 || scatter > SCATTER {
        return Err(format!("what is brightest, at {}, {}, is no lobe", at[0], at[1]));
    }
    let covariance = solved.inverse();
    let of = |k: usize| (covariance[(k, k)] * weights / count as f64).sqrt() * scatter / (2.0 * -p[3]);
    let saturated = square(size, at, radius).any(|q| !value(q).is_finite());
    Ok(Lobe {
        center: [at[0] as f64 + offset[0], at[1] as f64 + offset[1]],
        sigma_px: of(1).hypot(of(2)).max(LEAST_SIGMA),
        saturated,
        radius,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot(x: f64, y: f64, sigma: f64, clip: f64) -> Vec<f32> {
        let at = |i: usize| {
            let (dx, dy) = ((i % 120) as f64 - x, (i / 120) as f64 - y);
            // A second, weaker order, and a uniform background.
            let other = 0.5 * (-0.5 * ((dx - 40.0).powi(2) + dy * dy) / (sigma * sigma)).exp();
            let l = (-0.5 * (dx * dx + dy * dy) / (sigma * sigma)).exp() + other + 1e-3;
            if l > clip { f32::NAN } else { l as f32 }
        };
        (0..120 * 90).map(at).collect()
    }

    #[test]
    fn lobes_are_found_to_a_fraction_of_a_pixel() {
        for (x, y, sigma, clip) in [(40.3, 41.7, 2.0, 9.0), (39.5, 44.0, 6.0, 9.0), (40.2, 40.9, 4.0, 0.6)] {
            let lobe = require(&spot(x, y, sigma, clip), 120, 90).unwrap();
            let off = (lobe.center[0] - x).hypot(lobe.center[1] - y);
            assert!(off < 0.02 && off < 3.0 * lobe.sigma_px, "{off} {lobe:?}");
            assert_eq!(lobe.saturated, clip < 1.0);
        }
    }

    #[test]
    fn what_is_no_lobe_is_refused() {
        for light in [vec![0.0; 120 * 90], vec![1.0; 120 * 90], vec![f32::NAN; 120 * 90]] {
            let problem = require(&light, 120, 90).unwrap_err().to_string();
            assert!(problem.contains("--center"), "{problem}");
        }
        // The maximum of a ramp is at the border.
        let ramp: Vec<f32> = (0..120 * 90).map(|i| (i % 120) as f32).collect();
        assert!(find(&ramp, 120, 90, None).is_err());
    }
}
