//! Reflecting slits (2017 TOG, Eq. 16; in all directions, Fig. 20) and lattices of reflecting rectangles.

use crate::light::spectrum::Seen;
use crate::light::viewer::RANGE;
use crate::material::diffraction::grating::{Grating, Groove, Scratch};
use crate::material::diffraction::lobes::{Blur, along, half_cos, under};
use crate::material::shading::{Above, Accuracy};
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_brdf::{Reflectance, Slits, Window};
use std::f64::consts::{PI, TAU};

/// Orders of rectangles per side that are sampled under an environment.
const ORDERS: i32 = 24;

fn sinc_square(x: f64) -> f64 {
    let x = PI * x;
    if x.abs() < 1e-6 { 1.0 - x * x / 3.0 } else { (x.sin() / x).powi(2) }
}

/// Arrangement of the slits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SlitLayout {
    /// Perpendicular to one direction.
    Parallel,
    /// Around the centre of a disc.
    Disc,
    /// Small patches of parallel slits in all directions, below the resolution of a pixel.
    Radial,
}

/// Slits on a surface.
pub(crate) struct Comb {
    pub slits: Slits,
    /// Their orders, balanced as those of any grating.
    pub orders: Grating,
    pub across: [f64; 2],
    pub layout: SlitLayout,
    /// Standard deviation of the window along the slits, 1/µm.
    sigma: f64,
}

impl Comb {
    /// Prepares slits.
    ///
    /// # Errors
    /// `Input` for invalid values.
    pub(crate) fn new(slits: Slits, orientation: f64, layout: SlitLayout) -> Result<Self> {
        slits.check()?;
        if slits.spacing_um > 200.0 {
            return Err(Error::input("spacing_um", format!("is {}", slits.spacing_um), "give at most 200"));
        }
        let share = slits.width_um / slits.spacing_um;
        let most = (2.0 * slits.spacing_um * RANGE[1]).ceil() as usize + 1;
        let powers: Vec<f64> = (0..=most).map(|m| share * sinc_square(m as f64 * share)).collect();
        // A window as wide as all slits together.
        let sigma = Window::new((slits.spacing_um * slits.count as f64).clamp(1.0, 1e4))?.sigma;
        let orders = Grating::of_powers(&powers, sigma, Reflectance::Perfect);
        Ok(Self { slits, orders, across: [orientation.cos(), orientation.sin()], layout, sigma })
    }

    /// The grating vector at a point.
    fn groove(&self, uv: [f64; 2]) -> Option<Groove> {
        let across = if self.layout == SlitLayout::Disc { radial(uv)? } else { self.across };
        Some(Groove { across, period_um: self.slits.spacing_um })
    }

    /// The slits of one environment sample: a random direction if they lie in all directions.
    pub(crate) fn turned(&self, random: &mut Stream) -> Turned<'_> {
        let across = match self.layout {
            SlitLayout::Radial => {
                let (sin, cos) = (PI * random.next()).sin_cos();
                Some([cos, sin])
            }
            SlitLayout::Parallel | SlitLayout::Disc => None,
        };
        Turned { comb: self, across }
    }

    /// Reflecting fraction of the surface.
    pub(crate) fn share(&self) -> f64 {
        self.slits.width_um / self.slits.spacing_um
    }

    /// BRDF under a small light, integrated over its spectrum: X, Y, Z. `f = share · S(f) · N(f along) · ν²`, with
    /// `S = N w · sinc² · (D_N/N)²`, whose integral over all f is 1, times the balancing factor of the nearest order.
    pub(crate) fn lit(
        &self,
        uv: [f64; 2],
        [view, light]: [[f64; 3]; 2],
        (width, seen): (f64, &Seen),
        accuracy: &Accuracy,
        scratch: &mut Scratch,
    ) -> [f64; 3] {
        let Some(mut groove) = self.groove(uv) else { return [0.0; 3] };
        let t = [view[0] + light[0], view[1] + light[1]];
        let length = t[0].hypot(t[1]);
        // Of patches in all directions, those perpendicular to the half vector diffract there.
        let all_around = self.layout == SlitLayout::Radial;
        if all_around && length > 0.0 {
            groove.across = t.map(|v| v / length);
        }
        let [c, s] = groove.across;
        let (across, beside) = (t[0] * c + t[1] * s, t[1] * c - t[0] * s);
        // For an extended light the sharp function across the slits is averaged over the light's width in that
        // direction.
        let blur = width * (1.0 - (light[0] * c + light[1] * s).powi(2)).max(0.0).sqrt();
        let narrow = self.sigma.hypot(RANGE[0] * width);
        if beside.abs() * RANGE[0] > accuracy.reach * self.sigma.hypot(RANGE[1] * width) {
            return [0.0; 3];
        }
        // The bandwidths of the factors add up: the sum over slits (its fastest part belongs to the two farthest
        // coherent slits), the window along them, and the spectrum. The trapezoid rule keeps its accuracy if its
        // sampling frequency is their sum.
        let spacings = 1.0 + self.slits.coherent_spacings(RANGE[0] * blur) as f64;
        let fastest = spacings * self.slits.spacing_um * across.abs() + beside.abs() / narrow + 1.0 / seen.fine;
        let norm = self.slits.count as f64 * self.slits.width_um;
        let mut balanced = (f64::INFINITY, vec![]);
        let exact = Accuracy { step: 1.0, ..*accuracy };
        along(seen, seen.range(), 1.0 / fastest, &exact, |number| {
            let sigma = self.sigma.hypot(number * width);
            let window = if all_around {
                // Mean of the window below over all directions of the slits.
                scaled_bessel(0.25 * (length * number / sigma).powi(2)) / (TAU.sqrt() * sigma)
            } else {
                let off = beside * number / sigma;
                (-0.5 * off * off).exp() / (TAU.sqrt() * sigma)
            };
            if window * sigma < 1e-7 {
                return 0.0;
            }
            if (number - balanced.0).abs() > 0.02 * number {
                balanced.0 = number;
                balanced.1.clear();
                self.orders.orders(view, groove, number, scratch, |o| balanced.1.push((o.order, o.power)));
            }
            let (frequency, blur) = (across * number, blur * number);
            let density = self.slits.averaged(frequency, blur);
            self.share() * norm * density * window * self.balance(&balanced.1, frequency, blur) * number * number
        })
    }

    /// Ratio of balanced to scalar power at a spatial frequency across the slits. It is that of the nearest order, or
    /// the mean over the orders covered by a light of standard deviation `blur` (1/µm). Evanescent orders have zero.
    fn balance(&self, balanced: &[(i32, f64)], frequency: f64, blur: f64) -> f64 {
        let place = frequency * self.slits.spacing_um;
        let nearest = place.round() as i32;
        let wide = blur * self.slits.spacing_um;
        let power = |m: i32| [balanced.iter().find(|o| o.0 == m).map_or(0.0, |o| o.1), self.orders.power(m, 0.0)];
        // Five standard deviations; a narrower light lies within one order.
        let around = (5.0 * wide).min(1e6) as i32;
        let mut sums = [0.0; 2];
        for m in if wide > 0.05 { nearest - around..=nearest + around } else { nearest..=nearest } {
            let off = if wide > 0.05 { (place - f64::from(m)) / wide } else { 0.0 };
            let weight = (-0.5 * off * off).exp();
            power(m).into_iter().zip(&mut sums).for_each(|(power, sum)| *sum += weight * power);
        }
        if sums[1] > 0.0 { sums[0] / sums[1] } else { 0.0 }
    }
}

/// Slits of one direction at every point.
pub(crate) struct Turned<'a> {
    comb: &'a Comb,
    across: Option<[f64; 2]>,
}

impl Turned<'_> {
    /// Light of an environment reflected towards the view: X, Y, Z.
    pub(crate) fn under(
        &self,
        above: &Above,
        (uv, view): ([f64; 2], [f64; 3]),
        u: [f64; 4],
        accuracy: &Accuracy,
        scratch: &mut Scratch,
    ) -> [f64; 3] {
        let Some(mut groove) = self.comb.groove(uv) else { return [0.0; 3] };
        groove.across = self.across.unwrap_or(groove.across);
        under(above, (&self.comb.orders, groove), view, u, accuracy, scratch).map(|v| v * self.comb.share())
    }
}

/// `exp(-x) I0(x)` for x ≥ 0, to 2e-7 (Abramowitz and Stegun 9.8.1 and 9.8.2).
fn scaled_bessel(x: f64) -> f64 {
    let sum = |of: &[f64], t: f64| of.iter().rev().fold(0.0, |sum, c| sum * t + c);
    if x < 3.75 {
        let t = (x / 3.75).powi(2);
        sum(&[1.0, 3.5156229, 3.0899424, 1.2067492, 0.2659732, 0.0360768, 0.0045813], t) * (-x).exp()
    } else {
        const LARGE: [f64; 9] = [
            0.39894228,
            0.01328592,
            0.00225319,
            -0.00157565,
            0.00916281,
            -0.02057706,
            0.02635537,
            -0.01647633,
            0.00392377,
        ];
        sum(&LARGE, 3.75 / x) / x.sqrt()
    }
}

/// Radial direction from the centre of (u, v); `None` at the centre.
pub(crate) fn radial([u, v]: [f64; 2]) -> Option<[f64; 2]> {
    let (x, y) = (u - 0.5, v - 0.5);
    let r = x.hypot(y);
    (r > 1e-9).then(|| [x / r, y / r])
}

/// Rectangles in rows and columns.
pub(crate) struct Lattice {
    pub period: [f64; 2],
    pub aperture: [f64; 2],
    pub turn: [f64; 2],
    pub sigma: f64,
    pub reflectance: Reflectance,
    /// Cumulative sums of the orders' powers along each axis.
    pub running: [Vec<f64>; 2],
}

impl Lattice {
    /// Prepares rectangles.
    ///
    /// # Errors
    /// `Input` for invalid values.
    pub(crate) fn new(
        key: &str,
        period: [f64; 2],
        aperture: [f64; 2],
        orientation: f64,
        (coherence_um, reflectance): (f64, Reflectance),
    ) -> Result<Self> {
        for (aperture, period) in aperture.iter().zip(period) {
            if !(*aperture > 0.0 && *aperture <= period && (1.0..=1e4).contains(&period)) {
                let problem = format!("has apertures of {aperture} µm at distances of {period} µm");
                return Err(Error::input(
                    key,
                    problem,
                    "give distances of 1 to 10000, apertures above 0 and no larger",
                ));
            }
        }
        let running = [0, 1].map(|k| {
            let share = aperture[k] / period[k];
            let mut sum = 0.0;
            (-ORDERS..=ORDERS)
                .map(|m| {
                    sum += share * sinc_square(f64::from(m) * share);
                    sum
                })
                .collect()
        });
        let sigma = Window::new(coherence_um)?.sigma;
        Ok(Self { period, aperture, turn: [orientation.cos(), orientation.sin()], sigma, reflectance, running })
    }

    /// Reflecting fraction of the surface.
    pub(crate) fn share(&self) -> f64 {
        self.aperture[0] * self.aperture[1] / (self.period[0] * self.period[1])
    }

    fn own(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [cos, sin] = self.turn;
        [cos * x + sin * y, cos * y - sin * x, z]
    }

    /// BRDF under a small light, integrated over its spectrum: X, Y, Z. Orders lie close to the mirror direction, where
    /// scalar theory's gain is 1 and no balancing is needed.
    pub(crate) fn lit(
        &self,
        [view, light]: [[f64; 3]; 2],
        (width, seen): (f64, &Seen),
        accuracy: &Accuracy,
    ) -> [f64; 3] {
        let (view, light) = (self.own(view), self.own(light));
        let t = [view[0] + light[0], view[1] + light[1]];
        let blur = Blur::new(self.sigma, width, light);
        let cos = half_cos(view, light);
        let deviation = self.sigma.hypot(width * RANGE[0]) / t[0].hypot(t[1]).max(1e-9);
        let share = self.share();
        let reach = accuracy.reach * self.sigma.hypot(width * RANGE[1]);
        along(seen, seen.range(), deviation, accuracy, |number| {
            let f = [t[0] * number, t[1] * number];
            // Orders whose lobes reach the direction; the light between lobes is negligible.
            let near = [0, 1].map(|k| {
                let [low, high] = [f[k] - reach, f[k] + reach].map(|v| v * self.period[k]);
                low.ceil() as i64..=high.floor() as i64
            });
            let mut sum = 0.0;
            for m in near[0].clone() {
                let x = m as f64 / self.period[0];
                let wide = sinc_square(self.aperture[0] * x);
                for n in near[1].clone() {
                    let y = n as f64 / self.period[1];
                    let high = sinc_square(self.aperture[1] * y);
                    sum += wide * high * blur.at([f[0] - x, f[1] - y], number);
                }
            }
            // The powers of all orders add up to 1.
            sum * share * share * number * number * self.reflectance.at(cos, 1e3 / number)
        })
    }

    /// Direction of light at a wave number. Two numbers from 0 to 1 select an order by its power, two blur it. A
    /// direction below the horizon is replaced by the mirror direction.
    pub(crate) fn sample(&self, view: [f64; 3], number: f64, u: [f64; 4]) -> ([f64; 3], f64) {
        let own = self.own(view);
        let order = [0, 1].map(|k| {
            let all = self.running[k][self.running[k].len() - 1];
            self.running[k].partition_point(|r| *r <= u[k] * all) as i32 - ORDERS
        });
        let radius = self.sigma * (-2.0 * u[2].max(1e-12).ln()).sqrt();
        let blur = [radius * (TAU * u[3]).cos(), radius * (TAU * u[3]).sin()];
        let s = [0, 1].map(|k| (f64::from(order[k]) / self.period[k] + blur[k]) / number - own[k]);
        let square = s[0] * s[0] + s[1] * s[1];
        let s = if square < 1.0 { s } else { [-own[0], -own[1]] };
        let [cos, sin] = self.turn;
        let z = (1.0 - s[0] * s[0] - s[1] * s[1]).max(0.0).sqrt();
        let light = [cos * s[0] - sin * s[1], sin * s[0] + cos * s[1], z];
        (light, self.share() * self.reflectance.at(half_cos(view, light), 1e3 / number))
    }
}
