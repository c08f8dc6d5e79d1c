//! Radiance of every pixel.

use super::TilesPhotograph;
use super::pattern::{Grooves, Tile};
use crate::photographs::orders::{Orders, Profile, Surface};
use crate::random::{key, uniform};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Most wavelengths on each side of the band's centre.
const WAVELENGTHS: i32 = 4;

/// Number of standard deviations within which an order contributes.
const REACH: f64 = 5.0;

/// Highest diffraction order.
const HIGHEST: i32 = 3;

/// Largest distance of adjacent points of the light, in standard deviations of an order.
const APART: f64 = 1.4;

/// Radius at which Gaussian lights are truncated, in standard deviations.
const ENDS: f64 = 3.5;

/// Samples per axis of a pixel at the edge of a polygon.
const PARTS: usize = 3;

/// A 3D vector.
type V = [f64; 3];

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn towards(from: V, to: V) -> (V, f64) {
    let d = [0, 1, 2].map(|k| to[k] - from[k]);
    let length = dot(d, d).sqrt();
    (d.map(|v| v / length), length)
}

/// The scene, prepared for rendering.
struct Bench<'a> {
    scene: &'a TilesPhotograph,
    tile: Tile,
    orders: Orders,
    /// Wavelengths in µm with weights.
    band: Vec<[f64; 2]>,
    /// Points of the light relative to its centre in mm, with weights.
    points: Vec<[f64; 3]>,
    /// Radius of the light in mm.
    reach_mm: f64,
    /// Standard deviation of an order in direction cosines, per µm of wavelength.
    sigma: f64,
    light: V,
    /// Axes of the camera in sample coordinates. The focal length that follows is in pixels.
    axes: [V; 3],
    focal: f64,
}

/// A point of the sheet.
struct Place {
    at: V,
    /// Unit vectors to the right and up along the surface, and its normal.
    frame: [V; 3],
    polygon: Option<Grooves>,
}

impl TilesPhotograph {
    /// Radiance of every pixel under a light, row 0 on top, in units of (intensity of the light in W/sr) per mm² and
    /// sr.
    pub fn radiance(&self, light: V) -> Vec<f64> {
        let bench = Bench::new(self, light);
        let sharp: Vec<f64> = (0..self.width * self.height).into_par_iter().map(|i| bench.pixel(i)).collect();
        crate::photographs::flash::blurred(&sharp, self.width, self.blur_px)
    }

    /// Photograph under room light: a grey level for every polygon, with uneven illumination.
    pub(super) fn room_light(&self) -> Vec<f64> {
        let bench = Bench::new(self, self.lights_mm[0]);
        let grey = |offset: [f64; 2], i: usize| {
            let Some(place) = bench.place(i, offset) else { return 0.02 };
            let print = place.polygon.map_or(0.12, |g| 0.2 + 0.5 * uniform(key(&[self.seed, 9, g.polygon as u64])));
            let [x, y] = [0, 1].map(|k| place.at[k] / self.sheet_mm()[k]);
            print * (1.0 + 0.25 * x - 0.2 * y)
        };
        let part = |k: usize| (k as f64 + 0.5) / PARTS as f64 - 0.5;
        let pixel = |i: usize| {
            let all = (0..PARTS * PARTS).map(|k| grey([part(k % PARTS), part(k / PARTS)], i));
            all.sum::<f64>() / (PARTS * PARTS) as f64
        };
        let sharp: Vec<f64> = (0..self.width * self.height).into_par_iter().map(pixel).collect();
        crate::photographs::flash::blurred(&sharp, self.width, self.blur_px)
    }
}

impl<'a> Bench<'a> {
    fn new(scene: &'a TilesPhotograph, light: V) -> Self {
        let (lambda, half) = (scene.wavelength_nm / 1000.0, 0.5 * scene.band_nm / 1000.0);
        // A Gaussian amplitude of this σ on the surface has σ = λ/(2π σ) in direction cosines, its square 1/√2 of
        // that.
        let sigma = 1.0 / (TAU * scene.coherence_um * 2.0_f64.sqrt());
        // A Gaussian band, truncated at three half widths at half maximum. Its steps move second orders by one lobe
        // width.
        let shortest = scene.pattern.shortest_um();
        let steps = ((3.0 * half * 2.0 / shortest / (APART * sigma * lambda)).ceil() as i32).clamp(1, WAVELENGTHS);
        let at = |k: i32| {
            let off = 3.0 * f64::from(k) / f64::from(steps);
            [lambda + off * half, 0.5_f64.powf(off * off)]
        };
        let all: Vec<[f64; 2]> = (-steps..=steps).map(at).collect();
        let sum: f64 = all.iter().map(|b| b[1]).sum();
        let band = if half > 0.0 { all.into_iter().map(|[l, w]| [l, w / sum]).collect() } else { vec![[lambda, 1.0]] };
        let (least, most) = (lambda - 3.0 * half, lambda + 3.0 * half);
        let period_um = scene.pattern.longest_um();
        let grooves = Surface::Grating {
            profile: Profile::Sinusoid,
            period_um,
            depth_um: scene.pattern.depth_um,
            angle_deg: 0.0,
        };
        // The number of orders that are used, whatever the period.
        let orders = grooves.orders([0.2 / most, 2.0 / least], 1.01 * f64::from(HIGHEST) * least / period_um, least);
        let points = points(scene, APART * sigma * least * light[2]);
        let reach_mm = points.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
        let geometry = scene.geometry();
        Self {
            tile: Tile::new(&scene.pattern, scene.tile_mm, scene.seed),
            orders,
            band,
            points,
            reach_mm,
            sigma,
            light,
            axes: geometry.sample.rotation,
            focal: geometry.camera.focal_px[0],
            scene,
        }
    }

    /// Point where the ray through a pixel, `offset` right and down of its centre, meets the sheet; `None` beside the
    /// sheet.
    fn place(&self, i: usize, offset: [f64; 2]) -> Option<Place> {
        let s = self.scene;
        let size = [s.width, s.height];
        let pixel = [i % s.width, i / s.width];
        let [x, y] = [0, 1].map(|k| (pixel[k] as f64 + offset[k] - 0.5 * (size[k] - 1) as f64) / self.focal);
        let ray = [0, 1, 2].map(|k| x * self.axes[0][k] + y * self.axes[1][k] + self.axes[2][k]);
        let c = s.camera_mm;
        let meets = |z: f64| [0, 1].map(|k| c[k] + (z - c[2]) / ray[2] * ray[k]);
        let (mut z, mut at) = (0.0, meets(0.0));
        for _ in 0..30 {
            let higher = self.height(at);
            if (higher - z).abs() < 1e-9 {
                break;
            }
            (z, at) = (higher, meets(higher));
        }
        let sheet = s.sheet_mm();
        let from_corner = [at[0] + 0.5 * sheet[0], 0.5 * sheet[1] - at[1]];
        let tile = [0, 1].map(|k| (from_corner[k] / s.tile_mm[k]).floor());
        if (0..2).any(|k| !(0.0..s.tiles[k] as f64).contains(&tile[k])) {
            return None;
        }
        let off = s.offset_mm(tile.map(|t| t as usize));
        let inside = [0, 1].map(|k| from_corner[k] - tile[k] * s.tile_mm[k] - off[k]);
        let step = 1e-3;
        let slope = |d: [f64; 2]| (self.height([at[0] + d[0], at[1] + d[1]]) - self.height(at)) / step;
        let (sx, sy) = (slope([step, 0.0]), slope([0.0, step]));
        let unit = |v: V| v.map(|x| x / dot(v, v).sqrt());
        let (normal, right) = (unit([-sx, -sy, 1.0]), unit([1.0, 0.0, sx]));
        let up = [
            normal[1] * right[2] - normal[2] * right[1],
            normal[2] * right[0] - normal[0] * right[2],
            normal[0] * right[1] - normal[1] * right[0],
        ];
        Some(Place { at: [at[0], at[1], z], frame: [right, up, normal], polygon: self.tile.at(inside) })
    }

    /// Height of the sheet above z = 0 in mm.
    fn height(&self, at: [f64; 2]) -> f64 {
        let [about_x, about_y] = self.scene.tilt_deg.map(|t| t.to_radians().tan());
        let x = 2.0 * at[0] / self.scene.sheet_mm()[0];
        at[1] * about_x - at[0] * about_y + self.scene.bow_mm * (1.0 - x * x)
    }

    fn pixel(&self, i: usize) -> f64 {
        let part = |k: usize| (k as f64 + 0.5) / PARTS as f64 - 0.5;
        let polygon = |offset| self.place(i, offset).and_then(|p| p.polygon).map(|g| g.polygon);
        let corners = [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]].map(polygon);
        if corners.iter().all(|c| *c == corners[0]) {
            return self.place(i, [0.0; 2]).map_or(0.0, |p| self.light_from(&p));
        }
        let all = (0..PARTS * PARTS).map(|k| self.place(i, [part(k % PARTS), part(k / PARTS)]));
        all.map(|p| p.map_or(0.0, |p| self.light_from(&p))).sum::<f64>() / (PARTS * PARTS) as f64
    }

    /// Radiance of a point; areas without grooves are mirrors.
    fn light_from(&self, place: &Place) -> f64 {
        let along = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            [cos, sin]
        };
        match place.polygon {
            None => self.orders(place, [1.0, 0.0], f64::INFINITY),
            Some(g) => {
                let crossed = self.scene.pattern.crossed;
                let first = (1.0 - crossed) * self.orders(place, along(g.orientation), g.period_um);
                if crossed == 0.0 {
                    return first;
                }
                first + crossed * self.orders(place, along(g.orientation + 0.25 * TAU), g.period_um)
            }
        }
    }

    /// Radiance of grooves whose grating vector has this direction.
    fn orders(&self, place: &Place, direction: [f64; 2], period: f64) -> f64 {
        let seen = towards(place.at, self.scene.camera_mm).0;
        let [middle, _] = self.half(place, seen, self.light);
        let lambda = self.scene.wavelength_nm / 1000.0;
        let highest = if period.is_finite() { HIGHEST } else { 0 };
        // Half vectors of the light's points differ by at most their distance over the distance of the light.
        let wide = 1.2 * self.reach_mm / towards(place.at, self.light).1
            + REACH * self.sigma * lambda
            + 3.0 * 0.001 * self.scene.band_nm / period;
        let near = |n: i32| {
            let at = f64::from(n) * lambda / period;
            (middle[0] - at * direction[0]).hypot(middle[1] - at * direction[1]) < wide
        };
        let orders: Vec<i32> = (-highest..=highest).filter(|n| near(*n)).collect();
        if orders.is_empty() {
            return 0.0;
        }
        self.points
            .iter()
            .map(|point| point[2] * self.under_point(place, seen, *point, direction, period, &orders))
            .sum()
    }

    /// Tangential part of ωi + ωo, and `[its normal part, cosine of the incident light over the square of its
    /// distance]`.
    fn half(&self, place: &Place, seen: V, light: V) -> [[f64; 2]; 2] {
        let (incident, distance) = towards(place.at, light);
        let sum = [0, 1, 2].map(|k| incident[k] + seen[k]);
        let [right, up, normal] = place.frame;
        [[dot(sum, right), dot(sum, up)], [dot(sum, normal), dot(incident, normal) / (distance * distance)]]
    }

    fn under_point(
        &self,
        place: &Place,
        seen: V,
        [dx, dy, _]: [f64; 3],
        direction: [f64; 2],
        period: f64,
        orders: &[i32],
    ) -> f64 {
        let [lx, ly, lz] = self.light;
        let [h, [w, irradiance]] = self.half(place, seen, [lx + dx, ly + dy, lz]);
        let mut brdf = 0.0;
        for [lambda, weight] in &self.band {
            let sigma = self.sigma * lambda;
            for n in orders {
                let at = f64::from(*n) * lambda / period;
                let square =
                    ((h[0] - at * direction[0]).powi(2) + (h[1] - at * direction[1]).powi(2)) / (sigma * sigma);
                if square < REACH * REACH {
                    let energy = if period.is_finite() { self.orders.at([*n, 0], w / lambda) } else { 1.0 };
                    brdf += weight * energy * (-0.5 * square).exp() / (TAU * sigma * sigma);
                }
            }
        }
        irradiance * brdf
    }
}

/// Points of the light on a square grid with weights, which sum to 1.
fn points(scene: &TilesPhotograph, apart: f64) -> Vec<[f64; 3]> {
    let (reach, sigma) = match scene.light_disc_mm {
        Some(diameter) => (0.5 * diameter, f64::INFINITY),
        None => (ENDS * scene.light_sigma_mm, scene.light_sigma_mm),
    };
    if reach == 0.0 {
        return vec![[0.0, 0.0, 1.0]];
    }
    // The limit bounds the computing time.
    let n = ((reach / apart).ceil() as i32).clamp(3, 60);
    let step = reach / (f64::from(n) + 0.5);
    let point = |k: i32, j: i32| {
        let (x, y) = (step * f64::from(k), step * f64::from(j));
        let r = x.hypot(y);
        let inside = ((reach - r) / step + 0.5).clamp(0.0, 1.0);
        [x, y, inside * (-0.5 * (r / sigma).powi(2)).exp()]
    };
    let all: Vec<[f64; 3]> = (-n..=n).flat_map(|j| (-n..=n).map(move |k| point(k, j))).filter(|p| p[2] > 0.0).collect();
    let sum: f64 = all.iter().map(|p| p[2]).sum();
    all.into_iter().map(|[x, y, w]| [x, y, w / sum]).collect()
}
