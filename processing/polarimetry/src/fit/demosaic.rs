//! Full-size images behind all four polarizers, from a mosaic with one polarizer per pixel.
//!
//! An interpolated pixel has another variance than a measured one. Its noise is correlated with that of its neighbours
//! and, for the edge-aware method, with the other images at the same position. [`Demosaic::variances`] contains the
//! effect on σ.

use crate::fit::views::View;
use nacre_frames::LinearFrame;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Interpolation of the images behind each polarizer of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Demosaic {
    /// None: maps have one pixel per super-pixel.
    #[default]
    None,
    /// Means of the two or four nearest pixels of the same polarizer.
    Bilinear,
    /// Newton polynomials along the edges of the difference between polarizers. Li, Zhao, Pan, Kong and Chan,
    /// "Demosaicking DoFP images using Newton's polynomial interpolation and polarization difference model", Optics
    /// Express 27, 1376-1391, 2019.
    EdgeAware,
}

/// Variances for sensor pixels of variance 1, averaged over the pixels of a super-pixel. For the bilinear method they
/// are exact. A pixel is measured behind one polarizer, the mean of two pixels behind two, and of four behind one. The
/// mean variance is (1 + 1/2 + 1/2 + 1/4)/4 = 9/16, and all four are independent. The edge-aware method depends on the
/// noise itself, so its variances are measured on uniform light (test `variances_are_measured`).
#[derive(Clone, Copy)]
pub(crate) struct Variances {
    /// Variance of an image's pixel.
    pub image: f64,
    /// Variance estimated from the residual of the fit: Var(I0 + I90 - I45 - I135)/4.
    pub residual: f64,
    /// Variance from S1 and S2: Var(S1)/2 and Var(S2)/2.
    pub stokes: f64,
}

impl Variances {
    /// Variance factor from the residuals of a fit to `images` images to independent images with the same noise of S1
    /// and S2. Each frame after the first adds differences between images to the single residual of four angles.
    pub fn of_residuals(self, images: usize) -> f64 {
        let more = images.saturating_sub(4) as f64;
        self.stokes * (1.0 + more) / (self.residual + more * self.image)
    }
}

impl Demosaic {
    /// Variance of independent images with the same noise of S1 and S2, for sensor pixels of variance 1: the factor
    /// from the camera's noise variance to that of σ.
    pub fn noise_factor(self) -> f64 {
        self.variances().stokes
    }

    pub(crate) fn variances(self) -> Variances {
        match self {
            Self::None => Variances { image: 1.0, residual: 1.0, stokes: 1.0 },
            Self::Bilinear => Variances { image: 9.0 / 16.0, residual: 9.0 / 16.0, stokes: 9.0 / 16.0 },
            Self::EdgeAware => Variances { image: 0.633, residual: 0.393, stokes: 0.211 },
        }
    }
}

/// Images behind the four polarizers of each 2×2 block, row by row, from a mosaic of `width` × `height` pixels (both
/// even). They have full size, or one pixel per block for [`Demosaic::None`]. NaN propagates to pixels interpolated
/// from it.
pub fn demosaiced(mosaic: &[f32], [width, height]: [usize; 2], method: Demosaic) -> [Vec<f32>; 4] {
    if method == Demosaic::None {
        let rows = |top: usize| mosaic.chunks(width).skip(top).step_by(2);
        return [0, 1, 2, 3].map(|k| rows(k / 2).flat_map(|row| row[k % 2..].iter().step_by(2).copied()).collect());
    }
    let full = FullSize::of([width, height], method, |y, row| row.copy_from_slice(&mosaic[y * width..][..width]));
    [0, 1, 2, 3].map(|k| {
        let mut image = vec![0.0; width * height];
        image.par_chunks_mut(width).enumerate().for_each(|(y, row)| full.image_row([k % 2, k / 2], y, row));
        image
    })
}

/// Mirrored margin in pixels, the reach of the estimates. The image is mirrored about its outermost pixels, so that
/// polarizers keep their positions.
const MARGIN: usize = 10;

/// Ratio of the errors along two directions from which only the better one is used (the paper's threshold).
const CLEAR: f32 = 5.8;

/// Images behind the polarizers of a sensor, in full size.
pub(crate) struct FullSize {
    /// Width including margins.
    width: usize,
    /// The images behind a pixel's own polarizer, that of its neighbour to the right, the one below, and the diagonal
    /// one. NaN where an unusable pixel took part.
    planes: [Vec<f32>; 4],
}

impl FullSize {
    /// Interpolates a raw frame of `width` × `height` pixels.
    pub fn new(frame: &LinearFrame, size: [usize; 2], method: Demosaic) -> Self {
        Self::of(size, method, |y, light| {
            let mut bad = vec![0; light.len()];
            frame.row(y, light, &mut bad);
            light.iter_mut().zip(bad).filter(|(_, bad)| *bad != 0).for_each(|(v, _)| *v = f32::NAN);
        })
    }

    /// Interpolates rows filled in by `read`, with NaN for unusable pixels.
    pub fn of([width, height]: [usize; 2], method: Demosaic, read: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let padded = width + 2 * MARGIN;
        let mut mosaic = vec![0.0; padded * (height + 2 * MARGIN)];
        mosaic.par_chunks_mut(padded).enumerate().for_each(|(y, row)| {
            read(mirrored(y, height), &mut row[MARGIN..][..width]);
            for x in (0..MARGIN).chain(width + MARGIN..padded) {
                row[x] = row[MARGIN + mirrored(x, width)];
            }
        });
        let planes = if method == Demosaic::EdgeAware { edge_aware(mosaic, padded) } else { bilinear(mosaic, padded) };
        Self { width: padded, planes }
    }

    /// Row `y` of the image behind a view's polarizer.
    pub fn row(&self, view: &View, y: usize, light: &mut [f32], bad: &mut [u8]) {
        let [polarizer, ..] = view.pixels[..] else { return };
        self.image_row(polarizer, y, light);
        for (light, bad) in light.iter_mut().zip(bad).filter(|(light, _)| !light.is_finite()) {
            (*light, *bad) = (0.0, 1);
        }
    }

    /// Row `y` of the image of the polarizer at `(left, top)` of the blocks, with NaN for unusable pixels.
    fn image_row(&self, [left, top]: [usize; 2], y: usize, light: &mut [f32]) {
        let start = (y + MARGIN) * self.width + MARGIN;
        let below = 2 * ((y ^ top) & 1);
        let planes = [0, 1].map(|right| &self.planes[below + right][start..]);
        for (x, light) in light.iter_mut().enumerate() {
            *light = planes[(x ^ left) & 1][x];
        }
    }
}

/// Position in an image of `n` pixels for a position with margins.
fn mirrored(at: usize, n: usize) -> usize {
    let period = 2 * n.saturating_sub(1).max(1);
    let k = (at + MARGIN * period - MARGIN) % period;
    k.min(period - k).min(n - 1)
}

fn bilinear(mosaic: Vec<f32>, width: usize) -> [Vec<f32>; 4] {
    let mean = |a: isize, b: isize| {
        plane(&mosaic, width, 1, |at, out| {
            let taps = [a, -a, b, -b].map(|k| tap(&mosaic, at, k, out.len()));
            for (i, out) in out.iter_mut().enumerate() {
                *out = 0.25 * (taps[0][i] + taps[1][i] + taps[2][i] + taps[3][i]);
            }
        })
    };
    let w = width as isize;
    let [right, below, diagonal] = [mean(1, 1), mean(w, w), mean(w + 1, w - 1)];
    [mosaic, right, below, diagonal]
}

/// The method of Li et al. (2019). The diagonal images come first, each from both diagonals; from them follow the
/// images to the right and below, each from its row and its column.
fn edge_aware(mosaic: Vec<f32>, width: usize) -> [Vec<f32>; 4] {
    let w = width as isize;
    let along = |odd: &[f32], step| newton(&mosaic, odd, width, step);
    let fuse = |first: &[f32], second: &[f32], steps| fused(&mosaic, [first, second], width, steps);
    let diagonal = fuse(&along(&mosaic, w + 1), &along(&mosaic, w - 1), [w + 1, w - 1]);
    let right = fuse(&along(&mosaic, 1), &along(&diagonal, w), [1, w]);
    let below = fuse(&along(&diagonal, 1), &along(&mosaic, w), [1, w]);
    [mosaic, right, below, diagonal]
}

/// The image of the polarizer at every second pixel in a direction, `step` pixels apart. Newton polynomials interpolate
/// the difference between its pixels (`odd`, at odd steps) and those between (`mosaic`, at even steps), from both sides
/// (Eqs. 14 to 17).
fn newton(mosaic: &[f32], odd: &[f32], width: usize, step: isize) -> Vec<f32> {
    plane(mosaic, width, 3, |at, out| {
        let n = out.len();
        let here = tap(mosaic, at, 0, n);
        let [a1, b1, a3, b3] = [step, -step, 3 * step, -3 * step].map(|k| tap(odd, at, k, n));
        let [a2, b2] = [2 * step, -2 * step].map(|k| tap(mosaic, at, k, n));
        for (i, out) in out.iter_mut().enumerate() {
            *out = 0.5 * here[i] + 0.4375 * (a1[i] + b1[i]) - 0.25 * (a2[i] + b2[i]) + 0.0625 * (a3[i] + b3[i]);
        }
    })
}

/// Combines two estimates along different directions `steps`: the one with clearly smaller differences to the mosaic
/// nearby, otherwise their mean weighted by the inverse gradients.
fn fused(mosaic: &[f32], [first, second]: [&[f32]; 2], width: usize, steps: [isize; 2]) -> Vec<f32> {
    let w = width as isize;
    plane(mosaic, width, 2, |at, out| {
        let n = out.len();
        let (mut errors, mut gradients) = ([vec![0.0_f32; n], vec![0.0; n]], [vec![0.0_f32; n], vec![0.0; n]]);
        for (error, estimate) in errors.iter_mut().zip([first, second]) {
            for k in [-2 * w - 2, -2 * w, -2 * w + 2, -2, 0, 2, 2 * w - 2, 2 * w, 2 * w + 2] {
                let (e, m) = (tap(estimate, at, k, n), tap(mosaic, at, k, n));
                error.iter_mut().enumerate().for_each(|(i, error)| *error += (e[i] - m[i]).abs());
            }
        }
        let here = tap(mosaic, at, 0, n);
        for (gradient, step) in gradients.iter_mut().zip(steps) {
            let [a1, b1, a2, b2] = [step, -step, 2 * step, -2 * step].map(|k| tap(mosaic, at, k, n));
            for (i, gradient) in gradient.iter_mut().enumerate() {
                *gradient = (a1[i] - b1[i]).abs() + (2.0 * here[i] - a2[i] - b2[i]).abs();
            }
        }
        let (first, second) = (tap(first, at, 0, n), tap(second, at, 0, n));
        for (i, out) in out.iter_mut().enumerate() {
            let ([e1, e2], [g1, g2]) = ([errors[0][i], errors[1][i]], [gradients[0][i], gradients[1][i]]);
            let share = if e1 > CLEAR * e2 {
                0.0
            } else if e2 > CLEAR * e1 {
                1.0
            } else if g1 + g2 > 0.0 {
                g2 / (g1 + g2)
            } else {
                0.5
            };
            *out = share * first[i] + (1.0 - share) * second[i];
        }
    })
}

/// A plane of the size of `like`, in runs of pixels: `fill(at, run)` computes those from index `at` on, from pixels up
/// to `reach` rows and columns away. Values in the margins, with missing neighbours, are meaningless.
fn plane(like: &[f32], width: usize, reach: usize, fill: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let outside = reach * (width + 1);
    let mut new = vec![0.0; like.len()];
    let inner = &mut new[outside..like.len() - outside];
    inner.par_chunks_mut(width).enumerate().for_each(|(k, run)| fill(outside + k * width, run));
    new
}

/// `n` pixels from `at + step` on.
#[inline(always)]
fn tap(plane: &[f32], at: usize, step: isize, n: usize) -> &[f32] {
    &plane[at.strict_add_signed(step)..][..n]
}

#[cfg(test)]
mod tests;
