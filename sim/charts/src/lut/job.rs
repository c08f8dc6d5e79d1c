//! Photographs of known orders, and tables of them against their truth.

use super::{BAND_NM, PITCH_PX};
use nacre_base::Result;
use nacre_lut::{Light, Photograph, Settings, Table, Wavelength, lookup};
use nacre_optics::color::{Illuminant, Observer};
use nacre_sim::random::{key, uniform};
use nacre_studies::Outcome;
use rayon::prelude::*;
use std::time::Instant;

/// Entries that are compared with the truth.
const COMPARED: usize = 1500;

/// Orders to each side whose strength depends on the wavelength.
const ORDERS: usize = 16;

/// A table is confidently wrong when it is off by more than so many times what it says.
const CONFIDENTLY: f64 = 5.0;

/// Orders on a turned lattice: Gaussians, in pixels of a photograph at [`BAND_NM`].
#[derive(Clone, Debug)]
pub(super) struct Pattern {
    pub sigma_px: f64,
    /// Distance of orders.
    pub pitch_px: f64,
    pub angle: f64,
    /// Depth of crossed sinusoids in nm, peak to peak, whose orders have the strengths `Jm² Jn²`; none for orders that all follow
    /// the fourth power, as the first ones of shallow gratings do.
    pub depth_nm: Option<f64>,
}

impl Pattern {
    pub(super) fn shallow(seed: u64) -> Self {
        Self { sigma_px: 2.0, pitch_px: PITCH_PX, angle: uniform(key(&[seed, 0])), depth_nm: None }
    }

    /// Strengths of the orders along one axis, at a wavelength in nm.
    fn strengths(&self, nm: f64) -> [f64; ORDERS] {
        let depth = self.depth_nm.unwrap_or(0.0);
        // Phase amplitude k w h₀/2 at normal incidence and view, w = 2.
        let x = std::f64::consts::TAU / nm * depth;
        std::array::from_fn(|m| libm::jn(m as i32, x).powi(2))
    }

    /// Light that a photograph at this wavelength shows, at a place in pixels from the zero order.
    fn light(&self, nm: f64, strengths: &[f64; ORDERS], x: f64, y: f64) -> f64 {
        let shrink = BAND_NM / nm;
        let ((sin, cos), pitch) = (self.angle.sin_cos(), self.pitch_px / shrink);
        let (a, b) = ((cos * x + sin * y) / pitch, (cos * y - sin * x) / pitch);
        let (m, n) = (a.round(), b.round());
        let square = ((a - m).powi(2) + (b - n).powi(2)) * self.pitch_px * self.pitch_px;
        let shape = (-0.5 * square / (self.sigma_px * self.sigma_px)).exp();
        let strength = |k: f64| strengths.get(k.abs() as usize).copied().unwrap_or(0.0);
        match self.depth_nm {
            // What an order carries is spread over an area that grows with the square of the wavelength.
            Some(_) => shape * strength(m) * strength(n) * shrink.powi(2),
            None => shape / (1.0 + 0.1 * (m * m + n * n)) * shrink.powi(4),
        }
    }
}

/// A pattern, photographed with the zero order somewhere between four pixels.
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

    /// Half vector per pixel.
    pub(super) fn scale(&self) -> f64 {
        2.0 / self.pixels as f64
    }

    /// Of a photograph whose zero order is known.
    pub(super) fn settings(&self) -> Settings {
        Settings {
            wavelength_nm: Some(Wavelength::Band(BAND_NM)),
            scale: Some(self.scale()),
            center: Some(self.center),
            ..Settings::default()
        }
    }

    /// A photograph at a wavelength; `moved` says which place, in pixels right and up of the zero order, a pixel shows.
    pub(super) fn photograph(&self, nm: f64, moved: &(dyn Fn(f64, f64) -> [f64; 2] + Sync)) -> Photograph {
        let (size, strengths) = (self.pixels, self.pattern.strengths(nm));
        let pixel = |i: usize| {
            let [x, y] = moved((i % size) as f64 - self.center[0], self.center[1] - (i / size) as f64);
            // Half vectors point the other way.
            self.pattern.light(nm, &strengths, -x, -y) as f32
        };
        Photograph { light: (0..size * size).into_par_iter().map(pixel).collect(), width: size, height: size }
    }

    /// A table of the photograph as it is, or of a light that is no point, against the truth.
    pub(super) fn outcome(&self, settings: &Settings, light: Option<&Light>) -> Result<Outcome> {
        let points = [([0.0; 2], 1.0)];
        self.table(settings, &[self.photograph(BAND_NM, &|x, y| [x, y])], light, &points)
    }

    /// A table of photographs against the truth under points of light: where each puts the zero order, in pixels to the right and up,
    /// and its part of all light.
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

    /// Root mean square of Y at the rim where nine tenths and more were measured, over the truth's own: sums over wavelengths 1 nm apart of the pattern itself.
    fn error(&self, table: &Table, size: usize, points: &[([f64; 2], f64)]) -> f64 {
        let light = Illuminant::default().spectrum;
        // Half a nm where orders are narrower than what 1 nm moves them by at the rim.
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
                // A point to the right puts the pattern's half vectors to the left.
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
