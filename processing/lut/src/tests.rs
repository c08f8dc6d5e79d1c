//! Tables of patterns with known orders.

use super::table::Grid;
use super::*;
use nacre_optics::color::{Illuminant, Observer};

/// Gaussian orders on a square lattice, in half vectors.
pub(super) struct Lattice {
    pub pitch: f64,
    pub sigma: f64,
    pub angle: f64,
}

impl Lattice {
    pub(super) fn light(&self, u: f64, v: f64) -> f64 {
        let (c, s) = (self.angle.cos(), self.angle.sin());
        let (a, b) = ((c * u + s * v) / self.pitch, (c * v - s * u) / self.pitch);
        let mut sum = 0.0;
        for m in [a.floor(), a.ceil()] {
            for n in [b.floor(), b.ceil()] {
                let square = ((a - m).powi(2) + (b - n).powi(2)) * self.pitch * self.pitch;
                // Asymmetric, as for a blazed grating.
                let strength = (1.0 + 0.5 * m / (1.0 + m.abs())) / (1.0 + 0.4 * (m * m + n * n));
                sum += strength * (-0.5 * square / (self.sigma * self.sigma)).exp();
            }
        }
        sum
    }

    /// Photograph with its zero order at `center` and `scale` half vectors per pixel.
    pub(super) fn photograph(&self, size: usize, center: [f64; 2], scale: f64) -> Vec<f32> {
        let at = |i: usize| {
            // Half vectors point against the offset from the zero order, and rows grow downwards.
            self.light((center[0] - (i % size) as f64) * scale, ((i / size) as f64 - center[1]) * scale) as f32
        };
        (0..size * size).map(at).collect()
    }

    /// Y of an entry as a sum over wavelengths 0.1 nm apart of the exact pattern, within the photograph's `reach`.
    pub(super) fn entry(&self, light: &Illuminant, exponent: f64, u: f64, v: f64, reach: [f64; 4]) -> f64 {
        let (mut sum, mut white) = (0.0, 0.0);
        for k in 0..4700 {
            let nm = 360.05 + 0.1 * f64::from(k);
            let power = light.spectrum.at(nm) * Observer::Cie1931.at(nm)[1];
            let factor = 680.0 / nm;
            white += power;
            let (x, y) = (u * factor, v * factor);
            if x > reach[0] && x < reach[1] && y > reach[2] && y < reach[3] {
                sum += power * factor.powf(exponent) * self.light(x, y);
            }
        }
        sum / white
    }
}

const SIZE: usize = 1000;
const CENTER: [f64; 2] = [500.3, 498.8];

/// A lattice with orders two pixels wide, and its half vectors per pixel.
struct Scene {
    lattice: Lattice,
    scale: f64,
}

/// The photograph ends where the table does.
const NARROW: Scene = Scene { lattice: Lattice { pitch: 0.085, sigma: 0.004, angle: 0.2 }, scale: 0.002 };

/// The photograph covers all half vectors that the table needs.
const WIDE: Scene = Scene { lattice: Lattice { pitch: 0.1, sigma: 0.0072, angle: 0.2 }, scale: 0.0036 };

impl Scene {
    /// Range of half vectors that the photograph covers.
    fn reach(&self) -> [f64; 4] {
        let last = (SIZE - 1) as f64;
        [CENTER[0] - last, CENTER[0], -CENTER[1], last - CENTER[1]].map(|p| p * self.scale)
    }

    fn table(&self, method: MethodChoice, max_error: f64) -> (Table, Settings) {
        let light = self.lattice.photograph(SIZE, CENTER, self.scale);
        let settings = Settings {
            wavelength_nm: Some(Wavelength::Band(680.0)),
            scale: Some(self.scale),
            extent: Some(1.0),
            size: 512,
            // The zero order is detected to 0.01 pixels, which does not suffice for an error of 0.1 %.
            center: (max_error < 0.01).then_some(CENTER),
            method,
            max_error,
            ..Settings::default()
        };
        (lookup(&[Photograph { light, width: SIZE, height: SIZE }], &settings).unwrap(), settings)
    }

    /// Root mean square error of Y, relative to its root mean square, where the larger half-vector component lies in a
    /// range.
    fn error(&self, (table, settings): &(Table, Settings), range: std::ops::Range<f64>) -> f64 {
        let grid = Grid { size: settings.size, extent: table.extent, warp: settings.warp };
        let light = Illuminant::named(&settings.illuminant).unwrap();
        let (mut square, mut all, mut count) = (0.0, 0.0, 0);
        // Sampled entries with positions unrelated to those of the orders.
        for i in (0..table.entries.len()).step_by(grid.size * grid.size / 2003) {
            let (u, v) = (grid.at(i % grid.size), grid.at(grid.size - 1 - i / grid.size));
            if range.contains(&u.abs()) {
                let truth = self.lattice.entry(&light, settings.exponent, u, v, self.reach());
                square += (f64::from(table.entries[i][1]) - truth).powi(2);
                all += truth * truth;
                count += 1;
            }
        }
        assert!(count > 100, "{count}");
        (square / all).sqrt()
    }
}

#[test]
fn tables_are_as_exact_as_asked_for_where_fixed_steps_are_not() {
    for (name, scene, finest) in [("narrow", &NARROW, 0.002), ("wide", &WIDE, 0.001)] {
        let mut found = vec![];
        for (method, max_error) in
            [(MethodChoice::Auto, 0.01), (MethodChoice::Auto, 0.001), (MethodChoice::Fixed(5.0), 0.01)]
        {
            let made = scene.table(method, max_error);
            let [rim, inside] = [0.6..2.0, 0.05..0.6].map(|r| scene.error(&made, r));
            let predicted = made.0.error.unwrap();
            println!("{name} {max_error}: rim {rim:.5}, inside {inside:.5}, said {predicted:.5}, {:?}", made.0.choice);
            found.push([rim, inside]);
        }
        assert!(found[0].iter().all(|e| *e < 0.01), "{name}: {found:?}");
        // The border of the photograph is known only to a fraction of a pixel.
        assert!(found[1].iter().all(|e| *e < finest), "{name}: {found:?}");
        if name == "narrow" {
            assert!(found[2][0] > 0.05, "{found:?}");
        }
    }
}

#[test]
fn pixels_that_are_too_coarse_are_noticed() {
    for px in [0.6, 1.0, 2.0] {
        let scale = WIDE.scale;
        let scene = Scene { lattice: Lattice { pitch: 0.1, sigma: px * scale, angle: 0.2 }, scale };
        // The detector rejects lobes of fewer than nine pixels, so the position is given.
        let made = scene.table(MethodChoice::Auto, 0.009);
        let (off, predicted) = (scene.error(&made, 0.6..2.0), made.0.whole_error().unwrap());
        println!("{px} px: {off:.5}, said {predicted:.5}, between pixels {:.5}", made.0.sampling_error.unwrap());
        // The estimate is about twice the true error, because its parts are added as if independent.
        assert!(off < predicted && predicted < 3.0 * off, "{px}: {off} {predicted}");
    }
}

/// A black background between orders needs no interpolation, so a table costs as much as on a dim background. The test
/// compares predicted costs and needs no clock.
#[test]
fn a_black_background_costs_no_more_than_a_dim_one() {
    // The orders of the last case end far inside of the photograph. Its trial moves inwards to them, while that of the
    // dim background stays at the rim and is satisfied with a coarser sampling.
    for (pitch, angle, end, most) in [
        (0.58, 0.3, 9.0, 1.3),
        (0.46, 0.785, 9.0, 1.3),
        (0.3, 0.3, 9.0, 1.3),
        (0.2, 0.2, 9.0, 1.3),
        (0.2, 0.2, 0.42, 3.0),
    ] {
        let lattice = Lattice { pitch, sigma: 0.006, angle };
        let far = |i: usize| ((i % SIZE) as f64 - CENTER[0]).hypot((i / SIZE) as f64 - CENTER[1]) * 0.002 > end;
        let black = lattice.photograph(SIZE, CENTER, 0.002).into_iter().enumerate();
        let black: Vec<f32> = black.map(|(i, l)| if l < 1e-6 || far(i) { 0.0 } else { l }).collect();
        let dim = black.iter().enumerate().map(|(i, l)| l + 1e-7 * (1.0 + 0.1 * ((i * 7919) % 101) as f32 / 101.0));
        let choice = |light: Vec<f32>| {
            let settings = Settings {
                wavelength_nm: Some(Wavelength::Band(680.0)),
                scale: Some(0.002),
                extent: Some(1.0),
                size: 256,
                center: Some(CENTER),
                ..Settings::default()
            };
            let table = lookup(&[Photograph { light, width: SIZE, height: SIZE }], &settings).unwrap();
            assert!(table.error.is_none_or(|e| e < 0.01), "{pitch}: {:?}", table.error);
            table.choice
        };
        let (dim, black) = (choice(dim.collect()), choice(black.clone()));
        assert!(black.predicted_s < most * dim.predicted_s, "{pitch}, {end}: {black:?} {dim:?}");
    }
}
