//! Slits, discs and radial stripes (2017 paper, section 6.1, Eq. 16), with the stable form of the sum over slits.

use super::pq::dirichlet;
use nacre_base::{Error, Result};
use std::f64::consts::{PI, TAU};

/// Parallel slits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slits {
    /// Distance between slits in µm: 1.6 for a compact disc by its standard, 2.0 in the paper.
    pub spacing_um: f64,
    /// Width of a slit in µm.
    pub width_um: f64,
    /// Number of coherently illuminated slits.
    pub count: usize,
}

impl Slits {
    /// Compact disc with the values of the paper.
    pub const DISC: Self = Self { spacing_um: 2.0, width_um: 0.5, count: 21 };

    /// Checks that slits are narrower than their spacing.
    ///
    /// # Errors
    /// `Input` for values out of range.
    pub fn check(&self) -> Result<()> {
        let fits = self.width_um > 0.0 && self.width_um <= self.spacing_um && self.spacing_um <= 1e4;
        if fits && (1..=1_000_000).contains(&self.count) {
            return Ok(());
        }
        let problem = format!("are {} µm wide, {} µm apart, {} of them", self.width_um, self.spacing_um, self.count);
        Err(Error::input("slits", problem, "give a width above 0 and at most the spacing, and 1 to 1000000 of them"))
    }

    /// Light relative to the mirror direction for a component u of `ωi + ωr` across the slits:
    /// `sinc²(π w u/λ) (sin(NπΔu/λ) / (N sin(πΔu/λ)))²`.
    ///
    /// Both factors have their limits where they are 0/0.
    pub fn at(&self, u: f64, wavelength_nm: f64) -> f64 {
        let frequency = u * 1e3 / wavelength_nm;
        let x = PI * self.width_um * frequency;
        let slit = if x.abs() < 1e-6 { 1.0 - x * x / 6.0 } else { x.sin() / x };
        let all = dirichlet(self.count, self.spacing_um * frequency) / self.count as f64;
        (slit * all).powi(2)
    }

    /// Largest distance, in spacings, of two slits that interfere for light with a standard deviation `sigma` in
    /// spatial frequency (1/µm).
    ///
    /// Pairs at larger distances contribute less than 1e-6. [`Self::averaged`] has no component faster than this
    /// distance plus one spacing.
    pub fn coherent_spacings(&self, sigma: f64) -> usize {
        let reach = (0.84 / sigma + self.width_um) / self.spacing_um;
        // `as` limits too large values to the largest number.
        (reach as usize).min(self.count.saturating_sub(1))
    }

    /// [`Self::at`], averaged over a Gaussian of spatial frequencies `u/λ` with this mean and standard deviation in
    /// 1/µm.
    ///
    /// The sum over slits is a Fourier series over their distances, `Σ (1 - |k|/N) exp(2πi k Δ f) / N`. A Gaussian
    /// damps its terms by `exp(-2π² k² Δ² σ²)`. It evaluates the factor of one slit at the complex frequency
    /// `f + 2πi σ² k Δ`, averaged over the same Gaussian. An extended source thus needs fewer terms than a small one.
    pub fn averaged(&self, frequency: f64, sigma: f64) -> f64 {
        let (width, spacing, count) = (self.width_um, self.spacing_um, self.count as f64);
        if sigma * spacing * count < 5e-3 {
            return self.at(frequency, 1e3);
        }
        let most = self.coherent_spacings(sigma);
        let fastest = TAU * sigma * (spacing * count + width);
        // For very many slits and a very small source, direct averaging needs fewer terms, each at three times the
        // cost.
        if sigma * width > SERIES || 3.0 * (2.0 * fastest + 10.0) < most as f64 {
            let mut sum = 0.0;
            nodes(fastest, |node, weight| {
                sum += weight * self.at(frequency + sigma * node, 1e3);
            });
            return sum;
        }
        // exp(-2π² σ² k² Δ²) and the imaginary part of π w (f + 2πi σ² k Δ), for k = 1.
        let damping = 0.5 * (TAU * sigma * spacing).powi(2);
        let imaginary = PI * width * TAU * sigma * sigma * spacing;
        // exp(-d k²) = exp(-d) exp(-3d) exp(-5d) …
        let (step, growth) = ((-damping).exp(), imaginary.exp());
        let (sin, cos) = (TAU * spacing * frequency).sin_cos();
        let once = [cos, sin];
        let mut sum = 0.0;
        nodes(TAU * sigma * width, |node, weight| {
            let real = PI * width * (frequency + sigma * node);
            let (sin, cos) = real.sin_cos();
            let (mut turn, mut grown, mut damped) = ([1.0, 0.0], 1.0, [1.0, step]);
            for k in 0..=most {
                let (order, y) = (k as f64, imaginary * k as f64);
                let (up, down) = (0.5 * grown, 0.5 / grown);
                let slit = sinc_square([real, y], [sin * (up + down), cos * (up - down)]);
                let part = slit[0] * turn[0] - slit[1] * turn[1];
                let both = if k == 0 { 1.0 } else { 2.0 };
                sum += weight * both * (1.0 - order / count) * damped[0] * part;
                // Recurrence for the next factors.
                turn = [turn[0] * once[0] - turn[1] * once[1], turn[0] * once[1] + turn[1] * once[0]];
                grown *= growth;
                damped = [damped[0] * damped[1], damped[1] * step * step];
            }
        });
        (sum / count).max(0.0)
    }

    /// [`Self::at`] for a disc at a position relative to its centre.
    ///
    /// Its tracks are tangential, so the radial component of `ωi + ωr` is the one across the slits. Along the track, a
    /// Gaussian window of the same number of spacings (four standard deviations) limits the light.
    pub fn on_disc(&self, place: [f64; 2], tangent: [f64; 2], wavelength_nm: f64) -> f64 {
        let radius = place[0].hypot(place[1]);
        if radius == 0.0 {
            return 0.0;
        }
        let radial = [place[0] / radius, place[1] / radius];
        let across = tangent[0] * radial[0] + tangent[1] * radial[1];
        let along = tangent[1] * radial[0] - tangent[0] * radial[1];
        // |Ŵ|² of an amplitude exp(-x²/2σ²): exp(-4π²σ²f²).
        let turns = 2.0 * PI * 0.25 * self.spacing_um * self.count as f64 * along * 1e3 / wavelength_nm;
        self.at(across, wavelength_nm) * (-turns * turns).exp()
    }

    /// Pattern of slits in all directions, such as radial ones: that of parallel slits, rotated around its centre.
    pub fn radial(&self, tangent: [f64; 2], wavelength_nm: f64) -> f64 {
        self.at(tangent[0].hypot(tangent[1]), wavelength_nm)
    }
}

/// Largest product of the source's standard deviation and a slit's width for the series of [`Slits::averaged`], whose
/// terms cancel by `exp(2π² σ² w²)`.
const SERIES: f64 = 0.8;

/// Real and imaginary part of `(sin z / z)²`, for a complex number whose sine is given.
fn sinc_square([x, y]: [f64; 2], [a, b]: [f64; 2]) -> [f64; 2] {
    let square = x * x + y * y;
    if square < 1e-8 {
        return [1.0 - (x * x - y * y) / 3.0, -2.0 * x * y / 3.0];
    }
    let [re, im] = [(a * x + b * y) / square, (b * x - a * y) / square];
    [re * re - im * im, 2.0 * re * im]
}

/// Nodes and weights of the mean over a Gaussian of standard deviation 1, exact to 1e-5 for functions without
/// components faster than `fastest` (rad per standard deviation).
///
/// Gauss-Hermite quadrature for slow functions, else the trapezoidal rule, which converges exponentially.
fn nodes(fastest: f64, mut each: impl FnMut(f64, f64)) {
    /// Largest number of nodes to either side. Faster functions are narrower than the Gaussian by this factor.
    const MOST: f64 = 4000.0;
    match fastest {
        ..0.01 => each(0.0, 1.0),
        ..0.2 => [-1.0, 1.0].into_iter().for_each(|x| each(x, 0.5)),
        ..0.6 => {
            each(0.0, 2.0 / 3.0);
            [-3f64.sqrt(), 3f64.sqrt()].into_iter().for_each(|x| each(x, 1.0 / 6.0));
        }
        _ => {
            // The first alias of the fastest component is at five standard deviations of the Gaussian's transform.
            let step = (TAU / (fastest + 5.0)).max(5.0 / MOST);
            let half = (5.0 / step).ceil() as i32;
            let weight = |x: f64| step * (-0.5 * x * x).exp() / TAU.sqrt();
            (-half..=half).map(|k| f64::from(k) * step).for_each(|x| each(x, weight(x)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;
    use std::f64::consts::TAU;

    #[test]
    fn slits_are_the_sum_of_their_waves() {
        let slits = Slits::DISC;
        for k in 0..400 {
            let u = f64::from(k) * 0.0031 - 0.4;
            for nm in [400.0, 550.0, 700.0] {
                let f = u * 1e3 / nm;
                // Sum over all slits, each by the midpoint rule.
                let n = 400;
                let wave: Complex64 = (0..slits.count)
                    .flat_map(|s| (0..n).map(move |i| (s, i)))
                    .map(|(s, i)| 2.0 * s as f64 + 0.5 * (f64::from(i) + 0.5) / f64::from(n))
                    .map(|x| Complex64::from_polar(1.0, TAU * f * x))
                    .sum();
                let truth = (wave.norm() / (slits.count as f64 * f64::from(n))).powi(2);
                assert!((slits.at(u, nm) - truth).abs() < 1e-5, "{u} {nm}");
            }
        }
        // Exactly on the orders and next to them.
        for m in 0..4 {
            let peak = slits.at(f64::from(m) * 0.55 / 2.0, 550.0);
            let next = slits.at(f64::from(m) * 0.55 / 2.0 + 1e-13, 550.0);
            let envelope =
                if m == 0 { 1.0 } else { ((PI * 0.25 * f64::from(m)).sin() / (PI * 0.25 * f64::from(m))).powi(2) };
            assert!((peak - envelope).abs() < 1e-9 && (peak - next).abs() < 1e-9, "{m}: {peak} {envelope}");
        }
    }

    /// Sources from far narrower than a lobe to wider than the distance of orders, slits from fine ones to the width of
    /// their spacing.
    #[test]
    fn averages_are_those_of_dense_sums() {
        let slits = [
            Slits::DISC,
            Slits { spacing_um: 1.6, width_um: 1.6, count: 7 },
            Slits { spacing_um: 40.0, width_um: 11.0, count: 3 },
            Slits { spacing_um: 3.0, width_um: 1.0, count: 1 },
            Slits { spacing_um: 2.0, width_um: 0.5, count: 400 },
        ];
        let mut worst = 0.0_f64;
        for slits in slits {
            for sigma in [1e-5, 1e-3, 0.004, 0.012, 0.03, 0.08, 0.3] {
                for k in 0..60 {
                    let f = f64::from(k) * 0.0371 - 0.7;
                    let n = 40_000;
                    let (mut sum, mut all) = (0.0, 0.0);
                    for i in 0..n {
                        let x = 12.0 * (f64::from(i) + 0.5) / f64::from(n) - 6.0;
                        let weight = (-0.5 * x * x).exp();
                        sum += weight * slits.at(f + sigma * x, 1e3);
                        all += weight;
                    }
                    worst = worst.max((slits.averaged(f, sigma) - sum / all).abs());
                }
            }
        }
        assert!(worst < 2e-5, "{worst}");
    }

    #[test]
    fn discs_diffract_along_their_radius() {
        let u = 0.55 / 2.0;
        for angle in [0.0, 0.8, 2.5] {
            let (sin, cos) = f64::sin_cos(angle);
            let place = [30.0 * cos, 30.0 * sin];
            let radial = Slits::DISC.on_disc(place, [u * cos, u * sin], 550.0);
            let along = Slits::DISC.on_disc(place, [-u * sin, u * cos], 550.0);
            assert!(radial > 0.8 && along < 1e-9, "{angle}: {radial} {along}");
            assert!((Slits::DISC.radial([u * cos, u * sin], 550.0) - radial).abs() < 1e-9);
        }
        assert!(Slits { width_um: 3.0, ..Slits::DISC }.check().is_err() && Slits::DISC.check().is_ok());
    }
}
