//! Lights, as seen from a point on a surface.

pub(crate) mod spectrum;
pub(crate) mod viewer;

use crate::environment::Environment;
use crate::scene::{self, REMEDY};
use crate::vector::{V3, across, direction, number, place, turned};
use nacre_base::{Error, Result};
use spectrum::{Seen, Upsampling};
use std::f64::consts::TAU;
use std::path::Path;
use viewer::Viewer;

/// Permitted range of strengths.
const STRENGTHS: [f64; 2] = [0.0, 1e12];

/// Smallest angular size of a light in rad; smaller lights are enlarged to it.
pub(crate) const POINT: f64 = 1e-6;

/// Strata along each side of a rectangular light.
const STRATA: usize = 4;

/// A prepared light.
pub(crate) struct Lamp {
    pub kind: Kind,
    /// Its spectrum, as seen by the observer.
    pub seen: Seen,
}

/// Kind of a light.
pub(crate) enum Kind {
    Point { at: V3, intensity: f64, sigma: f64, beam: Option<(V3, f64)> },
    Far { towards: V3, illuminance: f64, sigma: f64 },
    Rectangle { center: V3, frame: [V3; 3], half: [f64; 2], luminance: f64 },
}

/// A part of a light, seen from a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    /// Direction towards the light.
    pub towards: V3,
    pub distance: f64,
    /// Illuminance of a surface that faces the light.
    pub illuminance: f64,
    /// Standard deviation of its directions in rad.
    pub sigma: f64,
}

/// A part of a light in the frame of a point.
pub(crate) struct Source<'a> {
    /// Direction towards its centre.
    pub light: [f64; 3],
    /// Standard deviation of its directions in rad.
    pub width: f64,
    /// Its spectrum, as seen by the observer.
    pub seen: &'a Seen,
    /// Two random numbers from 0 to 1 that select a point of the light.
    pub chance: [f64; 2],
}

impl Source<'_> {
    /// Direction of a random point of the light, for materials that need a point source.
    pub(crate) fn drawn(&self) -> [f64; 3] {
        let light = V3::from(self.light);
        let first = if light.x.abs() < 0.9 { V3::x() } else { V3::y() };
        let first = (first - light * light.dot(&first)).normalize();
        let [u, v] = self.chance;
        let radius = self.width * (-2.0 * u.max(1e-12).ln()).sqrt();
        let (sin, cos) = (TAU * v).sin_cos();
        (light + (first * cos + light.cross(&first) * sin) * radius).normalize().into()
    }
}

/// Environment light.
pub(crate) struct Sky {
    pub map: Environment,
    /// Directions of the map's axes.
    pub frame: [V3; 3],
    pub strength: f64,
    pub visible: bool,
    pub upsampling: Upsampling,
}

impl Lamp {
    /// Prepares a described light, rotated about z by an angle in rad; `None` for an environment.
    pub(crate) fn new(
        name: &str,
        light: &scene::Light,
        folder: &Path,
        viewer: Viewer,
        (angle, error): (f64, f64),
    ) -> Result<Option<Self>> {
        let key = |what: &str| format!("{name}.{what}");
        let at = |what: &str, p: &[f64; 3]| place(&key(what), *p).map(|v| turned(v, angle));
        let strength = |value: f64| number(&key("illuminance"), value, STRENGTHS);
        let size = |sigma: f64| number(&key("sigma_mm"), sigma, [0.0, 1e6]);
        let (kind, spectrum) = match light {
            scene::Light::Point { position, illuminance, sigma_mm, spectrum } => {
                let at = at("position", position)?;
                let intensity = strength(*illuminance)? * at.norm_squared().max(1e-12);
                (Kind::Point { at, intensity, sigma: size(*sigma_mm)?, beam: None }, spectrum)
            }
            scene::Light::Spot { position, target, beam_deg, illuminance, sigma_mm, spectrum } => {
                let (from, to) = (at("position", position)?, at("target", target)?);
                let along = to - from;
                if along.norm() < 1e-9 {
                    return Err(Error::input(key("target"), "is where the light is", REMEDY));
                }
                let beam = number(&key("beam_deg"), *beam_deg, [0.01, 90.0])?.to_radians();
                let intensity = strength(*illuminance)? * along.norm_squared();
                let beam = Some((along.normalize(), beam));
                (Kind::Point { at: from, intensity, sigma: size(*sigma_mm)?, beam }, spectrum)
            }
            scene::Light::Directional { direction: towards, illuminance, sigma_deg, spectrum } => {
                let towards = turned(direction(&key("direction"), *towards)?, angle);
                let sigma = number(&key("sigma_deg"), *sigma_deg, [0.0, 10.0])?.to_radians();
                (Kind::Far { towards, illuminance: strength(*illuminance)?, sigma }, spectrum)
            }
            scene::Light::Rectangle { center, normal, up, size, luminance, spectrum } => {
                let n = direction(&key("normal"), *normal)?;
                let v = across(&key("up"), *up, n)?;
                let frame = [v.cross(&n), v, n].map(|d| turned(d, angle));
                let half = [0, 1].map(|k| 0.5 * size[k]);
                half.iter().try_for_each(|h| number(&key("size"), *h, crate::shape::SIZES).map(drop))?;
                let luminance = number(&key("luminance"), *luminance, STRENGTHS)?;
                (Kind::Rectangle { center: at("center", center)?, frame, half, luminance }, spectrum)
            }
            scene::Light::Environment { .. } => return Ok(None),
        };
        let seen = Seen::new(&key("spectrum"), spectrum, folder, viewer, error)?;
        Ok(Some(Self { kind, seen }))
    }

    /// Calls `each` with the parts of the light seen from a point; two numbers from 0 to 1 select points within the
    /// strata of a rectangle.
    pub(crate) fn beams(&self, from: V3, u: [f64; 2], mut each: impl FnMut(Beam)) {
        match &self.kind {
            Kind::Far { towards, illuminance, sigma } => {
                let sigma = sigma.max(POINT);
                each(Beam { towards: *towards, distance: f64::INFINITY, illuminance: *illuminance, sigma });
            }
            Kind::Point { at, intensity, sigma, beam } => {
                let d = at - from;
                let square = d.norm_squared().max(1e-12);
                let distance = square.sqrt();
                let towards = d / distance;
                let falls = beam.map_or(1.0, |(axis, width)| {
                    let angle = (-towards.dot(&axis)).clamp(-1.0, 1.0).acos();
                    (-0.5 * (angle / width).powi(2)).exp()
                });
                let sigma = (sigma / distance).max(POINT);
                each(Beam { towards, distance, illuminance: intensity * falls / square, sigma });
            }
            Kind::Rectangle { center, frame, half, luminance } => {
                let n = STRATA as f64;
                for k in 0..STRATA * STRATA {
                    let cell = [(k % STRATA) as f64, (k / STRATA) as f64];
                    let at = [0, 1].map(|i| (2.0 * (cell[i] + u[i]) / n - 1.0) * half[i]);
                    let d = center + frame[0] * at[0] + frame[1] * at[1] - from;
                    let distance = d.norm().max(1e-9);
                    let towards = d / distance;
                    let cos = -towards.dot(&frame[2]);
                    if cos > 0.0 {
                        let area = 4.0 * half[0] * half[1] / (n * n);
                        // The stratum is replaced by a Gaussian with the variance of a square cell, foreshortened by
                        // its cosine.
                        let sigma = (area * cos / 12.0).sqrt() / distance;
                        let illuminance = luminance * area * cos / (distance * distance);
                        each(Beam { towards, distance, illuminance, sigma: sigma.max(POINT) });
                    }
                }
            }
        }
    }
}

impl Sky {
    /// Prepares a described environment; `None` for other lights.
    pub(crate) fn new(
        name: &str,
        light: &scene::Light,
        folder: &Path,
        viewer: Viewer,
        (angle, error): (f64, f64),
    ) -> Result<Option<Self>> {
        let scene::Light::Environment { file, layer, color, luminance, up, turn_deg, visible } = light else {
            return Ok(None);
        };
        let key = |what: &str| format!("{name}.{what}");
        let map = match (file, color) {
            (Some(file), None) => Environment::read(&folder.join(file), layer.as_deref())?,
            (None, Some(rgb)) if rgb.iter().all(|v| (0.0..=1e9).contains(v)) => Environment::constant(*rgb),
            (None, Some(rgb)) => {
                return Err(Error::input(key("color"), format!("is {rgb:?}"), "give three numbers from 0 to 1e9"));
            }
            _ => return Err(Error::input(name, "has not one of file and color", REMEDY)),
        };
        let strength = number(&key("luminance"), *luminance, STRENGTHS)?;
        let turn = number(&key("turn_deg"), *turn_deg, [-3600.0, 3600.0])?.to_radians();
        let z = direction(&key("up"), *up)?;
        // The centre of the picture points towards +z of the scene, behind the viewer of a sample, unless that is the
        // zenith.
        let first = across("", [0.0, 0.0, 1.0], z).or_else(|_| across("", [1.0, 0.0, 0.0], z))?;
        let (sin, cos) = turn.sin_cos();
        let second = z.cross(&first);
        let x = first * cos + second * sin;
        let frame = [x, z.cross(&x), z].map(|v| turned(v, angle));
        let upsampling = Upsampling::new(viewer, error)?;
        Ok(Some(Self { map, frame, strength, visible: *visible, upsampling }))
    }

    /// Radiance from a direction, linear sRGB.
    #[inline]
    pub(crate) fn radiance(&self, towards: V3) -> [f64; 3] {
        let local = self.frame.map(|f| f.dot(&towards));
        self.map.radiance(local).map(|v| f64::from(v) * self.strength)
    }

    /// Wave-number step in 1/µm at which sums over the spectrum alone are accurate.
    pub(crate) fn fine(&self) -> f64 {
        self.upsampling.fine().min(0.05)
    }

    /// A sampled direction, its radiance and its density per solid angle.
    pub(crate) fn sample(&self, u: [f64; 2]) -> (V3, [f64; 3], f64) {
        let ([x, y, z], rgb, density) = self.map.sample(u);
        (self.frame[0] * x + self.frame[1] * y + self.frame[2] * z, rgb.map(|v| f64::from(v) * self.strength), density)
    }

    /// Density of [`Self::sample`].
    pub(crate) fn density(&self, towards: V3) -> f64 {
        self.map.density(self.frame.map(|f| f.dot(&towards)))
    }
}
