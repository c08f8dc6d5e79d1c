//! Directions, and the geometric factors of Stam's BRDF.

use nacre_base::{Error, Result};
use serde::Serialize;

/// Unit direction away from the surface: x to the right, y up, z along the normal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Direction {
    /// Component to the right.
    pub x: f64,
    /// Component up in the plane of the surface.
    pub y: f64,
    /// Component along the normal.
    pub z: f64,
}

impl Direction {
    /// Direction at an angle from the normal and an azimuth anticlockwise from the right, in rad.
    pub fn new(theta: f64, phi: f64) -> Self {
        let (sin, cos) = theta.sin_cos();
        Self { x: sin * phi.cos(), y: sin * phi.sin(), z: cos }
    }

    /// Direction of these components in the plane of the surface; `None` beyond the horizon.
    pub fn of(x: f64, y: f64) -> Option<Self> {
        let square = 1.0 - x * x - y * y;
        (square > 0.0).then(|| Self { x, y, z: square.sqrt() })
    }

    /// Direction of the light from angles in degrees.
    ///
    /// # Errors
    /// `Input` for light that does not come from above.
    pub fn light(theta_deg: f64, phi_deg: f64) -> Result<Self> {
        if !((0.0..90.0).contains(&theta_deg) && phi_deg.is_finite() && theta_deg < 89.9) {
            let problem = format!("is at {theta_deg}, {phi_deg} degrees");
            return Err(Error::input("light", problem, "give an angle from the normal of 0 to 89.9, and an azimuth"));
        }
        Ok(Self::new(theta_deg.to_radians(), phi_deg.to_radians()))
    }

    pub(crate) fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }
}

/// Geometric factors of a pair of directions.
///
/// With `(u, v, w) = -ωi - ωr`, Stam's BRDF is `f = k²F²G / (4π²A w²) · <|P(ku, kv)|²> = F² · gain · S / λ²` (2014
/// thesis). `S = <|P|²>/A` is the power density of `exp(ikwh)` at the spatial frequency `-(u, v)/λ`, whose integral
/// over all frequencies is 1. The `gain = G/w²` is 1 in the mirror direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Components of `ωi + ωr` in the plane; divided by λ they are the spatial frequency of the visible order.
    pub tangent: [f64; 2],
    /// `cos θi + cos θr`, which is -w.
    pub w: f64,
    /// `G / w²` with `G = (1 + ωi·ωr)² / (cos θi cos θr)`.
    pub gain: f64,
    /// Cosine of the angle between either direction and the half vector.
    pub half_cos: f64,
}

impl Pair {
    /// Factors of the directions to the light and to the viewer.
    pub fn new(light: Direction, view: Direction) -> Self {
        let (w, dot) = (light.z + view.z, light.dot(view));
        Self {
            tangent: [light.x + view.x, light.y + view.y],
            w,
            gain: (1.0 + dot).powi(2) / (light.z * view.z * w * w),
            half_cos: (0.5 * (1.0 + dot)).max(0.0).sqrt(),
        }
    }

    /// Shadowing and masking of V grooves: the fraction of a facet that is both lit and visible (Stam 1999; Torrance
    /// and Sparrow 1967).
    pub fn v_grooves(light: Direction, view: Direction) -> f64 {
        let pair = Self::new(light, view);
        let length = (pair.tangent[0].powi(2) + pair.tangent[1].powi(2) + pair.w * pair.w).sqrt();
        if length <= 0.0 || pair.half_cos <= 0.0 {
            return 0.0;
        }
        let normal = pair.w / length;
        (2.0 * normal * light.z.min(view.z) / pair.half_cos).min(1.0)
    }
}

/// Gaussian coherence window.
///
/// Its amplitude has the standard deviation σs = width/4 (2014 thesis, section 3.2.2: 4σs = 65 µm for sunlight), and
/// its square is normalised. Averaged over all positions of the window on the repeated patch, the cross terms of two
/// frequencies cancel. The mean power density is then the sum over the patch's frequencies of |c|² times a Gaussian of
/// standard deviation `1/(2√2 π σs)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Standard deviation in spatial frequency, in 1/µm.
    pub sigma: f64,
}

impl Window {
    /// Window of a width of four standard deviations, in µm.
    ///
    /// # Errors
    /// `Input` for a width out of range.
    pub fn new(coherence_um: f64) -> Result<Self> {
        if !(1.0..=1e4).contains(&coherence_um) {
            let problem = format!("is {coherence_um} µm");
            return Err(Error::input("coherence length", problem, "give 1 to 10000 with --coherence-um"));
        }
        Ok(Self { sigma: 4.0 / (8_f64.sqrt() * std::f64::consts::PI * coherence_um) })
    }

    /// Radius in 1/µm outside of which less than a fraction `error` of the window lies.
    pub fn radius(&self, error: f64) -> f64 {
        self.sigma * (-2.0 * error.min(0.5).ln()).sqrt()
    }

    /// Maximum, in µm².
    pub fn peak(&self) -> f64 {
        0.5 / (std::f64::consts::PI * self.sigma * self.sigma)
    }

    /// Step of evenly spaced wave numbers in 1/µm for a relative error below `error` of an order's light, for
    /// directions with this length of the tangent.
    ///
    /// The trapezoidal rule on a Gaussian of standard deviation σ has the error `2 exp(-2π²σ²/step²)`.
    pub fn step(&self, tangent: f64, error: f64) -> f64 {
        let sigma = self.sigma / tangent.max(1e-9);
        std::f64::consts::PI * sigma * (2.0 / (2.0 / error.min(0.5)).ln()).sqrt()
    }
}
