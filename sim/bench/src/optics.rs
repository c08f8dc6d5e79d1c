//! One ray of the bench by Jones calculus: panel, retarder, film, grating, film, as seen by the camera.
//!
//! Fields are pairs of amplitudes along image right and up. They rotate with the ray, by the smallest rotation that
//! takes the surface normal to it. At normal incidence they are those of the paper.

use crate::config::BenchConfig;
use nacre_base::Result;
use nacre_optics::polarization::{Jones, JonesVector, Stokes};
use nacre_optics::rcwa::{ALUMINIUM, Grating, RatioTable};
use num_complex::Complex;
use std::f64::consts::TAU;

/// One wavelength of the filter's band, with all quantities that depend on the wavelength only.
pub struct Wavelength {
    /// Wavelength in µm.
    pub um: f64,
    /// Weight in the band; weights sum to 1.
    pub weight: f64,
    /// Field behind the retarder.
    source: JonesVector,
    film: FilmAt,
    /// ln r and 180° - ζ (radians) of the grating's R at a period of 1 µm.
    ln_r: f64,
    delta: f64,
    rigorous: Option<RatioTable>,
}

/// A direction in the surface, as cosine and sine.
#[derive(Clone, Copy)]
struct Axis([f64; 2]);

impl Axis {
    fn at(angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self([cos, sin])
    }

    /// Direction of a vector; x for the null vector.
    fn along(x: f64, y: f64) -> Self {
        let length = x.hypot(y);
        if length > 0.0 { Self([x / length, y / length]) } else { Self([1.0, 0.0]) }
    }

    /// Multiplies the components of a field along and across this axis: `diag(d).turned(angle)` without matrices, as
    /// this is the inner loop of rendering.
    fn act(self, diagonal: [Complex<f64>; 2], field: JonesVector) -> JonesVector {
        let ([c, s], [x, y]) = (self.0, field.0);
        let (along, across) = ((x * c + y * s) * diagonal[0], (y * c - x * s) * diagonal[1]);
        JonesVector([along * c - across * s, along * s + across * c])
    }
}

struct FilmAt {
    axis: Axis,
    retardance: f64,
    front: Complex<f64>,
    index: f64,
}

/// Fresnel coefficients of film and metal at one angle of incidence, relative to normal incidence, along (p) and
/// across (s) the plane of incidence.
#[derive(Clone, Copy)]
pub struct Incidence {
    plane: Axis,
    through: [f64; 2],
    front: [f64; 2],
    metal: [Complex<f64>; 2],
    /// Cosine of the angle in the film.
    pub cos_inside: f64,
}

/// The band as three wavelengths, or one for a laser.
///
/// Gauss-Hermite quadrature, exact for fields that vary as a polynomial of degree five over the band.
///
/// # Errors
/// A rigorous R that cannot be computed to the requested error.
pub fn band(bench: &BenchConfig) -> Result<Vec<Wavelength>> {
    let (middle, sigma) = (bench.filter.wavelength_nm, bench.filter.band_nm / (8.0 * 2f64.ln()).sqrt());
    let nodes: &[(f64, f64)] = if sigma == 0.0 {
        &[(0.0, 1.0)]
    } else {
        &[(-1.732_050_807_568_877_2, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732_050_807_568_877_2, 1.0 / 6.0)]
    };
    nodes.iter().map(|(node, weight)| Wavelength::new(bench, middle + node * sigma, *weight)).collect()
}

impl Wavelength {
    fn new(bench: &BenchConfig, nm: f64, weight: f64) -> Result<Self> {
        // Both plates are thin slabs of nearly constant birefringence, so retardance ∝ 1/λ.
        let stretch = bench.filter.wavelength_nm / nm;
        let (panel, film) = (&bench.panel, &bench.film);
        let retarder = Jones::retarder(panel.retarder_deg.to_radians(), panel.retardance_deg.to_radians() * stretch);
        let front = Complex::from_polar(film.front_reflection, film.front_phase_deg.to_radians() * stretch);
        let film = FilmAt {
            axis: Axis::at(film.axis_deg.to_radians()),
            retardance: film.retardance_deg.to_radians() * stretch,
            front,
            index: film.index,
        };
        let source = retarder.apply(JonesVector::linear(panel.polarization_deg.to_radians()));
        let (r, zeta) = Complex::from_polar(bench.grating.r, bench.grating.zeta_deg.to_radians()).to_polar();
        let delta = std::f64::consts::PI - zeta.rem_euclid(TAU);
        Ok(Self { um: nm / 1000.0, weight, source, film, ln_r: r.ln(), delta, rigorous: rigorous(bench, nm)? })
    }

    /// `R` of a grating with this period.
    ///
    /// It is computed from Maxwell's equations if the bench requests it. Otherwise ln r and ζ - 180° grow as
    /// period^-power. `ellipticity` interpolates between the mirror (R = -1) and R.
    pub fn ratio(&self, period_um: f64, power: f64, ellipticity: f64) -> Complex<f64> {
        if let Some(table) = &self.rigorous {
            return ellipticity * (table.nearest(period_um) + 1.0) - 1.0;
        }
        let growth = period_um.powf(-power);
        let delta = (self.delta * growth).clamp(-TAU, TAU);
        let grating = Complex::from_polar((self.ln_r * growth).exp(), std::f64::consts::PI - delta);
        ellipticity * (grating + 1.0) - 1.0
    }

    /// Light of one order towards the camera, for unit panel intensity.
    ///
    /// `ratio` is the grating's R, `amplitude` the order's amplitude efficiency; `specular` adds the film's front
    /// reflection, which interferes.
    pub fn reflect(
        &self,
        incidence: &Incidence,
        orientation: f64,
        ratio: Complex<f64>,
        amplitude: f64,
        specular: bool,
    ) -> Stokes {
        self.reflect_field(self.source, incidence, orientation, ratio, amplitude, specular)
    }

    /// Same for unpolarized light of the same intensity: the mean of two orthogonal polarizations.
    pub fn reflect_unpolarized(
        &self,
        incidence: &Incidence,
        orientation: f64,
        ratio: Complex<f64>,
        amplitude: f64,
        specular: bool,
    ) -> Stokes {
        let light = |angle| {
            let field = JonesVector::linear(angle);
            self.reflect_field(field, incidence, orientation, ratio, amplitude, specular)
        };
        (light(0.0) + light(std::f64::consts::FRAC_PI_2)) * 0.5
    }

    /// Light of a front-surface aluminium mirror, from `direction` (unit vector to the light), behind a linear
    /// polarizer if there is an axis (rad). `unpolarized` replaces the panel's light.
    pub fn reflect_bare(&self, direction: [f64; 3], polarizer: Option<f64>, unpolarized: bool) -> Stokes {
        let (s, p, normal) = metal(1.0, direction[2].clamp(1e-3, 1.0));
        let plane = Axis::along(direction[0], direction[1]);
        let light = |field: JonesVector| {
            let polarized = |e: JonesVector| match polarizer {
                Some(axis) => Axis::at(axis).act([1.0.into(), 0.0.into()], e),
                None => e,
            };
            polarized(plane.act([p / normal, s / normal], polarized(field))).stokes()
        };
        if unpolarized {
            (light(JonesVector::linear(0.0)) + light(JonesVector::linear(std::f64::consts::FRAC_PI_2))) * 0.5
        } else {
            light(self.source)
        }
    }

    fn reflect_field(
        &self,
        source: JonesVector,
        incidence: &Incidence,
        orientation: f64,
        ratio: Complex<f64>,
        amplitude: f64,
        specular: bool,
    ) -> Stokes {
        let plane = incidence.plane;
        let film = |e| {
            let retarder = [1.0.into(), Complex::from_polar(1.0, self.film.retardance / incidence.cos_inside)];
            self.film.axis.act(retarder, e)
        };
        let through = incidence.through.map(Complex::from);
        let inside = film(plane.act(through, source));
        let grating = Axis::at(orientation).act([Complex::from(-1.0), ratio], plane.act(incidence.metal, inside));
        let back = plane.act(incidence.metal, grating);
        let out = plane.act(through, film(back)).scaled(amplitude.into());
        let out =
            if specular { out.plus(plane.act(incidence.front.map(|f| self.film.front * f), source)) } else { out };
        out.stokes()
    }

    /// Coefficients for a ray towards `direction` (unit vector from the surface to the light).
    pub fn incidence(&self, direction: [f64; 3]) -> Incidence {
        let n = self.film.index;
        let cos = direction[2].clamp(1e-3, 1.0);
        let sin2 = 1.0 - cos * cos;
        let cos_inside = (1.0 - sin2 / (n * n)).sqrt();
        let normal = (1.0 - n) / (1.0 + n);
        // Transmission in and out, per axis. The product over both passes is 1 - r², so each pass has √(1 - r²).
        let front_s = (cos - n * cos_inside) / (cos + n * cos_inside);
        let front_p = (cos_inside - n * cos) / (cos_inside + n * cos);
        let relative = |r: f64| if normal == 0.0 { 1.0 } else { r / normal };
        let pass = |r: f64| ((1.0 - r * r) / (1.0 - normal * normal)).sqrt();
        let (metal_s, metal_p, metal_normal) = metal(n, cos_inside);
        Incidence {
            plane: Axis::along(direction[0], direction[1]),
            through: [pass(front_p), pass(front_s)],
            front: [relative(front_p), relative(front_s)],
            // Half before and half after the grating keeps the element reciprocal.
            metal: [root(metal_p / metal_normal), root(metal_s / metal_normal)],
            cos_inside,
        }
    }
}

/// R over the sample's periods, if the bench requests a rigorous computation.
fn rigorous(bench: &BenchConfig, nm: f64) -> Result<Option<RatioTable>> {
    let Some(config) = &bench.grating.rigorous else { return Ok(None) };
    let periods = bench.sample.periods_um();
    let grating = Grating {
        period_um: periods[0],
        depth_um: config.depth_um,
        above: bench.film.index,
        below: Complex::new(config.metal_n, config.metal_k),
    };
    RatioTable::new(&grating, periods, nm, config.max_error).map(Some)
}

/// Fresnel reflection of aluminium under a film of index `n` at this cosine: (s, p, normal). The sign of p makes both
/// agree at normal incidence.
fn metal(n: f64, cos: f64) -> (Complex<f64>, Complex<f64>, Complex<f64>) {
    let m = ALUMINIUM;
    let inside = root(1.0 - (n * n * (1.0 - cos * cos)) / (m * m));
    let s = (n * cos - m * inside) / (n * cos + m * inside);
    let p = (n * inside - m * cos) / (n * inside + m * cos);
    (s, p, (n - m) / (n + m))
}

/// Principal square root from real square roots, several times faster than in polar form.
fn root(z: Complex<f64>) -> Complex<f64> {
    let larger = (0.5 * (z.norm_sqr().sqrt() + z.re.abs())).sqrt();
    if larger == 0.0 {
        return Complex::new(0.0, 0.0);
    }
    let smaller = 0.5 * z.im.abs() / larger;
    let (re, im) = if z.re < 0.0 { (smaller, larger) } else { (larger, smaller) };
    Complex::new(re, im.copysign(z.im))
}

/// Amplitude efficiency of order `m` of a sinusoid of peak-to-peak depth `depth_um` in a medium of index `n`.
///
/// `J_m(k·n·w·h/2)`, where w is the sum of the cosines. This is exact in scalar theory and corrects Eq. 2 of the 2018
/// paper.
pub fn efficiency(m: i32, depth_um: f64, wavelength_um: f64, n: f64, w: f64) -> f64 {
    libm::jn(m, TAU / wavelength_um * n * w * depth_um / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The short form equals the product of Jones matrices.
    #[test]
    fn acting_along_an_axis_equals_the_turned_matrix() {
        let (d, e) = ([Complex::new(0.3, -1.0), Complex::new(2.0, 0.5)], JonesVector::circular());
        for angle in [0.0, 0.7, 2.0, -1.1] {
            let (short, long) = (Axis::at(angle).act(d, e), Jones::diagonal(d[0], d[1]).turned(angle).apply(e));
            assert!((0..2).all(|i| (short.0[i] - long.0[i]).norm() < 1e-14));
        }
    }

    #[test]
    fn roots_are_the_principal_ones() {
        for k in 0..40 {
            let z = Complex::from_polar(1e-3 * 1.9f64.powi(k), 0.17 * f64::from(k - 20));
            assert!((root(z) - z.sqrt()).norm() < 1e-14 * z.norm().sqrt(), "{z}");
        }
        for z in [Complex::new(0.0, 0.0), Complex::new(-4.0, 0.0), Complex::new(4.0, -0.0)] {
            assert_eq!(root(z), z.sqrt());
        }
    }

    #[test]
    fn orders_of_a_sinusoid_conserve_energy() {
        for depth in [0.02, 0.1, 0.3, 1.0] {
            let sum: f64 = (-40..=40).map(|m| efficiency(m, depth, 0.55, 1.468, 2.0).powi(2)).sum();
            assert!((sum - 1.0).abs() < 1e-10, "{depth}: {sum}");
        }
    }

    fn ideal() -> BenchConfig {
        let mut bench = BenchConfig::default();
        bench.filter.band_nm = 0.0;
        bench.film.front_reflection = 0.0;
        bench
    }

    /// At normal incidence without film, the bench equals the paper's closed form (Eq. 9), up to the source's
    /// intensity.
    #[test]
    fn normal_incidence_gives_equation_9() {
        let bench = ideal();
        let wave = &band(&bench).unwrap()[0];
        let incidence = wave.incidence([0.0, 0.0, 1.0]);
        let (r, zeta) = (1.1, std::f64::consts::FRAC_PI_4);
        for theta in [0.0, 0.4, 1.3, 2.9] {
            let light = wave.reflect(&incidence, theta, Complex::from_polar(r, zeta), 1.0, true);
            for k in 0..12 {
                let psi = f64::from(k) * 0.3;
                let local = 2.0 * (psi - theta);
                let i = 0.5 * (1.0 + (r * r - 1.0) * (1.0 - local.cos()) / 2.0 + r * zeta.sin() * local.sin());
                let mirrored = 0.5 * (1.0 + (r * r - 1.0) * (1.0 - local.cos()) / 2.0 - r * zeta.sin() * local.sin());
                let got = light.through_analyser(psi);
                // The retarder's handedness determines the sign of the last term.
                assert!((got - i).abs().min((got - mirrored).abs()) < 1e-12, "{got} {i} {mirrored}");
            }
        }
    }

    /// Fresnel coefficients conserve energy at the film's face, and s reflects more than p off aluminium at oblique
    /// incidence.
    #[test]
    fn oblique_coefficients_behave() {
        let bench = ideal();
        let wave = &band(&bench).unwrap()[0];
        let slanted = wave.incidence([0.6, 0.0, 0.8]);
        let normal = (1.0 - 1.468_f64) / (1.0 + 1.468);
        for axis in 0..2 {
            let energy =
                (slanted.front[axis] * normal).powi(2) + slanted.through[axis].powi(2) * (1.0 - normal * normal);
            assert!((energy - 1.0).abs() < 1e-12);
        }
        assert!(slanted.metal[1].norm() > 1.0 && slanted.metal[0].norm() < 1.0);
    }

    /// A rigorous R shifts the offset between periods as Maxwell's equations predict, at every pixel of a rendered
    /// sample. The emblem has rings of longer periods and bands.
    #[test]
    fn rigorous_scenes_have_an_offset_per_period() {
        use crate::config::RigorousConfig;
        use crate::scene::{Lamp, Scene, Source};
        use crate::surface::SampleKind;
        use nacre_base::progress::Silent;
        use nacre_optics::polarization::angle_difference;
        use nacre_optics::rcwa::{phase_offset, ratio};
        let mut bench = ideal();
        (bench.sample.kind, bench.filter.wavelength_nm) = (SampleKind::Emblem, 560.0);
        (bench.film.index, bench.camera.blur_px, bench.camera.subsamples) = (1.0, 0.0, 1);
        (bench.camera.width, bench.camera.height, bench.geometry.baseline_mm) = (96, 96, 10.0);
        bench.geometry.distance_mm = 2000.0;
        bench.grating.rigorous = Some(RigorousConfig::default());
        let scene = Scene::new(&bench).unwrap();
        let (center_mm, diameter_mm) = (scene.panel_middle_mm(), bench.disc_mm());
        let source = Source { lamp: Lamp::Panel, center_mm, diameter_mm, fringes: None };
        let (light, (truth, _)) =
            (scene.render(&source, [0.0; 2], &Silent).unwrap(), scene.survey([0.0; 2], &Silent).unwrap());
        for period in [1.0, 1.4, 2.0] {
            let surface = Grating { period_um: period, depth_um: 0.1, above: 1.0, below: ALUMINIUM };
            let r = ratio(&surface, 560.0, 1e-5).unwrap();
            let found: Vec<f64> = (0..truth.period_um.len())
                .filter(|i| (f64::from(truth.period_um[*i]) - period).abs() < 1e-5 && light.planes[0][*i] > 0.0)
                .map(|i| {
                    let aolp = 0.5 * f64::from(light.planes[2][i]).atan2(light.planes[1][i].into());
                    angle_difference(aolp, f64::from(truth.orientation[i]))
                })
                .collect();
            assert!(found.len() > 30, "{period}: {}", found.len());
            for offset in found {
                let off = angle_difference(offset, phase_offset(r)).abs();
                assert!(off < 2f64.to_radians(), "{period}: {} {}", offset.to_degrees(), phase_offset(r).to_degrees());
            }
        }
    }
}
