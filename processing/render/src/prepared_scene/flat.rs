//! Tables on a flat sample under far environments: what the sample reflects depends on the direction of view alone, so that it is summed up once
//! for all directions instead of drawn by chance for each pixel, where that is cheaper and as exact as asked for.

use crate::environment::{Reflected, correlate, light};
use crate::light::Sky;
use crate::material::diffraction::table::Table;
use crate::shape::ray::Hit;
use crate::vector::V3;
use nacre_base::Result;
use nacre_base::progress::Progress;
use std::f64::consts::PI;

/// What a flat sample reflects of each sky.
pub(crate) struct Flat {
    frame: [V3; 3],
    skies: Vec<Reflected>,
}

impl Flat {
    /// Whether a place is seen from the side that it is for.
    pub(crate) fn is_of(&self, hit: &Hit) -> bool {
        self.frame == hit.frame
    }

    /// Radiance of a sky that the table reflects towards a direction of view, times that direction's cosine, before it is divided by what the table
    /// gives back.
    pub(crate) fn at(&self, sky: usize, view: [f64; 3]) -> [f64; 3] {
        self.skies[sky].at(view)
    }

    /// Of a flat shape of this frame, whose third axis is on the camera's side, made of a table, in `size` × `size` directions.
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

    /// Cells along a side of the disc of direction cosines; none without a sky.
    pub(crate) fn size(&self) -> Option<usize> {
        self.skies.first().map(Reflected::size)
    }

    /// Root mean square difference of two over the mean, in directions of view.
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
