//! Arguments and functions shared by the commands on height fields.

use crate::commands::values::numbers;
use crate::console::Console;
use nacre_base::progress::Progress;
use nacre_brdf::height::{self, Quality, Scale};
use nacre_brdf::{HeightField, Method, Normalisation, Reflectance, Settings};
use nacre_capture::Failure;
use std::path::{Path, PathBuf};

/// Height field and its scale.
#[derive(clap::Args)]
pub struct Surface {
    /// Height field. Accepts a grey image (bright is high), an EXR map, text, or an AFM or profilometer file. Images:
    /// PNG, TIFF, JPEG, BMP. Instruments: Gwyddion, Igor, X3P, Nanoscope, SDF, Nanosurf, Surfer, BCR. Text: rows of
    /// heights, points x y z, or a profile.
    height: PathBuf,
    /// Pixel pitch in µm (default: as stated in the file).
    #[arg(long, value_name = "P", allow_negative_numbers = true)]
    pixel_um: Option<f64>,
    /// Height range in µm: from black to white of an image, or from the lowest to the highest number of text, signed or
    /// float TIFF. Required unless the file states it.
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    range_um: Option<f64>,
    /// Channel of a multi-channel file: its name, or its number from 1 (default: first height channel).
    #[arg(long, value_name = "NAME")]
    channel: Option<String>,
    /// Interpolate gaps if they cover at most this fraction of the heights, 0 to 0.5 (default: refuse gaps).
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    fill_gaps: Option<f64>,
    /// Subtract the best-fit plane, to remove sample tilt.
    #[arg(long)]
    level: bool,
}

/// Illumination, BRDF method and accuracy.
#[derive(clap::Args)]
pub struct Optics {
    /// Method for spectral densities; auto selects the cheapest one that meets --max-error.
    #[arg(long, default_value = "auto", value_name = "auto|reference|taylor|chebyshev|fft|nmm|pq|pq-linear")]
    method: Method,
    /// Highest power of --method taylor, whatever its error. 1 is the first order of measured heights (2017 paper).
    #[arg(long, value_name = "N", requires = "method")]
    order: Option<usize>,
    /// Coherence width of the light in µm (four standard deviations of a Gaussian).
    #[arg(long, default_value_t = 65.0, value_name = "UM", allow_negative_numbers = true)]
    coherence_um: f64,
    /// Maximum relative error of any lobe that holds at least 0.1 % of the light. A larger error sets exit code 1.
    #[arg(long, default_value_t = 0.01, value_name = "REL", allow_negative_numbers = true)]
    max_error: f64,
}

/// Reflectance of the surface.
#[derive(clap::Args)]
pub struct Metal {
    /// Reflectance model of the smooth surface.
    #[arg(
        long,
        default_value = "perfect",
        value_name = "perfect|schlick=R0|aluminium|silver|gold|copper|nickel|chromium|silicon"
    )]
    material: Reflectance,
    /// Include shadowing and masking of V grooves.
    #[arg(long)]
    shadowing: bool,
}

/// Reflectance of the material and normalisation of the output.
#[derive(clap::Args)]
pub struct Material {
    #[command(flatten)]
    metal: Metal,
    /// Output quantity: brdf (1/sr), or relative to a flat mirror in its mirror direction.
    #[arg(long, default_value = "brdf", value_name = "brdf|relative")]
    normalisation: Normalisation,
}

impl Surface {
    /// Reads the height field and evaluates its quality (resolution, slope, coherence).
    pub fn read(&self, coherence_um: f64, console: &Console) -> Result<(HeightField, Quality), Failure> {
        console.stage("reading", 1);
        let scale = Scale {
            pixel_um: self.pixel_um,
            range_um: self.range_um,
            channel: self.channel.clone(),
            fill_gaps: self.fill_gaps,
        };
        let field = height::read(&self.height, &scale)?;
        let field = if self.level { field.levelled() } else { field };
        let quality = Quality::of(&field, coherence_um);
        console.check()?;
        Ok((field, quality))
    }

    /// Path of the height-field file.
    pub fn path(&self) -> &Path {
        &self.height
    }
}

impl Optics {
    /// BRDF settings for incident light at (polar angle, azimuth) in degrees.
    pub fn settings(&self, light_deg: [f64; 2]) -> Settings {
        Settings {
            light_deg,
            method: self.method,
            order: self.order,
            coherence_um: self.coherence_um,
            max_error: self.max_error,
            ..Settings::default()
        }
    }

    /// Fails if the error exceeds `--max-error`.
    pub fn judge(&self, error: f64) -> Result<(), Failure> {
        if error <= self.max_error {
            return Ok(());
        }
        Err(Failure::Bound(format!("the error may be {error:.2e}, more than the {} asked for", self.max_error)))
    }
}

impl Metal {
    /// Adds reflectance and shadowing to the settings.
    pub fn add(&self, settings: Settings) -> Settings {
        Settings { reflectance: self.material.clone(), shadowing: self.shadowing, ..settings }
    }
}

impl Material {
    /// Adds reflectance, shadowing and normalisation to the settings.
    pub fn add(&self, settings: Settings) -> Settings {
        Settings { normalisation: self.normalisation, ..self.metal.add(settings) }
    }
}

/// Parses a direction: polar angle and azimuth in degrees.
pub fn direction(text: &str) -> Result<[f64; 2], String> {
    let wanted = "THETA or THETA,PHI in degrees";
    numbers(text, wanted).or_else(|_| numbers(text, wanted).map(|[theta]: [f64; 1]| [theta, 0.0]))
}

/// Maximum length of a list.
const MOST: f64 = 1e6;

/// List of numbers: `380:780:5` (from, to, step) or `450,550,650`.
#[derive(Clone, Debug, PartialEq)]
pub struct List(pub Vec<f64>);

impl std::str::FromStr for List {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = |by: char| -> Option<Vec<f64>> {
            text.split(by).map(|v| v.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect()
        };
        if let Some([from, to, step]) = numbers(':').as_deref() {
            let count = ((to - from) / step + 1e-9).floor();
            if !(0.0..MOST).contains(&count) || *step == 0.0 {
                return Err(format!("{text} is no range from:to:step of at most {MOST} numbers"));
            }
            // Rounded to nine decimals, to keep 0.30000000000000004 out of tables.
            let at = |k: usize| ((from + step * k as f64) * 1e9).round() / 1e9;
            return Ok(Self((0..=count as usize).map(at).collect()));
        }
        numbers(',').map(Self).ok_or_else(|| "give from:to:step, or numbers with commas between".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_ranges_or_numbers() {
        let of = |text: &str| text.parse::<List>().map(|l| l.0);
        assert_eq!(of("380:390:5").unwrap(), [380.0, 385.0, 390.0]);
        assert_eq!(of("-1:1:0.1").unwrap()[13], 0.3);
        assert_eq!(of("450, 550").unwrap(), [450.0, 550.0]);
        for bad in ["", "1:2", "1:2:0", "2:1:1", "1:2:nan", "1,x", "0:1:1e-12"] {
            assert!(of(bad).is_err(), "{bad}");
        }
        assert_eq!(direction("75").unwrap(), [75.0, 0.0]);
        assert!(direction("1,2,3").is_err());
    }
}
