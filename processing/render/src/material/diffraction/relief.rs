//! Measured height fields in a scene: Stam's BRDF by the cheapest method of the required accuracy (see [`nacre_brdf`]).

use crate::light::Source;
use crate::material::diffraction::albedo_normalisation::{AlbedoNormalisation, sides};
use crate::material::diffraction::light_sampler::LightSampler;
use crate::material::diffraction::lobes::{along, half_cos};
use crate::material::diffraction::power_table::PowerTable;
use crate::material::light_pool::{self, Candidate, Pool, even};
use crate::material::shading::{Above, Accuracy, add};
use crate::vector::V3;
use nacre_base::Result;
use nacre_base::progress::{Progress, Silent};
use nacre_base::random::Stream;
use nacre_brdf::{Densities, HeightField, Reflectance, Settings, TermSet, TermsRequest, Workspace};
use nacre_image::Precision;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Longest coherence length in µm for sums over environment light, and for the albedo.
const COARSE_UM: f64 = 32.0;
const NORM_UM: f64 = 8.0;

/// Smallest error that single-precision terms can meet.
const SINGLE: f64 = 1e-3;

/// Wave numbers per sample under an environment, directions per wave number drawn from the environment, and directions
/// drawn from the patch; few of them are selected.
const NUMBERS: usize = 4;
const CANDIDATES: usize = 6;

/// Importance sampling of an environment.
struct SkySums {
    sampler: Arc<LightSampler>,
    /// Power densities; `None` if no table is accurate enough, in which case [`Relief::coarse`] is used.
    table: Option<Arc<PowerTable>>,
}

/// A prepared height field.
pub(crate) struct Relief {
    field: HeightField,
    coherence_um: f64,
    densities: Densities,
    /// Densities with a coherence length short enough for sums over the frequencies of the patch.
    coarse: Densities,
    pub reflectance: Reflectance,
    /// Direction of the patch's axes.
    pub turn: [f64; 2],
    norm: Arc<AlbedoNormalisation>,
    /// For scenes with an environment.
    sky: Option<SkySums>,
    pub lossless: bool,
    /// Description of the method.
    pub why: String,
    /// Predicted error of lobes with at least a thousandth of the light.
    pub error: f64,
}

impl SkySums {
    fn new(field: &HeightField, coarse: &Densities, error: f64, progress: &dyn Progress) -> Result<Self> {
        let depth = field.range_um();
        let table = PowerTable::new(coarse, depth, error, progress)?.map(Arc::new);
        let sampler = LightSampler::new(field.size_um(), depth, |f, q, w| match &table {
            Some(table) => table.at(f, q),
            None => coarse.at(f, q, w),
        });
        progress.check()?;
        Ok(Self { sampler: Arc::new(sampler), table })
    }

    /// The same relief for another error. The table is dropped if its error is larger, so that a comparison of both
    /// reliefs includes it.
    fn within(&self, error: f64) -> Self {
        let table = self.table.clone().filter(|table| table.error <= error);
        Self { sampler: Arc::clone(&self.sampler), table }
    }
}

impl Relief {
    /// Prepares a height field. `like` is the same one prepared for another error, if any; `under` states whether the
    /// scene has an environment.
    ///
    /// # Errors
    /// `Input` if its pitch is too coarse.
    pub(crate) fn new(
        field: &HeightField,
        (coherence_um, reflectance): (f64, Reflectance),
        (orientation, lossless): (f64, bool),
        (error, under): (f64, bool),
        like: Option<&Self>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let error = error.clamp(1e-4, 0.2);
        let densities = Densities::new(field, coherence_um, error, 1e7, progress)?;
        let size = field.size_um();
        let short = 0.5 * size[0].min(size[1]);
        let short = |most: f64| Densities::new(field, short.clamp(1.0, most), error, 1e7, &Silent);
        let coarse = short(COARSE_UM)?;
        let (sin, cos) = orientation.sin_cos();
        let (why, predicted) = (densities.choice.why.clone(), densities.choice.predicted_error);
        let (norm, sky) = if let Some(like) = like {
            (Arc::clone(&like.norm), like.sky.as_ref().map(|sky| sky.within(error)))
        } else {
            let shortest = short(NORM_UM)?;
            let norm = AlbedoNormalisation::new(&shortest, sides(field, &shortest), field.range_um(), progress)?;
            let sky = if under { Some(SkySums::new(field, &coarse, error, progress)?) } else { None };
            (Arc::new(norm), sky)
        };
        Ok(Self {
            field: field.clone(),
            coherence_um,
            densities,
            coarse,
            reflectance,
            turn: [cos, sin],
            norm,
            sky,
            lossless,
            why,
            error: predicted,
        })
    }

    /// Terms of its phase expansion for graphics cards, with a density error below `error`, or below the limit of
    /// single precision for deep fields.
    ///
    /// # Errors
    /// As [`TermSet::new`].
    pub(crate) fn terms(&self, error: f64, progress: &dyn Progress) -> Result<TermSet> {
        let settings =
            Settings { coherence_um: self.coherence_um, max_error: error.clamp(SINGLE, 0.2), ..Settings::default() };
        let wanted = TermsRequest { extent: 2.0, precision: Some(Precision::Float) };
        TermSet::new(&self.field, &settings, wanted, progress)
    }

    /// Width and height of the patch in µm.
    pub(crate) fn size_um(&self) -> [f64; 2] {
        self.field.size_um()
    }

    /// Standard deviation of a lobe in 1/µm.
    pub(crate) fn sigma(&self) -> f64 {
        self.densities.window.sigma
    }

    /// Standard deviation of a lobe in sums over environment light, in 1/µm.
    pub(crate) fn sigma_under(&self) -> f64 {
        self.coarse.window.sigma
    }

    /// Albedo normalisation over directions of view.
    pub(crate) fn norm(&self) -> &AlbedoNormalisation {
        &self.norm
    }

    /// Transforms a direction into the patch's frame.
    fn own(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [cos, sin] = self.turn;
        [cos * x + sin * y, cos * y - sin * x, z]
    }

    /// Transforms a direction from the patch's frame.
    fn scene(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [cos, sin] = self.turn;
        [cos * x - sin * y, sin * x + cos * y, z]
    }

    /// Divisor for a direction of view, times its cosine, from its albedo times the cosine.
    fn divided_by(&self, albedo: f64, view: [f64; 3]) -> f64 {
        if self.lossless { albedo.max(1e-9) } else { albedo.max(view[2]) }
    }

    /// BRDF times the cosine of incidence at a wave number, in the patch's frame, before the reflectance and
    /// [`Self::divided_by`].
    fn value(&self, light: [f64; 3], view: [f64; 3], number: f64, density: impl FnOnce([f64; 2], f64) -> f64) -> f64 {
        let f = [0, 1].map(|k| (light[k] + view[k]) * number);
        let density = density(f, TAU * number * (light[2] + view[2]));
        density * number * number * gain(light, view)
    }

    /// BRDF times the cosine of incidence for a point of a small light, integrated over its spectrum: X, Y, Z.
    pub(crate) fn lit(&self, view: [f64; 3], source: &Source, accuracy: &Accuracy, w: &mut Workspace) -> [f64; 3] {
        let (view, light, seen) = (self.own(view), self.own(source.drawn()), source.seen);
        if light[2] <= 0.0 {
            return [0.0; 3];
        }
        let tangent = (light[0] + view[0]).hypot(light[1] + view[1]);
        let width = self.densities.window.sigma / tangent.max(1e-9);
        along(seen, seen.range(), width, accuracy, |number| {
            let value = self.value(light, view, number, |f, q| self.densities.at(f, q, w));
            if value <= 0.0 {
                return 0.0;
            }
            let reflected = self.reflectance.at(half_cos(light, view), 1e3 / number);
            value * reflected / self.divided_by(self.norm.at(view, number), view)
        })
    }

    /// Light of an environment: X, Y, Z. At each of [`NUMBERS`] wave numbers, directions are drawn from the densities
    /// of the environment and of the patch, and weighted by the balance heuristic. [`Pool`] selects few of them by
    /// their estimated light; only these are traced through the scene.
    pub(crate) fn under(&self, view: [f64; 3], above: &Above, random: &mut Stream, w: &mut Workspace) -> [f64; 3] {
        let (mut sum, Some(sky)) = ([0.0; 3], &self.sky) else { return [0.0; 3] };
        let view = self.own(view);
        let [least, most] = above.sky.upsampling.range();
        let step = (most - least) / NUMBERS as f64;
        let (at, own, shift): ([f64; 2], [f64; 3], f64) = (random.numbers(), random.numbers(), random.next());
        for k in 0..NUMBERS {
            let number = least + step * (k as f64 + shift);
            let sight = sky.sampler.sight(view, number);
            const { assert!(2 * CANDIDATES <= light_pool::MOST) }
            let mut pool = Pool::new();
            let mut put = |light: [f64; 3], towards: V3, rgb: [f64; 3], bright: f64| {
                let own = sky.sampler.density(&sight, light);
                let over = 1.0 / (CANDIDATES as f64 * (bright + own));
                let weight = rgb.iter().sum::<f64>() * own * over;
                pool.add(Candidate { local: light, towards, part: rgb.map(|c| c * over), weight });
            };
            for n in k * CANDIDATES..(k + 1) * CANDIDATES {
                let (towards, rgb, bright) = above.sky.sample(even(at, n));
                let light = self.own(above.frame.map(|f| f.dot(&towards)));
                if light[2] > 0.0 {
                    put(light, towards, rgb, bright);
                }
                if let Some(light) = sky.sampler.sample(&sight, even(own, n)) {
                    let towards = above.direction(self.scene(light));
                    put(light, towards, above.sky.radiance(towards), above.sky.density(towards));
                }
            }
            let colors = above.sky.upsampling.at(number);
            let share = step / self.divided_by(self.norm.at(view, number), view);
            pool.chosen(random.next(), |one, factor| {
                if !(above.open)(one.towards) {
                    return;
                }
                let value = match &sky.table {
                    Some(table) => self.value(one.local, view, number, |f, q| table.at(f, q)),
                    None => self.value(one.local, view, number, |f, q| self.coarse.at(f, q, w)),
                };
                let value = value * self.reflectance.at(half_cos(one.local, view), 1e3 / number) * share * factor;
                for (part, color) in one.part.iter().zip(&colors) {
                    add(&mut sum, *color, part * value);
                }
            });
        }
        sum
    }
}

/// Stam's gain times both cosines: `(1 + ωi·ωo)² / w²`.
fn gain(light: [f64; 3], view: [f64; 3]) -> f64 {
    let dot: f64 = (0..3).map(|k| light[k] * view[k]).sum();
    let w = light[2] + view[2];
    (1.0 + dot).powi(2) / (w * w)
}
