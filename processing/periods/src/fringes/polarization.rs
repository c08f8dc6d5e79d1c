//! Verification by orientations from `reconstruct polarization`.
//!
//! Polarization yields orientations up to an unknown offset; fringes yield absolute orientations, but not at every
//! pixel. Pixels with both determine the offset. Of two ambiguous gratings, the one consistent with polarization is
//! selected.

use super::answer::Verdict;
use super::scan::Found;
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_image::read_exr;
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::PI;
use std::path::Path;

/// Effect of a polarization map.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct PolarizationVerification {
    /// Offset to add to its orientations, in degrees; varies with the period if periods are mixed.
    pub offset_deg: f64,
    /// Median absolute deviation from the offset in degrees, over pixels with both.
    pub spread_deg: f64,
    /// Number of pixels with both.
    pub shared: usize,
    /// Number of masked pixels, where both differ by more than ten combined σ and 5°.
    pub contradicted: usize,
    /// Number of ambiguous pixels that it decided.
    pub decided: usize,
}

/// Orientation and σ of each pixel in rad; NaN where masked.
pub struct Orientations {
    turn: Vec<f32>,
    sigma: Vec<f32>,
}

impl Orientations {
    /// Reads `orientation.exr` of a result folder.
    ///
    /// # Errors
    /// `Input` without a map of this size.
    pub fn read(folder: &Path, width: usize, height: usize) -> Result<Self> {
        let path = folder.join("orientation.exr");
        let mut map = read_exr(&path)?;
        if [map.width, map.height] != [width, height] {
            let problem =
                format!("is {} × {} pixels, but the photographs are {width} × {height}", map.width, map.height);
            return Err(Error::file(&path, problem, "give results of the same camera and region of interest"));
        }
        let [turn, sigma] = [map.take("orientation", &path)?, map.take("sigma", &path)?];
        Ok(Self { turn, sigma })
    }

    /// Determines the offset, decides ambiguous pixels, and masks contradicted ones.
    pub fn verify(&self, found: &mut Found) -> Option<PolarizationVerification> {
        let apart = |i: usize, orientation: f64| {
            let turn = f64::from(self.turn[i]);
            turn.is_finite().then(|| fold(orientation - turn))
        };
        let known = |i: &usize| found.verdicts[*i] == Verdict::Resolved;
        let offsets: Vec<f64> = (0..self.turn.len())
            .filter(known)
            .filter_map(|i| found.gratings[i].and_then(|g| apart(i, g.orientation)))
            .collect();
        // Circular mean of doubled angles, then the median about it.
        let (sin, cos) = offsets.iter().fold((0.0, 0.0), |(s, c), o| (s + (2.0 * o).sin(), c + (2.0 * o).cos()));
        let about = 0.5 * f64::atan2(sin, cos);
        let middle = about + median(offsets.iter().map(|o| fold(o - about)).collect::<Vec<_>>())?;
        let spread = median(offsets.iter().map(|o| fold(o - middle).abs()).collect::<Vec<_>>())?;
        let mut verification = PolarizationVerification {
            offset_deg: fold(middle).to_degrees(),
            spread_deg: spread.to_degrees(),
            shared: offsets.len(),
            contradicted: 0,
            decided: 0,
        };
        for i in 0..self.turn.len() {
            let tolerance = |sigma: f64| 10.0 * sigma.hypot(f64::from(self.sigma[i])).hypot(spread);
            match found.verdicts[i] {
                Verdict::Resolved => {
                    let Some(grating) = found.gratings[i] else { continue };
                    let Some(off) = apart(i, grating.orientation).map(|o| fold(o - middle).abs()) else { continue };
                    if off > tolerance(grating.orientation_sigma).max(5f64.to_radians()) {
                        found.verdicts[i] = Verdict::Ambiguous;
                        verification.contradicted += 1;
                    }
                }
                Verdict::Ambiguous => {
                    let near = |orientation: f64, sigma: f64| {
                        apart(i, orientation).is_some_and(|o| fold(o - middle).abs() < tolerance(sigma).min(PI / 8.0))
                    };
                    let Some(pair) = found.rivals[i] else { continue };
                    let fits = pair.map(|g| near(g.orientation, g.orientation_sigma));
                    if fits[0] != fits[1] {
                        found.gratings[i] = Some(pair[usize::from(fits[1])]);
                        found.verdicts[i] = Verdict::Resolved;
                        verification.decided += 1;
                    }
                }
                _ => {}
            }
        }
        Some(verification)
    }
}

/// Difference of undirected angles, from -π/2 to π/2.
fn fold(angle: f64) -> f64 {
    (angle + 0.5 * PI).rem_euclid(PI) - 0.5 * PI
}

#[cfg(test)]
mod tests {
    use super::super::answer::Grating;
    use super::*;

    fn grating(degrees: f64) -> Grating {
        Grating {
            orientation: degrees.to_radians().rem_euclid(PI),
            orientation_sigma: 0.002,
            period_um: 2.0,
            period_sigma_um: 0.01,
            mirror_offset: [0.0; 2],
            residual: 1.0,
            first: 0.6,
            weights: [0.0; 7],
        }
    }

    /// The offset is found across the wrap at 180°, the consistent rival is selected, and contradicted pixels are
    /// masked.
    #[test]
    fn polarization_decides_and_contradicts() {
        let (offset, count) = (170.0, 50);
        let truth = |i: usize| 3.6 * i as f64;
        let orientations = Orientations {
            turn: (0..count).map(|i| (truth(i) - offset).to_radians().rem_euclid(PI) as f32).collect(),
            sigma: vec![0.005; count],
        };
        let mut found = Found {
            verdicts: vec![Verdict::Resolved; count],
            gratings: (0..count).map(|i| Some(grating(truth(i)))).collect(),
            rivals: vec![None; count],
        };
        found.gratings[7] = Some(grating(truth(7) + 40.0));
        (found.verdicts[8], found.gratings[8]) = (Verdict::Ambiguous, None);
        found.rivals[8] = Some([grating(truth(8) + 70.0), grating(truth(8) + 0.1)]);
        (found.verdicts[9], found.gratings[9]) = (Verdict::Ambiguous, None);
        found.rivals[9] = Some([grating(truth(9) + 70.0), grating(truth(9) - 50.0)]);
        let verification = orientations.verify(&mut found).unwrap();
        assert!(fold((verification.offset_deg - offset).to_radians()).abs() < 1e-3, "{verification:?}");
        assert_eq!((verification.contradicted, verification.decided), (1, 1));
        assert_eq!(found.verdicts[7..10], [Verdict::Ambiguous, Verdict::Resolved, Verdict::Ambiguous]);
        let chosen = found.gratings[8].unwrap().orientation.to_degrees();
        assert!((chosen - truth(8) - 0.1).abs() < 1e-6, "{chosen}");
    }
}
