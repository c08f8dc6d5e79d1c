//! Classes of pixels that differ in the strength of their modulation: gratings of several periods or depths in one
//! sample.
//!
//! Without a film, the points (S1/S0, S2/S0) of each grating lie on a circle about the origin. Its radius and offset
//! both follow from the grating's ratio R (2018 paper, Eq. 9). Radii are observable. Offsets are unknown constants, one
//! per class, which polarization photographs do not determine. The map therefore has a relative error between classes,
//! which σ must include. Gratings with equal radii cannot be distinguished.

use crate::StokesMaps;
use crate::film::check::{WIDEST_GAP_DEG, gap};
use crate::film::cloud::CloudPoint;
use nacre_base::statistics::median;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;

/// Standard deviation in degrees of the offset between two classes. It covers 68 % of the pairs of gratings whose radii
/// differ by a third, for ln r from 0 to 0.2 and ζ from 20 to 160°. Metal gratings of 30 to 100 nm depth have such
/// values.
const OFFSET_DEG: f64 = 4.0;

/// Limits of the decision.
mod limits {
    /// Minimum distance between two classes, in standard deviations of ln ρ.
    pub const APART: f64 = 4.0;
    /// Largest share of the points between two classes.
    pub const BETWEEN: f64 = 2e-3;
    /// Minimum share of the points in a class; smaller groups are edges and dirt.
    pub const SHARE: f64 = 0.03;
    /// Largest scatter variance about a class's circle, relative to the noise; beyond it, a film is the simpler
    /// explanation.
    pub const SCATTER: f64 = 1.5;
    /// Minimum number of points of all classes.
    pub const POINTS: usize = 1000;
}

/// Gratings that differ in the strength of their modulation.
#[derive(Clone, Debug)]
pub(crate) struct Classes {
    /// ln of the modulation at which each class but the first begins.
    bounds: Vec<f64>,
    /// Classes by increasing modulation.
    pub classes: Vec<Class>,
}

/// One class in the report.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Class {
    /// Share of the pixels with an orientation.
    pub share: f64,
    /// Median degree of linear polarization.
    pub dolp: f64,
    /// Standard deviation of its offset relative to the common offset of all pixels, in degrees; included in σ.
    pub offset_sigma_deg: f64,
}

/// ln of a point's modulation, with its standard deviation.
type Strength = (f64, f64);

fn strength(point: &CloudPoint) -> Strength {
    (point.at[0].hypot(point.at[1]).ln(), 1.0 / point.snr)
}

impl Classes {
    /// Finds classes among points with modulation. `None` for a single one, and for classes that resemble the few
    /// orientations of a sample behind a film.
    pub fn find(points: &[CloudPoint]) -> Option<Self> {
        if points.len() < limits::POINTS {
            return None;
        }
        let mut sorted: Vec<Strength> = points.iter().map(strength).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let groups = separated(&sorted);
        if groups.len() < 2 {
            return None;
        }
        let bounds: Vec<f64> = groups.windows(2).map(|pair| 0.5 * (pair[0].1 + pair[1].0)).collect();
        let mut all = vec![vec![]; groups.len()];
        points.iter().for_each(|p| all[class_of(&bounds, p)].push(*p));
        if !all.iter().all(|class| is_circle(class)) {
            return None;
        }
        let shares: Vec<f64> = all.iter().map(|class| class.len() as f64 / points.len() as f64).collect();
        let squares = shares.iter().map(|share| share * share).sum::<f64>();
        let classes = all
            .iter()
            .zip(&shares)
            .map(|(class, &share)| Class {
                share,
                dolp: typical(class).exp(),
                // Standard deviation of independent offsets relative to their mean over all pixels.
                offset_sigma_deg: OFFSET_DEG * (0.5 * (1.0 - 2.0 * share + squares)).max(0.0).sqrt(),
            })
            .collect();
        Some(Self { bounds, classes })
    }

    /// The points of the largest class.
    pub fn largest(&self, points: &[CloudPoint]) -> Vec<CloudPoint> {
        let share = |k: &usize| self.classes.get(*k).map_or(0.0, |c| c.share);
        let largest = (0..self.classes.len()).max_by(|a, b| share(a).total_cmp(&share(b))).unwrap_or(0);
        points.iter().filter(|p| class_of(&self.bounds, p) == largest).copied().collect()
    }

    /// Root mean square of the offsets over all pixels, in degrees.
    pub fn offset_deg(&self) -> f64 {
        self.classes.iter().map(|c| c.share * c.offset_sigma_deg * c.offset_sigma_deg).sum::<f64>().sqrt()
    }

    /// Adds the offset of each pixel's class to σ (rad).
    pub fn widen(&self, maps: &StokesMaps, sigma: &mut [f32]) {
        let bounds: Vec<f32> = self.bounds.iter().map(|b| (2.0 * b).exp() as f32).collect();
        let offsets: Vec<f32> = self.classes.iter().map(|c| (c.offset_sigma_deg as f32).to_radians()).collect();
        let light = maps.s0.par_iter().zip(&maps.s1).zip(&maps.s2);
        sigma.par_iter_mut().zip(light).with_min_len(1 << 14).for_each(|(sigma, ((s0, s1), s2))| {
            let square = (s1 * s1 + s2 * s2) / (s0 * s0);
            let class = bounds.iter().filter(|b| square >= **b).count();
            *sigma = sigma.hypot(offsets[class]).min(std::f32::consts::FRAC_PI_2);
        });
    }

    /// Warning for the user.
    pub fn warning(&self) -> String {
        let class = |c: &Class| format!("{:.0} % of the pixels with {:.3}", 100.0 * c.share, c.dolp);
        let list = self.classes.iter().map(class).collect::<Vec<_>>().join(", ");
        format!(
            "the degree of polarization falls into {} classes ({list}), as of gratings of several periods or depths: each has an offset of its own, \
             which the photographs do not determine. σ includes {OFFSET_DEG}° between two classes; deep gratings can differ by more",
            self.classes.len()
        )
    }
}

fn class_of(bounds: &[f64], point: &CloudPoint) -> usize {
    bounds.iter().filter(|b| strength(point).0 >= **b).count()
}

/// Bounds of groups of increasing strengths, separated by nearly empty gaps; smaller groups belong to no class.
fn separated(sorted: &[Strength]) -> Vec<(f64, f64)> {
    let noise = median(&mut sorted.iter().map(|s| s.1).collect::<Vec<_>>()).unwrap_or(0.0);
    let count = sorted.len() as f64;
    let between = (limits::BETWEEN * count) as usize;
    let mut groups: Vec<(usize, usize)> = vec![(0, 0)];
    // A group ends where the next points, apart from the few permitted between groups, are far away.
    for i in 0..sorted.len().saturating_sub(between + 1) {
        let far = sorted[i + between + 1].0 - sorted[i].0 > limits::APART * noise;
        let begins = i + between + 1;
        let inside = groups.last().is_some_and(|g| i >= g.0);
        if far && inside {
            groups.last_mut().into_iter().for_each(|g| g.1 = i);
            groups.push((begins, begins));
        }
    }
    groups.last_mut().into_iter().for_each(|g| g.1 = sorted.len() - 1);
    let large = |g: &&(usize, usize)| (g.1 + 1).saturating_sub(g.0) as f64 >= limits::SHARE * count;
    groups.iter().filter(large).map(|g| (sorted[g.0].0, sorted[g.1].0)).collect()
}

/// Whether points lie on a circle about the origin within their noise, without large gaps.
fn is_circle(class: &[CloudPoint]) -> bool {
    let middle = typical(class);
    let off = |p: &CloudPoint| {
        let (ln, sigma) = strength(p);
        ((ln - middle) / sigma).powi(2)
    };
    // The median of χ² with one degree of freedom is 0.455.
    let scatter = median(&mut class.iter().map(off).collect::<Vec<_>>()).unwrap_or(f64::INFINITY) / 0.455;
    let at: Vec<[f64; 2]> = class.iter().map(|p| p.at).collect();
    scatter < limits::SCATTER && gap(&at, [0.0; 2]) <= WIDEST_GAP_DEG
}

/// Median ln of the modulation.
fn typical(class: &[CloudPoint]) -> f64 {
    median(&mut class.iter().map(|p| strength(p).0).collect::<Vec<_>>()).unwrap_or(f64::NEG_INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::cloud::cloud;
    use crate::solve::orient_with;
    use crate::synthetic::{Series, Spread, Synthetic, uniform};
    use crate::{Fit, Model, SolveOptions, angle_difference};
    use num_complex::Complex;

    fn grating(r: f64, zeta_deg: f64, spread: Spread) -> Synthetic {
        Synthetic {
            ratio: Complex::from_polar(r, zeta_deg.to_radians()),
            spread,
            reflectance: 0.2,
            ..Synthetic::default()
        }
    }

    /// Photographs with one grating in the first part of the pixels and another one in the rest.
    fn beside(one: &Synthetic, two: &Synthetic, pixels: [usize; 2], seed: u64) -> Series {
        let (a, b) = (one.render(pixels[0], seed).unwrap(), two.render(pixels[1], seed + 1000).unwrap());
        let mut fit = Fit::new(pixels[0] + pixels[1], 1);
        for (k, psi) in a.angles.iter().enumerate() {
            fit.add(*psi, |_, values, _| {
                values[..pixels[0]].copy_from_slice(&a.frames[k]);
                values[pixels[0]..].copy_from_slice(&b.frames[k]);
            });
        }
        let truth = a.truth.iter().chain(&b.truth).copied().collect();
        Series { maps: fit.solve(&a.design), design: a.design, noise: a.noise, truth }
    }

    fn classes_of(series: &Series) -> Option<Classes> {
        let pixels = series.truth.len();
        Classes::find(&cloud(&series.maps, &series.design, &series.noise, pixels))
    }

    #[test]
    fn two_gratings_are_two_classes() {
        for spread in [Spread::Even, Spread::Bands(5)] {
            let series = beside(&grating(1.1, 45.0, spread), &grating(1.2, 30.0, spread), [9000, 3000], 7);
            let found = classes_of(&series).unwrap().classes;
            let [weak, strong] = found[..] else { panic!("{found:?}") };
            assert!((weak.share - 0.25).abs() < 0.01 && (strong.share - 0.75).abs() < 0.01, "{found:?}");
            // Eq. 9: |(1 - r², 2r sin ζ)|/(1 + r²).
            assert!((weak.dolp - 0.524).abs() < 0.002 && (strong.dolp - 0.710).abs() < 0.002, "{found:?}");
            // Relative to the mean over all pixels, a quarter of the pixels have three quarters of the offset.
            let offset = OFFSET_DEG * std::f64::consts::FRAC_1_SQRT_2;
            let wanted = [0.75, 0.25].map(|other: f64| offset * (2.0 * other * other).sqrt());
            assert!((weak.offset_sigma_deg - wanted[0]).abs() < 0.05, "{found:?} {wanted:?}");
            assert!((strong.offset_sigma_deg - wanted[1]).abs() < 0.05, "{found:?} {wanted:?}");
        }
    }

    /// A single grating, films with many or few orientations, and continuously varying strengths are not divided into
    /// classes.
    #[test]
    fn films_and_single_gratings_are_not_divided() {
        for spread in [Spread::Even, Spread::Bands(5), Spread::Bands(2)] {
            let plain = grating(1.1, 45.0, spread).photograph(12_000, 3).unwrap();
            assert!(classes_of(&plain).is_none(), "{spread:?}");
            for retardance in [3_f64, 10.0] {
                let film = Synthetic { retardance: retardance.to_radians(), axis: 0.4, ..grating(1.2, 150.0, spread) };
                let found = classes_of(&film.photograph(12_000, 3).unwrap());
                assert!(found.is_none(), "{retardance} {spread:?}: {found:?}");
            }
        }
    }

    /// For gratings drawn as in [`OFFSET_DEG`], σ includes their unknown offsets: most pixels are within 1σ and hardly
    /// any beyond 5σ.
    #[test]
    fn sigma_holds_the_offset_between_classes() {
        let mut ratios = vec![];
        for seed in 0..24 {
            let draw = |i| {
                let (ln_r, zeta) = (0.2 * uniform(seed, i), 20.0 + 140.0 * uniform(seed, i + 1));
                grating(ln_r.exp(), zeta, if seed % 2 == 0 { Spread::Even } else { Spread::Bands(5) })
            };
            let mut series = beside(&draw(1), &draw(3), [4000, 4000], seed);
            // Equal radii cannot be distinguished.
            if classes_of(&series).is_none() {
                continue;
            }
            let map = orient_with(&mut series.maps, &series.design, &series.noise, &SolveOptions::of(Model::Auto));
            let found = crate::compare(&map.orientation, &map.sigma, &series.truth, |_| true).unwrap();
            let off = |i: usize| f64::from(map.orientation[i]) - found.offset_deg.to_radians();
            let valid = (0..series.truth.len()).filter(|i| map.orientation[*i].is_finite());
            let ratio = |i: usize| angle_difference(off(i), f64::from(series.truth[i])).abs() / f64::from(map.sigma[i]);
            ratios.extend(valid.map(ratio));
        }
        let within = |limit: f64| ratios.iter().filter(|r| **r < limit).count() as f64 / ratios.len() as f64;
        println!("{} pixels: {:.3} within 1σ, {:.4} within 3σ", ratios.len(), within(1.0), within(3.0));
        assert!(ratios.len() > 12 * 8000 && (within(1.0) - 0.683).abs() < 0.05, "{}", within(1.0));
        assert!(within(3.0) > 0.99 && within(5.0) > 0.999);
    }
}
