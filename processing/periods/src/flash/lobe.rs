//! The shape of an order over half vectors: that of the light.

use super::view::Half;

/// Standard deviation in direction cosines that every lobe has at the least: coherence.
const FLOOR: f64 = 1e-3;

/// Area of a lobe whose peak is 1: only makes numbers handy.
const AREA: f64 = 1e-3;

/// What makes lobes wide.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lobe {
    /// Standard deviation of the light in its plane, in mm.
    pub light_mm: f64,
    /// Standard deviation of the filter's band over its wavelength.
    pub band: f64,
}

/// A Gaussian over half vectors, as wide as the lobes that are seen from a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Inverse covariance, xx, xy, yy.
    pub inverse: [f64; 3],
    /// Peak of a lobe of unit energy.
    pub peak: f64,
}

impl Lobe {
    /// Mean half vector over the light: orders lie where it is n λ/a.
    pub fn middle(&self, seen: &Half) -> [f64; 2] {
        let variance = self.light_mm * self.light_mm;
        [0, 1].map(|k| seen.half[k] + variance * seen.bend[k])
    }

    /// Lobes at a half vector. The light spreads them as the half vector changes over it, the band along themselves.
    pub fn at(&self, seen: &Half) -> Shape {
        let [a, b, c] = seen.slope;
        let (light, band) = (self.light_mm * self.light_mm, self.band * self.band);
        let [x, y] = seen.half;
        let xx = light * (a * a + b * b) + FLOOR * FLOOR + band * x * x;
        let xy = light * (a * b + b * c) + band * x * y;
        let yy = light * (b * b + c * c) + FLOOR * FLOOR + band * y * y;
        let determinant = xx * yy - xy * xy;
        Shape { inverse: [yy / determinant, -xy / determinant, xx / determinant], peak: AREA / determinant.sqrt() }
    }
}

impl Shape {
    /// Squared distance in standard deviations.
    pub fn square(&self, [x, y]: [f64; 2]) -> f64 {
        let [a, b, c] = self.inverse;
        a * x * x + 2.0 * b * x * y + c * y * y
    }

    /// Standard deviation of a round lobe of the same area.
    pub fn width(&self) -> f64 {
        let [a, b, c] = self.inverse;
        (a * c - b * b).powf(-0.25)
    }
}
