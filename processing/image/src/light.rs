//! Images as light sources: linear radiance in Rec. 709 primaries, with notes on the file.

use std::path::Path;

use super::fault::{Decoded, Fault};
use super::primaries::Primaries;
use super::read::{Format, sniff};
use super::source::{decode, open};
use super::{openexr, radiance};
use nacre_base::Result;

/// Linear radiance of an OpenEXR or Radiance HDR file.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Radiance in Rec. 709 primaries, row 0 on top, with the file's infinities and NaN.
    pub rgb: Vec<[f32; 3]>,
    /// Notes on conversions, choices and omissions.
    pub notes: Vec<String>,
}

/// Samples of an image, interleaved.
pub(super) enum Samples3 {
    Grey(Vec<f32>),
    Rgb(Vec<f32>),
}

impl Light {
    /// Converts samples from the given primaries (default Rec. 709).
    pub(super) fn new(
        [width, height]: [usize; 2],
        samples: Samples3,
        primaries: Option<Primaries>,
        mut notes: Vec<String>,
    ) -> Decoded<Self> {
        let rgb = match samples {
            // Grey has the chromaticity of the file's white, which is adapted to white.
            Samples3::Grey(values) => values.into_iter().map(|v| [v; 3]).collect(),
            Samples3::Rgb(values) => {
                let mut rgb = values.as_chunks::<3>().0.to_vec();
                if let Some(primaries) = primaries {
                    let words = format!("has primaries that lie on a line ({})", primaries.name());
                    let remedy = "correct its chromaticities";
                    let matrix = primaries.to_rec709().map_err(|()| Fault::unusable(words, remedy))?;
                    if let Some(matrix) = matrix {
                        let clipped = rgb.iter_mut().filter_map(|pixel| convert(&matrix, pixel)).count();
                        let mut words = format!("colours converted from {} to Rec. 709 primaries", primaries.name());
                        if clipped > 0 {
                            let part = 100.0 * clipped as f64 / rgb.len() as f64;
                            words
                                .push_str(&format!("; {part:.2} % of the pixels lie outside of these and are clipped"));
                        }
                        notes.push(words);
                    }
                }
                rgb
            }
        };
        Ok(Self { width, height, rgb, notes })
    }
}

/// Smallest negative component that is noted, relative to the brightest component of the pixel.
const CLIPPED: f32 = 0.01;

/// Converts a pixel. Negative components (colours outside of the gamut) become 0; `Some` if the change is visible.
fn convert(matrix: &[[f64; 3]; 3], pixel: &mut [f32; 3]) -> Option<()> {
    let before = *pixel;
    *pixel = converted(matrix, before);
    if before.iter().any(|v| !v.is_finite() || *v < 0.0) {
        return None;
    }
    let most = pixel.iter().fold(0.0_f32, |m, v| m.max(*v));
    let least = pixel.iter().fold(0.0_f32, |m, v| m.min(*v));
    *pixel = pixel.map(|v| v.max(0.0));
    (least < -CLIPPED * most).then_some(())
}

/// Multiplies a pixel by a row-major matrix. An infinite pixel stays unchanged, so that it does not become NaN.
pub(super) fn converted(matrix: &[[f64; 3]; 3], pixel: [f32; 3]) -> [f32; 3] {
    if pixel.iter().any(|v| !v.is_finite()) {
        return pixel;
    }
    matrix.map(|row| row.iter().zip(pixel).map(|(m, v)| m * f64::from(v)).sum::<f64>() as f32)
}

/// Reads an OpenEXR or Radiance HDR file as light. `layer` names the layer of an OpenEXR file that has several.
///
/// # Errors
/// `Error::Input` as for [`super::read()`], for other formats, and for a layer that is absent or, among several, not
/// named.
pub fn read_light(path: &Path, layer: Option<&str>) -> Result<Light> {
    decode(path, || {
        let mut source = open(path)?;
        match sniff(&mut source)? {
            Format::Exr => openexr::read_light(source, layer),
            Format::Radiance if layer.is_none() => radiance::read_light(source),
            Format::Radiance => Err(Fault::unusable("has no layers", "remove layer")),
            _ => Err(Fault::unusable("is not linear radiance", "give an OpenEXR or Radiance HDR file")),
        }
    })
}
