//! Normalisation of Stam's BRDF of a height field by its directional albedo.

use crate::light::viewer::RANGE;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_brdf::{Densities, HeightField, Workspace};
use nacre_image::catmull_rom;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicU32, Ordering};

/// Side of a block in spectrum samples, which are merged where the integrand varies little. A block is as wide as the
/// spacing of the patch's frequencies, or as a lobe's standard deviation if that is larger.
const BLOCK: i32 = 4;

/// Number of the brightest blocks whose samples are summed individually near the rim. The other blocks hold little
/// light, but grazing views receive nothing else.
const BRIGHTEST: usize = 312;

/// Radius in the disc of direction cosines within which the integrand varies little over a block.
const INSIDE: f64 = 0.7;

/// Nodes per standard deviation of a lobe, the scale on which the albedo changes where a lobe sets; cubic interpolation
/// between them.
const FINE: f64 = 2.0;

/// Sampling steps of a patch's spectrum: a quarter of its frequency spacing, or of a lobe's standard deviation if that
/// is larger. Twice these steps gave an error of 0.9 % at 88°.
pub(crate) fn sides(field: &HeightField, densities: &Densities) -> [f64; 2] {
    field.size_um().map(|s| (0.25 / s).max(0.25 * densities.window.sigma))
}

/// Smallest and largest number of directions of view along a side, and of wave numbers.
const VIEWS: [usize; 2] = [33, 121];
const NUMBERS: [usize; 2] = [12, 48];

/// Smallest cosine of view that is distinguished from zero.
const GRAZING: f64 = 2e-3;

/// Radius in the disc of direction cosines beyond which gain and solid angle vary within cells and are integrated.
const RIM: f64 = 0.9;

/// Nodes per turn of the phase of the deepest point. A power density varies on the scale of half a turn; interpolation
/// between nodes is linear.
const NODES_PER_TURN: f64 = 32.0;
const MAX_NODES: usize = 800;

/// Albedo times cos² θ over directions of view and wave numbers. At grazing views Stam's gain makes the albedo times
/// cos θ grow as 1 / cos θ.
///
/// Directions are equidistant in the projection `(x, y) / √((1 + z)(1 + √z))` with radius `√(1 - √z)`, which is smooth
/// at the centre and dense where the cosine z is small. A node is computed at its first use: a picture of a distant
/// plane needs only nodes around one direction of view.
pub(crate) struct AlbedoNormalisation {
    views: usize,
    numbers: usize,
    places: Places,
    /// Bits of an f32; those of NaN for nodes not yet computed.
    albedo: Vec<AtomicU32>,
}

const UNKNOWN: u32 = f32::NAN.to_bits();

/// The patch's spectrum, block by block.
struct Places {
    blocks: Vec<Block>,
    /// Power densities at nodes of `q`, row by row.
    power: Vec<f32>,
    /// Sides of a sample.
    sides: [f64; 2],
    nodes: usize,
    /// Nodes per unit of q.
    per_q: f64,
}

/// Adjacent spectrum samples.
struct Block {
    middle: [f64; 2],
    /// Index of its row of power densities.
    row: usize,
    /// Centres of its samples, whose rows follow the block's; empty for a dim block.
    places: Vec<[f64; 2]>,
}

impl AlbedoNormalisation {
    /// Normalisation of a height field of this depth, from densities under light of a short coherence length. The
    /// spectrum is sampled with cells of these sides.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn new(densities: &Densities, sides: [f64; 2], depth_um: f64, progress: &dyn Progress) -> Result<Self> {
        progress.check()?;
        let places = Places::new(densities, sides, depth_um);
        let lobe = densities.window.sigma / FINE;
        let within = |n: f64, [least, most]: [usize; 2]| (n.ceil() as usize).clamp(least, most);
        let views = within(2.0 * 2f64.sqrt() * 1.9 / lobe, VIEWS) | 1;
        let numbers = within((RANGE[1] - RANGE[0]) / lobe, NUMBERS);
        let albedo = (0..views * views * numbers).map(|_| AtomicU32::new(UNKNOWN)).collect();
        progress.check()?;
        Ok(Self { views, numbers, places, albedo })
    }

    /// Value at a node: `k` counts row by row, wave number by wave number.
    fn value(&self, k: usize) -> f32 {
        let known = self.albedo[k].load(Ordering::Relaxed);
        if known != UNKNOWN {
            return f32::from_bits(known);
        }
        let views = self.views * self.views;
        let number = RANGE[0] + (RANGE[1] - RANGE[0]) * (k / views) as f64 / (self.numbers - 1) as f64;
        // Two threads that compute the same node obtain the same value.
        let value = self.node(k % views, number) as f32;
        self.albedo[k].store(value.to_bits(), Ordering::Relaxed);
        value
    }

    /// Value at a node. Beyond the rim it is extrapolated, for the cubic interpolation near the rim.
    fn node(&self, k: usize, number: f64) -> f64 {
        let at = |k: usize| 2.0 * k as f64 / (self.views - 1) as f64 - 1.0;
        let [x, y] = [at(k % self.views), at(k / self.views)];
        let radius = x.hypot(y);
        let of = |to: f64| {
            let z = (1.0 - to * to).max(0.0).powi(2);
            let scale = ((1.0 + z) * (1.0 + z.sqrt())).sqrt() * to / radius.max(1e-9);
            let z = z.max(GRAZING);
            self.places.albedo([x * scale, y * scale, z], number) * z
        };
        let beyond = radius - 1.0;
        if beyond <= 0.0 {
            of(radius)
        } else if beyond < 6.0 / (self.views - 1) as f64 {
            2.0 * of(1.0) - of(1.0 - beyond)
        } else {
            0.0
        }
    }

    /// Nodes along a side, and wave numbers.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.views, self.numbers]
    }

    /// Values at all nodes: wave number by wave number, row by row.
    pub(crate) fn values(&self) -> Vec<f32> {
        (0..self.albedo.len()).into_par_iter().map(|k| self.value(k)).collect()
    }

    /// Albedo times the cosine of view.
    pub(crate) fn at(&self, view: [f64; 3], number: f64) -> f64 {
        let cos = view[2].max(0.0);
        let scale = 1.0 / ((1.0 + cos) * (1.0 + cos.sqrt())).sqrt();
        let (n, m) = (self.views, self.numbers);
        let place = |v: f64| ((v * scale).clamp(-1.0, 1.0) + 1.0) * 0.5 * (n - 1) as f64;
        let (x, y) = (place(view[0]), place(view[1]));
        let z = ((number - RANGE[0]) / (RANGE[1] - RANGE[0])).clamp(0.0, 1.0) * (m - 1) as f64;
        let (i, j, k) = ((x as usize).min(n - 2), (y as usize).min(n - 2), (z as usize).min(m - 2));
        let [u, v, w] = [x - i as f64, y - j as f64, z - k as f64].map(|t| catmull_rom(t as f32));
        // Beyond the edges, the edge nodes are repeated.
        let near = |i: usize, n: usize| [0, 1, 2, 3].map(|o| (i + o).saturating_sub(1).min(n - 1));
        let (columns, rows) = (near(i, n), near(j, n));
        let mut sum = 0.0;
        for (k, w) in near(k, m).into_iter().zip(w) {
            for (j, v) in rows.iter().zip(v) {
                let across: f32 = columns.iter().zip(u).map(|(i, u)| u * self.value((k * n + j) * n + i)).sum();
                sum += w * v * across;
            }
        }
        f64::from(sum) / view[2].max(GRAZING)
    }
}

impl Places {
    fn new(densities: &Densities, sides: [f64; 2], depth_um: f64) -> Self {
        let most_q = 2.0 * TAU * RANGE[1];
        let nodes = ((most_q * depth_um / TAU * NODES_PER_TURN) as usize).clamp(16, MAX_NODES) + 1;
        let per_q = (nodes - 1) as f64 / most_q;
        let half = sides.map(|s| (2.0 * RANGE[1] / s) as i32);
        let width = (2 * half[0] + 1) as usize;
        let count = width * (2 * half[1] + 1) as usize;
        let frequency = |k: usize| {
            let at = [(k % width) as i32 - half[0], (k / width) as i32 - half[1]];
            [0, 1].map(|i| f64::from(at[i]) * sides[i])
        };
        // Evaluated at three phase depths, since some orders vanish at one.
        let light: Vec<f64> = (0..count)
            .into_par_iter()
            .map_init(Workspace::default, |w, k| {
                [0.35, 0.5, 0.65].iter().map(|part| densities.at(frequency(k), part * most_q, w)).sum()
            })
            .collect();
        let mut blocks: BTreeMap<[i32; 2], Vec<usize>> = BTreeMap::new();
        for k in 0..count {
            let at = [(k % width) as i32 - half[0], (k / width) as i32 - half[1]];
            blocks.entry(at.map(|v| v.div_euclid(BLOCK))).or_default().push(k);
        }
        let mut blocks: Vec<_> = blocks.into_iter().collect();
        let light_of = |members: &[usize]| members.iter().map(|k| light[*k]).sum::<f64>();
        blocks.sort_by(|a, b| light_of(&b.1).total_cmp(&light_of(&a.1)));
        // Centroid of a block's light, so that its variation cancels to first order.
        let middle = |members: &[usize]| {
            let all = light_of(members).max(f64::MIN_POSITIVE);
            [0, 1].map(|i| members.iter().map(|k| (light[*k] / all) * frequency(*k)[i]).sum::<f64>())
        };
        let mut rows = 0;
        let each = blocks.iter().enumerate().map(|(n, (_, members))| {
            let places: Vec<[f64; 2]> = members.iter().filter(|_| n < BRIGHTEST).map(|k| frequency(*k)).collect();
            let block = Block { middle: middle(members), row: rows, places };
            rows += 1 + block.places.len();
            block
        });
        let each: Vec<Block> = each.collect();
        let mut power = vec![0.0_f32; rows * nodes];
        let mut rest = power.as_mut_slice();
        let mut tasks = vec![];
        for (block, (_, members)) in each.iter().zip(&blocks) {
            let rows;
            (rows, rest) = std::mem::take(&mut rest).split_at_mut((1 + block.places.len()) * nodes);
            tasks.push((rows, members));
        }
        tasks.into_par_iter().for_each_init(Workspace::default, |w, (rows, members)| {
            let (whole, places) = rows.split_at_mut(nodes);
            // A lobe is four samples wide, so every second one along both axes suffices for a dim block.
            let odd = |k: &&usize| (**k % width) % 2 == 1 && (**k / width) % 2 == 1;
            let some: Vec<usize> = members.iter().filter(odd).copied().collect();
            let looked_at = if some.is_empty() || !places.is_empty() { members } else { &some };
            let share = members.len() as f64 / (looked_at.len() as f64 * f64::from(BLOCK * BLOCK));
            for n in 0..nodes {
                let mut sum = 0.0;
                for (j, k) in looked_at.iter().enumerate() {
                    let density = densities.at(frequency(*k), n as f64 / per_q, w);
                    sum += density;
                    if !places.is_empty() {
                        places[j * nodes + n] = density as f32;
                    }
                }
                whole[n] = (share * sum) as f32;
            }
        });
        Self { blocks: each, power, sides, nodes, per_q }
    }

    /// `∬ (1 + ωi·ωo)² / w² · P(f, q) ν² / cos θi dx dy`: the albedo times the cosine of view before normalisation.
    fn albedo(&self, view: [f64; 3], number: f64) -> f64 {
        let turn = 1.0 / number;
        let sides = self.sides.map(|s| s * turn);
        let whole = sides.map(|s| s * f64::from(BLOCK));
        let reach = 0.5 * whole[0].hypot(whole[1]);
        let mut sum = 0.0;
        for block in &self.blocks {
            let [x, y] = [0, 1].map(|k| block.middle[k] * turn - view[k]);
            let square = x * x + y * y;
            if square > (1.0 + reach) * (1.0 + reach) {
                continue;
            }
            if square < INSIDE * INSIDE || block.places.is_empty() {
                sum += self.part(block.row, [x, y], whole, view, number);
                continue;
            }
            for (k, place) in block.places.iter().enumerate() {
                let at = [0, 1].map(|k| place[k] * turn - view[k]);
                sum += self.part(block.row + 1 + k, at, sides, view, number);
            }
        }
        sum * number * number
    }

    /// Contribution of a cell with these sides about a position in the disc of direction cosines.
    #[inline]
    fn part(&self, row: usize, [x, y]: [f64; 2], sides: [f64; 2], view: [f64; 3], number: f64) -> f64 {
        let power = &self.power[row * self.nodes..][..self.nodes];
        let square = x * x + y * y;
        // A single division, because divisions dominate the time.
        let value = |[x, y, z]: [f64; 3], by: f64| {
            let w = (z + view[2]).max(1e-6);
            let aligned = 1.0 + x * view[0] + y * view[1] + z * view[2];
            self.density(power, TAU * number * w) * aligned * aligned / (w * w * by)
        };
        if square > RIM * RIM {
            at_rim([x, y], sides, view[2].max(1e-3), value)
        } else {
            let z = (1.0 - square).sqrt();
            value([x, y, z], z) * sides[0] * sides[1]
        }
    }

    /// Power density of a sample, interpolated between its nodes.
    fn density(&self, power: &[f32], q: f64) -> f64 {
        let q = q * self.per_q;
        let k = (q as usize).min(self.nodes - 2);
        let share = q - k as f64;
        // The diffracted power of a shallow phase grows with its square.
        let share = if k == 0 { share * share } else { share };
        f64::from(power[k]) * (1.0 - share) + f64::from(power[k + 1]) * share
    }
}

/// Integral over the solid angle of the part of a cell above the horizon, for an integrand that varies as a power of
/// `z + low`. Gauss quadrature runs along the cell's centre line, octave by octave of that sum. The solid angle is
/// `dx dy / z`, which equals `dz dy / x` on a line of constant y. `value` divides by its second argument.
#[inline]
fn at_rim([x, y]: [f64; 2], sides: [f64; 2], low: f64, value: impl Fn([f64; 3], f64) -> f64) -> f64 {
    const GAUSS: [f64; 2] = [-0.577_350_269_189_625_8, 0.577_350_269_189_625_8];
    let along_x = x.abs() >= y.abs();
    let ([along, across], [length, width]) = if along_x { ([x, y], sides) } else { ([y, x], [sides[1], sides[0]]) };
    let square = 1.0 - across * across;
    let height = |along: f64| (square - along.max(0.0).powi(2)).max(0.0).sqrt();
    let [first, last] = [height(along.abs() + 0.5 * length), height(along.abs() - 0.5 * length)];
    if last <= first {
        return 0.0;
    }
    let [mut from, to] = [first, last].map(|z| z + low);
    let mut sum = 0.0;
    while from < to {
        let next = to.min(2.0 * from);
        let half = 0.5 * (next - from);
        for node in GAUSS {
            let z = from + half * (1.0 + node) - low;
            let flat = (square - z * z).max(1e-6).sqrt();
            let along = flat.copysign(along);
            let [x, y] = if along_x { [along, across] } else { [across, along] };
            sum += value([x, y, z], flat) * half;
        }
        from = next;
    }
    sum * width
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_base::progress::Silent;

    /// The albedo times cos θ by direct summation over light, equidistant in azimuth and in log(z + cos θ).
    fn plainly(densities: &Densities, view: [f64; 3], number: f64) -> f64 {
        let (n, cos) = (300, view[2]);
        let ratio = (1.0 + cos) / cos;
        let part = |w: &mut Workspace, i: usize| {
            let [u, v] = [(i / (2 * n)) as f64 + 0.5, 0.5 * ((i % (2 * n)) as f64 + 0.5)].map(|k| k / n as f64);
            let z = cos * ratio.powf(u) - cos;
            let (flat, (s, c)) = ((1.0 - z * z).max(0.0).sqrt(), (TAU * v).sin_cos());
            let light = [flat * c, flat * s, z];
            let density = densities.at([0, 1].map(|k| (light[k] + view[k]) * number), TAU * number * (z + cos), w);
            let gain = (1.0 + (0..3).map(|k| light[k] * view[k]).sum::<f64>()) / (z + cos);
            density * gain * gain * (z + cos)
        };
        let sum: f64 = (0..2 * n * n).into_par_iter().map_init(Workspace::default, part).sum();
        sum * number * number * ratio.ln() * TAU / (2 * n * n) as f64
    }

    #[test]
    fn the_albedo_is_that_of_plain_sums() {
        // Sinusoids in two directions, 0.26 µm deep.
        let n = 64;
        let um = |i: usize| -> f64 {
            let [u, v] = [i % n, i / n].map(|k| TAU * k as f64 / n as f64);
            0.08 * (4.0 * u).cos() + 0.05 * (3.0 * v + u).sin()
        };
        let field = HeightField::new("bumps", n, n, 0.09, (0..n * n).map(um).collect()).unwrap();
        let densities = Densities::new(&field, 2.88, 1e-4, 1e7, &Silent).unwrap();
        let begun = std::time::Instant::now();
        let norm = AlbedoNormalisation::new(&densities, sides(&field, &densities), field.range_um(), &Silent).unwrap();
        println!("{:.1} s", begun.elapsed().as_secs_f64());
        for (angle, bound) in [(20.0_f64, 0.005), (60.0, 0.005), (80.0, 0.005), (88.0, 0.005), (89.5, 0.01)] {
            for number in [1.5, 2.4] {
                let ((sin, cos), (s, c)) = (angle.to_radians().sin_cos(), 10.0_f64.to_radians().sin_cos());
                let view = [sin * c, sin * s, cos];
                let (found, truth) = (norm.at(view, number), plainly(&densities, view, number));
                println!("{angle}° {number}: {:+.4} %", 100.0 * (found / truth - 1.0));
                assert!((found / truth - 1.0).abs() < bound, "{angle}° {number}: {found} {truth}");
            }
        }
    }
}
