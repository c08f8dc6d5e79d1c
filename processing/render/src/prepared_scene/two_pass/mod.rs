//! Tables under environments by lookups in filtered environments (2017 TOG, section 6.2), which two passes made (2017 CVMP, section 4).
//!
//! A filtered environment holds, for each direction, what a surface of this table reflects that faces the direction and the viewer, with a direction
//! of the table towards the environment's pole. A place is looked up in its mirror direction. Where its table lies there decides the pole: the
//! great circle from the mirror direction along the table's direction passes through it. So one pole does for a plane and for a cylinder whose
//! axis is a direction of the table; for other shapes, whose table turns from place to place, there are poles all around one great circle, which
//! every other great circle crosses, and a place is interpolated between the nearest two.
//!
//! Exact where the surface faces the viewer, but for terms left out and the environment's pixels. At other views the pattern would be stretched
//! by `1/cos θ` in the plane of incidence, which is left out; the light of a white sky is right at each view.

mod filtered;
mod poles;

use crate::environment::factor::Part;
use crate::light::Sky;
use crate::material::diffraction::table::Table;
use crate::vector::V3;
use filtered::{Filtered, Source};
use nacre_base::Result;
use nacre_base::progress::Progress;
use poles::Poles;
use rayon::prelude::*;

/// A place that is looked at: its frame, and the direction towards the viewer.
pub(crate) type Seen = ([V3; 3], V3);

/// Most bytes of all filtered environments of a shape.
const MOST_BYTES: usize = 128 << 20;

/// How finely environments are filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fineness {
    /// Columns of a filtered environment, twice the rows.
    pub width: usize,
    /// Poles around the great circle, where one does not do.
    pub poles: usize,
}

/// Where filtered environments are needed, before any is made.
pub(crate) struct Plan {
    fineness: Fineness,
    parts: Vec<(Part, [Poles; 2])>,
}

/// Filtered environments of a shape.
pub(crate) struct TwoPass {
    parts: Vec<Filter>,
    /// Places are looked up from this cosine of view on, and drawn by chance below.
    pub least_cosine: f64,
}

/// Those of a part of a table, for frames that are right-handed and for those that are not (planes seen from behind).
struct Filter {
    meridian: f64,
    /// Environments by pole and sky; poles that no place needs have none.
    sides: [(Poles, Vec<Vec<Filtered>>); 2],
}

/// How a place looks into a filtered environment.
#[derive(Clone, Copy)]
struct Look {
    mirror: V3,
    /// The table's meridian there: that of the surface, turned as the normal is turned to the mirror direction.
    north: V3,
    left_handed: bool,
}

impl Look {
    /// None for what is not seen.
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
        Some(Self { mirror, north, left_handed: frame[0].cross(&frame[1]).dot(&normal) < 0.0 })
    }
}

impl Plan {
    /// For some places of a shape; none without a place.
    pub(crate) fn new(parts: &[Part], seen: &[Seen], fineness: Fineness) -> Self {
        let plan = |part: &Part| {
            let looks: Vec<Look> = seen.iter().filter_map(|s| Look::new(s, part.grid.meridian)).collect();
            let side = |left: bool| {
                let looks: Vec<Look> = looks.iter().filter(|l| l.left_handed == left).copied().collect();
                Poles::new(&looks, fineness.poles)
            };
            (part.clone(), [side(false), side(true)])
        };
        Self { fineness, parts: parts.iter().map(plan).collect() }
    }

    /// Environments that are to be filtered, per sky.
    pub(crate) fn count(&self) -> usize {
        self.parts.iter().flat_map(|(_, sides)| sides).map(Poles::needed).sum()
    }

    /// Whether the filtered environments fit into the memory that they may take.
    pub(crate) fn fits(&self, skies: usize) -> bool {
        let Fineness { width, .. } = self.fineness;
        let bytes = (width * width / 2).saturating_mul(size_of::<[f32; 3]>());
        bytes.saturating_mul(self.count()).saturating_mul(skies) <= MOST_BYTES
    }

    /// Multiplications that the passes of one sky take.
    pub(crate) fn operations(&self) -> f64 {
        let height = self.fineness.width / 2;
        let pixels = (self.fineness.width * height) as f64;
        let of = |part: &Part| {
            // Four for the light between pixels, and one for each picture between the passes: mirrored curves double them.
            let across = |terms: usize| part.grid.size[0] as f64 * (4.0 + 2.0 * terms as f64);
            let steps = 2.0 * part.grid.reach[1] / std::f64::consts::PI * height as f64;
            part.channels.iter().map(|c| across(c.len()) + c.len() as f64 * steps).sum::<f64>()
        };
        let needed = |sides: &[Poles; 2]| sides.iter().map(Poles::needed).sum::<usize>() as f64;
        self.parts.iter().map(|(part, sides)| pixels * of(part) * needed(sides)).sum()
    }

    /// Filters the skies.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn filter(self, skies: &[Sky], progress: &dyn Progress) -> Result<TwoPass> {
        let width = self.fineness.width;
        let sources: Vec<Source> = skies.iter().map(|sky| Source::new(sky, width)).collect();
        let side = |part: &Part, poles: Poles| -> Result<(Poles, Vec<Vec<Filtered>>)> {
            let filter = |k: usize| -> Result<Vec<Filtered>> {
                let pole = poles.get(k);
                sources.iter().map(|source| source.filtered(pole, part, progress)).collect()
            };
            let all = (0..poles.len()).into_par_iter().map(|k| if poles.needs(k) { filter(k) } else { Ok(vec![]) });
            let all = all.collect::<Result<Vec<_>>>()?;
            Ok((poles, all))
        };
        let parts = self.parts.into_iter().map(|(part, [right, left])| {
            let mirrored = part.mirrored();
            Ok(Filter { meridian: part.grid.meridian, sides: [side(&part, right)?, side(&mirrored, left)?] })
        });
        Ok(TwoPass { parts: parts.collect::<Result<_>>()?, least_cosine: 0.0 })
    }
}

impl TwoPass {
    /// Radiance of a sky that a table reflects at a place, times the cosine of view, before it is divided by what the table gives back. None where
    /// no environment was filtered for the place, or it is seen too obliquely.
    pub(crate) fn at(&self, sky: usize, table: &Table, seen: &Seen) -> Option<[f64; 3]> {
        let view = seen.0.map(|f| f.dot(&seen.1));
        if view[2] < self.least_cosine {
            return None;
        }
        let mut sum = [0.0; 3];
        for part in &self.parts {
            let look = Look::new(seen, part.meridian)?;
            let (poles, maps) = &part.sides[usize::from(look.left_handed)];
            for (k, weight) in poles.around(&look) {
                if weight > 0.0 {
                    let rgb = maps.get(k)?.get(sky)?.at(look.mirror);
                    (0..3).for_each(|c| sum[c] += weight * rgb[c]);
                }
            }
        }
        let share = table.white_share(view);
        Some([0, 1, 2].map(|c| sum[c] * share[c]))
    }
}
