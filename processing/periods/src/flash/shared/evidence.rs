//! Evidence for shared gratings: an individual grating is fitted to each connected area of pixels with one shared
//! grating.

use super::super::solve::{Copy, Prior, Solution, solve};
use super::refine::thinned;
use rayon::prelude::*;

/// Minimum number of interior pixels for a fit of an area's, or half an area's, individual grating.
const MIN_PIXELS: usize = 8;

/// Systematic shift of a grating observed from one side, relative to the lobe's width, from non-Gaussian lobes.
pub(super) const SHAPE: f64 = 0.1;

/// Minimum number of areas for a test of gradual change.
const MIN_AREAS: usize = 6;

/// Maximum useful standard deviation of an area's individual grating, relative to the lobe's width.
const MAX_SIGMA: f64 = 0.4;

/// χ² (two degrees of freedom) above which an area's individual grating differs from the shared one (chance probability
/// 1/3000).
const DIFFERENCE_CHI2: f64 = 16.0;

/// Side in pixels of a square within one area that must contain a pixel. Beside edges, and where the next tile
/// overlaps, all copies of narrower parts of an area may show the neighbouring polygon.
const WIDE: usize = 3;

/// Connected pixels with the same shared grating.
#[derive(Clone, Debug)]
pub(super) struct Area {
    /// Index of the shared grating.
    pub grating: usize,
    /// Pixels of the map, as indices.
    pub pixels: Vec<usize>,
}

impl Area {
    /// Pixels that lie in a square of the area.
    pub fn wide(&self, width: usize) -> Vec<usize> {
        let mut sorted = self.pixels.clone();
        sorted.sort_unstable();
        let square = |i: usize| (0..WIDE * WIDE).map(move |k| i + k / WIDE * width + k % WIDE);
        // Squares by their top left pixel.
        let is_square = |i: usize| i % width + WIDE <= width && square(i).all(|k| sorted.binary_search(&k).is_ok());
        let mut all: Vec<usize> = self.pixels.iter().copied().filter(|i| is_square(*i)).flat_map(square).collect();
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// Result of the test of one area.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AreaTest {
    /// Angle in rad from the shared to the individual grating, and relative difference of their lengths; `None` without
    /// a fit.
    pub own: Option<[f64; 2]>,
    /// Angles between the gratings of the left and right half and of the upper and lower half, and relative differences
    /// of their lengths.
    pub halves: [Option<[f64; 2]>; 2],
    /// True if the area's individual grating, or that of one of its halves, differs from the shared one.
    pub other: [bool; 2],
}

/// Areas of a map of gratings.
pub(super) fn areas(of: &[Option<usize>], width: usize) -> Vec<Area> {
    let height = of.len() / width.max(1);
    let mut seen = vec![false; of.len()];
    let mut all = vec![];
    for start in 0..of.len() {
        let Some(grating) = of[start].filter(|_| !seen[start]) else { continue };
        let (mut pixels, mut next) = (vec![], vec![start]);
        seen[start] = true;
        while let Some(i) = next.pop() {
            pixels.push(i);
            let (x, y) = (i % width, i / width);
            let sides = [
                (x > 0).then(|| i - 1),
                (x + 1 < width).then_some(i + 1),
                (y > 0).then(|| i - width),
                (y + 1 < height).then_some(i + width),
            ];
            for k in sides.into_iter().flatten().filter(|k| of[*k] == Some(grating)) {
                if !std::mem::replace(&mut seen[k], true) {
                    next.push(k);
                }
            }
        }
        all.push(Area { grating, pixels });
    }
    all
}

/// Fits each area's individual grating. `kept` holds, for interior pixels, the copies near the lobes of the shared
/// grating.
pub(super) fn area_tests(
    areas: &[Area],
    gratings: &[Solution],
    kept: &[Option<Vec<Copy>>],
    size: [usize; 2],
    prior: &Prior,
    lobe: f64,
) -> Vec<AreaTest> {
    let of = |area: &Area| {
        let shared = &gratings[area.grating];
        let whole: Vec<usize> = area.pixels.iter().copied().filter(|i| kept[*i].is_some()).collect();
        let own = |pixels: &[usize]| own(pixels, shared, kept, prior, lobe);
        let Some(all) = own(&whole) else { return AreaTest::default() };
        let mut area_tests = AreaTest {
            own: Some([turn(all.vector, shared.vector), length(all.vector) / length(shared.vector) - 1.0]),
            ..AreaTest::default()
        };
        area_tests.other[0] = all.from(shared.vector, [0.0; 3]) > DIFFERENCE_CHI2;
        for axis in 0..2 {
            let at = |i: usize| if axis == 0 { i % size[0] } else { i / size[0] };
            let mut sorted = whole.clone();
            sorted.sort_by_key(|i| at(*i));
            let (low, high) = sorted.split_at(sorted.len() / 2);
            if let (Some(low), Some(high)) = (own(low), own(high)) {
                let longer = length(high.vector) / length(low.vector) - 1.0;
                area_tests.halves[axis] = Some([turn(high.vector, low.vector), longer]);
                area_tests.other[1] |= low.from(high.vector, high.covariance) > DIFFERENCE_CHI2;
            }
        }
        area_tests
    };
    areas.par_iter().map(of).collect()
}

/// Significance, in standard deviations, of a gradual change of gratings over the tile. If they change gradually,
/// halves of all areas differ in the same sense, and individual gratings depend on position.
pub(super) fn gradual_change_sigmas(areas: &[Area], area_tests: &[AreaTest], width: usize) -> f64 {
    let middle = |area: &Area, axis: usize| {
        let at = |i: &usize| if axis == 0 { i % width } else { i / width };
        area.pixels.iter().map(at).sum::<usize>() as f64 / area.pixels.len() as f64
    };
    let off = |axis: usize, k: usize| {
        let halves: Vec<f64> = area_tests.iter().filter_map(|t| t.halves[axis]).map(|h| h[k]).collect();
        let places = areas.iter().zip(area_tests).filter_map(|(a, t)| Some([middle(a, axis), t.own?[k]]));
        from_zero(&halves).max(slope(&places.collect::<Vec<_>>()))
    };
    [[0, 0], [0, 1], [1, 0], [1, 1]].into_iter().map(|[axis, k]| off(axis, k)).fold(0.0, f64::max)
}

/// Mean over its standard deviation.
fn from_zero(all: &[f64]) -> f64 {
    let count = all.len() as f64;
    let mean = all.iter().sum::<f64>() / count;
    let squares: f64 = all.iter().map(|v| (v - mean).powi(2)).sum();
    if all.len() < MIN_AREAS || squares == 0.0 { 0.0 } else { mean.abs() / (squares / (count - 1.0) / count).sqrt() }
}

/// Slope of a fitted line over its standard deviation.
fn slope(all: &[[f64; 2]]) -> f64 {
    let count = all.len() as f64;
    let mean = [0, 1].map(|k| all.iter().map(|p| p[k]).sum::<f64>() / count);
    let sum = |j: usize, k: usize| all.iter().map(|p| (p[j] - mean[j]) * (p[k] - mean[k])).sum::<f64>();
    let (xx, xy, yy) = (sum(0, 0), sum(0, 1), sum(1, 1));
    let left = yy - xy * xy / xx;
    if all.len() < MIN_AREAS || left.is_nan() || left <= 0.0 {
        0.0
    } else {
        xy.abs() / (xx * left / (count - 2.0)).sqrt()
    }
}

/// A grating fitted to some pixels, with its covariance.
struct Individual {
    vector: [f64; 2],
    covariance: [f64; 3],
}

fn own(
    pixels: &[usize],
    shared: &Solution,
    kept: &[Option<Vec<Copy>>],
    prior: &Prior,
    lobe: f64,
) -> Option<Individual> {
    if pixels.len() < MIN_PIXELS {
        return None;
    }
    let all = thinned(pixels.iter().filter_map(|i| kept[*i].clone()).collect());
    let found = solve(&all, shared.vector, prior)?;
    let scale = (found.cost / (all.len() as f64 - 4.0).max(1.0)).max(1.0);
    let floor = (SHAPE * lobe).powi(2);
    let [xx, xy, yy] = found.covariance.map(|c| c * scale);
    let known = xx.max(yy).sqrt() < MAX_SIGMA * lobe;
    known.then_some(Individual { vector: found.vector, covariance: [xx + floor, xy, yy + floor] })
}

impl Individual {
    /// Squared Mahalanobis distance from another vector.
    fn from(&self, other: [f64; 2], more: [f64; 3]) -> f64 {
        let [xx, xy, yy] = [0, 1, 2].map(|k| self.covariance[k] + more[k]);
        let [dx, dy] = [self.vector[0] - other[0], self.vector[1] - other[1]];
        (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    }
}

fn length(v: [f64; 2]) -> f64 {
    v[0].hypot(v[1])
}

/// Angle from the second vector to the first, in rad.
fn turn(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[0] * a[1] - b[1] * a[0]).atan2(a[0] * b[0] + a[1] * b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gradual_change_is_distinguished_from_scatter() {
        let area = |k: usize| Area { grating: k % 4, pixels: vec![k, k + 1] };
        let areas: Vec<Area> = (0..20).map(area).collect();
        let with = |of: &dyn Fn(usize) -> f64| -> f64 {
            let area_tests = |k: usize| AreaTest { own: Some([0.0, of(k)]), ..AreaTest::default() };
            gradual_change_sigmas(&areas, &(0..20).map(area_tests).collect::<Vec<_>>(), 100)
        };
        let scatter = |k: usize| 0.01 * f64::from(((k as u32).wrapping_mul(2_654_435_761) >> 16) % 100) / 100.0;
        assert!(with(&scatter) < 3.0, "{}", with(&scatter));
        assert!(with(&|k| scatter(k) + 0.002 * k as f64) > 6.0);
    }

    #[test]
    fn areas_are_connected_by_sides() {
        let (a, b) = (Some(0), Some(1));
        #[rustfmt::skip]
        let map = [a, a, b,
                   None, b, a,
                   a, a, a];
        let found = areas(&map, 3);
        let sizes: Vec<(usize, usize)> = found.iter().map(|f| (f.grating, f.pixels.len())).collect();
        assert_eq!(sizes, [(0, 2), (1, 1), (1, 1), (0, 4)]);
        // A square of nine pixels, one pixel beside it, and two in a row below.
        let area = Area { grating: 0, pixels: vec![0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 12, 13] };
        assert_eq!(area.wide(4), [0, 1, 2, 4, 5, 6, 8, 9, 10]);
        // Rows do not continue beyond the picture's sides.
        let strip = Area { grating: 0, pixels: vec![1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12] };
        assert_eq!(strip.wide(2), Vec::<usize>::new());
    }
}
