//! Light in front of the analyser per pixel, and the ground truth of the sample.

mod sampling;

use crate::config::BenchConfig;
use crate::fringes::{Fringes, Tone};
use crate::optics::{Incidence, Wavelength, band, efficiency};
use crate::surface::{Point, Sample, Surface};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_optics::polarization::Stokes;
use num_complex::Complex;
use rayon::prelude::*;

/// Highest diffraction order that is traced from the panel; higher orders of common gratings miss the panel or are
/// evanescent.
const ORDERS: i32 = 3;

/// R of a mirror pixel (metal without grating).
const MIRROR_RATIO: Complex<f64> = Complex::new(-1.0, 0.0);

/// Stokes image in front of the analyser under one source, in units of the panel's intensity. It includes the lens
/// blur, but no noise.
pub struct StokesImage {
    /// S0, S1, S2, row-major.
    pub planes: [Vec<f32>; 3],
}

/// A luminous disc, or the whole panel, in the plane of panel and camera lens, parallel to the sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// The lamp.
    pub lamp: Lamp,
    /// Centre relative to the midpoint between camera and panel, in mm.
    pub center_mm: [f64; 2],
    /// Diameter in mm; for a panel, that of its circumscribed circle.
    pub diameter_mm: f64,
    /// Stripes over the whole panel, instead of the disc.
    pub fringes: Option<Fringes>,
}

/// Points of the aperture and their weights: cubature of degree 5 on the unit disc (Hammer and Stroud 1958).
const APERTURE: [([f64; 2], f64); 7] = {
    const R: f64 = 0.816_496_580_927_726;
    const H: f64 = 0.5 * R;
    const V: f64 = 0.707_106_781_186_547_5;
    [
        ([0.0, 0.0], 0.25),
        ([R, 0.0], 0.125),
        ([-R, 0.0], 0.125),
        ([H, V], 0.125),
        ([-H, V], 0.125),
        ([H, -V], 0.125),
        ([-H, -V], 0.125),
    ]
};

/// Kinds of lamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lamp {
    /// The panel behind its retarder, with a luminance that falls off with the angle.
    Panel,
    /// The flash: unpolarized, with the panel's luminance times its power.
    Flash,
}

/// A source, and the panel's tone curve under fringes.
struct Light<'a> {
    source: &'a Source,
    tone: Option<Tone>,
}

/// A point of the sample in mm, the direction to the camera, and the light.
struct Ray<'a> {
    x: f64,
    y: f64,
    view: [f64; 3],
    /// Mirror direction of the viewing direction.
    mirror: [f64; 3],
    /// Mirror directions as seen from the points of the aperture; used for fringes only.
    mirrors: [[f64; 3]; APERTURE.len()],
    light: &'a Light<'a>,
}

/// Ground truth of the sample, per pixel.
pub struct Truth {
    /// Orientation of the grating vector, `[0, π)` rad; NaN where no ray of the pixel meets a grating.
    pub orientation: Vec<f32>,
    /// Period in µm; NaN as above.
    pub period_um: Vec<f32>,
    /// Length of the mean vector of doubled orientations: 1 where all rays meet gratings of one orientation, 0 where
    /// they cancel or miss.
    pub purity: Vec<f32>,
}

/// The bench's view of a sample, ready for rendering.
pub struct Scene {
    bench: BenchConfig,
    sample: Sample,
    band: Vec<Wavelength>,
    pixel_mm: f64,
}

impl Scene {
    /// Builds the sample and the wavelengths of the band.
    ///
    /// # Errors
    /// A rigorous R (`[grating.rigorous]`) that cannot be computed to the requested error.
    pub fn new(bench: &BenchConfig) -> Result<Self> {
        let sample = Sample::new(&bench.sample, bench.sample.seed.unwrap_or(bench.seed));
        let pixel_mm = sample.field_mm() / f64::from(bench.camera.width.min(bench.camera.height));
        Ok(Self { sample, band: band(bench)?, pixel_mm, bench: bench.clone() })
    }

    /// Size of a pixel on the sample in mm.
    pub fn pixel_mm(&self) -> f64 {
        self.pixel_mm
    }

    /// Position of the panel's centre relative to the midpoint between camera and panel, in mm.
    pub fn panel_middle_mm(&self) -> [f64; 2] {
        [0.5 * self.bench.geometry.baseline_mm, 0.0]
    }

    /// Source of stripes over the whole panel.
    pub fn fringes(&self, cycles_per_mm: [f64; 2], phase: f64, gamma: f64) -> Source {
        let [w, h] = self.bench.panel.size_mm;
        let fringes = Some(Fringes { cycles_per_mm, phase, gamma });
        Source { lamp: Lamp::Panel, center_mm: self.panel_middle_mm(), diameter_mm: w.hypot(h), fringes }
    }

    /// Stokes image under one source, row-major, shifted by `shift` pixels, right and down.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn render(&self, source: &Source, shift: [f64; 2], progress: &dyn Progress) -> Result<StokesImage> {
        let light = Light { source, tone: source.fringes.map(|f| Tone::new(f, self.bench.panel.gamma)) };
        let rows = self.rows("rendering the bench", progress, |x, y| self.light(x, y, &light, shift))?;
        let plane = |of: fn(&Stokes) -> f64| self.blurred(&rows.iter().map(|s| of(s) as f32).collect::<Vec<_>>());
        Ok(StokesImage { planes: [plane(|s| s.s0), plane(|s| s.s1), plane(|s| s.s2)] })
    }

    /// Ground truth, and S0 of the ambient light; shifted as in [`Scene::render`].
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn survey(&self, shift: [f64; 2], progress: &dyn Progress) -> Result<(Truth, Vec<f32>)> {
        let rows = self.rows("laying the sample", progress, |x, y| self.sample_in(x, y, shift))?;
        let (margin, width) = (self.margin(), self.width());
        let inner = || rows.chunks(width + 2 * margin).skip(margin).take(self.bench.camera.height as usize);
        let plane = |of: fn(&Surveyed) -> f32| -> Vec<f32> {
            inner().flat_map(|row| row[margin..][..width].iter().map(of)).collect()
        };
        let truth =
            Truth { orientation: plane(|p| p.truth.0), period_um: plane(|p| p.truth.1), purity: plane(|p| p.truth.2) };
        let ambient: Vec<f32> = rows.iter().map(|p| p.ambient).collect();
        Ok((truth, self.blurred(&ambient)))
    }

    fn width(&self) -> usize {
        self.bench.camera.width as usize
    }

    /// Margin in pixels from which the lens blur brings light into the picture.
    fn margin(&self) -> usize {
        crate::blur::reach(self.bench.camera.blur_px)
    }

    /// Value of a function at each pixel, and at those of the margins around the picture.
    fn rows<T: Send>(
        &self,
        stage: &str,
        progress: &dyn Progress,
        pixel: impl Fn(f64, f64) -> T + Sync,
    ) -> Result<Vec<T>> {
        let margin = self.margin() as i64;
        let (width, height) = (i64::from(self.bench.camera.width), i64::from(self.bench.camera.height));
        progress.stage(stage, (height + 2 * margin) as u64);
        let row = |y: i64| {
            progress.check()?;
            let row: Vec<T> = (-margin..width + margin).map(|x| pixel(x as f64, y as f64)).collect();
            progress.step();
            Ok(row)
        };
        let rows: Vec<Vec<T>> = (-margin..height + margin).into_par_iter().map(row).collect::<Result<_>>()?;
        Ok(rows.into_iter().flatten().collect())
    }

    fn blurred(&self, plane: &[f32]) -> Vec<f32> {
        crate::blur::gaussian(plane, self.width() + 2 * self.margin(), self.bench.camera.blur_px)
    }

    fn light(&self, x: f64, y: f64, light: &Light, shift: [f64; 2]) -> Stokes {
        let rays = self.rays(x, y, shift);
        let share = 1.0 / rays.len() as f64;
        rays.map(|(x, y)| self.ray(x, y, &self.sample.at(x, y), light)).fold(Stokes::default(), |a, b| a + b) * share
    }

    fn sample_in(&self, x: f64, y: f64, shift: [f64; 2]) -> Surveyed {
        let rays = self.rays(x, y, shift);
        let count = rays.len() as u32;
        let (mut mean, mut reflectance) = (GratingMean::default(), 0.0);
        for (x, y) in rays {
            let point = self.sample.at(x, y);
            mean.add(&point);
            reflectance += point.reflectance;
        }
        let ambient = self.bench.panel.ambient as f32 * reflectance / count as f32;
        Surveyed { ambient, truth: mean.result(count) }
    }

    /// Light from one point of the sample towards the camera.
    fn ray(&self, x: f64, y: f64, point: &Point, light: &Light) -> Stokes {
        let (distance, [half, _], source) = (self.bench.geometry.distance_mm, self.panel_middle_mm(), light.source);
        let seen = match point.surface {
            Surface::Nothing => return Stokes::default(),
            // A diffuser collects light from the whole disc: its solid angle over π.
            Surface::Diffuse => match &light.tone {
                None => Stokes::unpolarized((0.5 * source.diameter_mm / distance).powi(2) * self.power(source)),
                // It averages over many stripes.
                Some(tone) => {
                    let [w, h] = self.bench.panel.size_mm;
                    let mean = if tone.fringes().even() { tone.at([0.0; 2]) } else { 0.5 };
                    Stokes::unpolarized(mean * w * h / (std::f64::consts::PI * distance * distance))
                }
            },
            Surface::Mirror => self.order(&self.traced(x, y, point, light), point, 0),
            Surface::Bare { polarizer } => self.bare(&self.traced(x, y, point, light), polarizer.map(f64::from)),
            Surface::Grating { period_um, .. } => {
                // Orders whose sines lie outside the reach of the disc are not traced.
                let [across, up] = source.center_mm;
                let reach = ((across - half).hypot(up) + 0.5 * source.diameter_mm) / distance + 0.2;
                let highest = ((reach * f64::from(period_um) / self.band[0].um).floor() as i32).clamp(0, ORDERS);
                let ray = self.traced(x, y, point, light);
                (-highest..=highest).map(|m| self.order(&ray, point, m)).fold(Stokes::default(), |a, b| a + b)
            }
        };
        seen * f64::from(point.reflectance)
    }

    /// The ray from a point of the sample to the camera.
    fn traced<'a>(&self, x: f64, y: f64, point: &Point, light: &'a Light<'a>) -> Ray<'a> {
        let (distance, [half, _]) = (self.bench.geometry.distance_mm, self.panel_middle_mm());
        let normal = unit([-f64::from(point.slope[0]), -f64::from(point.slope[1]), 1.0]);
        let radius = 0.5 * self.bench.camera.aperture_mm;
        let view = unit([-half - x, -y, distance]);
        let through =
            |([a, b], _): ([f64; 2], f64)| mirrored(unit([radius * a - half - x, radius * b - y, distance]), normal);
        let mirrors = light.tone.as_ref().map_or(Default::default(), |_| APERTURE.map(through));
        Ray { x, y, view, mirror: mirrored(view, normal), mirrors, light }
    }

    /// Light of a front-surface mirror.
    fn bare(&self, ray: &Ray, polarizer: Option<f64>) -> Stokes {
        let Some((seen, direction)) = self.seen(ray, [0.0; 2]) else { return Stokes::default() };
        let unpolarized = ray.light.source.lamp == Lamp::Flash;
        let reflected = |wave: &Wavelength| wave.reflect_bare(direction, polarizer, unpolarized) * (seen * wave.weight);
        self.band.iter().map(reflected).fold(Stokes::default(), |a, b| a + b)
    }

    fn power(&self, source: &Source) -> f64 {
        match source.lamp {
            Lamp::Panel => 1.0,
            Lamp::Flash => self.bench.flash.power,
        }
    }

    /// Light of diffraction order `m` from the source, integrated over the band.
    fn order(&self, ray: &Ray, point: &Point, m: i32) -> Stokes {
        let (orientation, period_um) = match point.surface {
            Surface::Grating { orientation, period_um, .. } => (f64::from(orientation), f64::from(period_um)),
            _ => (0.0, f64::INFINITY),
        };
        let (sin, cos) = orientation.sin_cos();
        let way = |wave: &Wavelength| {
            let shift = f64::from(m) * wave.um / period_um;
            self.way(ray, [shift * cos, shift * sin])
        };
        // The direction of the zero order does not depend on the wavelength.
        let zero = (m == 0).then(|| way(&self.band[0]));
        let mut light = Stokes::default();
        for wave in &self.band {
            let Some((seen, incidence)) = zero.unwrap_or_else(|| way(wave)) else { continue };
            let (ratio, amplitude) = match point.surface {
                Surface::Grating { depth_um, .. } => {
                    let (g, n) = (&self.bench.grating, self.bench.film.index);
                    let w = incidence.cos_inside + (1.0 - (1.0 - ray.view[2] * ray.view[2]) / (n * n)).sqrt();
                    let ratio = wave.ratio(period_um, g.period_power, g.ellipticity);
                    (ratio, efficiency(m, depth_um.into(), wave.um, n, w))
                }
                _ => (MIRROR_RATIO, 1.0),
            };
            let reflected = match ray.light.source.lamp {
                Lamp::Panel => wave.reflect(&incidence, orientation, ratio, amplitude, m == 0),
                Lamp::Flash => wave.reflect_unpolarized(&incidence, orientation, ratio, amplitude, m == 0),
            };
            light = light + reflected * (seen * wave.weight);
        }
        light
    }

    /// Luminance of the source in the direction of an order, and the incidence of that light.
    ///
    /// The order's sines are the mirrored ones plus `shift`. `None` if the luminance is 0.
    fn way(&self, ray: &Ray, shift: [f64; 2]) -> Option<(f64, Incidence)> {
        // The film's index does not depend on the wavelength.
        self.seen(ray, shift).map(|(seen, direction)| (seen, self.band[0].incidence(direction)))
    }

    /// As `way`, with the direction of the light in place of its incidence.
    fn seen(&self, ray: &Ray, shift: [f64; 2]) -> Option<(f64, [f64; 3])> {
        let source = lifted(ray.mirror[0] + shift[0], ray.mirror[1] + shift[1])?;
        let seen = match &ray.light.tone {
            None => self.luminance(ray, source),
            Some(tone) => self.stripes(ray, shift, tone),
        };
        (seen != 0.0).then_some((seen, source))
    }

    /// Luminance at the point where a ray along `direction` meets the plane of the lights.
    ///
    /// The camera focuses on the sample, so the light is out of focus: the disc's edge is as soft as the aperture is
    /// wide.
    fn luminance(&self, ray: &Ray, direction: [f64; 3]) -> f64 {
        let hit = |from: f64, along: f64| from + along * self.bench.geometry.distance_mm / direction[2];
        let [x, y] = ray.light.source.center_mm;
        let radius = (hit(ray.x, direction[0]) - x).hypot(hit(ray.y, direction[1]) - y);
        let edge = self.bench.camera.aperture_mm.max(1e-6);
        let inside = ((0.5 * ray.light.source.diameter_mm - radius) / edge + 0.5).clamp(0.0, 1.0);
        if inside == 0.0 {
            return 0.0;
        }
        let falloff = match ray.light.source.lamp {
            Lamp::Panel => self.falloff(direction[2]),
            Lamp::Flash => 1.0,
        };
        inside * inside * (3.0 - 2.0 * inside) * falloff * self.power(ray.light.source)
    }
}

impl Scene {
    /// Relative luminance of the panel at an angle with this cosine.
    fn falloff(&self, cos: f64) -> f64 {
        // The default exponent without a power function, as this is the inner loop of rendering.
        if self.bench.panel.falloff == 2.0 { cos * cos } else { cos.powf(self.bench.panel.falloff) }
    }

    /// Luminance of the panel's stripes through one order, averaged over the aperture; the order's sines are the
    /// mirrored ones plus `shift`.
    fn stripes(&self, ray: &Ray, shift: [f64; 2], tone: &Tone) -> f64 {
        let (distance, [half, _]) = (self.bench.geometry.distance_mm, self.panel_middle_mm());
        let [w, h] = self.bench.panel.size_mm;
        let through = |(mirror, (_, weight)): (&[f64; 3], ([f64; 2], f64))| {
            let Some(to) = lifted(mirror[0] + shift[0], mirror[1] + shift[1]) else { return 0.0 };
            let place = [ray.x + to[0] * distance / to[2] - half, ray.y + to[1] * distance / to[2]];
            if place[0].abs() > 0.5 * w || place[1].abs() > 0.5 * h {
                return 0.0;
            }
            weight * self.falloff(to[2]) * tone.at(place)
        };
        ray.mirrors.iter().zip(APERTURE).map(through).sum()
    }
}

/// Mirror direction of `view` about a normal.
fn mirrored(view: [f64; 3], normal: [f64; 3]) -> [f64; 3] {
    let along = 2.0 * (0..3).map(|i| view[i] * normal[i]).sum::<f64>();
    std::array::from_fn(|i| along * normal[i] - view[i])
}

/// Unit vector above the surface with these sines; `None` if they exceed 1.
fn lifted(u: f64, v: f64) -> Option<[f64; 3]> {
    let z2 = 1.0 - u * u - v * v;
    (z2 > 1e-4).then(|| [u, v, z2.sqrt()])
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    v.map(|c| c / length)
}

/// S0 of ambient light, and (orientation, period, purity) of a pixel.
struct Surveyed {
    ambient: f32,
    truth: (f32, f32, f32),
}

/// Mean orientation (of doubled angles) and mean period of a pixel's rays, weighted by reflectance.
#[derive(Default)]
struct GratingMean {
    cos: f64,
    sin: f64,
    period: f64,
    weight: f64,
    rays: u32,
}

impl GratingMean {
    fn add(&mut self, point: &Point) {
        if let Surface::Grating { orientation, period_um, .. } = point.surface {
            let weight = f64::from(point.reflectance);
            let (sin, cos) = (2.0 * f64::from(orientation)).sin_cos();
            self.cos += weight * cos;
            self.sin += weight * sin;
            self.period += weight * f64::from(period_um);
            self.weight += weight;
            self.rays += 1;
        }
    }

    fn result(&self, rays: u32) -> (f32, f32, f32) {
        if self.weight <= 0.0 {
            return (f32::NAN, f32::NAN, 0.0);
        }
        let orientation = ((0.5 * self.sin.atan2(self.cos)).rem_euclid(std::f64::consts::PI)) as f32;
        let orientation = if orientation >= std::f32::consts::PI { 0.0 } else { orientation };
        let purity = self.cos.hypot(self.sin) / self.weight * f64::from(self.rays) / f64::from(rays);
        (orientation, (self.period / self.weight) as f32, purity as f32)
    }
}
