//! Prepared materials.

pub(crate) mod base;
pub(crate) mod diffraction;
mod light_pool;
mod notes;
pub(crate) mod shading;
pub(crate) mod texture;

pub use notes::Notes;
pub use shading::{SAMPLES, WELL_SPREAD};

use crate::light::Source;
use crate::scene::{self, Blend};
use base::Surface;
use diffraction::Diffraction;
use diffraction::memory::Memory;
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_optics::color::Observer;
use shading::{Above, Accuracy, Place, add, pooled};
use std::path::Path;
use texture::Over;

/// Directions that a base samples under an environment, from the environment's density and as many from its BRDF:
/// together cheaper than tracing two.
const BASE: usize = 4;

/// A material.
pub(crate) struct Material {
    pub base: Option<Base>,
    pub diffraction: Option<Diffraction>,
    pub coverage: Over<1>,
    pub blend: Blend,
    pub normals: Option<Over<3>>,
    /// Notes for reports.
    pub notes: Notes,
}

/// The scattering base.
pub(crate) struct Base {
    pub albedo: Over<3>,
    pub roughness: Over<1>,
    pub specular: [f64; 3],
}

impl Base {
    fn surface(&self, uv: [f64; 2]) -> Surface {
        let [alpha] = self.roughness.at(uv);
        Surface { albedo: self.albedo.at(uv), specular: self.specular, alpha }
    }

    /// X, Y, Z of the reflection of an environment; `share` weights light by its cosine.
    pub(crate) fn under(
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
        let own = |u: [f64; 3]| Some(surface.sample(view, u)).filter(|light| light[2] > 0.0);
        let numbers = (random.numbers(), random.numbers(), random.next());
        pooled::<BASE, 3>(above, numbers, value, own, |l| surface.density(l, view))
    }
}

/// Scene-wide inputs of materials.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    /// Folder of the scene's files.
    pub folder: &'a Path,
    pub observer: Observer,
    pub accuracy: &'a Accuracy,
    /// Whether there is an environment.
    pub under: bool,
    pub progress: &'a dyn Progress,
}

impl Material {
    /// Prepares a described material; parts may be shared with `like`, the same material prepared for another accuracy.
    ///
    /// # Errors
    /// `Input` for invalid values and files.
    pub(crate) fn new(name: &str, material: &scene::Material, context: &Context, like: Option<&Self>) -> Result<Self> {
        let folder = context.folder;
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
                let like = like.and_then(|like| like.diffraction.as_ref());
                Some(Diffraction::new(&key("diffraction"), of, context, like, &mut notes)?)
            }
            None => None,
        };
        if notes.method.is_empty() {
            notes.method = "diffuse and glossy".into();
        }
        let normals = material.normals.as_ref().map(|file| texture::normals(&folder.join(file))).transpose()?;
        let (coverage, warnings) = texture::coverage(&key("coverage"), &material.coverage, folder)?;
        notes.warnings.extend(warnings);
        Ok(Self { base, diffraction, coverage, blend: material.blend, normals, notes })
    }

    /// Whether it depends on the direction of u.
    pub(crate) fn needs_tangents(&self) -> bool {
        self.diffraction.is_some() || self.normals.is_some()
    }

    /// The normal at a point in its shape's frame, if it differs from the shape's normal.
    pub(crate) fn normal(&self, uv: [f64; 2]) -> Option<[f64; 3]> {
        self.normals.as_ref().map(|n| n.at(uv))
    }

    /// Transmittance through the diffracting layer to the base and back, at the cosines of both directions. A grating's
    /// reflectance at the centre of the spectrum is used for its top. `None` if the layer is opaque.
    pub(crate) fn through(&self, cosines: [f64; 2]) -> Option<f64> {
        match (&self.diffraction, self.blend) {
            (Some(Diffraction::Grating { grating, .. }), Blend::Fresnel) => {
                Some(cosines.iter().map(|cos| 1.0 - grating.reflectance.at(*cos, 550.0)).product())
            }
            _ => None,
        }
    }

    /// Diffracting share and visible share of the base, at a direction of view (and of light, for the Fresnel blend).
    fn shares(&self, uv: [f64; 2], cosines: [f64; 2]) -> [f64; 2] {
        if self.diffraction.is_none() {
            return [0.0, 1.0];
        }
        let [covered] = self.coverage.at(uv);
        [covered, 1.0 - covered + covered * self.through(cosines).unwrap_or(0.0)]
    }

    /// X, Y, Z of the reflection of a light with illuminance 1 on a surface that faces it.
    pub(crate) fn lit(&self, place: &Place, source: &Source, accuracy: &Accuracy, memory: &mut Memory) -> [f64; 3] {
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
                // The rest of the surface is base.
                let f = self.base.as_ref().map_or([0.0; 3], |b| b.surface(place.uv).scattered(light, view));
                add(&mut sum, seen.reflected(f), 1.0 - below);
            }
        }
        sum
    }

    /// X, Y, Z of the reflection of an environment.
    pub(crate) fn under(
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
