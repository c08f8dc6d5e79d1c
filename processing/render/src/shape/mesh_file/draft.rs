//! A mesh under construction: corners, triangles, and counts of everything else.

use super::fault::{Decoded, Fault};
use super::left_out::LeftOut;
use super::polygon::{Outline, Triangulation};
use crate::shape::mesh::{Corner, MAX_TRIANGLES};
use std::collections::HashMap;

/// A mesh under construction.
#[derive(Default)]
pub(super) struct Draft {
    pub corners: Vec<Corner>,
    pub triangles: Vec<[u32; 3]>,
    pub left_out: LeftOut,
    indices: usize,
    triangulation: Triangulation,
}

impl Draft {
    /// Adds a corner and returns its index.
    pub(super) fn corner(&mut self, corner: Corner) -> Decoded<u32> {
        check_count("corners", self.corners.len() + 1)?;
        if !corner.place.iter().all(|c| c.is_finite()) {
            let problem = format!("has vertex {} at {:?}", self.corners.len(), corner.place.as_slice());
            return Err(Fault::damaged(problem));
        }
        self.corners.push(corner);
        Ok((self.corners.len() - 1) as u32)
    }

    /// Counts the corners of triangles to be added, including the joints of strips.
    pub(super) fn count_indices(&mut self, count: usize) -> Decoded<()> {
        self.indices = self.indices.saturating_add(count);
        check_count("triangles", self.indices / 3)
    }

    /// Adds a triangle of corners.
    pub(super) fn triangle(&mut self, corners: [u32; 3]) -> Decoded<()> {
        check_count("triangles", self.triangles.len() + 1)?;
        self.triangles.push(corners);
        Ok(())
    }

    /// Adds the triangles of a face whose corners have been added; concave faces are triangulated by ear clipping.
    pub(super) fn face(&mut self, face: &[u32]) -> Decoded<()> {
        match face {
            [] => self.left_out.add("face without corners", 1),
            [_] => self.left_out.add("face of one corner", 1),
            [_, _] => self.left_out.add("face of two corners", 1),
            [a, b, c] => self.triangle([*a, *b, *c])?,
            _ => {
                let lost = face.iter().find(|k| **k as usize >= self.corners.len());
                if let Some(lost) = lost {
                    return Err(missing_corner(*lost as usize, self.corners.len()));
                }
                let places: Vec<_> = face.iter().map(|k| self.corners[*k as usize].place).collect();
                let mut triangles = vec![];
                match self.triangulation.face(&places, &mut triangles)? {
                    Outline::Simple => {}
                    Outline::Flat => self.left_out.add("face without an area", 1),
                    Outline::Crossing => self.left_out.add_crossing(),
                }
                for triangle in triangles {
                    self.triangle(triangle.map(|k| face[k]))?;
                }
            }
        }
        Ok(())
    }

    /// Adds the triangles of a strip. Triangles with a repeated corner only join its parts and are skipped.
    pub(super) fn strip(&mut self, strip: &[u32]) -> Decoded<()> {
        if strip.len() < 3 {
            self.left_out.add("strip of fewer than three corners", 1);
        }
        for (k, window) in strip.windows(3).enumerate() {
            let [a, b, c] = [window[0], window[1], window[2]];
            if a != b && b != c && a != c {
                self.triangle(if k % 2 == 0 { [a, b, c] } else { [b, a, c] })?;
            }
        }
        Ok(())
    }

    /// Adds the triangles of a fan around its first corner.
    pub(super) fn fan(&mut self, fan: &[u32]) -> Decoded<()> {
        if fan.len() < 3 {
            self.left_out.add("fan of fewer than three corners", 1);
        }
        (2..fan.len()).try_for_each(|k| self.triangle([fan[0], fan[k - 1], fan[k]]))
    }

    /// Returns the draft if its triangles refer to existing corners.
    pub(super) fn checked(self) -> Decoded<Self> {
        let lost = self.triangles.iter().flatten().find(|k| **k as usize >= self.corners.len());
        match lost {
            Some(lost) => Err(missing_corner(*lost as usize, self.corners.len())),
            None if self.triangles.is_empty() => {
                let others = Some(self.left_out.words()).filter(|w| !w.is_empty());
                let others = others.map(|words| format!(" ({words})")).unwrap_or_default();
                Err(Fault::refused(format!("has no faces{others}"), "give a mesh with faces"))
            }
            None => Ok(self),
        }
    }
}

/// Refuses too many corners or triangles before they are allocated.
pub(super) fn check_count(noun: &str, count: usize) -> Decoded<()> {
    if count > MAX_TRIANGLES {
        let problem = format!("has more than {} million {noun}", MAX_TRIANGLES / 1_000_000);
        return Err(Fault::refused(problem, "reduce the mesh"));
    }
    Ok(())
}

/// Fault of a face that refers to a missing corner; both numbers are counted from zero.
pub(super) fn missing_corner(wanted: usize, count: usize) -> Fault {
    Fault::damaged(format!("has a face with vertex {wanted} (counted from 0) of {count}"))
}

/// Corners of a file that indexes positions, texture coordinates and normals separately: one for each combination.
#[derive(Default)]
pub(super) struct Combinations<K>(HashMap<K, u32>);

impl<K: Eq + std::hash::Hash> Combinations<K> {
    /// Index of the corner of a combination, added to the draft at its first use.
    pub(super) fn corner(&mut self, key: K, draft: &mut Draft, corner: impl FnOnce() -> Corner) -> Decoded<u32> {
        match self.0.entry(key) {
            std::collections::hash_map::Entry::Occupied(known) => Ok(*known.get()),
            std::collections::hash_map::Entry::Vacant(new) => Ok(*new.insert(draft.corner(corner())?)),
        }
    }
}
