//! Shape of a diffraction order over half vectors, determined by the light.

use super::view::Half;

/// Minimum standard deviation of a lobe in direction cosines, due to coherence.
const FLOOR: f64 = 1e-3;

/// Area of a lobe with peak 1; a scale that keeps values near 1.
const AREA: f64 = 1e-3;

/// Causes of lobe width.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lobe {
    /// Standard deviation of the light in its plane in mm.
    pub light_mm: f64,
    /// Relative standard deviation of the filter's band.
    pub band: f64,
}

/// Gaussian over half vectors, with the width of lobes seen at a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Inverse covariance: xx, xy, yy.
    pub inverse: [f64; 3],
    /// Peak of a lobe with unit energy.
    pub peak: f64,
}

impl Lobe {
    /// Mean half vector over the light; orders lie where it equals n λ/a.
    pub fn middle(&self, seen: &Half) -> [f64; 2] {
        let variance = self.light_mm * self.light_mm;
        [0, 1].map(|k| seen.half[k] + variance * seen.bend[k])
    }

    /// Lobe shape at a half vector. The extent of the light broadens it according to the half vector's gradient; the
    /// spectral band broadens it radially.
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

    /// Standard deviation of an isotropic lobe with the same area.
    pub fn width(&self) -> f64 {
        let [a, b, c] = self.inverse;
        (a * c - b * b).powf(-0.25)
    }
}
