//! The parts of a glTF document that are needed for meshes.

use crate::shape::mesh_file::fault::{Decoded, Fault};
use nalgebra::{Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// Extensions that a file may require: supported, or without effect on surfaces. Names that end in `_` are prefixes.
const READ_EXTENSIONS: [&str; 12] = [
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_xmp_",
    "KHR_animation_",
    "EXT_materials_",
    "EXT_texture_",
    "EXT_lights_",
    "ADOBE_materials_",
    "MSFT_texture_",
    "AGI_stk_metadata",
];

type Extensions = BTreeMap<String, serde_json::Value>;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
#[derive(Default)]
pub(super) struct Document {
    extensions_required: Vec<String>,
    pub scene: Option<usize>,
    pub scenes: Vec<Scene>,
    pub nodes: Vec<Node>,
    pub meshes: Vec<Mesh>,
    pub skins: Vec<Skin>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<View>,
    pub buffers: Vec<Buffer>,
    pub materials: Vec<serde_json::Value>,
    pub animations: Vec<IgnoredAny>,
}

#[derive(Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub nodes: Vec<usize>,
}

#[derive(Deserialize)]
#[serde(default)]
#[derive(Default)]
pub(super) struct Node {
    pub children: Vec<usize>,
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    pub weights: Vec<f64>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    pub extensions: Extensions,
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub primitives: Vec<Primitive>,
    #[serde(default)]
    pub weights: Vec<f64>,
}

/// Accessors by the name of an attribute, such as `POSITION`.
pub(super) type Attributes = BTreeMap<String, usize>;

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub attributes: Attributes,
    pub indices: Option<usize>,
    pub material: Option<usize>,
    /// 0 points, 1 lines, 2 line loop, 3 line strip, 4 triangles, 5 triangle strip, 6 triangle fan.
    pub mode: Option<u32>,
    #[serde(default)]
    pub targets: Vec<Attributes>,
    #[serde(default)]
    pub extensions: Extensions,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Skin {
    pub joints: Vec<usize>,
    pub inverse_bind_matrices: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default)]
    pub byte_offset: usize,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub shape: String,
    pub sparse: Option<Sparse>,
}

/// Values of an accessor that replace others.
#[derive(Deserialize)]
pub(super) struct Sparse {
    pub count: usize,
    pub indices: SparseIndices,
    pub values: SparseValues,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub buffer_view: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub component_type: u32,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub buffer_view: usize,
    #[serde(default)]
    pub byte_offset: usize,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct View {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub uri: Option<String>,
    pub byte_length: usize,
}

/// Only the version: the other parts differ between versions.
#[derive(Deserialize)]
struct Versioned {
    asset: Option<Asset>,
}

#[derive(Deserialize)]
struct Asset {
    version: Option<serde_json::Value>,
}

impl Document {
    pub(super) fn parse(json: &[u8]) -> Decoded<Self> {
        let invalid = |e: serde_json::Error| Fault::damaged(format!("is no valid glTF: {e}"));
        let Versioned { asset } = serde_json::from_slice(json).map_err(invalid)?;
        let version = asset.and_then(|a| a.version).map(|v| v.to_string().trim_matches('"').to_owned());
        match version {
            Some(version) if version.starts_with("2.") || version == "2" => {
                serde_json::from_slice(json).map_err(invalid)
            }
            Some(version) => Err(Fault::refused(format!("is glTF {version}; 2.0 is read"), "export it as glTF 2.0")),
            None => Err(Fault::damaged("is no valid glTF: asset.version is missing")),
        }
    }

    /// Refuses files that require an unsupported extension which changes surfaces.
    pub(super) fn check_extensions(&self) -> Decoded<()> {
        let read = |name: &String| {
            READ_EXTENSIONS.iter().any(|read| name == read || (read.ends_with('_') && name.starts_with(read)))
        };
        match self.extensions_required.iter().find(|name| !read(name)) {
            Some(name) => Err(extension(name)),
            None => Ok(()),
        }
    }
}

/// Fault of a file that requires an extension.
pub(super) fn extension(name: &str) -> Fault {
    let remedy = match name {
        "KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            "export the mesh without compression"
        }
        _ => "export the mesh without it",
    };
    Fault::refused(format!("needs the glTF extension {name}, which is not read"), remedy)
}

impl Node {
    /// Transform to the parent node.
    pub(super) fn matrix(&self) -> Matrix4<f64> {
        if let Some(columns) = &self.matrix {
            return Matrix4::from_column_slice(columns);
        }
        let [x, y, z, w] = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-12).unwrap_or_default();
        let scale = Vector3::from(self.scale.unwrap_or([1.0; 3]));
        Translation3::from(Vector3::from(self.translation.unwrap_or_default())).to_homogeneous()
            * turn.to_homogeneous()
            * Matrix4::new_nonuniform_scaling(&scale)
    }
}
