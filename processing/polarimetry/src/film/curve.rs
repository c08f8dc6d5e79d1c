//! The closed curve of the points (S1/S0, S2/S0) over all orientations (2018 paper, Fig. 15).
//!
//! With `R` the grating's ratio, `B` the film and `e` the light, the field behind the film is
//! `E = (a B² + f) e + b B H(2θ) B e`. Here `a = (R-1)/2`, `b = -(1+R)/2`, f is the front reflection and `H(2θ)` a
//! reflection (from Eq. 4-6). Every Stokes parameter is therefore a trigonometric polynomial in 2θ and 4θ, and fifteen
//! coefficients define the curve.

use crate::{Jones, JonesVector};
use nacre_frames::RetarderCalibration;
use num_complex::Complex;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Light of the display: linear polarization through a retarder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Direction of the display's polarization in rad.
    pub panel: f64,
    /// Azimuth of the retarder in rad.
    pub axis: f64,
    /// Retardance in rad.
    pub retardance: f64,
    /// Standard deviation of the retardance in rad, if it is calibrated.
    pub sigma: Option<f64>,
}

impl Source {
    /// An ideal quarter-wave retarder (2018 paper, section 5.1).
    pub const IDEAL: Self = Self { panel: 0.0, axis: FRAC_PI_4, retardance: FRAC_PI_2, sigma: None };

    /// The calibrated source.
    pub fn of(calibration: &RetarderCalibration) -> Self {
        let [panel, axis, retardance] =
            [calibration.panel_deg, calibration.azimuth_deg, calibration.retardance_deg].map(f64::to_radians);
        Self { panel, axis, retardance, sigma: Some(calibration.retardance_sigma_deg.to_radians()) }
    }

    /// Field behind the retarder, with this excess of retardance in rad.
    pub fn light(&self, excess: f64) -> JonesVector {
        Jones::retarder(self.axis, self.retardance + excess).apply(JonesVector::linear(self.panel))
    }
}

/// Parameters of the curve: those of the 2018 paper, and effects that it neglects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// Natural logarithm of r = |R|.
    pub ln_r: f64,
    /// Phase of R in rad.
    pub zeta: f64,
    /// Retardance of the film in rad (Δn of Eq. 6).
    pub retardance: f64,
    /// Azimuth of the film's axis in rad, which is 0 in Eq. 6.
    pub axis: f64,
    /// Reflection at the film's front (r_p of Eq. 4), with the phase caused by the film's thickness.
    pub front: Complex<f64>,
    /// Excess retardance of the display's quarter-wave retarder in rad.
    pub source_error: f64,
    /// Share of unpolarised stray light, which draws all points towards the origin.
    pub stray: f64,
    /// Relative decrease of the front reflection, compared with the light from below, over metal without a grating: a
    /// grating diffracts part of its light into other orders.
    pub shade: f64,
    /// Light of the display, which is not fitted.
    pub source: Source,
}

/// Number of fitted parameters of [`Film`].
pub const PARAMETERS: usize = 9;

impl Film {
    /// R = 1, and no film.
    pub const NONE: Self = Self {
        ln_r: 0.0,
        zeta: 0.0,
        retardance: 0.0,
        axis: 0.0,
        front: Complex::new(0.0, 0.0),
        source_error: 0.0,
        stray: 0.0,
        shade: 0.0,
        source: Source::IDEAL,
    };

    /// All fitted parameters in the order of the fields.
    pub fn to_array(self) -> [f64; PARAMETERS] {
        let Self { ln_r, zeta, retardance, axis, front, source_error, stray, shade, source: _ } = self;
        [ln_r, zeta, retardance, axis, front.re, front.im, source_error, stray, shade]
    }

    /// The inverse of [`Film::to_array`], with an ideal source.
    pub fn from_array([ln_r, zeta, retardance, axis, re, im, source_error, stray, shade]: [f64; PARAMETERS]) -> Self {
        let front = Complex::new(re, im);
        Self { ln_r, zeta, retardance, axis, front, source_error, stray, shade, source: Source::IDEAL }
    }

    /// The equivalent film with ζ from 0 to 180°, a positive retardance and an axis from 0 to 180°. It uses the
    /// equivalence (r, ζ) = (1/r, -ζ), under which the front reflection refers to the other polarization.
    pub fn canonical(&self) -> Self {
        let mut film = *self;
        if film.retardance < 0.0 {
            // The slow and fast axes are exchanged. Their common phase is only visible relative to the front
            // reflection.
            let phase = Complex::from_polar(1.0, -2.0 * film.retardance);
            (film.retardance, film.axis, film.front) = (-film.retardance, film.axis + FRAC_PI_2, film.front * phase);
        }
        film.zeta = (film.zeta + PI).rem_euclid(TAU) - PI;
        if film.zeta < 0.0 {
            let ratio = Complex::from_polar(film.ln_r.exp(), film.zeta);
            (film.ln_r, film.zeta, film.front) = (-film.ln_r, -film.zeta, -film.front / ratio);
        }
        film.axis = film.axis.rem_euclid(PI);
        film
    }

    /// `1`, `a = (R-1)/2` and `b = -(1+R)/2`, all divided by 1 + r to avoid overflow; the points are ratios.
    pub(crate) fn amplitudes(&self) -> (f64, Complex<f64>, Complex<f64>) {
        let (small, large) = (1.0 / (1.0 + self.ln_r.exp()), 1.0 / (1.0 + (-self.ln_r).exp()));
        let ratio = Complex::from_polar(large, self.zeta);
        (small, 0.5 * (ratio - small), -0.5 * (ratio + small))
    }

    /// Field of the display's light.
    pub(crate) fn light(&self) -> JonesVector {
        self.source.light(self.source_error)
    }

    /// The curve.
    pub fn curve(&self) -> Curve {
        let light = self.light();
        let film = Jones::retarder(self.axis, self.retardance);
        let (small, a, b) = self.amplitudes();
        let inside = film.apply(light);
        let [x, y] = inside.0;
        let constant = film.apply(inside.scaled(a)).plus(light.scaled(self.front * small));
        let cos = film.apply(JonesVector([x, -y]).scaled(b));
        let sin = film.apply(JonesVector([y, x]).scaled(b));
        Curve::of_field(constant, cos, sin).with_stray(self.stray)
    }

    /// The curve with the point of metal without a grating under the same film, which corresponds to R = -1.
    pub fn curve_and_mirror(&self) -> Curve {
        let light = self.light();
        let film = Jones::retarder(self.axis, self.retardance);
        let back =
            film.apply(film.apply(light)).scaled((-1.0).into()).plus(light.scaled(self.front * (1.0 - self.shade)));
        self.curve().with_mirror(back, self.stray_over_mirrors())
    }

    /// Share of stray light over metal without a grating, which reflects more: amplitudes scale as their front
    /// reflections.
    pub(crate) fn stray_over_mirrors(&self) -> f64 {
        self.stray * (1.0 - self.shade).powi(2)
    }
}

/// A closed curve in the plane of (S1/S0, S2/S0), traversed once for θ from 0 to π.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve {
    /// Coefficients of 1, cos 2θ, sin 2θ, cos 4θ and sin 4θ in S0, S1 and S2.
    stokes: [[f64; 5]; 3],
    /// Point of metal without a grating, if there is any in view.
    pub mirror: Option<[f64; 2]>,
}

impl Curve {
    /// The circle of orientations without a film, or nearly without.
    pub fn circle(center: [f64; 2], radius: f64) -> Self {
        Self {
            stokes: [[1.0, 0.0, 0.0, 0.0, 0.0], [center[0], radius, 0.0, 0.0, 0.0], [center[1], 0.0, radius, 0.0, 0.0]],
            mirror: None,
        }
    }

    /// Adds the field of metal without a grating, with this share of stray light there.
    pub(crate) fn with_mirror(self, field: JonesVector, stray: f64) -> Self {
        let s = field.stokes();
        Self { mirror: Some([s.s1, s.s2].map(|v| v / s.s0 * (1.0 - stray))), ..self }
    }

    /// The curve with the offset of orientations of a circle: the fundamental of S1/S0 + i S2/S0 over 2θ has the phase
    /// 0. Samples of one grating then have one offset under all models and equivalent films.
    pub(crate) fn in_phase(self) -> Self {
        const POINTS: usize = 64;
        let turn = |k: usize| Complex::from_polar(1.0, TAU * k as f64 / POINTS as f64);
        let point = |k: usize| {
            let [x, y] = self.at(PI * k as f64 / POINTS as f64);
            Complex::new(x, y)
        };
        let fundamental: Complex<f64> = (0..POINTS).map(|k| point(k) * turn(k).conj()).sum();
        let back: Complex<f64> = (0..POINTS).map(|k| point(k) * turn(k)).sum();
        // A curve without a sense of rotation keeps its offset.
        if fundamental.norm() <= back.norm() { self } else { self.turned(0.5 * fundamental.arg()) }
    }

    /// The curve at `theta - by` (rad).
    fn turned(self, by: f64) -> Self {
        let ((s, c), (s2, c2)) = ((2.0 * by).sin_cos(), (4.0 * by).sin_cos());
        let row = |[mean, cos, sin, cos2, sin2]: [f64; 5]| {
            [mean, c * cos - s * sin, s * cos + c * sin, c2 * cos2 - s2 * sin2, s2 * cos2 + c2 * sin2]
        };
        Self { stokes: self.stokes.map(row), ..self }
    }

    /// Adds a share of unpolarised light.
    pub(crate) fn with_stray(self, share: f64) -> Self {
        let [s0, s1, s2] = self.stokes;
        let less = |row: [f64; 5]| row.map(|v| v * (1.0 - share));
        Self { stokes: [s0, less(s1), less(s2)], ..self }
    }

    /// The curve of the field `u + v cos 2θ + w sin 2θ`.
    pub(crate) fn of_field(u: JonesVector, v: JonesVector, w: JonesVector) -> Self {
        let (uu, vv, ww) = (product(u, u), product(v, v), product(w, w));
        let (uv, uw, vw) = (product(u, v), product(u, w), product(v, w));
        Self {
            stokes: std::array::from_fn(|j| {
                [
                    uu[j] + 0.5 * (vv[j] + ww[j]),
                    2.0 * uv[j],
                    2.0 * uw[j],
                    0.5 * (vv[j] - ww[j]),
                    // Twice the mixed term, times sin 2θ cos 2θ = sin 4θ / 2.
                    vw[j],
                ]
            }),
            mirror: None,
        }
    }

    /// Coefficients of 1, cos 2θ, sin 2θ, cos 4θ and sin 4θ in S0, S1 and S2.
    pub fn coefficients(&self) -> [[f64; 5]; 3] {
        self.stokes
    }

    /// The point of orientation `theta` (rad).
    #[inline]
    pub fn at(&self, theta: f64) -> [f64; 2] {
        self.with_tangent(theta).0
    }

    /// The point of orientation `theta` (rad) and its derivative.
    #[inline]
    pub fn with_tangent(&self, theta: f64) -> ([f64; 2], [f64; 2]) {
        self.at_turn((2.0 * theta).sin_cos())
    }

    /// The point and its derivative, from sine and cosine of 2θ.
    #[inline(always)]
    pub(crate) fn at_turn(&self, turn: (f64, f64)) -> ([f64; 2], [f64; 2]) {
        let (at, tangent, _) = self.bent_at_turn(turn);
        (at, tangent)
    }

    /// The point with its first and second derivative.
    #[inline(always)]
    pub(crate) fn bent_at_turn(&self, (s, c): (f64, f64)) -> ([f64; 2], [f64; 2], [f64; 2]) {
        let (s2, c2) = (2.0 * s * c, c * c - s * s);
        let value = |k: &[f64; 5]| k[0] + k[1] * c + k[2] * s + k[3] * c2 + k[4] * s2;
        let slope = |k: &[f64; 5]| 2.0 * (k[2] * c - k[1] * s) + 4.0 * (k[4] * c2 - k[3] * s2);
        let bend = |k: &[f64; 5]| -4.0 * (k[1] * c + k[2] * s) - 16.0 * (k[3] * c2 + k[4] * s2);
        let [s0, s1, s2] = self.stokes.each_ref().map(value);
        let [d0, d1, d2] = self.stokes.each_ref().map(slope);
        let [e0, e1, e2] = self.stokes.each_ref().map(bend);
        // A single division, which takes as long as many products.
        let one = 1.0 / s0;
        let (x, y) = (s1 * one, s2 * one);
        let (dx, dy) = ((d1 - x * d0) * one, (d2 - y * d0) * one);
        ([x, y], [dx, dy], [(e1 - x * e0 - 2.0 * dx * d0) * one, (e2 - y * e0 - 2.0 * dy * d0) * one])
    }
}

/// S0, S1 and S2 of the interference of two fields: `Re(E† M F)` with the Pauli matrices.
fn product(e: JonesVector, f: JonesVector) -> [f64; 3] {
    let ([a, b], [c, d]) = (e.0, f.0);
    let (ac, bd) = ((a.conj() * c).re, (b.conj() * d).re);
    [ac + bd, ac - bd, (a.conj() * d + b.conj() * c).re]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::Synthetic;
    use proptest::prelude::*;

    proptest! {
        /// The polynomial equals the Jones calculus, and the tangent its derivative.
        #[test]
        fn the_curve_is_the_jones_calculus(
            ln_r in -9.0..9.0f64, zeta in -3.1..3.1f64, retardance in 0.0..1.5f64, axis in 0.0..3.1f64,
            re in -0.3..0.3f64, im in -0.3..0.3f64, source_error in -0.2..0.2f64, theta in 0.0..3.1f64,
        ) {
            let film = Film { ln_r, zeta, retardance, axis, front: Complex::new(re, im), source_error, stray: 0.0, shade: 0.0, source: Source::IDEAL };
            let scene = Synthetic {
                ratio: Complex::from_polar(ln_r.exp(), zeta), retardance, axis, front: film.front, source_error,
                ..Synthetic::default()
            };
            let (point, tangent) = film.curve().with_tangent(theta);
            let at = |deg: f64| scene.intensity(theta, deg.to_radians());
            let s0 = at(0.0) + at(90.0);
            prop_assume!(s0 > 1e-6 * (2.0 * ln_r).exp().max(1.0));
            let wanted = [(at(0.0) - at(90.0)) / s0, (at(45.0) - at(135.0)) / s0];
            prop_assert!((point[0] - wanted[0]).abs() < 1e-8 && (point[1] - wanted[1]).abs() < 1e-8);
            let (before, after) = (film.curve().at(theta - 1e-6), film.curve().at(theta + 1e-6));
            for k in 0..2 {
                let slope = (after[k] - before[k]) / 2e-6;
                prop_assert!((slope - tangent[k]).abs() < 1e-4 * (1.0 + slope.abs()), "{slope} {}", tangent[k]);
            }
            let (_, tangent, bend) = film.curve().bent_at_turn((2.0 * theta).sin_cos());
            let later = film.curve().with_tangent(theta + 1e-7).1;
            for k in 0..2 {
                let second = (later[k] - tangent[k]) / 1e-7;
                prop_assert!((second - bend[k]).abs() < 1e-3 * (1.0 + second.abs() + tangent[k].powi(2)), "{second} {}", bend[k]);
            }
        }

        /// Equivalence: the curve of (1/r, -ζ) is the same, with all orientations rotated by 90°.
        #[test]
        fn the_inverse_ratio_is_turned_by_90_degrees(ln_r in -1.0..1.0f64, zeta in -3.1..3.1f64, retardance in 0.0..0.5f64,
            axis in 0.0..3.1f64, theta in 0.0..3.1f64) {
            let film = Film { ln_r, zeta, retardance, axis, front: Complex::new(0.0, 0.0), source_error: 0.0, stray: 0.0, shade: 0.0, source: Source::IDEAL };
            let other = Film { ln_r: -ln_r, zeta: -zeta, ..film };
            let (a, b) = (film.curve().at(theta), other.curve().at(theta + FRAC_PI_2));
            prop_assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9);
            // Both have one curve in phase, under any source.
            let source = Source { panel: 0.2, axis: 1.1, retardance: 1.4, sigma: None };
            let [a, b] = [film, other].map(|f| Film { source, ..f }).map(|f| f.curve().in_phase().at(theta));
            prop_assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9);
        }

        /// A curve near a circle has the circle's offset.
        #[test]
        fn curves_in_phase_have_the_offset_of_circles(zeta in 0.5..2.5f64, retardance in -0.01..0.01f64, theta in 0.0..3.1f64) {
            let film = Film { ln_r: 0.1, zeta, retardance, axis: 0.4, ..Film::NONE };
            let curve = film.curve().in_phase();
            let mean = |of: fn([f64; 2]) -> f64| (0..64).map(|k| of(curve.at(PI * f64::from(k) / 64.0))).sum::<f64>() / 64.0;
            let (x, y) = (mean(|p| p[0]), mean(|p| p[1]));
            let [at_x, at_y] = curve.at(theta);
            let off = (at_y - y).atan2(at_x - x) - 2.0 * theta;
            prop_assert!(off.sin().abs() < 0.05 && off.cos() > 0.0, "{off}");
        }

        /// The reported film has the curve of the fitted one.
        #[test]
        fn the_canonical_film_has_the_same_curve(ln_r in -1.0..1.0f64, zeta in -9.0..9.0f64, retardance in -0.5..0.5f64,
            axis in -3.1..9.1f64, re in -0.3..0.3f64, im in -0.3..0.3f64, theta in 0.0..3.1f64) {
            let film = Film { ln_r, zeta, retardance, axis, front: Complex::new(re, im), source_error: 0.1, stray: 0.02, shade: 0.0, source: Source::IDEAL };
            let same = film.canonical();
            prop_assert!(same.retardance >= 0.0 && (0.0..=PI).contains(&same.zeta) && (0.0..=PI).contains(&same.axis));
            let turned = (film.zeta + PI).rem_euclid(TAU) < PI;
            let (a, b) = (film.curve().at(theta), same.curve().at(theta + if turned { FRAC_PI_2 } else { 0.0 }));
            prop_assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9, "{a:?} {b:?}");
        }
    }
}
