//! Materials ready for light.

use super::base::Surface;
use super::grating::{Grating, Groove, Scratch};
use super::lobes::{Above, Accuracy, lit, under};
use super::random::Stream;
use super::relief::Relief;
use super::scene::{self, Blend};
use super::slits::{Comb, Lattice, radial};
use super::spectrum::{RANGE, Seen, xyz};
use super::table::Table;
use super::texture::{self, Grooves, Over};
use super::vector::number;
use crate::color::Observer;
use crate::progress::Progress;
use crate::surface::height::{self, Scale};
use crate::surface::{Reflectance, Section, Slits, Window, Workspace};
use crate::{Error, Result};
use std::path::Path;

/// Longest period of a grating, in µm, and deepest.
const PERIODS: [f64; 2] = [0.05, 200.0];
const DEPTHS: [f64; 2] = [0.0, 5.0];

/// Memory of one thread.
#[derive(Default)]
pub(super) struct Memory {
    pub scratch: Scratch,
    workspace: Workspace,
}

/// A material.
pub(super) struct Material {
    base: Option<Base>,
    diffraction: Option<Diffraction>,
    coverage: Over<1>,
    blend: Blend,
    normals: Option<Over<3>>,
    /// What there is to know about it.
    pub notes: Notes,
}

/// How a material is computed.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Notes {
    /// How, in words.
    pub method: String,
    /// Highest order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orders: Option<i32>,
    /// Relative error that is predicted of its model.
    pub predicted_error: f64,
    /// What is to be known.
    pub warnings: Vec<String>,
}

struct Base {
    albedo: Over<3>,
    roughness: Over<1>,
    specular: [f64; 3],
}

enum Diffraction {
    Grating { grating: Grating, same: [Option<f64>; 2], maps: Option<Grooves>, disc: bool },
    Comb(Comb),
    Lattice(Lattice),
    Table(Box<Table>),
    Relief(Box<Relief>),
}

/// A place that is looked at.
pub(super) struct Place {
    pub uv: [f64; 2],
    /// Direction of view in the place's frame.
    pub view: [f64; 3],
}

fn add(sum: &mut [f64; 3], part: [f64; 3], weight: f64) {
    sum.iter_mut().zip(part).for_each(|(s, p)| *s += p * weight);
}

impl Material {
    /// Of a description.
    ///
    /// # Errors
    /// `Input` for what makes no sense, or files that are none.
    pub(super) fn new(
        name: &str,
        material: &scene::Material,
        folder: &Path,
        observer: Observer,
        accuracy: &Accuracy,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let key = |what: &str| format!("material.{name}.{what}");
        let mut notes = Notes::default();
        let base = match &material.base {
            Some(base) => {
                if !base.specular.iter().all(|v| (0.0..=1.0).contains(v)) {
                    let problem = format!("is {:?}", base.specular);
                    return Err(Error::input(key("base.specular"), problem, "give three numbers from 0 to 1"));
                }
                Some(Base {
                    albedo: texture::color(&key("base.albedo"), &base.albedo, folder)?,
                    roughness: texture::value(&key("base.roughness"), &base.roughness, folder, [0.02, 1.0])?,
                    specular: base.specular.map(f64::from),
                })
            }
            None => None,
        };
        let diffraction = match &material.diffraction {
            Some(of) => {
                Some(Diffraction::new(&key("diffraction"), of, folder, observer, accuracy, &mut notes, progress)?)
            }
            None => None,
        };
        if notes.method.is_empty() {
            notes.method = "diffuse and glossy".into();
        }
        let normals = material.normals.as_ref().map(|file| texture::normals(&folder.join(file))).transpose()?;
        let coverage = texture::value(&key("coverage"), &material.coverage, folder, [0.0, 1.0])?;
        Ok(Self { base, diffraction, coverage, blend: material.blend, normals, notes })
    }

    /// Whether it depends on the direction of u.
    pub(super) fn needs_tangents(&self) -> bool {
        self.diffraction.is_some() || self.normals.is_some()
    }

    /// The normal at a place in its shape's frame, if it is not the shape's own.
    pub(super) fn normal(&self, uv: [f64; 2]) -> Option<[f64; 3]> {
        self.normals.as_ref().map(|n| n.at(uv))
    }

    /// Part that diffracts, and what of the base is seen, at a direction of view (and, blended by Fresnel, of light).
    fn shares(&self, uv: [f64; 2], cos: [f64; 2]) -> [f64; 2] {
        let [covered] = self.coverage.at(uv);
        match (&self.diffraction, self.blend) {
            (None, _) => [0.0, 1.0],
            (Some(_), Blend::Mix) => [covered, 1.0 - covered],
            (Some(top), Blend::Fresnel) => {
                let reflected = |cos: f64| top.reflectance(cos);
                [covered, 1.0 - covered + covered * (1.0 - reflected(cos[0])) * (1.0 - reflected(cos[1]))]
            }
        }
    }

    fn surface(&self, base: &Base, uv: [f64; 2]) -> Surface {
        let [alpha] = base.roughness.at(uv);
        Surface { albedo: base.albedo.at(uv), specular: base.specular, alpha }
    }

    /// X, Y, Z of what is seen of a light of illuminance 1 on what faces it; `light` is its direction in the frame, `width` its size in rad.
    pub(super) fn lit(
        &self,
        place: &Place,
        light: [f64; 3],
        (width, seen): (f64, &Seen),
        accuracy: &Accuracy,
        memory: &mut Memory,
    ) -> [f64; 3] {
        let view = place.view;
        if light[2] <= 0.0 || view[2] <= 0.0 {
            return [0.0; 3];
        }
        let [covered, below] = self.shares(place.uv, [view[2], light[2]]);
        let mut sum = [0.0; 3];
        if let Some(base) = self.base.as_ref().filter(|_| below > 0.0) {
            let f = self.surface(base, place.uv).scattered(light, view);
            add(&mut sum, xyz([0, 1, 2].map(|c| f[c] * seen.rgb[c])), below);
        }
        if let Some(top) = self.diffraction.as_ref().filter(|_| covered > 0.0) {
            add(&mut sum, top.lit(place, light, (width, seen), accuracy, memory), covered);
            if self.base.is_some() && top.is_masked(place.uv) {
                // What does not diffract is base.
                let f = self.base.as_ref().map_or([0.0; 3], |b| self.surface(b, place.uv).scattered(light, view));
                add(&mut sum, xyz([0, 1, 2].map(|c| f[c] * seen.rgb[c])), 1.0 - below);
            }
        }
        sum
    }

    /// X, Y, Z of what is seen of an environment.
    pub(super) fn under(
        &self,
        place: &Place,
        above: &Above,
        random: &mut Stream,
        accuracy: &Accuracy,
        memory: &mut Memory,
    ) -> [f64; 3] {
        let view = place.view;
        let mut sum = [0.0; 3];
        if view[2] <= 0.0 {
            return sum;
        }
        let masked = self.diffraction.as_ref().is_some_and(|d| d.is_masked(place.uv));
        if let Some(base) = &self.base {
            let surface = self.surface(base, place.uv);
            let value = |light: [f64; 3], rgb: [f64; 3]| {
                let share = if masked { 1.0 } else { self.shares(place.uv, [view[2], light[2]])[1] };
                let f = surface.scattered(light, view);
                xyz([0, 1, 2].map(|c| f[c] * rgb[c])).map(|v| v * share)
            };
            let drawn = surface.sample(view, random.numbers());
            let part = both_ways(above, random, value, (drawn[2] > 0.0).then_some(drawn), |l| surface.density(l, view));
            add(&mut sum, part, 1.0);
        }
        if let Some(top) = self.diffraction.as_ref().filter(|_| !masked) {
            let [covered, _] = self.shares(place.uv, [view[2]; 2]);
            if covered > 0.0 {
                add(&mut sum, top.under(place, above, random, accuracy, memory), covered);
            }
        }
        sum
    }
}

/// An environment by multiple importance sampling with the balance heuristic (Veach and Guibas 1995): a direction of the environment's, and one of
/// the surface's own. `value` is BRDF times cosine times radiance.
fn both_ways(
    above: &Above,
    random: &mut Stream,
    mut value: impl FnMut([f64; 3], [f64; 3]) -> [f64; 3],
    drawn: Option<[f64; 3]>,
    density: impl Fn([f64; 3]) -> f64,
) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let (towards, rgb, bright) = above.sky.sample(random.numbers());
    let local = above.frame.map(|f| f.dot(&towards));
    let all = bright + density(local);
    if local[2] > 0.0 && all > 0.0 && (above.open)(towards) {
        add(&mut sum, value(local, rgb), 1.0 / all);
    }
    if let Some(local) = drawn {
        let own = density(local);
        let all = own + above.sky.density(above.direction(local));
        if own > 0.0 && all > 0.0 {
            add(&mut sum, value(local, above.radiance(local)), 1.0 / all);
        }
    }
    sum
}

impl Diffraction {
    fn new(
        key: &str,
        of: &scene::Diffraction,
        folder: &Path,
        observer: Observer,
        accuracy: &Accuracy,
        notes: &mut Notes,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let sub = |what: &str| format!("{key}.{what}");
        let degrees = |what: &str, v: f64| number(&sub(what), v, [-3600.0, 3600.0]).map(f64::to_radians);
        let sigma = |um: f64| number(&sub("coherence_um"), um, [1.0, 1e4]).and_then(|um| Ok(Window::new(um)?.sigma));
        let known = |r: &Reflectance| r.check(crate::surface::RANGE_NM);
        notes.predicted_error = 2.0 * accuracy.error;
        match of {
            scene::Diffraction::Grating {
                relief,
                period_um,
                orientation_deg,
                maps,
                repeat,
                coherence_um,
                reflectance,
            } => {
                known(reflectance)?;
                let maps = match maps {
                    Some(path) => {
                        for r in repeat {
                            number(&sub("repeat"), *r, [1e-3, 1e6])?;
                        }
                        Some(Grooves::read(&folder.join(path), *repeat)?)
                    }
                    None => None,
                };
                let period = period_um.map(|p| number(&sub("period_um"), p, PERIODS)).transpose()?;
                let orientation = orientation_deg.map(|d| degrees("orientation_deg", d)).transpose()?;
                let has = maps.as_ref().map_or([false; 2], Grooves::has);
                for (what, given, mapped) in
                    [("orientation_deg", orientation.is_some(), has[0]), ("period_um", period.is_some(), has[1])]
                {
                    if given == mapped {
                        let problem = if given { "is given and in the maps" } else { "is missing" };
                        return Err(Error::input(sub(what), problem, "give it, or a map of it"));
                    }
                }
                let longest = maps.as_ref().map_or(0.0, |m| m.longest_um).max(period.unwrap_or(0.0));
                number(&sub("maps"), longest, PERIODS)?;
                let grating = Self::grating(key, relief, longest, sigma(*coherence_um)?, reflectance, accuracy, notes)?;
                Ok(Self::Grating { grating, same: [orientation, period], maps, disc: false })
            }
            scene::Diffraction::Cd { period_um, relief, coherence_um, reflectance } => {
                known(reflectance)?;
                let period = number(&sub("period_um"), *period_um, PERIODS)?;
                let grating = Self::grating(key, relief, period, sigma(*coherence_um)?, reflectance, accuracy, notes)?;
                Ok(Self::Grating { grating, same: [None, Some(period)], maps: None, disc: true })
            }
            scene::Diffraction::Multislit { spacing_um, width_um, count, orientation_deg, disc } => {
                let slits = Slits { spacing_um: *spacing_um, width_um: *width_um, count: *count };
                notes.method = "sum over slits (2017 paper, Eq. 16), orders balanced".into();
                Ok(Self::Comb(Comb::new(slits, degrees("orientation_deg", *orientation_deg)?, *disc)?))
            }
            scene::Diffraction::Lattice { period_um, aperture_um, orientation_deg, coherence_um, reflectance } => {
                known(reflectance)?;
                sigma(*coherence_um)?;
                notes.method = "orders of a lattice of rectangles".into();
                let turn = degrees("orientation_deg", *orientation_deg)?;
                let light = (*coherence_um, reflectance.clone());
                Ok(Self::Lattice(Lattice::new(key, *period_um, *aperture_um, turn, light)?))
            }
            scene::Diffraction::Table { file, albedo, lossless } => {
                let albedo = number(&sub("albedo"), *albedo, [0.0, 1.0])?;
                let table = Table::read(&folder.join(file), observer, albedo, *lossless)?;
                notes.method = "table over half vectors, per channel".into();
                if table.unknown > 0.0 {
                    let percent = 100.0 * table.unknown;
                    notes.warnings.push(format!("{percent:.1} % of the table are not known and count as dark"));
                }
                Ok(Self::Table(Box::new(table)))
            }
            scene::Diffraction::Heightfield {
                file,
                pixel_um,
                range_um,
                orientation_deg,
                coherence_um,
                reflectance,
                lossless,
            } => {
                known(reflectance)?;
                sigma(*coherence_um)?;
                let field = height::read(&folder.join(file), &Scale { pixel_um: *pixel_um, range_um: *range_um })?;
                let turn = degrees("orientation_deg", *orientation_deg)?;
                let light = (*coherence_um, reflectance.clone());
                let relief = Relief::new(&field, light, (turn, *lossless), accuracy.error, progress)?;
                notes.method = format!("Stam's BRDF of the height field: {}", relief.why);
                notes.predicted_error += relief.error;
                Ok(Self::Relief(Box::new(relief)))
            }
        }
    }

    fn grating(
        key: &str,
        relief: &scene::Relief,
        longest_um: f64,
        sigma: f64,
        reflectance: &Reflectance,
        accuracy: &Accuracy,
        notes: &mut Notes,
    ) -> Result<Grating> {
        let depth_um = number(&format!("{key}.relief.depth_um"), relief.depth_um, DEPTHS)?;
        if let height::Profile::Rectangular { duty } = relief.profile {
            number(&format!("{key}.relief.profile"), duty, [0.0, 1.0])?;
        }
        let section = Section::Formula { profile: relief.profile, depth_um };
        let grating = Grating::new(&section, longest_um, sigma, reflectance.clone(), accuracy.error);
        notes.orders = Some(grating.orders);
        notes.predicted_error += grating.left_out;
        notes.method = format!(
            "exact orders, balanced: ±{} hold all but {:.2e} of the light at any direction; exact ones cost what a first-order theory's cost",
            grating.orders, grating.left_out
        );
        Ok(grating)
    }

    /// Reflectance of the smooth material in the middle of the spectrum.
    fn reflectance(&self, cos: f64) -> f64 {
        match self {
            Self::Grating { grating, .. } => grating.reflectance.at(cos, 550.0),
            _ => 1.0,
        }
    }

    fn groove(&self, uv: [f64; 2]) -> Option<Groove> {
        let Self::Grating { same, maps, disc, .. } = self else { return None };
        if *disc {
            return Some(Groove { across: radial(uv)?, period_um: same[1]? });
        }
        let [orientation, period_um] = match maps {
            Some(maps) => {
                let found = maps.at(uv)?;
                [found[0].or(same[0])?, found[1].or(same[1])?]
            }
            None => [same[0]?, same[1]?],
        };
        let (sin, cos) = orientation.sin_cos();
        Some(Groove { across: [cos, sin], period_um })
    }

    /// Whether nothing diffracts at a place.
    fn is_masked(&self, uv: [f64; 2]) -> bool {
        matches!(self, Self::Grating { .. }) && self.groove(uv).is_none()
    }

    fn lit(
        &self,
        place: &Place,
        light: [f64; 3],
        (width, seen): (f64, &Seen),
        accuracy: &Accuracy,
        memory: &mut Memory,
    ) -> [f64; 3] {
        let pair = [place.view, light];
        let f = match self {
            Self::Grating { grating, .. } => match self.groove(place.uv) {
                Some(groove) => lit(grating, groove, pair, (width, seen), accuracy, &mut memory.scratch),
                None => return [0.0; 3],
            },
            Self::Comb(comb) => comb.lit(place.uv, pair, (width, seen), accuracy, &mut memory.scratch),
            Self::Lattice(lattice) => lattice.lit(pair, (width, seen), accuracy),
            Self::Table(table) => {
                let rgb = table.scattered(light, place.view);
                return xyz([0, 1, 2].map(|c| rgb[c] * seen.rgb[c]));
            }
            Self::Relief(relief) => return relief.lit(pair, seen, accuracy, &mut memory.workspace),
        };
        f.map(|v| v * light[2])
    }

    fn under(
        &self,
        place: &Place,
        above: &Above,
        random: &mut Stream,
        accuracy: &Accuracy,
        memory: &mut Memory,
    ) -> [f64; 3] {
        let view = place.view;
        let spectrum = RANGE[1] - RANGE[0];
        match self {
            Self::Grating { grating, .. } => match self.groove(place.uv) {
                Some(groove) => under(above, (grating, groove), view, random.numbers(), accuracy, &mut memory.scratch),
                None => [0.0; 3],
            },
            Self::Comb(comb) => comb.under(above, (place.uv, view), random.numbers(), accuracy, &mut memory.scratch),
            Self::Lattice(lattice) => {
                // One order for each of some wave numbers.
                const COUNT: usize = 16;
                let mut sum = [0.0; 3];
                let shift = random.next();
                for k in 0..COUNT {
                    let number = RANGE[0] + spectrum * (k as f64 + shift) / COUNT as f64;
                    let (from, power) = lattice.sample(view, number, random.numbers());
                    let rgb = above.radiance(from);
                    let colors = above.sky.upsampling.at(number);
                    for (color, part) in rgb.iter().zip(&colors) {
                        add(&mut sum, *part, color * power * spectrum / COUNT as f64);
                    }
                }
                sum
            }
            Self::Table(table) => {
                let value = |light: [f64; 3], rgb: [f64; 3]| {
                    let f = table.scattered(light, view);
                    xyz([0, 1, 2].map(|c| f[c] * rgb[c]))
                };
                let drawn = table.sample(view, random.numbers());
                both_ways(above, random, value, drawn, |l| if l[2] > 0.0 { table.density(l, view) } else { 0.0 })
            }
            Self::Relief(relief) => {
                const COUNT: usize = 4;
                let mut sum = [0.0; 3];
                let shift = random.next();
                for k in 0..COUNT {
                    let number = RANGE[0] + spectrum * (k as f64 + shift) / COUNT as f64;
                    let colors = above.sky.upsampling.at(number);
                    let workspace = &mut memory.workspace;
                    let value = |light: [f64; 3], rgb: [f64; 3]| {
                        let f = relief.at(light, view, number, workspace) * spectrum / COUNT as f64;
                        let mut part = [0.0; 3];
                        for (color, weights) in rgb.iter().zip(&colors) {
                            add(&mut part, *weights, color * f);
                        }
                        part
                    };
                    let drawn = relief.sample(view, number, random.numbers());
                    let density = |l: [f64; 3]| if l[2] > 0.0 { relief.density(l, view, number) } else { 0.0 };
                    add(&mut sum, both_ways(above, random, value, drawn, density), 1.0);
                }
                sum
            }
        }
    }
}
