//! What reaches the camera's side of the analyser, per pixel, and the truth about the sample.

use crate::config::BenchConfig;
use crate::optics::{Wavelength, band, efficiency};
use crate::surface::{Point, Sample, Surface};
use nacre_processing::Result;
use nacre_processing::polarimetry::Stokes;
use nacre_processing::progress::Progress;
use num_complex::Complex;
use rayon::prelude::*;

/// Highest order that is traced from the panel; the others of the usual gratings miss it or vanish.
const ORDERS: i32 = 3;

/// Reflectance of a mirror pixel (metal without grating).
const MIRROR_RATIO: Complex<f64> = Complex::new(-1.0, 0.0);

/// Light before the analyser, in units of the panel's intensity; blurred by the lens, before noise.
pub struct StokesImage {
    /// S0, S1, S2 from the white disc, row-major.
    pub planes: [Vec<f32>; 3],
    /// S0 of the unpolarized light from elsewhere, there also when the panel is black.
    pub ambient: Vec<f32>,
}

/// Light from the disc, S0 from elsewhere, and (orientation, period, purity) of a pixel.
struct Pixel {
    light: Stokes,
    ambient: f32,
    truth: (f32, f32, f32),
}

/// A point of the sample (mm), the direction to the camera, and the disc on the panel.
struct Ray {
    x: f64,
    y: f64,
    view: [f64; 3],
    disc_mm: f64,
}

/// What the sample really is, per pixel.
pub struct Truth {
    /// Orientation of the grating vector, `[0, π)` rad; NaN where no ray of the pixel meets a grating.
    pub orientation: Vec<f32>,
    /// Period in µm; NaN as above.
    pub period_um: Vec<f32>,
    /// 1 where all rays of the pixel meet gratings of one orientation, down to 0 where they cancel or miss.
    pub purity: Vec<f32>,
}

/// The bench's view of a sample, ready to be rendered.
pub struct Scene {
    bench: BenchConfig,
    sample: Sample,
    band: Vec<Wavelength>,
    pixel_mm: f64,
}

impl Scene {
    /// Builds the sample and the band.
    pub fn new(bench: &BenchConfig) -> Self {
        let sample = Sample::new(&bench.sample, bench.seed);
        let pixel_mm = sample.field_mm() / f64::from(bench.camera.width.min(bench.camera.height));
        Self { sample, band: band(bench), pixel_mm, bench: bench.clone() }
    }

    /// Size of a pixel on the sample in mm.
    pub fn pixel_mm(&self) -> f64 {
        self.pixel_mm
    }

    /// Renders light and truth with a white disc of `disc_mm` on the panel.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn render(&self, disc_mm: f64, progress: &dyn Progress) -> Result<(StokesImage, Truth)> {
        let (width, height) = (self.bench.camera.width as usize, self.bench.camera.height as usize);
        progress.stage("rendering the bench", height as u64);
        let row = |y: usize| {
            progress.check()?;
            let row: Vec<Pixel> = (0..width).map(|x| self.pixel(x, y, disc_mm)).collect();
            progress.step();
            Ok(row)
        };
        let rows: Vec<Vec<Pixel>> = (0..height).into_par_iter().map(row).collect::<Result<_>>()?;
        let plane = |of: fn(&Pixel) -> f32| -> Vec<f32> { rows.iter().flatten().map(of).collect() };
        let blurred = |of: fn(&Pixel) -> f32| {
            let mut plane = plane(of);
            crate::blur::gaussian(&mut plane, width, self.bench.camera.blur_px);
            plane
        };
        let light = StokesImage {
            planes: [blurred(|p| p.light.s0 as f32), blurred(|p| p.light.s1 as f32), blurred(|p| p.light.s2 as f32)],
            ambient: blurred(|p| p.ambient),
        };
        let truth =
            Truth { orientation: plane(|p| p.truth.0), period_um: plane(|p| p.truth.1), purity: plane(|p| p.truth.2) };
        Ok((light, truth))
    }

    /// Everything about one pixel, over all its rays.
    fn pixel(&self, x: usize, y: usize, disc_mm: f64) -> Pixel {
        let n = self.bench.camera.subsamples;
        let (width, height) = (f64::from(self.bench.camera.width), f64::from(self.bench.camera.height));
        let mut light = Stokes::default();
        let mut mean = GratingMean::default();
        let mut reflectance = 0.0;
        for k in 0..n * n {
            let offset = |i: u32| (f64::from(i) + 0.5) / f64::from(n);
            let x_mm = (x as f64 + offset(k % n) - 0.5 * width) * self.pixel_mm;
            let y_mm = (0.5 * height - y as f64 - offset(k / n)) * self.pixel_mm;
            let point = self.sample.at(x_mm, y_mm);
            mean.add(&point);
            reflectance += point.reflectance;
            light = light + self.ray(x_mm, y_mm, &point, disc_mm);
        }
        let rays = n * n;
        let ambient = self.bench.panel.ambient as f32 * reflectance / rays as f32;
        Pixel { light: light * (1.0 / f64::from(rays)), ambient, truth: mean.result(rays) }
    }

    /// Light from one point of the sample towards the camera.
    fn ray(&self, x: f64, y: f64, point: &Point, disc_mm: f64) -> Stokes {
        let (distance, half) = (self.bench.geometry.distance_mm, 0.5 * self.bench.geometry.baseline_mm);
        let ray = Ray { x, y, view: unit([-half - x, -y, distance]), disc_mm };
        let seen = match point.surface {
            Surface::Nothing => return Stokes::default(),
            // A diffuser sees the whole disc: its solid angle over π.
            Surface::Diffuse => Stokes::unpolarized((0.5 * disc_mm / distance).powi(2)),
            Surface::Mirror => self.order(&ray, point, 0),
            Surface::Grating { period_um, .. } => {
                // Orders whose sine leaves the disc's reach are not even traced.
                let reach = 0.5 * disc_mm / distance + 0.2;
                let highest = ((reach * f64::from(period_um) / self.band[0].um).floor() as i32).clamp(0, ORDERS);
                (-highest..=highest).map(|m| self.order(&ray, point, m)).fold(Stokes::default(), |a, b| a + b)
            }
        };
        seen * f64::from(point.reflectance)
    }

    /// Light that order `m` brings from the panel, over the band.
    fn order(&self, ray: &Ray, point: &Point, m: i32) -> Stokes {
        let mirror = mirrored(ray.view, point.slope);
        let mut light = Stokes::default();
        for wave in &self.band {
            let (shift, orientation) = match point.surface {
                Surface::Grating { orientation, period_um, .. } => {
                    (f64::from(m) * wave.um / f64::from(period_um), f64::from(orientation))
                }
                _ => (0.0, 0.0),
            };
            let (sin, cos) = orientation.sin_cos();
            let Some(source) = lifted(mirror[0] + shift * cos, mirror[1] + shift * sin) else { continue };
            let seen = self.panel(ray, source);
            if seen == 0.0 {
                continue;
            }
            let incidence = wave.incidence(source);
            let (ratio, amplitude) = match point.surface {
                Surface::Grating { period_um, depth_um, .. } => {
                    let (g, n) = (&self.bench.grating, self.bench.film.index);
                    let w = incidence.cos_inside + (1.0 - (1.0 - ray.view[2] * ray.view[2]) / (n * n)).sqrt();
                    let ratio = wave.ratio(period_um.into(), g.period_power, g.ellipticity);
                    (ratio, efficiency(m, depth_um.into(), wave.um, n, w))
                }
                _ => (MIRROR_RATIO, 1.0),
            };
            light = light + wave.reflect(&incidence, orientation, ratio, amplitude, m == 0) * (seen * wave.weight);
        }
        light
    }

    /// Luminance of the panel where a ray along `direction` meets it. The camera focuses on the sample,
    /// so the panel is out of focus and the disc's edge as soft as the aperture is wide.
    fn panel(&self, ray: &Ray, direction: [f64; 3]) -> f64 {
        let (distance, half) = (self.bench.geometry.distance_mm, 0.5 * self.bench.geometry.baseline_mm);
        let hit = |from: f64, along: f64| from + along * distance / direction[2];
        let radius = (hit(ray.x, direction[0]) - half).hypot(hit(ray.y, direction[1]));
        let edge = self.bench.camera.aperture_mm.max(1e-6);
        let inside = ((0.5 * ray.disc_mm - radius) / edge + 0.5).clamp(0.0, 1.0);
        if inside == 0.0 {
            return 0.0;
        }
        inside * inside * (3.0 - 2.0 * inside) * direction[2].powf(self.bench.panel.falloff)
    }
}

/// Mirror direction of `view` about the tilted normal `(-slope, 1)`.
fn mirrored(view: [f64; 3], slope: [f32; 2]) -> [f64; 3] {
    let normal = unit([-f64::from(slope[0]), -f64::from(slope[1]), 1.0]);
    let along = 2.0 * (0..3).map(|i| view[i] * normal[i]).sum::<f64>();
    std::array::from_fn(|i| along * normal[i] - view[i])
}

/// The unit vector with these sines above the surface, if there is one.
fn lifted(u: f64, v: f64) -> Option<[f64; 3]> {
    let z2 = 1.0 - u * u - v * v;
    (z2 > 1e-4).then(|| [u, v, z2.sqrt()])
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    v.map(|c| c / length)
}

/// Mean orientation (of a line, so of the doubled angle) and period of a pixel's rays, weighted by reflectance.
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
