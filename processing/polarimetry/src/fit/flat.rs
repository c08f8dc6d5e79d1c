//! A flat field that maps were divided by, and σ of the corrected intensities.

use super::noise::Covariance;
use crate::StokesMaps;

/// A flat field of maps; without one, nothing was divided.
#[derive(Default)]
pub(crate) struct Flat {
    /// Factor of each pixel; empty without a flat field.
    pub factors: Vec<f32>,
    /// Standard deviation of a factor, as a share.
    pub sigma: f32,
}

impl Flat {
    /// S0, S1 and S2 of pixel `i`, before the division.
    pub fn before(&self, maps: &StokesMaps, i: usize) -> [f32; 3] {
        let factor = self.factors.get(i).copied().unwrap_or(1.0);
        [&maps.s0, &maps.s1, &maps.s2].map(|plane| plane[i] / factor)
    }

    /// σ of S0 of pixel `i`: noise of the photographs and, as a common factor, of the flat field.
    pub fn sigma_s0(&self, maps: &StokesMaps, covariance: &Covariance, i: usize) -> f32 {
        let factor = self.factors.get(i).copied().unwrap_or(1.0);
        // The covariance is that of (S0, S1, S2) / 2.
        let noise = 2.0 * covariance.of_mean(i, self.before(maps, i).map(|v| 0.5 * v)).max(0.0).sqrt();
        (noise * factor).hypot(self.sigma * maps.s0[i])
    }
}
