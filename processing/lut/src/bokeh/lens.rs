//! Resolution limits of a lens.

use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A lens and its distance from the sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Focal length of the lens in mm.
    pub focal_mm: f64,
    /// f-number: focal length over aperture diameter.
    #[schemars(extend("x-flag" = "f-number"))]
    pub f_number: f64,
    /// Distance from the aperture to the sample in m.
    #[schemars(extend("x-flag" = "distance-m"))]
    pub distance_m: f64,
}

/// Resolution limits of a lens.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Cutoff {
    /// Numerical aperture on the sample side.
    pub numerical_aperture: f64,
    /// Wavelength in nm.
    pub wavelength_nm: f64,
    /// Shortest resolvable period in µm under any illumination: λ / (2 NA), the incoherent limit (Abbe 1873).
    pub period_um: f64,
    /// Shortest resolvable period in µm under a single distant light on the camera axis: λ / NA, the coherent limit.
    pub coherent_period_um: f64,
}

impl Lens {
    /// Computes the limits at a wavelength in nm.
    ///
    /// # Errors
    /// `Input` for invalid parameters.
    pub fn cutoff(&self, wavelength_nm: f64) -> Result<Cutoff> {
        let checked = [
            ("--lens-focal-mm", self.focal_mm, 0.1, 1e5),
            ("--f-number", self.f_number, 0.3, 1000.0),
            ("--distance-m", self.distance_m, 1e-4, 1000.0),
            ("--wavelength", wavelength_nm, 100.0, 20_000.0),
        ];
        for (name, value, least, most) in checked {
            if !(least..=most).contains(&value) {
                return Err(Error::input(name, format!("is {value}; expected {least} to {most}"), "correct it"));
            }
        }
        let radius_m = 0.5 * self.focal_mm / self.f_number / 1000.0;
        let aperture = (radius_m / self.distance_m).atan().sin();
        let wavelength_um = wavelength_nm / 1000.0;
        Ok(Cutoff {
            numerical_aperture: aperture,
            wavelength_nm,
            period_um: wavelength_um / (2.0 * aperture),
            coherent_period_um: wavelength_um / aperture,
        })
    }
}

impl Cutoff {
    /// Rejects a period below the resolution limit.
    ///
    /// # Errors
    /// `Input`, with the reason.
    pub fn check(&self, period_um: f64, whose: &str) -> Result<()> {
        if period_um >= self.period_um {
            return Ok(());
        }
        let problem = format!(
            "a period of {period_um:.3} µm is below the optical cut-off of {:.2} µm (λ / (2 NA) at {} nm with NA {:.4}): this lens \
             cannot have shown it, so lines that are seen are something else, as aliasing, or the scale is wrong",
            self.period_um, self.wavelength_nm, self.numerical_aperture
        );
        Err(Error::input(whose, problem, "check scale and lens, or use a lens with a larger aperture that is nearer"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_lens_shows_nothing_below_nine_micrometres() {
        let lens = Lens { focal_mm: 250.0, f_number: 5.6, distance_m: 0.85 };
        let cutoff = lens.cutoff(500.0).unwrap();
        assert!((cutoff.numerical_aperture - 0.02625).abs() < 1e-4, "{cutoff:?}");
        assert!((cutoff.period_um - 9.52).abs() < 0.02 && cutoff.coherent_period_um == 2.0 * cutoff.period_um);
        // The paper's grating with 600 lines per mm.
        let message = cutoff.check(1.0 / 0.6, "--lines-per-mm").unwrap_err().to_string();
        assert!(message.contains("1.667 µm") && message.contains("9.52 µm"), "{message}");
        assert!(cutoff.check(10.0, "").is_ok());
        assert!(Lens { f_number: 0.0, ..lens }.cutoff(500.0).is_err() && lens.cutoff(f64::NAN).is_err());
    }
}
