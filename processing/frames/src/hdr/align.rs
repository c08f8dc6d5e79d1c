//! Registration of hand-held exposures: shifts, and resampling with these shifts.

use super::coding::{Coding, Entry, SATURATED};
use super::merge::{Exposed, Sums, entries};
use nacre_image::registration::{Alignment, Registrar, Resampler};

/// Shifts of exposures, added one at a time.
pub(super) struct Aligner {
    registrar: Registrar,
    width: usize,
}

impl Aligner {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { registrar: Registrar::new(width, height), width }
    }

    /// Adds the next exposure. Registration uses the logarithm of light, because otherwise the brightest parts of a
    /// bracket would dominate.
    pub(super) fn add(&mut self, coding: &Coding, exposed: &Exposed, channels: &[usize]) {
        let (entry, scatter) = (entries(coding, exposed, channels), coding.scatter(exposed.frame));
        self.registrar.add(|y, left, values, bad| {
            for (x, (value, bad)) in values.iter_mut().zip(bad).enumerate() {
                let at = (y * self.width + left + x) * channels.len();
                let all = (at..at + channels.len()).map(&entry);
                let sigma = |[light, rounding]: Entry| scatter.weight(light, rounding).recip().sqrt();
                let (light, sigma) = all.fold((0.0, 0.0), |(l, s), e| (l + e[0], s + sigma(e)));
                *bad |= u8::from(light <= 2.0 * sigma || sigma.is_nan());
                *value = if light > 0.0 { light.ln() } else { 0.0 };
            }
        });
    }

    /// Computes the shifts.
    pub(super) fn shifts(&self) -> Alignment {
        self.registrar.still().into()
    }
}

/// Adds an exposure displaced by `shift` pixels.
pub(super) fn add_moved(sums: &mut Sums, coding: &Coding, exposed: &Exposed, channels: &[usize], shift: [f64; 2]) {
    let (width, height, n) = (exposed.raster.width, exposed.raster.height, channels.len());
    let entry = entries(coding, exposed, channels);
    let back = Resampler::new(shift, width, height);
    let mut moved = vec![SATURATED; width * height * n];
    let (mut line, mut bad) = (vec![0.0_f32; width], vec![0_u8; width]);
    let nearest = |at: usize, by: f64, length: usize| (at as f64 + by).round().clamp(0.0, (length - 1) as f64) as usize;
    for c in 0..n {
        for y in 0..height {
            bad.fill(0);
            let row = |y: usize, values: &mut [f32], bad: &mut [u8]| {
                for (x, (value, bad)) in values.iter_mut().zip(bad).enumerate() {
                    let [light, rounding] = entry((y * width + x) * n + c);
                    *bad |= u8::from(rounding.is_infinite());
                    *value = light;
                }
            };
            back.row(y, row, &mut line, &mut bad);
            for x in 0..width {
                if bad[x] == 0 {
                    // Rounding variance of the nearest pixel.
                    let from = (nearest(y, shift[1], height) * width + nearest(x, shift[0], width)) * n + c;
                    moved[(y * width + x) * n + c] = [line[x], entry(from)[1]];
                }
            }
        }
    }
    sums.add_entries(coding.scatter(exposed.frame), |i| moved[i]);
}
