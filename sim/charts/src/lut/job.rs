//! Photographs of known diffraction orders, and comparison of the resulting lookup tables with the truth.

use super::{BAND_NM, PITCH_PX};
use nacre_base::Result;
use nacre_lut::{Light, Photograph, Settings, Table, Wavelength, lookup};
use nacre_optics::color::{Illuminant, Observer};
use nacre_sim::random::{key, uniform};
use nacre_studies::Outcome;
use rayon::prelude::*;
use std::time::Instant;

/// Number of table entries that are compared with the truth.
const COMPARED: usize = 1500;

/// Orders per side with wavelength-dependent efficiency.
const ORDERS: usize = 16;

/// A table counts as confidently wrong if its error exceeds its predicted error by this factor.
const CONFIDENTLY: f64 = 5.0;

/// Gaussian orders on a rotated lattice, in pixels of a photograph at [`BAND_NM`].
#[derive(Clone, Debug)]
pub(super) struct Pattern {
    pub sigma_px: f64,
    /// Spacing of the orders in pixels.
    pub pitch_px: f64,
    pub angle: f64,
    /// Peak-to-peak depth of crossed sinusoids in nm, for orders of efficiency `Jm² Jn²`. `None`: all orders scale with
    /// λ⁻⁴, as the first orders of shallow gratings do.
    pub depth_nm: Option<f64>,
}

impl Pattern {
    pub(super) fn shallow(seed: u64) -> Self {
        Self { sigma_px: 2.0, pitch_px: PITCH_PX, angle: uniform(key(&[seed, 0])), depth_nm: None }
    }

    /// Efficiencies of the orders along one axis, at a wavelength in nm.
    fn strengths(&self, nm: f64) -> [f64; ORDERS] {
        let depth = self.depth_nm.unwrap_or(0.0);
        // Phase amplitude k w h₀/2 at normal incidence and view, w = 2.
        let x = std::f64::consts::TAU / nm * depth;
        std::array::from_fn(|m| libm::jn(m as i32, x).powi(2))
    }

    /// Radiance of a photograph at this wavelength, at a position in pixels from the zero order.
    fn light(&self, nm: f64, strengths: &[f64; ORDERS], x: f64, y: f64) -> f64 {
        let shrink = BAND_NM / nm;
        let ((sin, cos), pitch) = (self.angle.sin_cos(), self.pitch_px / shrink);
        let (a, b) = ((cos * x + sin * y) / pitch, (cos * y - sin * x) / pitch);
        let (m, n) = (a.round(), b.round());
        let square = ((a - m).powi(2) + (b - n).powi(2)) * self.pitch_px * self.pitch_px;
        let shape = (-0.5 * square / (self.sigma_px * self.sigma_px)).exp();
        let strength = |k: f64| strengths.get(k.abs() as usize).copied().unwrap_or(0.0);
        match self.depth_nm {
            // The power of an order spreads over an area that grows with λ², so its radiance falls as λ⁻².
            Some(_) => shape * strength(m) * strength(n) * shrink.powi(2),
            None => shape / (1.0 + 0.1 * (m * m + n * n)) * shrink.powi(4),
        }
    }
}

/// A pattern, photographed with the zero order at a subpixel position.
pub(super) struct Job {
    pub pattern: Pattern,
    pub pixels: usize,
    pub center: [f64; 2],
}

impl Job {
    pub(super) fn new(pattern: Pattern, pixels: usize, seed: u64) -> Self {
        let place = |k: u64| 0.5 * pixels as f64 + uniform(key(&[seed, k]));
        Self { pattern, pixels, center: [place(1), place(2)] }
    }

    /// Half-vector units per pixel.
    pub(super) fn scale(&self) -> f64 {
        2.0 / self.pixels as f64
    }

    /// Options for a photograph whose zero order is known.
    pub(super) fn settings(&self) -> Settings {
        Settings {
            wavelength_nm: Some(Wavelength::Band(BAND_NM)),
            scale: Some(self.scale()),
            center: Some(self.center),
            ..Settings::default()
        }
    }

    /// A photograph at a wavelength. `moved` maps a position, in pixels right and up of the zero order, to the imaged
    /// position.
    pub(super) fn photograph(&self, nm: f64, moved: &(dyn Fn(f64, f64) -> [f64; 2] + Sync)) -> Photograph {
        let (size, strengths) = (self.pixels, self.pattern.strengths(nm));
        let pixel = |i: usize| {
            let [x, y] = moved((i % size) as f64 - self.center[0], self.center[1] - (i / size) as f64);
            // Half vectors have the opposite sign.
            self.pattern.light(nm, &strengths, -x, -y) as f32
        };
        Photograph { light: (0..size * size).into_par_iter().map(pixel).collect(), width: size, height: size }
    }

    /// Error of the lookup table of an undistorted photograph, optionally under an extended source.
    pub(super) fn outcome(&self, settings: &Settings, light: Option<&Light>) -> Result<Outcome> {
        let points = [([0.0; 2], 1.0)];
        self.table(settings, &[self.photograph(BAND_NM, &|x, y| [x, y])], light, &points)
    }

    /// Error of the lookup table of given photographs. `points` lists the point sources: position of their zero order,
    /// in pixels right and up, and share of the total light.
    pub(super) fn table(
        &self,
        settings: &Settings,
        photographs: &[Photograph],
        light: Option<&Light>,
        points: &[([f64; 2], f64)],
    ) -> Result<Outcome> {
        let begun = Instant::now();
        let mut table = lookup(photographs, settings)?;
        light.map_or(Ok(()), |light| table.spread(light))?;
        let seconds = begun.elapsed().as_secs_f64();
        let error = self.error(&table, settings.size, points);
        let said = table.whole_error();
        let wrong = said.is_none_or(|said| error > CONFIDENTLY * said);
        Ok(Outcome {
            error: Some(error),
            seconds,
            masked: table.entries.iter().filter(|e| e[3] < 0.01).count() as f64 / table.entries.len() as f64,
            wrong: f64::from(u8::from(wrong)),
            predicted: said,
        })
    }

    /// Root mean square error of Y at the rim, relative to the RMS of the true Y, over entries with a measured fraction
    /// above 0.9. The truth integrates the pattern over wavelengths 0.5 nm apart.
    fn error(&self, table: &Table, size: usize, points: &[([f64; 2], f64)]) -> f64 {
        let light = Illuminant::default().spectrum;
        // Steps of 0.5 nm: at the rim, 1 nm moves narrow orders by more than their width.
        let spectrum: Vec<(f64, f64, [f64; ORDERS])> = (0..940)
            .map(|k| 360.25 + 0.5 * f64::from(k))
            .map(|nm| (nm, light.at(nm) * Observer::Cie1931.at(nm)[1], self.pattern.strengths(nm)))
            .collect();
        let white: f64 = spectrum.iter().map(|s| s.1).sum();
        let at = |k: usize| table.extent * ((2 * k + 1) as f64 / size as f64 - 1.0) / self.scale();
        let rim = 0.6 * table.extent / self.scale();
        let places: Vec<usize> = (0..size * size)
            .step_by((size * size / COMPARED).max(1))
            .filter(|i| at(i % size).abs() > rim && table.entries[*i][3] > 0.9)
            .collect();
        let squares = places.par_iter().map(|i| {
            let (u, v) = (at(i % size), at(size - 1 - i / size));
            let of = |([x, y], part): &([f64; 2], f64)| {
                // A source to the right shifts the pattern to the left in half-vector space.
                let sum = spectrum.iter().map(|(nm, power, s)| power * self.pattern.light(*nm, s, u + x, v + y));
                part * sum.sum::<f64>()
            };
            let truth = points.iter().map(of).sum::<f64>() / white;
            [(f64::from(table.entries[*i][1]) - truth).powi(2), truth * truth]
        });
        let [off, all] = squares.reduce(|| [0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
        (off / all).sqrt()
    }
}
