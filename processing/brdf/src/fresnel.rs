//! Reflectance of a smooth surface of the material, a factor of the BRDF.
//!
//! Stam's F is an amplitude coefficient, so his F² is a reflectance. Schlick's F is a reflectance already, but the 2014
//! thesis squares it.

use nacre_base::{Error, Result};
use num_complex::Complex64;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Names of the built-in materials.
pub const MATERIALS: [&str; 7] = ["aluminium", "silver", "gold", "copper", "nickel", "chromium", "silicon"];

/// Reflectance of the smooth surface.
///
/// In JSON as on the command line: `perfect`, `schlick=0.04`, or a material's name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub enum Reflectance {
    /// Reflectance of 1 at every angle.
    Perfect,
    /// Schlick's approximation with this reflectance at normal incidence.
    Schlick(f64),
    /// Fresnel's equations for unpolarized light and the complex refractive index of a material.
    Material {
        /// Name of the material.
        name: String,
        /// Wavelength in nm, n and k.
        rows: Vec<[f64; 3]>,
    },
}

impl FromStr for Reflectance {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if text == "perfect" {
            return Ok(Self::Perfect);
        }
        if let Some(r0) = text.strip_prefix("schlick=") {
            return match r0.parse() {
                Ok(r0) if (0.0..=1.0).contains(&r0) => Ok(Self::Schlick(r0)),
                _ => Err(format!("{r0:?} is no reflectance from 0 to 1")),
            };
        }
        let table = match text {
            "aluminium" => include_str!("data/aluminium.csv"),
            "silver" => include_str!("data/silver.csv"),
            "gold" => include_str!("data/gold.csv"),
            "copper" => include_str!("data/copper.csv"),
            "nickel" => include_str!("data/nickel.csv"),
            "chromium" => include_str!("data/chromium.csv"),
            "silicon" => include_str!("data/silicon.csv"),
            _ => return Err(format!("{text:?} is none of perfect, schlick=R0, {}", MATERIALS.join(", "))),
        };
        Ok(Self::Material { name: text.into(), rows: rows(table) })
    }
}

impl TryFrom<String> for Reflectance {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        text.parse()
    }
}

impl From<Reflectance> for String {
    fn from(reflectance: Reflectance) -> Self {
        match reflectance {
            Reflectance::Perfect => "perfect".into(),
            Reflectance::Schlick(r0) => format!("schlick={r0}"),
            Reflectance::Material { name, .. } => name,
        }
    }
}

fn rows(csv: &str) -> Vec<[f64; 3]> {
    let row = |line: &str| -> Option<[f64; 3]> {
        let mut values = line.split(',').map(|v| v.trim().parse().ok());
        Some([values.next()??, values.next()??, values.next()??])
    };
    csv.lines().filter_map(row).collect()
}

impl Reflectance {
    /// Checks that the table of the material covers a range of wavelengths in nm.
    ///
    /// # Errors
    /// `Input` if it does not.
    pub fn check(&self, range_nm: [f64; 2]) -> Result<()> {
        let Self::Material { name, rows } = self else { return Ok(()) };
        let known = [rows.first(), rows.last()].map(|r| r.map_or(f64::NAN, |r| r[0]));
        if known[0] <= range_nm[0] && known[1] >= range_nm[1] {
            return Ok(());
        }
        let problem = format!("{name} is known from {} to {} nm", known[0], known[1]);
        Err(Error::input("material", problem, "choose wavelengths within, or give schlick=R0"))
    }

    /// Reflectance for the cosine of the angle of incidence and a wavelength in nm.
    pub fn at(&self, cos: f64, nm: f64) -> f64 {
        match self {
            Self::Perfect => 1.0,
            Self::Schlick(r0) => r0 + (1.0 - r0) * (1.0 - cos.clamp(0.0, 1.0)).powi(5),
            Self::Material { rows, .. } => fresnel(index(rows, nm), cos.clamp(0.0, 1.0)),
        }
    }
}

/// Complex refractive index, interpolated linearly between the rows.
fn index(rows: &[[f64; 3]], nm: f64) -> Complex64 {
    let next = rows.partition_point(|r| r[0] < nm).clamp(1, rows.len() - 1);
    let ([a, n0, k0], [b, n1, k1]) = (rows[next - 1], rows[next]);
    let t = ((nm - a) / (b - a)).clamp(0.0, 1.0);
    Complex64::new(n0 + (n1 - n0) * t, k0 + (k1 - k0) * t)
}

/// Fresnel reflectance, averaged over both polarizations.
///
/// With `a + ib = √(n² - sin²)`, the reflectance for p is that for s times
/// `((a cos - sin²)² + b² cos²) / ((a cos + sin²)² + b² cos²)`. Only a and squares of b are needed, without complex
/// angles.
fn fresnel(n: Complex64, cos: f64) -> f64 {
    let sin_square = 1.0 - cos * cos;
    let inside = n * n - sin_square;
    let length = inside.norm_sqr().sqrt();
    let (a, b_square) = ((0.5 * (length + inside.re)).max(0.0).sqrt(), 0.5 * (length - inside.re));
    let ratio = |x: f64, y: f64, rest: f64| ((x - y).powi(2) + rest) / ((x + y).powi(2) + rest);
    let across = ratio(cos, a, b_square);
    0.5 * across * (1.0 + ratio(a * cos, sin_square, b_square * cos * cos))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str) -> Reflectance {
        name.parse().unwrap()
    }

    #[test]
    fn metals_reflect_as_published() {
        // Handbook reflectances at normal incidence. Metal films differ by 0.02 to 0.03 between sources, so this test
        // only distinguishes metals and columns of a table.
        for (name, nm, truth) in [
            ("aluminium", 550.0, 0.92),
            ("silver", 550.0, 0.97),
            ("gold", 450.0, 0.39),
            ("gold", 700.0, 0.97),
            ("copper", 500.0, 0.60),
            ("copper", 700.0, 0.96),
            ("nickel", 550.0, 0.62),
            ("chromium", 550.0, 0.55),
            ("silicon", 550.0, 0.36),
        ] {
            let r = of(name).at(1.0, nm);
            assert!((r - truth).abs() < 0.035, "{name} {nm}: {r}");
        }
        for name in MATERIALS {
            assert!(of(name).check([380.0, 780.0]).is_ok(), "{name}");
            for cos in [0.0, 1e-3, 0.3, 1.0] {
                let r = of(name).at(cos, 500.0);
                assert!((0.0..=1.0).contains(&r), "{name} {cos}: {r}");
            }
            assert!((of(name).at(0.0, 500.0) - 1.0).abs() < 1e-12);
        }
        assert!(of("silicon").check([200.0, 780.0]).is_err());
    }

    #[test]
    fn glass_has_its_brewster_angle_and_schlick_is_near_it() {
        let n = Complex64::new(1.5, 0.0);
        assert!((fresnel(n, 1.0) - 0.04).abs() < 1e-12);
        // At Brewster's angle, tan θ = n, p light is not reflected.
        let cos = 1.0 / (1.0 + 1.5_f64.powi(2)).sqrt();
        let s: f64 = (1.0 - 1.5 * 1.5) / (1.0 + 1.5 * 1.5);
        let s = s * s;
        assert!((fresnel(n, cos) - 0.5 * s).abs() < 1e-12);
        let schlick = of("schlick=0.04");
        for cos in [0.2, 0.5, 0.8, 1.0] {
            assert!((schlick.at(cos, 550.0) - fresnel(n, cos)).abs() < 0.03, "{cos}");
        }
    }

    /// Fresnel's equations for amplitudes, with the complex cosine inside.
    #[test]
    fn reflectances_are_squares_of_amplitudes() {
        for (re, im) in [(0.05, 3.0), (0.5, 0.0), (1.0, 7.0), (1.5, 0.0), (2.5, 0.3), (4.0, 0.03)] {
            for cos in [1e-3, 0.1, 0.4, 0.7, 0.95, 1.0] {
                let n = Complex64::new(re, im);
                let inside = (Complex64::from(1.0) - (1.0 - cos * cos) / (n * n)).sqrt();
                let [s, p] = [(cos - n * inside) / (cos + n * inside), (n * cos - inside) / (n * cos + inside)];
                let truth = 0.5 * (s.norm_sqr() + p.norm_sqr());
                assert!((fresnel(n, cos) - truth).abs() < 1e-12, "{n} {cos}: {} {truth}", fresnel(n, cos));
            }
        }
    }

    #[test]
    fn nonsense_is_refused() {
        for text in ["", "schlick", "schlick=2", "schlick=nan", "unobtainium"] {
            assert!(text.parse::<Reflectance>().is_err(), "{text}");
        }
    }
}
