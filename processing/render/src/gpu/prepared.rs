//! A scene in the form required by the shaders.

use super::repeating::{Cells, Field};
use super::texture::Texture;
use super::{textures, under};
use crate::light::viewer::RANGE;
use crate::light::{Kind, Lamp, Sky};
use crate::material::Material;
use crate::material::diffraction::grating::{BALANCED, Grating, ROUNDS};
use crate::material::diffraction::{Diffraction, SlitLayout};
use crate::material::shading::Accuracy;
use crate::material::texture::Over;
use crate::prepared_scene::PreparedScene;
use crate::prepared_scene::camera::Camera;
use crate::scene::Scene;
use crate::shape::Form;
use nacre_base::progress::{Progress, Silent};
use nacre_base::{Error, Result};
use nacre_brdf::Slits;
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Names of the uniforms, four numbers each, in the order of `Scene` in scene.wgsl. Five uniforms per light follow.
pub const NAMES: [&str; 25] = [
    "eye", "right", "up", "ahead", "center", "across", "along", "normal", "form", "what", "same", "grooves", "relief",
    "sums", "table", "repeat", "turn", "detail", "albedo", "specular", "sky_x", "sky_y", "sky_z", "range", "samples",
];

/// Longest period in µm on a software renderer, and on a mesh, which needs some of the loop iterations. Beyond it,
/// balancing exceeds llvmpipe's limit of 65535 loop iterations per pixel.
const SOFTWARE_UM: f32 = 1.6;
const SOFTWARE_MESH_UM: f32 = 1.4;
const TURNS: f32 = 60_000.0;

/// Maximum number of coherently lit slits: more produce lines too fine for the shaders' sums.
const MAX_SLITS: usize = 256;

/// Maximum number of lights, and uniforms of each.
const LIGHTS: usize = 8;
const ROWS: usize = 5;

/// Shader inputs of a scene.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Values of [`NAMES`], then the lights; lengths in mm, angles in rad, periods in µm, wave numbers in 1/µm.
    pub uniforms: Vec<[f32; 4]>,
    /// Textures in the order of the shader's bindings, from 1.
    pub textures: Vec<Texture>,
}

#[derive(Serialize)]
struct Header<'a> {
    size: [usize; 2],
    uniforms: BTreeMap<&'a str, Vec<[f32; 4]>>,
    textures: Vec<Layout<'a>>,
}

#[derive(Serialize)]
struct Layout<'a> {
    name: &'a str,
    width: usize,
    height: usize,
    channels: usize,
}

impl Prepared {
    /// Prepares a scene whose files are in `folder`. The truncation error of sums is at most `error`, and maps are
    /// subsampled to at most `most` pixels along a side.
    ///
    /// # Errors
    /// `Input` for invalid scenes, and for scenes that the shaders do not support.
    pub fn new(scene: &Scene, folder: &Path, error: f64, most: usize, progress: &dyn Progress) -> Result<Self> {
        let prepared = PreparedScene::new(scene, folder, Accuracy::new(error, None), progress)?;
        Self::of(&prepared, most).map_err(|why| Error::input("scene", why, "render it with `nacre render`"))
    }

    /// Converts a prepared scene, or returns the reason why the shaders do not support it.
    pub(in super::super) fn of(prepared: &PreparedScene, most: usize) -> std::result::Result<Self, String> {
        let [shape] = prepared.shapes.as_slice() else {
            return Err(format!("it has {} shapes, not one", prepared.shapes.len()));
        };
        if prepared.skies.len() > 1 {
            return Err(format!("it has {} environments, more than one", prepared.skies.len()));
        }
        if prepared.lamps.len() > LIGHTS {
            return Err(format!("it has {} lights, more than {LIGHTS}", prepared.lamps.len()));
        }
        if prepared.accuracy.fixed.is_some() {
            return Err("the number of wavelengths is given".into());
        }
        let material = prepared.materials.get(shape.material).ok_or("its shape has no material")?;
        let mut values = Values { by_name: BTreeMap::new(), lights: [[0.0; 4]; ROWS * LIGHTS] };
        values.camera(&prepared.camera)?;
        let mesh = values.shape(&shape.form);
        let mut field = match &material.diffraction {
            Some(Diffraction::Relief(relief)) => {
                Some(Field::new(relief, prepared.accuracy.error, !prepared.skies.is_empty(), &Silent)?)
            }
            _ => None,
        };
        values.material(material, prepared, field.as_ref())?;
        for (k, lamp) in prepared.lamps.iter().enumerate() {
            values.lamp(k, lamp);
        }
        let diffraction = material.diffraction.as_ref();
        let cells = field.as_mut().and_then(|f| f.cells.take());
        let mut textures = textures::all(diffraction, &prepared.lamps, most, field);
        match prepared.skies.first() {
            Some(sky) => {
                values.sky(sky);
                textures.extend(under::all(sky, material, (&shape.form, prepared.camera.at), cells)?);
            }
            None => textures.extend(under::none()),
        }
        textures.push(mesh);
        Ok(Self { size: prepared.camera.size, uniforms: values.list(), textures })
    }

    /// Sets the range of samples to add, and the weight of the previous samples in the result.
    pub fn samples(&mut self, first: usize, count: usize, before: f32) {
        if let Some(value) = self.uniforms.get_mut(NAMES.len() - 1) {
            *value = [first as f32, count as f32, before, 0.0];
        }
    }

    /// Value of a uniform by its name.
    pub(super) fn value(&self, name: &str) -> [f32; 4] {
        NAMES.iter().position(|n| *n == name).and_then(|k| self.uniforms.get(k).copied()).unwrap_or_default()
    }

    /// Whether the sums exceed the loop limit (`TURNS`) of software renderers.
    pub fn too_long_for_software(&self) -> bool {
        let [what, same, form, sky] = ["what", "same", "form", "sky_x"].map(|name| self.value(name));
        let meshed = form[0] == 3.0;
        match what[0] {
            1.0 | 3.0 => {
                let maps = self.textures.iter().filter(|t| t.name == "maps").flat_map(|t| t.values.chunks_exact(4));
                let longest = maps.fold(same[1], |longest, texel| longest.max(texel[1]));
                longest > if meshed { SOFTWARE_MESH_UM } else { SOFTWARE_UM } || (meshed && sky[3] > 0.0)
            }
            4.0 | 5.0 => self.frequency_turns() > TURNS,
            _ => false,
        }
    }

    /// Maximum loop iterations per pixel of a doubly periodic material: frequencies along and across the longest line,
    /// and samples and terms of each.
    fn frequency_turns(&self) -> f32 {
        let [repeat, turn, grooves, sums] = ["repeat", "turn", "grooves", "sums"].map(|name| self.value(name));
        let lights = self.uniforms.get(NAMES.len()..).unwrap_or(&[]).chunks_exact(ROWS);
        let distance =
            |l: &[[f32; 4]]| if l[1][1] != 1.0 { l[0][..3].iter().map(|v| v * v).sum::<f32>().sqrt() } else { 1.0 };
        // A light may be closer to the sample than to the scene's centre: a margin of three.
        let wide = |l: &[[f32; 4]]| 3.0 * l[0][3] / distance(l).max(1e-6);
        let last = RANGE[1] as f32;
        let lobes = lights.filter(|l| l[1][0] > 0.0).map(|l| {
            let margin = 2.0 * sums[1] * (grooves[3] + (wide(l) * last).powi(2)).sqrt();
            let side = repeat[0].max(repeat[1]);
            let along = 2.0 * (RANGE[1] - RANGE[0]) as f32 + margin;
            along * side * (1.5 * margin * side + 2.0) * (3.0 * sums[1] / sums[0].max(0.1)).max(4.0)
        });
        // Under an environment each sample draws 16 frequencies.
        (lobes.sum::<f32>() + 16.0) * turn[2].max(1.0) + 1000.0
    }

    /// Uniforms in the layout of the shader's buffer.
    pub fn uniform_bytes(&self) -> Vec<u8> {
        bytemuck::cast_slice(&self.uniforms).to_vec()
    }

    /// Serialisation for a browser. First comes the header's length in bytes (32 bits, little endian), then the header
    /// (JSON, padded with blanks to a multiple of 4). The textures' numbers follow in sequence (32-bit floats, little
    /// endian).
    pub fn bytes(&self) -> Vec<u8> {
        let mut uniforms: BTreeMap<&str, Vec<[f32; 4]>> =
            NAMES.into_iter().zip(&self.uniforms).map(|(name, value)| (name, vec![*value])).collect();
        uniforms.insert("lights", self.uniforms.get(NAMES.len()..).unwrap_or(&[]).to_vec());
        let layout = |t: &Texture| (t.name, t.width, t.height, t.channels);
        let textures = self.textures.iter().map(layout);
        let textures =
            textures.map(|(name, width, height, channels)| Layout { name, width, height, channels }).collect();
        let mut header = serde_json::to_vec(&Header { size: self.size, uniforms, textures }).unwrap_or_default();
        header.resize(header.len().next_multiple_of(4), b' ');
        let mut bytes = (header.len() as u32).to_le_bytes().to_vec();
        bytes.extend(header);
        bytes.extend(self.textures.iter().flat_map(|t| &t.values).flat_map(|v| v.to_le_bytes()));
        bytes
    }
}

/// Uniforms by name.
struct Values {
    by_name: BTreeMap<&'static str, [f64; 4]>,
    lights: [[f64; 4]; ROWS * LIGHTS],
}

fn four(v: Vector3<f64>, w: f64) -> [f64; 4] {
    [v.x, v.y, v.z, w]
}

fn flag(on: bool) -> f64 {
    f64::from(u8::from(on))
}

impl Values {
    fn set(&mut self, name: &'static str, value: [f64; 4]) {
        self.by_name.insert(name, value);
    }

    fn camera(&mut self, camera: &Camera) -> std::result::Result<(), String> {
        if camera.lens > 0.0 {
            return Err("its camera has an aperture".into());
        }
        let [right, up, ahead] = camera.frame;
        let [width, height] = camera.size.map(|n| n as f64);
        self.set("eye", four(camera.at, camera.half));
        self.set("right", four(right, width));
        self.set("up", four(up, height));
        self.set("ahead", four(ahead, 0.0));
        Ok(())
    }

    /// Sets the shape, and returns its triangles.
    fn shape(&mut self, form: &Form) -> Texture {
        let mut mesh = Texture::none("mesh", 4);
        let (kind, center, frame, [x, y, z, w]) = match form {
            Form::Flat { center, frame, half, round } => {
                let [inner, outer] = round.unwrap_or([0.0; 2]);
                ([0.0, 0.0], center, frame, [half[0], half[1], inner, outer])
            }
            Form::Cylinder { center, frame, radius, half, arc } => {
                ([1.0, 0.0], center, frame, [*half, *radius, arc[0], arc[0] - arc[1]])
            }
            Form::Sphere { center, radius, frame } => ([2.0, 0.0], center, frame, [*radius, 0.0, 0.0, 0.0]),
            Form::Mesh(of) => {
                let nodes;
                (nodes, mesh) = textures::mesh(of);
                ([3.0, nodes as f64], &Vector3::zeros(), &[Vector3::zeros(); 3], [0.0; 4])
            }
        };
        self.set("form", [kind[0], kind[1], 0.0, 0.0]);
        self.set("center", four(*center, x));
        self.set("across", four(frame[0], y));
        self.set("along", four(frame[1], z));
        self.set("normal", four(frame[2], w));
        mesh
    }

    fn material(
        &mut self,
        material: &Material,
        prepared: &PreparedScene,
        field: Option<&Field>,
    ) -> std::result::Result<(), String> {
        let Over::Same([coverage]) = material.coverage else {
            return Err("its coverage is a picture".into());
        };
        if material.normals.is_some() {
            return Err("it has a map of normals".into());
        }
        let kind = match &material.diffraction {
            None => 0.0,
            Some(Diffraction::Grating { grating, same, maps, disc }) => {
                let mapped = maps.as_ref().map_or([false; 2], |m| m.has());
                let repeat = maps.as_ref().map_or([1.0; 2], |m| m.repeat);
                let values = same.map(|v| v.unwrap_or(0.0));
                self.set("same", [values[0], values[1], flag(mapped[0]), flag(mapped[1])]);
                self.set("grooves", [repeat[0], repeat[1], flag(*disc), grating.sigma * grating.sigma]);
                self.grating(grating);
                1.0
            }
            Some(Diffraction::Table(table)) => {
                self.set("table", [table.extent, table.warp, table.scale, flag(table.lossless)]);
                2.0
            }
            Some(Diffraction::Comb(comb)) => {
                if comb.layout == SlitLayout::Radial {
                    return Err("its slits lie in all directions".into());
                }
                let Slits { spacing_um, width_um, count } = comb.slits;
                if count > MAX_SLITS {
                    return Err(format!("light falls on {count} slits together, more than {MAX_SLITS}"));
                }
                let [x, y] = comb.across;
                self.set("same", [y.atan2(x), spacing_um, 0.0, 0.0]);
                self.set(
                    "grooves",
                    [1.0, 1.0, flag(comb.layout == SlitLayout::Disc), comb.orders.sigma * comb.orders.sigma],
                );
                self.set("detail", [width_um, count as f64, comb.share(), 0.0]);
                self.grating(&comb.orders);
                3.0
            }
            Some(Diffraction::Lattice(of)) => {
                let share = of.share();
                self.repeating(of.period, [f64::from(u16::MAX); 2], of.turn, of.sigma);
                self.set("detail", [of.aperture[0], of.aperture[1], share * share, 0.0]);
                4.0
            }
            Some(Diffraction::Relief(of)) => {
                let field = field.ok_or("report this")?;
                self.repeating(of.size_um(), field.reach.map(|r| r as f64), of.turn, of.sigma());
                let [cos, sin] = of.turn;
                self.set("turn", [cos, sin, field.pairs as f64, field.half_um]);
                let [views, numbers] = of.norm().size();
                self.set("detail", [field.per_x, flag(of.lossless), views as f64, numbers as f64]);
                if let Some(Cells { side: [x, y], fine, .. }) = &field.cells {
                    let [x, y, fine] = [*x, *y, *fine].map(|n| n as f64);
                    self.set("relief", [x, y, fine, of.sigma_under().powi(2)]);
                }
                5.0
            }
        };
        self.set("what", [kind, prepared.lamps.len() as f64, 0.0, coverage]);
        let accuracy = &prepared.accuracy;
        self.set("sums", [accuracy.step, accuracy.reach, ROUNDS as f64, BALANCED]);
        let Some(base) = &material.base else { return Ok(()) };
        let (Over::Same(albedo), Over::Same([roughness])) = (&base.albedo, &base.roughness) else {
            return Err("its base is a picture".into());
        };
        self.set("albedo", [albedo[0], albedo[1], albedo[2], *roughness]);
        let below = material.through([1.0; 2]).is_some();
        let [r, g, b] = base.specular;
        self.set("specular", [r, g, b, flag(below)]);
        Ok(())
    }

    /// Sets the parameters of a doubly periodic material: periods in µm, maximum frequencies, direction and lobe width.
    fn repeating(&mut self, um: [f64; 2], most: [f64; 2], [cos, sin]: [f64; 2], sigma: f64) {
        self.set("same", [0.0; 4]);
        self.set("grooves", [1.0, 1.0, 0.0, sigma * sigma]);
        self.set("repeat", [um[0], um[1], most[0], most[1]]);
        self.set("turn", [cos, sin, 0.0, 0.0]);
    }

    fn grating(&mut self, grating: &Grating) {
        let orders = f64::from(grating.orders);
        self.set("relief", [textures::rows_per_q(grating), orders, orders, flag(grating.even)]);
    }

    fn sky(&mut self, sky: &Sky) {
        let [x, y, z] = sky.frame;
        self.set("sky_x", four(x, 1.0));
        self.set("sky_y", four(y, flag(sky.visible)));
        self.set("sky_z", four(z, sky.fine()));
    }

    fn lamp(&mut self, k: usize, lamp: &Lamp) {
        let seen = &lamp.seen;
        let none = [0.0; 4];
        let (place, strength, kind, beam) = match &lamp.kind {
            Kind::Point { at, intensity, sigma, beam } => {
                let beam = beam.map_or(none, |(axis, width)| four(axis, width));
                (four(*at, *sigma), *intensity, 0.0, [beam, none])
            }
            Kind::Far { towards, illuminance, sigma } => (four(*towards, *sigma), *illuminance, 1.0, [none; 2]),
            Kind::Rectangle { center, frame, half, luminance } => {
                let sides = [0, 1].map(|k| four(frame[k] * half[k], 0.0));
                // As wide as one of its sixteen parts.
                let sigma = (half[0] * half[1] / 48.0).sqrt();
                (four(*center, sigma), luminance * 4.0 * half[0] * half[1], 2.0, sides)
            }
        };
        let [r, g, b] = seen.rgb;
        let rows = [place, [strength, kind, seen.first, seen.step], [r, g, b, seen.fine], beam[0], beam[1]];
        if let Some(out) = self.lights.get_mut(ROWS * k..ROWS * k + ROWS) {
            out.copy_from_slice(&rows);
        }
    }

    fn list(&self) -> Vec<[f32; 4]> {
        let named = NAMES.iter().map(|name| self.by_name.get(name).copied().unwrap_or_default());
        named.chain(self.lights).map(|v| v.map(|c| c as f32)).collect()
    }
}
