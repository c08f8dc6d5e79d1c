//! Extended light sources: convolution of a table with the source's shape, from a photograph of its mirror image (2017
//! TOG paper, section 6.2 and Fig. 22).
//!
//! Every point of the source produces the whole pattern, displaced like its mirror image. The table of an extended
//! source is therefore the table of a point source, convolved with the mirror image over half vectors. The convolution
//! must follow the spectral integration: a photographed pattern scales with wavelength, but the shape of the source
//! does not.

use super::kernel::Weight;
use super::plane::{to_coefficients, weights};
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_image::Convolution;
use nacre_optics::color::{linear_srgb, xyz_of_linear_srgb};
use schemars::JsonSchema;
use serde::Serialize;

/// Thresholds above the background: standard deviations of the noise, and fraction of the brightest pixel.
const SIGMAS: f32 = 6.0;
const LEAST: f32 = 0.003;

/// Maximum fraction of lit pixels; more leaves no background to compare with.
const LARGEST: f64 = 0.3;

/// A light source: its mirror image, cut out of a photograph.
#[derive(Clone, Debug)]
pub struct Light {
    width: usize,
    height: usize,
    /// One plane, or red, green and blue; each sums to 1.
    parts: Vec<Vec<f32>>,
    /// Pixel that corresponds to the zero order.
    center: [f64; 2],
    /// Half vector per pixel.
    scale: f64,
}

/// Properties of a light source.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct LightReport {
    /// Pixel of its photograph that corresponds to the zero order: the given one, or the centroid of the light.
    pub center: [f64; 2],
    /// Half vector per pixel of its photograph.
    pub scale: f64,
    /// Number of lit pixels.
    pub pixels: usize,
    /// Root mean square distance of the light from its centroid, in half vectors.
    pub spread: f64,
    /// Root mean square interpolation error of the table between its entries, relative to its root mean square. Points
    /// of the source fall between entries.
    pub error: Option<f64>,
}

impl Light {
    /// Cuts a light source out of one channel, or of red, green and blue, of a photograph; NaN is unknown. Without
    /// `center`, the centroid of the light corresponds to the zero order. Each colour is normalised: all points
    /// together have the colour of the table's illuminant.
    ///
    /// # Errors
    /// `Input` for photographs without a distinct light, and with unknown pixels in it.
    pub fn cut_out(planes: &[Vec<f32>], width: usize, center: Option<[f64; 2]>, scale: f64) -> Result<Self> {
        let bad = |problem: &str, remedy: &str| Err(Error::input("photograph of the light", problem, remedy));
        if !(1e-7..=1.0).contains(&scale) {
            return bad(&format!("has {scale} half vectors per pixel"), "give 1e-7 to 1");
        }
        let height = planes.first().map_or(0, |p| p.len() / width.max(1));
        if planes.is_empty() || width == 0 || planes.iter().any(|p| p.len() != width * height || p.is_empty()) {
            return bad("is empty", "give one");
        }
        if planes.iter().flatten().any(|v| !v.is_finite()) {
            return bad(
                "is saturated or unknown in places, so that the light's brightest part is not known",
                "expose it for less long, or merge exposures (nacre reconstruct hdr)",
            );
        }
        let sums: Vec<f32> = (0..width * height).map(|i| planes.iter().map(|p| p[i]).sum()).collect();
        let background = median(sums.clone()).unwrap_or(0.0);
        let noise = 1.4826 * median(sums.iter().map(|v| (v - background).abs()).collect::<Vec<f32>>()).unwrap_or(0.0);
        let top = sums.iter().copied().fold(0.0, f32::max) - background;
        let least = background + (SIGMAS * noise).max(LEAST * top);
        let lit: Vec<usize> = (0..sums.len()).filter(|i| sums[*i] > least).collect();
        if lit.is_empty() || lit.len() as f64 > LARGEST * sums.len() as f64 {
            return bad("shows no light before a dark background", "photograph the light's mirror image by itself");
        }
        let at_edge = |i: &usize| [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width));
        if lit.iter().any(at_edge) {
            return bad("ends within the light", "show all of it, with a dark border");
        }
        let part = |plane: &Vec<f32>| {
            let dark = median(plane.to_vec()).unwrap_or(0.0);
            let mut part = vec![0.0; plane.len()];
            lit.iter().for_each(|i| part[*i] = (plane[*i] - dark).max(0.0));
            let all: f32 = part.iter().sum();
            part.iter_mut().for_each(|v| *v /= all.max(f32::MIN_POSITIVE));
            part
        };
        let parts: Vec<Vec<f32>> = planes.iter().map(part).collect();
        let mut light = Self { width, height, parts, center: [0.0; 2], scale };
        light.center = center.unwrap_or_else(|| light.middle());
        Ok(light)
    }

    /// Lit pixels with their mean over the planes.
    fn lit(&self) -> impl Iterator<Item = ([f64; 2], f64)> {
        let mean = |i: usize| self.parts.iter().map(|p| f64::from(p[i])).sum::<f64>() / self.parts.len() as f64;
        let place = |i: usize| [(i % self.width) as f64, (i / self.width) as f64];
        (0..self.width * self.height).map(move |i| (place(i), mean(i))).filter(|(_, v)| *v > 0.0)
    }

    fn middle(&self) -> [f64; 2] {
        self.lit().fold([0.0; 2], |[x, y], (at, v)| [x + v * at[0], y + v * at[1]])
    }

    /// Properties of the source.
    pub(super) fn report(&self, error: Option<f64>) -> LightReport {
        let [x, y] = self.middle();
        let square: f64 = self.lit().map(|(at, v)| v * ((at[0] - x).powi(2) + (at[1] - y).powi(2))).sum();
        let spread = square.sqrt() * self.scale;
        LightReport { center: self.center, scale: self.scale, pixels: self.lit().count(), spread, error }
    }

    /// A plane resampled to table entries, in a square of odd side. Pixels fall between entries and are distributed
    /// with spline weights.
    fn kernel(&self, part: &[f32], step: f64, half: usize) -> Vec<f32> {
        let side = 2 * half + 1;
        let mut kernel = vec![0.0; side * side];
        for (i, v) in part.iter().enumerate().filter(|(_, v)| **v > 0.0) {
            // As in the table: positions right of the zero order have half vectors to the left; rows grow downwards in
            // both.
            let across = half as f64 - ((i % self.width) as f64 - self.center[0]) * self.scale / step;
            let down = half as f64 - ((i / self.width) as f64 - self.center[1]) * self.scale / step;
            let (a, b) = (weights(across.fract() as f32), weights(down.fract() as f32));
            for (j, b) in b.iter().enumerate() {
                for (k, a) in a.iter().enumerate() {
                    kernel[(down as usize + j - 1) * side + across as usize + k - 1] += v * a * b;
                }
            }
        }
        kernel
    }

    /// Radius of the source in table entries.
    fn reach(&self, step: f64) -> usize {
        let far = |(at, _): ([f64; 2], f64)| (at[0] - self.center[0]).abs().max((at[1] - self.center[1]).abs());
        (self.lit().map(far).fold(0.0, f64::max) * self.scale / step).ceil() as usize + 2
    }

    /// Convolves a table of `size` × `size` entries, `step` half vectors apart, and its coverage.
    ///
    /// # Errors
    /// `Input` for a source wider than the table.
    pub(super) fn spread(&self, entries: &mut [Weight], size: usize, step: f64) -> Result<()> {
        let half = self.reach(step);
        if half > size / 2 {
            let problem =
                format!("shows a light that is larger than the table, {:.3} half vectors", half as f64 * step);
            return Err(Error::input("photograph of the light", problem, "check its scale, or give a larger --extent"));
        }
        let colored = self.parts.len() == 3;
        if colored {
            entries.iter_mut().for_each(|e| [e[0], e[1], e[2]] = linear_srgb([e[0], e[1], e[2]]));
        }
        let mut known = vec![0.0; if colored { entries.len() } else { 0 }];
        for (k, part) in self.parts.iter().enumerate() {
            let by = Convolution::new([size; 2], [2 * half + 1; 2], &self.kernel(part, step, half));
            // A grey source affects all channels equally, a coloured one each channel separately; coverage is the mean
            // over the colours.
            let channels: &[usize] = if colored { &[[0, 3], [1, 3], [2, 3]][k] } else { &[0, 1, 2, 3] };
            for c in channels {
                let mut splines: Vec<f32> = entries.iter().map(|e| e[*c]).collect();
                to_coefficients(&mut splines, size, size);
                // Beyond the border, where splines need values, nothing is known; entries beside it are partly covered.
                let fill = |y: usize, row: &mut [f32]| {
                    if y < size {
                        row[..size].copy_from_slice(&splines[y * size..][..size]);
                    }
                };
                let (image, stride) = (by.convolved(&fill, false), by.stride());
                let value = |i: usize| image[i / size * stride + i % size];
                if colored && *c == 3 {
                    known.iter_mut().enumerate().for_each(|(i, v)| *v += value(i) / 3.0);
                } else {
                    entries.iter_mut().enumerate().for_each(|(i, e)| e[*c] = value(i));
                }
            }
        }
        if colored {
            for (e, known) in entries.iter_mut().zip(known) {
                let [x, y, z] = xyz_of_linear_srgb([e[0], e[1], e[2]]);
                *e = [x, y, z, known];
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::Grid;
    use super::super::tests::Lattice;
    use super::super::{MethodChoice, Photograph, Settings, Wavelength, lookup};
    use super::*;
    use nacre_optics::color::Illuminant;

    /// Discs of light: centre and radius in pixels, and colour.
    fn mirror_image(size: usize, discs: &[([f64; 2], f64, [f32; 3])]) -> Vec<Vec<f32>> {
        let at = |c: usize, i: usize| {
            let inside = |[x, y]: [f64; 2], r: f64| ((i % size) as f64 - x).hypot((i / size) as f64 - y) <= r;
            0.02 + discs.iter().filter(|(place, r, _)| inside(*place, *r)).map(|d| d.2[c]).sum::<f32>()
        };
        (0..3).map(|c| (0..size * size).map(|i| at(c, i)).collect()).collect()
    }

    const SCALE: f64 = 0.002;

    /// Compares a table under an extended source with sums of analytically known tables over the source's points.
    fn off(discs: &[([f64; 2], f64, [f32; 3])], center: Option<[f64; 2]>) -> [f64; 2] {
        let lattice = Lattice { pitch: 0.12, sigma: 0.012, angle: 0.3 };
        let settings = Settings {
            wavelength_nm: Some(Wavelength::Band(680.0)),
            scale: Some(SCALE),
            center: Some([249.5; 2]),
            size: 256,
            extent: Some(0.25),
            method: MethodChoice::Auto,
            max_error: 0.002,
            ..Settings::default()
        };
        let photograph = Photograph { light: lattice.photograph(500, [249.5; 2], SCALE), width: 500, height: 500 };
        let mut table = lookup(&[photograph], &settings).unwrap();
        let light = Light::cut_out(&mirror_image(120, discs), 120, center, SCALE).unwrap();
        table.spread(&light).unwrap();
        let grid = Grid { size: 256, extent: 0.25, warp: 1 };
        let (mut square, mut all) = (0.0, 0.0);
        // Away from the border, beyond which nothing is known.
        for i in
            (0..256 * 256).step_by(611).filter(|i| (60..196).contains(&(i % 256)) && (60..196).contains(&(i / 256)))
        {
            let (u, v) = (grid.at(i % 256), grid.at(255 - i / 256));
            let of_point = |([x, y], weight): ([f64; 2], f64)| {
                let [du, dv] = [-(x - light.center[0]) * SCALE, (y - light.center[1]) * SCALE];
                weight * lattice.entry(&Illuminant::default(), 4.0, u - du, v - dv, [-9.0, 9.0, -9.0, 9.0])
            };
            // Grey light: all planes are equal.
            let truth: f64 = light.lit().map(of_point).sum();
            assert!((table.entries[i][3] - 1.0).abs() < 1e-3);
            square += (f64::from(table.entries[i][1]) - truth).powi(2);
            all += truth * truth;
        }
        [f64::sqrt(square / all), table.light.unwrap().error.unwrap()]
    }

    #[test]
    fn a_light_moves_and_adds_the_pattern_of_each_of_its_points() {
        let gray = [1.0; 3];
        // Two sources: the second lies below the first and is weaker; and one displaced source.
        let [error, predicted] = off(&[([50.0, 55.0], 1.5, gray), ([72.0, 66.0], 1.0, [0.4; 3])], None);
        assert!(error < 1e-3 && predicted < error, "{error} {predicted}");
        let [error, _] = off(&[([60.0, 60.0], 0.9, gray)], Some([52.3, 63.4]));
        assert!(error < 1e-3, "{error}");
    }

    #[test]
    fn each_colour_is_spread_by_its_own_light() {
        // Red light on the right, green and blue light on the left: each displaces its channel of the table.
        let planes = mirror_image(64, &[([40.0, 32.0], 0.5, [1.0, 0.0, 0.0]), ([24.0, 32.0], 0.5, [0.0, 1.0, 1.0])]);
        let light = Light::cut_out(&planes, 64, Some([32.0, 32.0]), 0.01).unwrap();
        let mut entries = vec![[0.0; 4]; 64 * 64];
        let [x, y, z] = xyz_of_linear_srgb([0.5, 0.25, 0.125]);
        entries[32 * 64 + 32] = [x, y, z, 1.0];
        light.spread(&mut entries, 64, 0.01).unwrap();
        let rgb = |i: usize| linear_srgb([entries[i][0], entries[i][1], entries[i][2]]);
        // Positions on the right have half vectors to the left.
        for (found, wanted) in [(rgb(32 * 64 + 24), [0.5, 0.0, 0.0]), (rgb(32 * 64 + 40), [0.0, 0.25, 0.125])] {
            assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-5), "{found:?} {wanted:?}");
        }
        assert!((entries[32 * 64 + 24][3] - 1.0 / 3.0).abs() < 1e-5);
    }

    #[test]
    fn photographs_without_a_whole_light_are_refused() {
        let cut = |planes: Vec<Vec<f32>>, scale: f64| {
            Light::cut_out(&planes, 32, None, scale).map(|_| ()).unwrap_err().to_string()
        };
        let disc = |x: f64| mirror_image(32, &[([x, 16.0], 3.0, [1.0; 3])]);
        let mut saturated = disc(16.0);
        saturated[1][16 * 32 + 16] = f32::NAN;
        for (planes, scale, word) in [
            (saturated, 0.01, "saturated"),
            (disc(1.0), 0.01, "ends within"),
            (vec![vec![0.5; 1024]], 0.01, "no light"),
            (vec![vec![]], 0.01, "empty"),
            (disc(16.0), f64::NAN, "half vectors per pixel"),
        ] {
            let problem = cut(planes, scale);
            assert!(problem.contains(word), "{problem}");
        }
        let light = Light::cut_out(&disc(16.0), 32, Some([-400.0, 16.0]), 0.01).unwrap();
        assert!(light.spread(&mut [[0.0; 4]; 256], 16, 0.01).is_err());
    }
}
