//! Slits, discs and radial stripes (2017 paper, section 6.1, Eq. 16), with the stable form of the sum over slits.

use super::pq::dirichlet;
use nacre_base::{Error, Result};
use std::f64::consts::PI;

/// Parallel slits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slits {
    /// From one to the next, in µm: 1.6 for a compact disc by its standard, 2.0 in the paper.
    pub spacing_um: f64,
    /// Width of each, in µm.
    pub width_um: f64,
    /// How many light falls on together.
    pub count: usize,
}

impl Slits {
    /// A compact disc as the paper has it.
    pub const DISC: Self = Self { spacing_um: 2.0, width_um: 0.5, count: 21 };

    /// Checks that slits are narrower than their spacing.
    ///
    /// # Errors
    /// `Input` for what makes no sense.
    pub fn check(&self) -> Result<()> {
        let fits = self.width_um > 0.0 && self.width_um <= self.spacing_um && self.spacing_um <= 1e4;
        if fits && (1..=1_000_000).contains(&self.count) {
            return Ok(());
        }
        let problem = format!("are {} µm wide, {} µm apart, {} of them", self.width_um, self.spacing_um, self.count);
        Err(Error::input("slits", problem, "give a width above 0 and at most the spacing, and 1 to 1000000 of them"))
    }

    /// Light relative to the mirror direction, for the component across the slits of `ωi + ωr`: `sinc²(π w u/λ) (sin(NπΔu/λ) / (N
    /// sin(πΔu/λ)))²`. Both factors have their limits where they are 0/0.
    pub fn at(&self, u: f64, wavelength_nm: f64) -> f64 {
        let frequency = u * 1e3 / wavelength_nm;
        let x = PI * self.width_um * frequency;
        let slit = if x.abs() < 1e-6 { 1.0 - x * x / 6.0 } else { x.sin() / x };
        let all = dirichlet(self.count, self.spacing_um * frequency) / self.count as f64;
        (slit * all).powi(2)
    }

    /// The same on a disc at a place relative to its middle: its tracks run along the tangent, so that the radial component of `ωi + ωr` is the
    /// one across, and along the track a Gaussian window of the same number of spacings (four standard deviations) holds the light.
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

    /// Of a pattern of all directions, such as a radial one: the slits' pattern turned around its middle.
    pub fn radial(&self, tangent: [f64; 2], wavelength_nm: f64) -> f64 {
        self.at(tangent[0].hypot(tangent[1]), wavelength_nm)
    }
}

/// Which pixels of a photograph under a flash belong to the stripes that diffract: those above a threshold; unknown ones do not.
pub fn stripes(light: &[f32], threshold: f32) -> Vec<bool> {
    light.iter().map(|v| *v > threshold).collect()
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
                // Each slit by the midpoint rule, all of them added up.
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
        assert_eq!(stripes(&[0.1, f32::NAN, 0.9], 0.5), [false, false, true]);
    }
}
