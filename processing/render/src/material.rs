//! Materials ready for light.

use super::base::Surface;
use super::diffraction::Diffraction;
use super::grating::Scratch;
use super::light::Source;
use super::lobes::{Above, Accuracy, Kept};
use super::scene::{self, Blend};
use super::texture::{self, Over};
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_brdf::Workspace;
use nacre_optics::color::Observer;
use std::path::Path;

/// Memory of one thread.
#[derive(Default)]
pub(super) struct Memory {
    pub scratch: Scratch,
    pub kept: Kept,
    pub workspace: Workspace,
}

/// A material.
pub(super) struct Material {
    pub base: Option<Base>,
    pub diffraction: Option<Diffraction>,
    pub coverage: Over<1>,
    pub blend: Blend,
    pub normals: Option<Over<3>>,
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
    /// Part of a grating's light that scalar theory, balanced, has in a wrong order: about, at 45°, against Maxwell's equations for a perfect
    /// conductor. No sampling mends it, so that it is no part of what is met.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub theory_error: Option<f64>,
    /// What is to be known.
    pub warnings: Vec<String>,
}

/// What scatters.
pub(super) struct Base {
    pub albedo: Over<3>,
    pub roughness: Over<1>,
    pub specular: [f64; 3],
}

impl Base {
    fn surface(&self, uv: [f64; 2]) -> Surface {
        let [alpha] = self.roughness.at(uv);
        Surface { albedo: self.albedo.at(uv), specular: self.specular, alpha }
    }

    /// X, Y, Z of what is seen of an environment; of light at a cosine a share counts.
    pub(super) fn under(
        &self,
        place: &Place,
        above: &Above,
        random: &mut Stream,
        share: impl Fn(f64) -> f64,
    ) -> [f64; 3] {
        let (surface, view) = (self.surface(place.uv), place.view);
        let value = |light: [f64; 3], rgb: [f64; 3]| {
            let f = surface.scattered(light, view);
            above.sky.upsampling.seen([0, 1, 2].map(|c| f[c] * rgb[c])).map(|v| v * share(light[2]))
        };
        let drawn = surface.sample(view, random.numbers());
        both_ways(above, random, value, (drawn[2] > 0.0).then_some(drawn), |l| surface.density(l, view))
    }
}

/// A place that is looked at.
pub(super) struct Place {
    pub uv: [f64; 2],
    /// Direction of view in the place's frame.
    pub view: [f64; 3],
}

/// Adds a part.
pub(super) fn add(sum: &mut [f64; 3], part: [f64; 3], weight: f64) {
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

    /// Part of light that comes through what diffracts to the base and out again, at the cosines of its directions (a grating's reflectance in the
    /// middle of the spectrum is taken for that of its top); None where nothing comes through.
    pub(super) fn through(&self, cosines: [f64; 2]) -> Option<f64> {
        match (&self.diffraction, self.blend) {
            (Some(Diffraction::Grating { grating, .. }), Blend::Fresnel) => {
                Some(cosines.iter().map(|cos| 1.0 - grating.reflectance.at(*cos, 550.0)).product())
            }
            _ => None,
        }
    }

    /// Part that diffracts, and what of the base is seen, at a direction of view (and, blended by Fresnel, of light).
    fn shares(&self, uv: [f64; 2], cosines: [f64; 2]) -> [f64; 2] {
        if self.diffraction.is_none() {
            return [0.0, 1.0];
        }
        let [covered] = self.coverage.at(uv);
        [covered, 1.0 - covered + covered * self.through(cosines).unwrap_or(0.0)]
    }

    /// X, Y, Z of what is seen of a light of illuminance 1 on what faces it.
    pub(super) fn lit(&self, place: &Place, source: &Source, accuracy: &Accuracy, memory: &mut Memory) -> [f64; 3] {
        let Source { light, seen, .. } = *source;
        let view = place.view;
        if light[2] <= 0.0 || view[2] <= 0.0 {
            return [0.0; 3];
        }
        let [covered, below] = self.shares(place.uv, [view[2], light[2]]);
        let mut sum = [0.0; 3];
        if let Some(base) = self.base.as_ref().filter(|_| below > 0.0) {
            let f = base.surface(place.uv).scattered(light, view);
            add(&mut sum, seen.reflected(f), below);
        }
        if let Some(top) = self.diffraction.as_ref().filter(|_| covered > 0.0) {
            add(&mut sum, top.lit(place, source, accuracy, memory), covered);
            if self.base.is_some() && top.is_masked(place.uv) {
                // What does not diffract is base.
                let f = self.base.as_ref().map_or([0.0; 3], |b| b.surface(place.uv).scattered(light, view));
                add(&mut sum, seen.reflected(f), 1.0 - below);
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
            let share = |cos: f64| if masked { 1.0 } else { self.shares(place.uv, [view[2], cos])[1] };
            add(&mut sum, base.under(place, above, random, share), 1.0);
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
pub(super) fn both_ways(
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
