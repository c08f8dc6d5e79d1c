//! Prepared scenes: shapes, materials and lights for ray tracing, and the light along a ray.

pub(crate) mod camera;
pub(crate) mod flat;
pub(crate) mod two_pass;

use crate::light::spectrum::Upsampling;
use crate::light::viewer::{Bands, Viewer};
use crate::light::{Lamp, Sky, Source};
use crate::material::diffraction::Diffraction;
use crate::material::diffraction::memory::Memory;
use crate::material::shading::{Above, Accuracy, Place};
use crate::material::{Context, Material, Notes};
use crate::scene::{self, Scene};
use crate::shape::ray::{Hit, Ray};
use crate::shape::{Form, Placed};
use crate::vector::{V3, number};
use camera::Camera;
use flat::Flat;
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_image::budget::Operation;
use nacre_image::{Depth, Info};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use two_pass::{Seen, TwoPass};

/// Maximum number of shapes, and of lights, of a scene.
const MAX_THINGS: usize = 1000;

/// Positions along a side of the picture at which directions of view are sampled.
const VIEWED: usize = 48;

/// A prepared scene.
pub(crate) struct PreparedScene {
    pub camera: Camera,
    pub shapes: Vec<Placed>,
    pub materials: Vec<Material>,
    pub lamps: Vec<Lamp>,
    pub skies: Vec<Sky>,
    /// Precomputed reflections of the skies by shapes.
    pub flats: Vec<Option<Flat>>,
    /// Filtered skies of shapes that are rendered by two passes.
    pub two_passes: Vec<Option<Arc<TwoPass>>>,
    pub accuracy: Accuracy,
    pub viewer: Viewer,
    /// Method of each material.
    pub notes: BTreeMap<String, Notes>,
    pub warnings: Vec<String>,
}

/// Checks the scene without its files.
pub(crate) fn check(scene: &Scene) -> Result<()> {
    let Scene { camera, shape, light, exposure, .. } = scene;
    if shape.is_empty() {
        return Err(Error::input("shape", "is none", "give at least one [[shape]]"));
    }
    if shape.len() > MAX_THINGS || light.len() > MAX_THINGS {
        let problem = format!("has {} shapes and {} lights", shape.len(), light.len());
        return Err(Error::input("scene", problem, format!("give at most {MAX_THINGS}")));
    }
    if let Some(exposure) = exposure {
        number("exposure", *exposure, [1e-12, 1e12])?;
    }
    let [width, height] = [camera.width, camera.height];
    Camera::new(camera, 0.0)?;
    let picture = Info { width, height, channels: 3, depth: Depth::F32 };
    Operation::Rendering(1).check(Path::new("camera"), picture).map(drop)
}

impl PreparedScene {
    /// Prepares a scene whose files are in `folder`; the error of sums is below that of the accuracy.
    ///
    /// # Errors
    /// `Input` for invalid values, with the key or file.
    pub(crate) fn new(scene: &Scene, folder: &Path, accuracy: Accuracy, progress: &dyn Progress) -> Result<Self> {
        Self::like(None, scene, folder, accuracy, progress)
    }

    /// Prepares a scene for another accuracy. Independent parts of materials are shared with `like`, an earlier
    /// preparation of the scene.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn like(
        like: Option<&Self>,
        scene: &Scene,
        folder: &Path,
        accuracy: Accuracy,
        progress: &dyn Progress,
    ) -> Result<Self> {
        check(scene)?;
        let Scene { camera, shape, light, material, turn, observer, .. } = scene;
        let angle = |what: &str, deg: f64| number(what, deg, [-1e6, 1e6]).map(f64::to_radians);
        let sample = angle("turn.sample_deg", turn.sample_deg)?;
        let lights = angle("turn.light_deg", turn.light_deg)?;
        let camera = Camera::new(camera, angle("turn.view_deg", turn.view_deg)?)?;
        progress.stage("reading the scene", (shape.len() + light.len() + material.len()) as u64);
        let viewer = Viewer::from(*observer);
        let (mut lamps, mut skies) = (vec![], vec![]);
        for (k, light) in light.iter().enumerate() {
            let name = format!("light[{k}]");
            lamps.extend(Lamp::new(&name, light, folder, viewer, (lights, accuracy.error))?);
            skies.extend(Sky::new(&name, light, folder, viewer, (lights, accuracy.error))?);
            progress.step();
            progress.check()?;
        }
        let (mut materials, mut names, mut notes, mut warnings) = (vec![], vec![], BTreeMap::new(), vec![]);
        let context = Context { folder, observer: *observer, accuracy: &accuracy, under: !skies.is_empty(), progress };
        for (k, (name, of)) in material.iter().enumerate() {
            if !shape.iter().any(|s| s.material() == name) {
                warnings.push(format!("no shape is made of {name}"));
            }
            let made = Material::new(name, of, &context, like.and_then(|like| like.materials.get(k)))?;
            notes.insert(name.clone(), made.notes.clone());
            warnings.extend(made.notes.warnings.iter().map(|w| format!("material {name}: {w}")));
            materials.push(made);
            names.push(name);
            progress.step();
            progress.check()?;
        }
        let mut shapes = vec![];
        for (k, of) in shape.iter().enumerate() {
            let name = format!("shape[{k}]");
            let Some(index) = names.iter().position(|n| *n == of.material()) else {
                let problem = format!("is {:?}, which is described nowhere", of.material());
                return Err(Error::input(format!("{name}.material"), problem, "add [material.NAME]"));
            };
            let form = Form::new(&name, of, folder, sample)?;
            if let (Form::Mesh(mesh), scene::Shape::Mesh { file, .. }) = (&form, of) {
                let path = folder.join(file);
                if !mesh.tangents && materials[index].needs_tangents() {
                    let problem =
                        "has neither tangents nor texture coordinates, so that nobody knows where grooves run";
                    return Err(Error::file(&path, problem, "add texture coordinates, or give it a material without"));
                }
                warnings.extend(mesh.left_out.warnings().iter().map(|words| format!("{}: {words}", file.display())));
            }
            shapes.push(Placed { form, material: index });
            progress.step();
            progress.check()?;
        }
        warnings.extend(skies.iter().flat_map(|s: &Sky| s.map.warnings()));
        if lamps.is_empty() && skies.is_empty() {
            warnings.push("there is no light".into());
        }
        let flats = shapes.iter().map(|_| None).collect();
        let two_passes = vec![None; shapes.len()];
        Ok(Self { camera, shapes, materials, lamps, skies, flats, two_passes, accuracy, viewer, notes, warnings })
    }

    /// Switches to three bands of the spectrum.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn set_bands(&mut self, scene: &Scene, folder: &Path, bands: Bands) -> Result<()> {
        self.viewer.bands = Some(bands);
        let angle = scene.turn.light_deg.to_radians();
        self.lamps.clear();
        for (k, light) in scene.light.iter().enumerate() {
            let name = format!("light[{k}]");
            self.lamps.extend(Lamp::new(&name, light, folder, self.viewer, (angle, self.accuracy.error))?);
        }
        for sky in &mut self.skies {
            sky.upsampling = Upsampling::new(self.viewer, self.accuracy.error)?;
        }
        Ok(())
    }

    /// Whether any material sums over orders or wavelengths.
    pub(crate) fn sums(&self) -> bool {
        self.materials.iter().any(|m| !matches!(m.diffraction, None | Some(Diffraction::Table(_))))
    }

    /// Width and height in pixels.
    pub(crate) fn size(&self) -> [usize; 2] {
        self.camera.size
    }

    /// Intersection of a ray with the nearest shape, and the shape's index.
    fn meet(&self, ray: &Ray, range: [f64; 2]) -> Option<(Hit, usize)> {
        let mut best: Option<(Hit, usize)> = None;
        for (k, shape) in self.shapes.iter().enumerate() {
            let far = best.map_or(range[1], |(hit, _)| hit.t);
            if let Some(hit) = shape.form.meet(ray, [range[0], far]) {
                best = Some((hit, k));
            }
        }
        best
    }

    /// Directions, in its frame, in which a shape is seen from some positions of the picture.
    pub(crate) fn views_of(&self, shape: usize) -> Vec<[f64; 3]> {
        let [width, height] = self.camera.size.map(|n| n as f64);
        let at = |k: usize, n: f64| (k as f64 + 0.5) / VIEWED as f64 * n;
        let view = |k: usize| {
            let ray = self.camera.ray([at(k % VIEWED, width), at(k / VIEWED, height)], [0.0; 2]);
            let (hit, met) = self.meet(&ray, [0.0, f64::INFINITY])?;
            (met == shape).then(|| hit.frame.map(|f| -f.dot(&ray.along)))
        };
        (0..VIEWED * VIEWED).filter_map(view).collect()
    }

    /// Intersections of the rays at `side` × `side` positions of the picture with a shape, with the indices of the
    /// rays.
    pub(crate) fn places_of(&self, shape: usize, side: usize) -> Vec<(usize, Hit)> {
        let [width, height] = self.camera.size.map(|n| n as f64);
        let at = |k: usize, n: f64| (k as f64 + 0.5) / side as f64 * n;
        let place = |k: usize| {
            let ray = self.camera.ray([at(k % side, width), at(k / side, height)], [0.0; 2]);
            let (hit, met) = self.meet(&ray, [0.0, f64::INFINITY])?;
            (met == shape).then_some((k, hit))
        };
        (0..side * side).filter_map(place).collect()
    }

    /// The shading frame of a point, and the direction towards the camera's centre.
    pub(crate) fn seen(&self, hit: &Hit, shape: usize) -> Seen {
        let towards = (self.camera.at - hit.point).normalize();
        (self.shading_frame(hit, shape, towards), towards)
    }

    fn shading_frame(&self, hit: &Hit, shape: usize, towards: V3) -> [V3; 3] {
        match self.materials[self.shapes[shape].material].normal(hit.uv) {
            Some(normal) => bent(&hit.frame, normal, towards),
            None => hit.frame,
        }
    }

    /// Luminance reflected by a shape's table from the skies at a point, by filtered skies or, without them, by one
    /// sample of each. `None` for other materials, and for points without a filtered sky.
    pub(crate) fn under_skies(
        &self,
        (hit, shape): (&Hit, usize),
        seen: &Seen,
        filtered: Option<&TwoPass>,
        random: &mut Stream,
    ) -> Option<f64> {
        let material = &self.materials[self.shapes[shape].material];
        let Some(top @ Diffraction::Table(_)) = &material.diffraction else { return None };
        let [covered] = material.coverage.at(hit.uv);
        let (frame, towards) = seen;
        let place = Place { uv: hit.uv, view: frame.map(|f| f.dot(towards)) };
        let open = |towards: V3| self.open(hit, towards);
        let mut sum = 0.0;
        for (k, sky) in self.skies.iter().enumerate() {
            let summed = match filtered {
                Some(filtered) => Some(filtered.at(k, seen)?),
                None => None,
            };
            let above = Above { sky, frame, open: &open, summed };
            sum += covered * top.under(&place, &above, random, &self.accuracy, &mut Memory::default())[1];
        }
        Some(sum)
    }

    /// Whether the sky is visible from a point in a direction. A bent normal may look below the shape's horizon, which
    /// counts as visible.
    fn open(&self, hit: &Hit, towards: V3) -> bool {
        let start = above(hit);
        hit.flat.dot(&towards) <= 0.0 || self.meet(&Ray { from: start, along: towards }, [0.0, f64::INFINITY]).is_none()
    }

    /// Computes the reflection of the skies by a flat shape with a table, if nothing occludes the skies.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn flat(&self, shape: usize, size: usize, progress: &dyn Progress) -> Result<Option<Flat>> {
        let placed = &self.shapes[shape];
        let material = &self.materials[placed.material];
        let (Form::Flat { center, frame, .. }, Some(Diffraction::Table(table)), None, 1) =
            (&placed.form, &material.diffraction, &material.normals, self.shapes.len())
        else {
            return Ok(None);
        };
        let side = (self.camera.at - center).dot(&frame[2]);
        let frame = if side < 0.0 { [frame[0], frame[1], -frame[2]] } else { *frame };
        Flat::new(frame, table, &self.skies, size, progress).map(Some)
    }

    /// Records in the notes that a shape's reflection of the skies is precomputed.
    pub(crate) fn note_flat(&mut self, shape: usize, size: usize, error: f64) {
        let material = self.shapes[shape].material;
        let Some(notes) = self.notes.values_mut().nth(material) else { return };
        notes.method.push_str(&format!(
            ", on a flat sample: light from the environment is summed up once for {size} × {size} directions (a correlation), which takes less than drawing it \
             by chance"
        ));
        notes.predicted_error += error;
    }

    /// X, Y, Z at a position of the picture, in pixels from its upper left corner.
    pub(crate) fn at(&self, pixel: [f64; 2], random: &mut Stream, memory: &mut Memory) -> [f64; 3] {
        let ray = self.camera.ray(pixel, random.numbers());
        let Some((hit, shape)) = self.meet(&ray, [0.0, f64::INFINITY]) else {
            let mut sum = [0.0; 3];
            for sky in self.skies.iter().filter(|s| s.visible) {
                let seen = sky.upsampling.seen(sky.radiance(ray.along));
                (0..3).for_each(|c| sum[c] += seen[c]);
            }
            return sum;
        };
        self.reflected(&hit, shape, -ray.along, random, memory)
    }

    /// X, Y, Z reflected by a point towards a direction.
    fn reflected(&self, hit: &Hit, shape: usize, towards: V3, random: &mut Stream, memory: &mut Memory) -> [f64; 3] {
        let material = &self.materials[self.shapes[shape].material];
        let flat = self.flats[shape].as_ref().filter(|flat| flat.is_of(hit));
        let frame = self.shading_frame(hit, shape, towards);
        let local = |v: V3| frame.map(|f| f.dot(&v));
        let place = Place { uv: hit.uv, view: local(towards) };
        let start = above(hit);
        let free = |towards: V3, distance: f64| {
            hit.flat.dot(&towards) > 0.0 && self.meet(&Ray { from: start, along: towards }, [0.0, distance]).is_none()
        };
        let mut sum = [0.0; 3];
        memory.kept.forget();
        for lamp in &self.lamps {
            let [u, chance] = [(); 2].map(|()| random.numbers());
            lamp.beams(hit.point, u, |beam| {
                let light = local(beam.towards);
                if light[2] <= 0.0 || beam.illuminance <= 0.0 {
                    return;
                }
                let source = Source { light, width: beam.sigma, seen: &lamp.seen, chance };
                let part = material.lit(&place, &source, &self.accuracy, memory);
                if part != [0.0; 3] && free(beam.towards, beam.distance) {
                    (0..3).for_each(|c| sum[c] += part[c] * beam.illuminance);
                }
            });
        }
        for (k, sky) in self.skies.iter().enumerate() {
            let open = |towards: V3| self.open(hit, towards);
            let summed = match (flat, &self.two_passes[shape]) {
                (Some(flat), _) => Some(flat.at(k, place.view)),
                (None, Some(filtered)) => filtered.at(k, &(frame, towards)),
                (None, None) => None,
            };
            let above = Above { sky, frame: &frame, open: &open, summed };
            let part = material.under(&place, &above, random, &self.accuracy, memory);
            (0..3).for_each(|c| sum[c] += part[c]);
        }
        sum
    }
}

/// A point slightly above the surface, to avoid self-shadowing.
fn above(hit: &Hit) -> V3 {
    hit.point + hit.flat * (1e-7 * (1.0 + hit.t))
}

/// A frame whose normal has these components in another frame, turned back until it faces the viewer.
fn bent(frame: &[V3; 3], [x, y, z]: [f64; 3], towards: V3) -> [V3; 3] {
    let mut n = (frame[0] * x + frame[1] * y + frame[2] * z).normalize();
    let seen = n.dot(&towards);
    if seen < 1e-3 {
        n = (n + towards * (1e-3 - seen)).normalize();
    }
    let u = frame[0] - n * frame[0].dot(&n);
    let u = if u.norm() > 1e-9 { u.normalize() } else { frame[1] };
    let v = frame[1] - n * frame[1].dot(&n) - u * frame[1].dot(&u);
    let v = if v.norm() > 1e-9 { v.normalize() } else { n.cross(&u) };
    [u, v, n]
}
