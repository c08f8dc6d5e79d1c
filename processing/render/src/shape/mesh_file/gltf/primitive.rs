//! Primitives: corners with morph targets and skins applied, and their triangles.

use super::File;
use super::document::{Primitive, extension};
use super::skin::Influences;
use crate::shape::mesh::Corner;
use crate::shape::mesh_file::draft::{Draft, check_count, missing_corner};
use crate::shape::mesh_file::fault::{Decoded, Fault};
use crate::vector::V3;
use nalgebra::Matrix4;

const POINTS: u32 = 0;
const LINES: u32 = 1;
const LINE_LOOP: u32 = 2;
const LINE_STRIP: u32 = 3;
const TRIANGLES: u32 = 4;
const TRIANGLE_STRIP: u32 = 5;
const TRIANGLE_FAN: u32 = 6;

impl File {
    /// Adds the surface of a primitive, or counts its points and lines.
    pub(super) fn add_primitive(
        &self,
        primitive: &Primitive,
        weights: &[f64],
        matrix: &Matrix4<f64>,
        joints: Option<&[Matrix4<f64>]>,
        draft: &mut Draft,
    ) -> Decoded<()> {
        let Some(places) = primitive.attributes.get("POSITION") else {
            draft.left_out.add("primitive without positions", 1);
            return Ok(());
        };
        let draco = "KHR_draco_mesh_compression";
        let compressed = primitive.extensions.contains_key(draco)
            && self.document.accessors.get(*places).is_some_and(|a| a.buffer_view.is_none() && a.sparse.is_none());
        if compressed {
            return Err(extension(draco));
        }
        let mode = primitive.mode.unwrap_or(TRIANGLES);
        let count = match (primitive.indices, self.document.accessors.get(*places)) {
            (Some(indices), _) => self.document.accessors.get(indices).map_or(0, |a| a.count),
            (None, accessor) => accessor.map_or(0, |a| a.count),
        };
        match mode {
            POINTS => draft.left_out.add("point", count),
            LINES => draft.left_out.add("line", count / 2),
            LINE_LOOP => draft.left_out.add("line", count),
            LINE_STRIP => draft.left_out.add("line", count.saturating_sub(1)),
            TRIANGLES | TRIANGLE_STRIP | TRIANGLE_FAN => {
                let first = draft.corners.len() as u32;
                let corners = self.add_corners(primitive, *places, weights, (matrix, joints), draft)?;
                let indices = self.indices(primitive, corners)?;
                draft.count_indices(indices.len())?;
                let indices: Vec<u32> = indices.into_iter().map(|k| k + first).collect();
                match mode {
                    TRIANGLES => {
                        let (whole, rest) = indices.as_chunks::<3>();
                        draft.left_out.add("incomplete triangle", usize::from(!rest.is_empty()));
                        whole.iter().try_for_each(|t| draft.triangle(*t))?;
                    }
                    TRIANGLE_STRIP => draft.strip(&indices)?,
                    _ => draft.fan(&indices)?,
                }
            }
            mode => return Err(Fault::damaged(format!("has a primitive of mode {mode}"))),
        }
        Ok(())
    }

    /// Corner indices of a primitive's triangles, all below `corners`.
    fn indices(&self, primitive: &Primitive, corners: usize) -> Decoded<Vec<u32>> {
        let Some(accessor) = primitive.indices else { return Ok((0..corners as u32).collect()) };
        let indices = self.elements::<1>(accessor)?;
        let valid = |v: f64| v >= 0.0 && v.fract() == 0.0 && v < corners as f64;
        let index = |[v]: [f64; 1]| if valid(v) { Ok(v as u32) } else { Err(missing_corner(v as usize, corners)) };
        indices.into_iter().map(index).collect()
    }

    /// Adds the corners of a primitive and returns their number.
    fn add_corners(
        &self,
        primitive: &Primitive,
        places: usize,
        weights: &[f64],
        (matrix, joints): (&Matrix4<f64>, Option<&[Matrix4<f64>]>),
        draft: &mut Draft,
    ) -> Decoded<usize> {
        let mut places = self.elements::<3>(places)?;
        let count = places.len();
        let named = |name: &str| primitive.attributes.get(name).copied();
        let mut normals = named("NORMAL").map(|k| self.attribute::<3>(k, count)).transpose()?.unwrap_or_default();
        let tangents = named("TANGENT").map(|k| self.attribute::<4>(k, count)).transpose()?.unwrap_or_default();
        let mut tangents: Vec<[f64; 3]> = tangents.into_iter().map(|[x, y, z, _]| [x, y, z]).collect();
        let uvs = self.texture_coordinates(primitive, count)?;
        let named = [("POSITION", &mut places), ("NORMAL", &mut normals), ("TANGENT", &mut tangents)];
        for (name, values) in named {
            self.morph(primitive, weights, name, values)?;
        }
        let influences = joints.map(|joints| Influences::of(self, primitive, joints, count)).transpose()?;
        check_count("corners", draft.corners.len() + count)?;
        for (k, place) in places.iter().enumerate() {
            let skinned = influences.as_ref().map(|of| of.matrix(k)).transpose()?;
            let matrix = skinned.as_ref().unwrap_or(matrix);
            let turn = matrix.fixed_view::<3, 3>(0, 0).into_owned();
            let upright = turn.try_inverse().map_or(turn, |i| i.transpose());
            let shift = V3::new(matrix[(0, 3)], matrix[(1, 3)], matrix[(2, 3)]);
            draft.corner(Corner {
                place: turn * V3::from(*place) + shift,
                normal: normals.get(k).map(|n| upright * V3::from(*n)),
                tangent: tangents.get(k).map(|t| turn * V3::from(*t)),
                // v points down in glTF.
                uv: uvs.get(k).map(|t| [t[0], 1.0 - t[1]]),
            })?;
        }
        Ok(count)
    }

    /// Adds the weighted morph targets of an attribute.
    fn morph(&self, primitive: &Primitive, weights: &[f64], name: &str, values: &mut [[f64; 3]]) -> Decoded<()> {
        for (target, weight) in primitive.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            let Some(accessor) = target.get(name) else { continue };
            if values.is_empty() {
                continue;
            }
            let shifts = self.attribute::<3>(*accessor, values.len())?;
            for (value, shift) in values.iter_mut().zip(shifts) {
                (0..3).for_each(|c| value[c] += weight * shift[c]);
            }
        }
        Ok(())
    }
}
