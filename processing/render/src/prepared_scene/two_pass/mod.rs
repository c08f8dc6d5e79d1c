//! Lookup tables under environments by filtered environments (2017 TOG, section 6.2), which are computed in two passes
//! (2017 CVMP, section 4).
//!
//! A filtered environment holds, for each mirror direction, the reflection of surfaces with a certain tilt, with a
//! direction of the table towards the environment's pole. The orientation of the table at a point determines the pole:
//! the great circle from the mirror direction along the table's direction passes through it. A single pole therefore
//! suffices for a plane, and for a cylinder whose axis is a direction of the table. On other shapes the table's
//! orientation varies. Their poles are distributed around one great circle, which every other great circle intersects,
//! and a point is interpolated between the nearest two.
//!
//! The papers' surfaces face the viewer. Here environments are filtered for a grid of tilts, and a point is
//! interpolated between them. With finer tilts, poles and pixels and more terms the result converges to the full
//! integral.

mod filtered;
mod poles;

use crate::environment::Table as EvenTable;
use crate::environment::factor::{Factors, MAX_RANK, Part};
use crate::light::Sky;
use crate::material::diffraction::table::Table;
use crate::vector::V3;
use filtered::{Filtered, Source};
use nacre_base::Result;
use nacre_base::progress::Progress;
use poles::Poles;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A visible point: its frame, and the direction towards the viewer.
pub(crate) type Seen = ([V3; 3], V3);

/// Maximum size of all filtered environments of a shape in bytes.
const MAX_BYTES: usize = 256 << 20;

/// Minimum width of a curve's cells, in pixels of the filtered environment.
const CELL: f64 = 0.25;

/// Terms of tilted surfaces beyond twice those of the table.
const MORE: usize = 4;

/// Weight of a tilt below which it is neglected.
const LITTLE: f64 = 1e-9;

/// Resolution of the filtered environments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fineness {
    /// Columns of a filtered environment, twice the number of rows.
    pub width: usize,
    /// Poles around the great circle, if one does not suffice.
    pub poles: usize,
    /// Spacing of tilts, rad.
    pub tilts: f64,
}

/// Curves, and limits for those of tilted surfaces.
pub(crate) struct Curves {
    pub factors: Factors,
    /// The table, if it is known in addition to the curves.
    pub table: Option<EvenTable>,
    pub extent: f64,
    /// Maximum number of terms, and target error of the table.
    pub terms: (usize, f64),
}

/// A part of the table, whether its frame is left-handed (planes seen from behind), and a tilt.
type Key = (usize, bool, [i32; 2]);

/// The filtered environments to compute.
pub(crate) struct Plan<'a> {
    fineness: Fineness,
    curves: &'a Curves,
    nodes: Vec<(Key, Poles)>,
}

/// Filtered environments of a shape.
pub(crate) struct TwoPass {
    /// Directions of the parts along their meridians, rad.
    meridians: Vec<f64>,
    tilts: f64,
    nodes: BTreeMap<Key, Node>,
    /// Smallest cosine of view for lookups; below it points are sampled.
    pub least_cosine: f64,
}

/// Environments of a tilt by pole and sky; unused poles have none.
struct Node {
    poles: Poles,
    /// Largest number of terms over the channels.
    rank: usize,
    maps: Vec<Vec<Filtered>>,
}

/// Lookup coordinates of a point in a filtered environment.
#[derive(Clone, Copy)]
struct LookupPoint {
    mirror: V3,
    /// The table's meridian at the mirror direction: that of the surface, rotated as the normal is rotated to the
    /// mirror direction.
    north: V3,
    left_handed: bool,
    /// Tilt of the surface from the mirror direction, rad, across the table's meridian and along it.
    tilt: [f64; 2],
}

impl LookupPoint {
    /// `None` for points that face away.
    fn new((frame, towards): &Seen, meridian: f64) -> Option<Self> {
        let normal = frame[2];
        let cos = normal.dot(towards);
        if cos <= 0.0 {
            return None;
        }
        let mirror = normal * (2.0 * cos) - towards;
        let (sin, c) = meridian.sin_cos();
        let along = frame[0] * c + frame[1] * sin;
        let north = along - (normal + mirror) * (along.dot(&mirror) / (1.0 + cos));
        let left_handed = frame[0].cross(&frame[1]).dot(&normal) < 0.0;
        let east = north.cross(&mirror) * if left_handed { -1.0 } else { 1.0 };
        let towards = (normal - mirror * cos).try_normalize(1e-12).unwrap_or_else(V3::zeros) * cos.min(1.0).acos();
        Some(Self { mirror, north, left_handed, tilt: [towards.dot(&east), towards.dot(&north)] })
    }

    /// The nine neighbouring tilts, with the weights of quadratic interpolation along each axis, which may be negative.
    fn around(&self, tilts: f64) -> [([i32; 2], f64); 9] {
        let place = self.tilt.map(|v| v / tilts);
        let middle = place.map(f64::round);
        let weights = [0, 1].map(|k| {
            let off = place[k] - middle[k];
            [0.5 * off * (off - 1.0), 1.0 - off * off, 0.5 * off * (off + 1.0)]
        });
        std::array::from_fn(|k| {
            let [i, j] = [k % 3, k / 3];
            ([middle[0] as i32 + i as i32 - 1, middle[1] as i32 + j as i32 - 1], weights[0][i] * weights[1][j])
        })
    }
}

impl<'a> Plan<'a> {
    /// Plans the environments for some points of a shape.
    pub(crate) fn new(curves: &'a Curves, seen: &[Seen], fineness: Fineness) -> Self {
        let mut points: BTreeMap<Key, Vec<LookupPoint>> = BTreeMap::new();
        for (k, part) in curves.factors.parts.iter().enumerate() {
            for point in seen.iter().filter_map(|s| LookupPoint::new(s, part.grid.meridian)) {
                for (tilt, weight) in point.around(fineness.tilts) {
                    if weight.abs() > LITTLE {
                        points.entry((k, point.left_handed, tilt)).or_default().push(point);
                    }
                }
            }
        }
        let nodes = points.into_iter().map(|(key, points)| (key, Poles::new(&points, fineness.poles))).collect();
        Self { fineness, curves, nodes }
    }

    /// Number of environments to filter per sky.
    pub(crate) fn count(&self) -> usize {
        self.nodes.iter().map(|(_, poles)| poles.needed()).sum()
    }

    /// Whether the filtered environments fit into the permitted memory.
    pub(crate) fn fits(&self, skies: usize) -> bool {
        let Fineness { width, .. } = self.fineness;
        let bytes = (width * width / 2).saturating_mul(size_of::<[f32; 3]>());
        bytes.saturating_mul(self.count()).saturating_mul(skies) <= MAX_BYTES
    }

    /// Approximate number of multiplications of the passes per sky.
    pub(crate) fn operations(&self) -> f64 {
        let height = self.fineness.width / 2;
        let pixels = (self.fineness.width * height) as f64;
        let cell = CELL * std::f64::consts::TAU / self.fineness.width as f64;
        let columns = |part: &Part| (part.grid.size[0] as f64).min(2.0 * part.grid.reach[0] / cell);
        let of = |part: &Part| {
            // Four for interpolation, and one for each intermediate picture; mirrored curves double them.
            let across = |terms: usize| columns(part) * (4.0 + 2.0 * terms as f64);
            let steps = 2.0 * part.grid.reach[1] / std::f64::consts::PI * height as f64;
            part.channels.iter().map(|c| across(c.len()) + c.len() as f64 * steps).sum::<f64>()
        };
        let parts: Vec<f64> = self.curves.factors.parts.iter().map(of).collect();
        self.nodes.iter().map(|((k, ..), poles)| pixels * parts[*k] * poles.needed() as f64).sum()
    }

    /// Filters the skies.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn filter(self, skies: &[Sky], progress: &dyn Progress) -> Result<TwoPass> {
        let Self { fineness, curves, nodes } = self;
        let sources: Vec<Source> = skies.iter().map(|sky| Source::new(sky, fineness.width)).collect();
        let node = |((k, left_handed, tilt), poles): (Key, Poles)| -> Result<(Key, Node)> {
            progress.check()?;
            let of = &curves.factors.parts[k];
            let angle = tilt.map(|v| f64::from(v) * fineness.tilts);
            let cell = CELL * std::f64::consts::TAU / fineness.width as f64;
            let part = match &curves.table {
                Some(table) => of.tilted(angle, |h| table.at(h).map(f64::from), curves.extent, cell, curves.terms),
                None => of.tilted(angle, |h| of.value(h), curves.extent, cell, curves.terms),
            };
            let part = if left_handed { part.mirrored() } else { part };
            let filter = |k: usize| -> Result<Vec<Filtered>> {
                sources.iter().map(|source| source.filtered(poles.get(k), &part, progress)).collect()
            };
            let maps = (0..poles.len()).map(|k| if poles.needs(k) { filter(k) } else { Ok(vec![]) });
            let maps = maps.collect::<Result<Vec<_>>>()?;
            Ok(((k, left_handed, tilt), Node { poles, rank: part.terms(), maps }))
        };
        let nodes = nodes.into_par_iter().map(node).collect::<Result<BTreeMap<_, _>>>()?;
        let meridians = curves.factors.parts.iter().map(|p| p.grid.meridian).collect();
        Ok(TwoPass { meridians, tilts: fineness.tilts, nodes, least_cosine: 0.0 })
    }
}

impl TwoPass {
    /// Largest number of terms over the tilts, for each part.
    pub(crate) fn ranks(&self) -> Vec<usize> {
        let of = |k: usize| self.nodes.iter().filter(|(key, _)| key.0 == k).map(|(_, node)| node.rank).max();
        (0..self.meridians.len()).map(|k| of(k).unwrap_or(0)).collect()
    }

    /// Radiance of a sky reflected by a table at a point, times the cosine of view, before albedo normalisation. `None`
    /// if no environment was filtered for the point, or if it is seen too obliquely.
    pub(crate) fn at(&self, sky: usize, seen: &Seen) -> Option<[f64; 3]> {
        if seen.0[2].dot(&seen.1) < self.least_cosine {
            return None;
        }
        let mut sum = [0.0; 3];
        for (part, meridian) in self.meridians.iter().enumerate() {
            let point = LookupPoint::new(seen, *meridian)?;
            for (tilt, share) in point.around(self.tilts) {
                if share.abs() <= LITTLE {
                    continue;
                }
                let node = self.nodes.get(&(part, point.left_handed, tilt))?;
                for (k, weight) in node.poles.around(&point) {
                    if weight > 0.0 {
                        let rgb = node.maps.get(k)?.get(sky)?.at(point.mirror);
                        (0..3).for_each(|c| sum[c] += share * weight * rgb[c]);
                    }
                }
            }
        }
        Some(sum)
    }
}

/// Factorisation of a table for two passes.
impl Curves {
    /// The curves of the table's folder, or as many terms as the residual `max_error` requires; at most `rank` terms in
    /// either case.
    ///
    /// # Errors
    /// `Input` for a folder without curves of this table.
    pub(crate) fn of(table: &Table, rank: Option<usize>, max_error: f64) -> Result<Self> {
        let (factors, own) = table.factored(rank, max_error)?;
        let known = table.factors.is_none().then_some(own);
        let own_terms = factors.parts.iter().map(Part::terms).max().unwrap_or(1);
        let most = rank.unwrap_or((2 * own_terms + MORE).min(MAX_RANK));
        let terms = (most, if rank.is_some() { 0.0 } else { max_error });
        Ok(Self { factors, table: known, extent: table.extent, terms })
    }
}
