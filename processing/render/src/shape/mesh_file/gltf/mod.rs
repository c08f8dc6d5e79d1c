//! glTF 2.0, as JSON (`.gltf`) or binary (`.glb`): the meshes of its scene in rest pose.
//!
//! Supported are triangles, strips and fans, sparse and quantized accessors, skins and morph targets. Materials,
//! cameras, lights and animations are ignored.

mod accessor;
mod buffers;
mod container;
mod document;
mod primitive;
mod skin;
mod texture;

use super::draft::Draft;
use super::fault::{Decoded, Fault};
use buffers::Buffers;
use container::split;
use document::{Document, Node};
use nalgebra::Matrix4;
use std::path::Path;

/// Maximum depth of nodes.
const MAX_DEPTH: usize = 64;

pub(super) fn read(bytes: &[u8], path: &Path, draft: &mut Draft) -> Decoded<()> {
    let (json, binary) = split(bytes)?;
    let document = Document::parse(json)?;
    document.check_extensions()?;
    let file = File { buffers: Buffers::read(&document, binary, path)?, document };
    draft.left_out.add("material (materials are the scene's)", file.document.materials.len());
    draft.left_out.add("animation", file.document.animations.len());
    let nodes = file.placed_nodes(draft)?;
    for (index, matrix) in nodes.iter().enumerate() {
        if let Some(matrix) = matrix {
            file.add_node(&file.document.nodes[index], matrix, &nodes, draft)?;
        }
    }
    Ok(())
}

/// A document with its buffers.
struct File {
    document: Document,
    buffers: Buffers,
}

impl File {
    /// Transforms of the nodes in the scene.
    fn placed_nodes(&self, draft: &mut Draft) -> Decoded<Vec<Option<Matrix4<f64>>>> {
        let Document { nodes, scenes, scene, .. } = &self.document;
        let roots: Vec<usize> = match scenes.get(scene.unwrap_or(0)) {
            Some(shown) => shown.nodes.clone(),
            None if scene.is_some() => return Err(Fault::damaged("has a default scene that is not there")),
            // Without a scene all nodes are shown.
            None => {
                let children: std::collections::BTreeSet<usize> =
                    nodes.iter().flat_map(|n| n.children.iter().copied()).collect();
                (0..nodes.len()).filter(|k| !children.contains(k)).collect()
            }
        };
        draft.left_out.add("further scene", scenes.len().saturating_sub(1));
        let mut placed = vec![None; nodes.len()];
        let mut todo: Vec<(usize, Matrix4<f64>, usize)> =
            roots.into_iter().map(|n| (n, Matrix4::identity(), 0)).collect();
        while let Some((index, above, depth)) = todo.pop() {
            if depth > MAX_DEPTH {
                return Err(Fault::refused(
                    format!("has nodes more than {MAX_DEPTH} deep"),
                    "export the mesh with fewer levels",
                ));
            }
            let node =
                nodes.get(index).ok_or_else(|| Fault::damaged(format!("names node {index}, which is not there")))?;
            if placed[index].is_some() {
                return Err(Fault::damaged(format!("has node {index} below two others")));
            }
            let matrix = above * node.matrix();
            placed[index] = Some(matrix);
            todo.extend(node.children.iter().map(|n| (*n, matrix, depth + 1)));
        }
        Ok(placed)
    }

    fn add_node(
        &self,
        node: &Node,
        matrix: &Matrix4<f64>,
        nodes: &[Option<Matrix4<f64>>],
        draft: &mut Draft,
    ) -> Decoded<()> {
        let Some(index) = node.mesh else { return Ok(()) };
        if node.extensions.contains_key("EXT_mesh_gpu_instancing") {
            return Err(Fault::refused(
                "has instances of a mesh (EXT_mesh_gpu_instancing), which are not read",
                "export the mesh with its instances applied",
            ));
        }
        let missing = || Fault::damaged(format!("names mesh {index}, which is not there"));
        let mesh = self.document.meshes.get(index).ok_or_else(missing)?;
        let weights = if node.weights.is_empty() { &mesh.weights } else { &node.weights };
        let joints = node.skin.map(|skin| self.joints(skin, nodes)).transpose()?;
        for primitive in &mesh.primitives {
            self.add_primitive(primitive, weights, matrix, joints.as_deref(), draft)?;
        }
        Ok(())
    }
}
