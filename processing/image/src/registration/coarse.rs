//! Shifts of up to 32 pixels, to about half a pixel, by correlation of edge directions.
//!
//! Rotating the analyser changes each region's brightness differently, so an edge may fade or reverse, but its
//! direction stays. For the gradient g as a complex number, g²/|g| is independent of the sign of the contrast and has
//! zero mean. Its correlation between frames has one sharp peak, where that of the brightness may have none.

use super::windows::Windows;
use nacre_base::vectors::vectorised;
use nacre_fourier::Fourier;
use num_complex::Complex;
use rayon::prelude::*;

/// Largest shift in pixels; a quarter of the window if that is less.
const REACH: usize = 32;

/// Factor by which random correlations of two Hann windows near zero shift exceed their average: `∫h⁴ / (∫h²)²` for
/// both sides, as a standard deviation.
const UNDER_HANN: f64 = 35.0 / 18.0;

type Image = Vec<Complex<f32>>;

/// Maximum of a correlation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peak {
    /// Shift against the first frame in pixels, x right, y down.
    pub(super) shift: [f64; 2],
    /// Height in standard deviations of the correlation of unrelated frames, whose maximum over 65² points is at 4.
    pub(super) height: f64,
}

/// Number of windows that suffices for high peaks: those of a diagonal.
const ENOUGH: usize = 4;

/// Correlation peak of each frame; the first is at (0, 0). Fewer windows are used if they give peaks of at least
/// `height` (in standard deviations).
pub(super) fn peaks(windows: &Windows, height: f64) -> Vec<Peak> {
    if windows.count() > ENOUGH {
        let found = peaks_of(windows, &(0..windows.count()).step_by(ENOUGH + 1).collect::<Vec<_>>());
        if found.iter().all(|peak| peak.height >= height) {
            return found;
        }
    }
    peaks_of(windows, &(0..windows.count()).collect::<Vec<_>>())
}

fn peaks_of(windows: &Windows, few: &[usize]) -> Vec<Peak> {
    let fourier = Fourier::new([windows.side; 2]);
    let spectra = |frame: usize| -> Vec<Image> {
        let edges = |w: &usize| fourier.forward(edges(windows.get(frame, *w), windows.side));
        few.par_iter().map(edges).collect()
    };
    let first = spectra(0);
    (0..windows.frames())
        .into_par_iter()
        .map(|frame| {
            let mut cross: Image = vec![Complex::default(); windows.side * windows.side];
            for (a, b) in first.iter().zip(spectra(frame)) {
                vectorised(
                    #[inline(always)]
                    || {
                        for (c, (a, b)) in cross.iter_mut().zip(a.iter().zip(&b)) {
                            *c += b * a.conj();
                        }
                    },
                );
            }
            // Halfway to phase correlation, amplitudes become their square roots: the peak is as sharp as the edges,
            // and noise is not amplified to their level.
            vectorised(
                #[inline(always)]
                || {
                    for c in &mut cross {
                        // Double precision, because squares of bright spectra overflow in single precision.
                        let [re, im] = [f64::from(c.re), f64::from(c.im)];
                        let share = 1.0 / ((re * re + im * im).sqrt().sqrt() as f32).max(f32::MIN_POSITIVE);
                        (c.re, c.im) = (c.re * share, c.im * share);
                    }
                },
            );
            // Unrelated frames have random phases.
            let power = cross.iter().map(|c| 0.5 * f64::from(c.norm_sqr())).sum::<f64>();
            let deviation = UNDER_HANN * power.sqrt();
            peak(&fourier.inverse(cross), windows.side, deviation)
        })
        .collect()
}

/// Edge directions g²/|g| under a Hann window.
fn edges(window: &[f32], side: usize) -> Image {
    let hann: Vec<f32> =
        (0..side).map(|i| (std::f32::consts::PI * (i as f32 + 0.5) / side as f32).sin().powi(2)).collect();
    let mut out = vec![Complex::default(); side * side];
    vectorised(
        #[inline(always)]
        || {
            for y in 1..side - 1 {
                let row = |y: usize, left: usize| &window[y * side + left..][..side - 2];
                let ([left, right], [above, below]) = ([row(y, 0), row(y, 2)], [row(y - 1, 1), row(y + 1, 1)]);
                let out = &mut out[y * side + 1..][..side - 2];
                for x in 0..side - 2 {
                    let g = Complex::new(right[x] - left[x], below[x] - above[x]);
                    let strength = g.norm_sqr().sqrt();
                    let weight = if strength > 0.0 { hann[x + 1] * hann[y] / strength } else { 0.0 };
                    let squared = g * g * weight;
                    // Zero at unusable pixels.
                    out[x] = if strength > 0.0 { squared } else { Complex::default() };
                }
            }
        },
    );
    out
}

fn peak(correlation: &[Complex<f32>], side: usize, deviation: f64) -> Peak {
    let reach = REACH.min(side / 4) as isize;
    let at = |x: isize, y: isize| {
        let wrap = |i: isize| i.rem_euclid(side as isize) as usize;
        f64::from(correlation[wrap(y) * side + wrap(x)].re)
    };
    let places = || (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
    let (x, y) = places().max_by(|a, b| at(a.0, a.1).total_cmp(&at(b.0, b.1))).unwrap_or_default();
    // Vertex of the parabola through the peak and its neighbours.
    let vertex = |before: f64, after: f64| {
        let bend = before - 2.0 * at(x, y) + after;
        if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let fraction = [vertex(at(x - 1, y), at(x + 1, y)), vertex(at(x, y - 1), at(x, y + 1))];
    let shift = [x as f64 + fraction[0], y as f64 + fraction[1]];
    Peak { shift, height: if deviation > 0.0 { at(x, y) / deviation } else { 0.0 } }
}
