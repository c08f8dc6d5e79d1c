//! Oblique incidence, and its effect on the points (S1/S0, S2/S0).
//!
//! The camera sees each point of the sample from another direction, and the display in the mirror direction. Off the
//! normal, the film's surfaces and the metal below reflect light along and across the plane of incidence differently
//! (Fresnel), and the path through the film is longer. The curve of orientations therefore differs from pixel to pixel,
//! as determined by the camera position.

use crate::film::curve::{Curve, Film};
pub use nacre_optics::polarization::{Jones, JonesVector, Material};
use num_complex::Complex;

/// Coefficients of the film and the metal at an angle of incidence, relative to normal incidence, along (p) and across
/// (s) the plane of incidence.
pub struct Incidence {
    /// Azimuth of the plane of incidence in rad.
    plane: f64,
    through: [f64; 2],
    front: [f64; 2],
    /// Square roots, since half of the metal's effect acts before the grating and half after it: the element is
    /// reciprocal.
    metal: [Complex<f64>; 2],
    cos_inside: f64,
}

impl Incidence {
    /// Incidence at an angle with squared sine `sin2`, in a plane of this azimuth (rad).
    pub fn new(material: &Material, sin2: f64, plane: f64) -> Self {
        let (n, cos) = (material.film_index, (1.0 - sin2).sqrt());
        let cos_inside = (1.0 - sin2 / (n * n)).sqrt();
        // Fresnel coefficients, with the sign of p chosen to agree with s at normal incidence.
        let s = |n1: Complex<f64>, c1: Complex<f64>, n2: Complex<f64>, c2: Complex<f64>| {
            (n1 * c1 - n2 * c2) / (n1 * c1 + n2 * c2)
        };
        let p = |n1: Complex<f64>, c1: Complex<f64>, n2: Complex<f64>, c2: Complex<f64>| {
            (n1 * c2 - n2 * c1) / (n1 * c2 + n2 * c1)
        };
        let one = Complex::from(1.0);
        let (film, metal) = (Complex::from(n), Complex::new(material.metal_n, material.metal_k));
        let (in_air, in_film) = (Complex::from(cos), Complex::from(cos_inside));
        let in_metal = (one - Complex::from(sin2) / (metal * metal)).sqrt();
        let face = [p(one, in_air, film, in_film).re, s(one, in_air, film, in_film).re];
        let normal = (1.0 - n) / (1.0 + n);
        let under = [p(film, in_film, metal, in_metal), s(film, in_film, metal, in_metal)];
        let under_normal = (film - metal) / (film + metal);
        Self {
            plane,
            // Transmission by energy conservation: both surfaces together transmit 1 - r².
            through: face.map(|r| ((1.0 - r * r) / (1.0 - normal * normal)).sqrt()),
            front: face.map(|r| if normal == 0.0 { 1.0 } else { r / normal }),
            metal: under.map(|r| (r / under_normal).sqrt()),
            cos_inside,
        }
    }

    fn element(&self, [p, s]: [Complex<f64>; 2]) -> Jones {
        Jones::diagonal(p, s).turned(self.plane)
    }
}

/// The curve and the bare-metal point of a film at an angle of incidence; equal to [`Film::curve_and_mirror`] at the
/// normal (2018 paper, Eq. 4-6, with Fresnel coefficients).
pub fn curve_at(film: &Film, incidence: &Incidence) -> Curve {
    let light = film.light();
    let retarder = Jones::retarder(film.axis, film.retardance / incidence.cos_inside);
    let through = incidence.element(incidence.through.map(Complex::from));
    let metal = incidence.element(incidence.metal);
    let front = incidence.element(incidence.front.map(Complex::from));
    let inward = metal.after(retarder).after(through);
    let outward = through.after(retarder).after(metal);
    let (small, a, b) = film.amplitudes();
    let inside = inward.apply(light);
    let [x, y] = inside.0;
    let reflected = front.apply(light).scaled(film.front);
    let constant = outward.apply(inside.scaled(a)).plus(reflected.scaled(small.into()));
    let cos = outward.apply(JonesVector([x, -y]).scaled(b));
    let sin = outward.apply(JonesVector([y, x]).scaled(b));
    let mirror = outward.apply(inside.scaled((-1.0).into())).plus(reflected.scaled((1.0 - film.shade).into()));
    Curve::of_field(constant, cos, sin).with_stray(film.stray).with_mirror(mirror, film.stray_over_mirrors())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILM: Film = Film {
        ln_r: 0.05,
        zeta: 2.9,
        retardance: 0.17,
        axis: 0.4,
        front: Complex::new(0.05, 0.02),
        source_error: 0.02,
        stray: 0.01,
        shade: 0.0,
        ..Film::NONE
    };

    /// At normal incidence there is no change, for any azimuth.
    #[test]
    fn the_normal_is_the_plain_curve() {
        for plane in [0.0, 1.0, 2.5] {
            let curve = curve_at(&FILM, &Incidence::new(&Material::default(), 0.0, plane));
            for k in 0..20 {
                let (a, b) = (curve.at(0.3 * f64::from(k)), FILM.curve().at(0.3 * f64::from(k)));
                assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12);
            }
            let (a, b) = (curve.mirror.unwrap(), FILM.curve_and_mirror().mirror.unwrap());
            assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12);
        }
    }

    /// A rotation of plane of incidence, film, source and sample rotates the polarization.
    #[test]
    fn the_plane_of_incidence_turns_with_the_rest() {
        let film = Film { axis: 0.0, source_error: 0.0, ..FILM };
        let at = |turn: f64, theta: f64| {
            let film = Film { axis: turn, ..film };
            let [x, y] = curve_at(&film, &Incidence::new(&Material::default(), 0.05, 0.6 + turn)).at(theta + turn);
            // Circular light has no azimuth, so only the polarization rotates.
            let (s, c) = (2.0 * turn).sin_cos();
            [x * c + y * s, y * c - x * s]
        };
        for theta in [0.0, 0.7, 2.0] {
            let (a, b) = (at(0.0, theta), at(0.9, theta));
            assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12, "{a:?} {b:?}");
        }
    }

    /// At Brewster's angle p-polarized light passes a surface without loss, and aluminium reflects less of it.
    #[test]
    fn coefficients_are_fresnel() {
        let material = Material { film_index: 1.5, ..Material::default() };
        let brewster = 1.5f64.atan().sin().powi(2);
        let at = Incidence::new(&material, brewster, 0.0);
        assert!(at.front[0].abs() < 1e-12 && (at.through[0] - (1.0 / (1.0 - 0.04f64)).sqrt()).abs() < 1e-12);
        assert!(at.metal[0].norm() < 1.0 && at.metal[1].norm() > 1.0);
        // Published for aluminium at 550 nm (n = 0.96 + 6.69i) in air at 45°: Rp = Rs², so their ratio is Rs.
        let bare = Material { film_index: 1.0, ..material };
        let at = Incidence::new(&bare, 0.5, 0.0);
        let metal = Complex::new(bare.metal_n, bare.metal_k);
        let normal = ((1.0 - metal) / (1.0 + metal)).norm_sqr();
        let [rp, rs] = at.metal.map(|m| m.norm_sqr().powi(2) * normal);
        assert!((rp - rs * rs).abs() < 1e-12, "{rp} {rs}");
    }
}
