//! Lookup tables on a flat sample under distant environments. The reflection depends on the direction of view only, so
//! it is computed once for all directions. This replaces Monte Carlo sampling per pixel where it is cheaper and meets
//! the target error.

use crate::environment::{Reflected, correlate, light};
use crate::light::Sky;
use crate::material::diffraction::table::Table;
use crate::shape::ray::Hit;
use crate::vector::V3;
use nacre_base::Result;
use nacre_base::progress::Progress;
use std::f64::consts::PI;

/// Reflection of each sky by a flat sample.
pub(crate) struct Flat {
    frame: [V3; 3],
    skies: Vec<Reflected>,
}

impl Flat {
    /// Whether a point is seen from the side for which the reflection was computed.
    pub(crate) fn is_of(&self, hit: &Hit) -> bool {
        self.frame == hit.frame
    }

    /// Radiance of a sky reflected by the table towards a direction of view, times that direction's cosine, before
    /// albedo normalisation.
    pub(crate) fn at(&self, sky: usize, view: [f64; 3]) -> [f64; 3] {
        self.skies[sky].at(view)
    }

    /// Computes the reflection of a flat shape with a table, in `size` × `size` directions. The third axis of `frame`
    /// is on the camera's side.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(super) fn new(
        frame: [V3; 3],
        table: &Table,
        skies: &[Sky],
        size: usize,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let around = |h: [f64; 2]| table.around(h, 2.0 / size as f64);
        let sum = |sky: &Sky| {
            let radiance = |[x, y, z]: [f64; 3]| sky.radiance(frame[0] * x + frame[1] * y + frame[2] * z);
            let apart = PI / sky.map.height as f64;
            correlate(size, around, |channel| light(size, apart, |towards| radiance(towards)[channel]), progress)
        };
        let skies = skies.iter().map(sum).collect::<Result<_>>()?;
        Ok(Self { frame, skies })
    }

    /// Cells along a side of the disc of direction cosines; `None` without a sky.
    pub(crate) fn size(&self) -> Option<usize> {
        self.skies.first().map(Reflected::size)
    }

    /// Root mean square difference of two reflections, relative to the mean, over directions of view.
    pub(crate) fn differs(&self, other: &Self, views: &[[f64; 3]]) -> f64 {
        let (mut square, mut mean, mut count) = (0.0, 0.0, 0.0_f64);
        for view in views {
            for sky in 0..self.skies.len() {
                for (a, b) in self.at(sky, *view).into_iter().zip(other.at(sky, *view)) {
                    square += (a - b).powi(2);
                    mean += b;
                    count += 1.0;
                }
            }
        }
        if mean > 0.0 { (square * count).sqrt() / mean } else { 0.0 }
    }
}
