//! Texture coordinates stored as integers, which are scaled by the texture transform of their material
//! (`KHR_texture_transform`).

use super::File;
use super::document::Primitive;
use crate::shape::mesh_file::fault::Decoded;
use serde_json::Value;

/// Component type of float accessors.
const FLOAT: u32 = 5126;

impl File {
    /// Texture coordinates of a primitive's vertices, v downwards; empty if there are none.
    ///
    /// A transform of float coordinates repeats a texture. It belongs to the material and is ignored with it.
    pub(super) fn texture_coordinates(&self, primitive: &Primitive, vertices: usize) -> Decoded<Vec<[f64; 2]>> {
        let Some(accessor) = primitive.attributes.get("TEXCOORD_0") else { return Ok(vec![]) };
        let mut uvs = self.attribute::<2>(*accessor, vertices)?;
        let integers = self.document.accessors.get(*accessor).is_some_and(|a| a.component_type != FLOAT);
        let material = primitive.material.and_then(|k| self.document.materials.get(k));
        if let Some(transform) = material.filter(|_| integers).and_then(transform) {
            let number = |key: &str, k: usize, other: f64| transform[key][k].as_f64().unwrap_or(other);
            let (sin, cos) = transform["rotation"].as_f64().unwrap_or(0.0).sin_cos();
            for uv in &mut uvs {
                let [u, v] = [0, 1].map(|k| uv[k] * number("scale", k, 1.0));
                *uv = [cos * u + sin * v + number("offset", 0, 0.0), cos * v - sin * u + number("offset", 1, 0.0)];
            }
        }
        Ok(uvs)
    }
}

/// The first texture transform in a material.
fn transform(value: &Value) -> Option<&Value> {
    match value {
        Value::Object(map) => map.get("KHR_texture_transform").or_else(|| map.values().find_map(transform)),
        Value::Array(all) => all.iter().find_map(transform),
        _ => None,
    }
}
