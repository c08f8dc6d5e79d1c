//! The sums of a fit, with equal or with weighted frames.

use crate::fit::merge::Merge;
use crate::fit::weighted::WeightedFit;
use crate::{Design, Fit, StokesMaps};

/// Sums over the photographs.
pub(crate) enum Accumulator {
    /// All pixels of a view have the same weight.
    Uniform(Fit),
    /// Exposures were merged, so variances differ from pixel to pixel.
    Weighted(WeightedFit),
}

impl Accumulator {
    pub(crate) fn new(weighted: bool, width: usize, height: usize) -> Self {
        if weighted { Self::Weighted(WeightedFit::new(width, height)) } else { Self::Uniform(Fit::new(width, height)) }
    }

    /// Empty sums of the same kind.
    pub(crate) fn emptied(&self, width: usize, height: usize) -> Self {
        Self::new(matches!(self, Self::Weighted(_)), width, height)
    }

    pub(crate) fn width(&self) -> usize {
        match self {
            Self::Uniform(fit) => fit.width(),
            Self::Weighted(fit) => fit.width(),
        }
    }

    /// Number of added views.
    pub(crate) fn views(&self) -> usize {
        match self {
            Self::Uniform(fit) => fit.frames(),
            Self::Weighted(fit) => fit.frames(),
        }
    }

    pub(crate) fn thinned(&self, step: usize) -> Self {
        match self {
            Self::Uniform(fit) => Self::Uniform(fit.thinned(step)),
            Self::Weighted(fit) => Self::Weighted(fit.thinned(step)),
        }
    }

    pub(crate) fn solve(self, design: &Design) -> StokesMaps {
        match self {
            Self::Uniform(fit) => fit.solve(design),
            Self::Weighted(fit) => fit.solve(),
        }
    }

    /// Adds several views at once; with equal weights only one photograph of each is used. `row(v, k, y, values, bad)`
    /// yields a row of the `k`-th photograph of the `v`-th view.
    pub(crate) fn add_several(
        &mut self,
        views: &[(f64, &Merge)],
        row: impl Fn(usize, usize, usize, &mut [f32], &mut [u8]) + Sync,
    ) {
        match self {
            Self::Uniform(fit) => {
                let angles: Vec<f64> = views.iter().map(|(angle, _)| *angle).collect();
                fit.add_several(&angles, |v, y, light, bad| row(v, 0, y, light, bad));
            }
            Self::Weighted(_) => {
                for (v, (angle, merge)) in views.iter().enumerate() {
                    self.add(*angle, merge, |k, y, light, bad| row(v, k, y, light, bad));
                }
            }
        }
    }

    /// Adds one view. `row(k, y, values, bad)` yields a row of its `k`-th photograph.
    pub(crate) fn add(&mut self, angle: f64, merge: &Merge, row: impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync) {
        match self {
            Self::Uniform(fit) => fit.add(angle, |y, light, bad| row(0, y, light, bad)),
            Self::Weighted(fit) => fit.add(angle, |y, light, variances, bad| {
                merge.row(|k, light, bad| row(k, y, light, bad), light, variances, bad);
            }),
        }
    }
}
