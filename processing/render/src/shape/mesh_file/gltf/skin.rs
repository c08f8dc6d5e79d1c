//! Skins: meshes deformed by joints, in the pose given by the nodes.

use super::File;
use super::document::Primitive;
use crate::shape::mesh_file::fault::{Decoded, Fault};
use nalgebra::Matrix4;

/// Joints that move each vertex, four per set.
pub(super) struct Influences<'a> {
    joints: &'a [Matrix4<f64>],
    sets: Vec<Set>,
}

/// Four joints of each vertex and their weights.
struct Set {
    joints: Vec<[f64; 4]>,
    weights: Vec<[f64; 4]>,
}

impl File {
    /// Transform of each joint of a skin, from mesh coordinates to the scene.
    pub(super) fn joints(&self, skin: usize, nodes: &[Option<Matrix4<f64>>]) -> Decoded<Vec<Matrix4<f64>>> {
        let missing = || Fault::damaged(format!("names skin {skin}, which is not there"));
        let skin = self.document.skins.get(skin).ok_or_else(missing)?;
        let bind = skin.inverse_bind_matrices.map(|k| self.elements::<16>(k)).transpose()?;
        let joint = |(k, node): (usize, &usize)| {
            let outside = || Fault::damaged(format!("has a skin with joint {node}, which is not in the scene"));
            let placed = nodes.get(*node).copied().flatten().ok_or_else(outside)?;
            let bind = bind.as_ref().map(|all| all.get(k).ok_or_else(|| Fault::damaged("has too few bind matrices")));
            Ok(placed * bind.transpose()?.map_or_else(Matrix4::identity, |m| Matrix4::from_column_slice(m)))
        };
        skin.joints.iter().enumerate().map(joint).collect()
    }
}

impl<'a> Influences<'a> {
    /// Influences on the `count` vertices of a primitive.
    pub(super) fn of(file: &File, primitive: &Primitive, joints: &'a [Matrix4<f64>], count: usize) -> Decoded<Self> {
        let mut sets = vec![];
        for set in 0.. {
            let attribute = |name: &str| primitive.attributes.get(&format!("{name}_{set}"));
            let (Some(joints), Some(weights)) = (attribute("JOINTS"), attribute("WEIGHTS")) else { break };
            let (joints, weights) = (file.attribute(*joints, count)?, file.attribute(*weights, count)?);
            sets.push(Set { joints, weights });
        }
        if sets.is_empty() {
            return Err(Fault::damaged("has a skin on a mesh without joints and weights"));
        }
        Ok(Self { joints, sets })
    }

    /// Transform of a vertex: the weighted mean over its joints.
    pub(super) fn matrix(&self, vertex: usize) -> Decoded<Matrix4<f64>> {
        let damaged = || Fault::damaged(format!("has vertex {vertex} without a joint of its skin"));
        let (mut sum, mut whole) = (Matrix4::zeros(), 0.0);
        for Set { joints, weights } in &self.sets {
            let (joints, weights) = joints.get(vertex).zip(weights.get(vertex)).ok_or_else(damaged)?;
            for (joint, weight) in joints.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                sum += self.joints.get(*joint as usize).ok_or_else(damaged)? * *weight;
                whole += weight;
            }
        }
        if whole > 0.0 { Ok(sum / whole) } else { Err(damaged()) }
    }
}
