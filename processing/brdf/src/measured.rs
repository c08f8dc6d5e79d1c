//! Measured error of a method, compared with direct sums.

use super::engine::{Memory, Model, Request};
use super::height::HeightField;
use super::reference::Reference;
use super::settings::{FAINTEST, Method};

/// Number of points per value of q.
const GROUP: usize = 8;

/// Largest difference from direct sums at some points near lobes, relative to the density there or to a lobe with 0.1 %
/// of the light.
pub(super) fn measured(field: &HeightField, model: &Model, request: &Request, method: Method) -> Option<f64> {
    // Windows of other shapes are not comparable.
    if matches!(method, Method::Pq | Method::PqLinear) {
        return None;
    }
    let points = field.um.len();
    let count = (20_000_000 / points.max(1)).clamp(3, 48);
    let reference = Reference::new(field);
    let (mut memory, mut worst) = (Memory::default(), 0.0_f64);
    let floor = FAINTEST * model.window.peak();
    let ratio = |k: usize, by: f64| (k as f64 * by).fract();
    let size = field.size_um();
    for group in 0..count.div_ceil(GROUP) {
        let q = request.q[0] + (request.q[1] - request.q[0]) * ratio(group + 1, 0.754_877_666_2);
        let bright = brightest(model, request, size, q, &mut memory);
        let place = |k: usize| {
            // Three of four points at the strongest frequencies, the others anywhere, slightly off-centre.
            let anywhere = [0, 1].map(|axis| {
                let bins = (request.frequency[axis] * size[axis]).floor();
                ((2.0 * ratio(k + 1, [0.569_840_291, 0.618_033_989][axis]) - 1.0) * bins).round() / size[axis]
            });
            // Corners that no pair of directions reaches are moved inwards.
            let within = (request.length / anywhere[0].hypot(anywhere[1]).max(1e-9)).min(1.0);
            let anywhere = if within < 1.0 {
                [0, 1].map(|axis| (within * anywhere[axis] * size[axis]).trunc() / size[axis])
            } else {
                anywhere
            };
            let place = bright.get(k % GROUP).copied().filter(|_| k % 4 != 3).unwrap_or(anywhere);
            let off = model.window.sigma * (ratio(k, 0.324_717_957) - 0.5);
            [place[0] + off, place[1] - 0.5 * off]
        };
        let places: Vec<[f64; 2]> = (group * GROUP..count.min((group + 1) * GROUP)).map(place).collect();
        for (place, truth) in places.iter().zip(reference.densities(&places, q, model.window)) {
            let found = model.density(*place, q, &mut memory);
            worst = worst.max((found - truth).abs() / truth.max(floor));
        }
    }
    Some(worst)
}

/// Brightest points on a coarse grid of a patch's frequencies.
fn brightest(model: &Model, request: &Request, size: [f64; 2], q: f64, memory: &mut Memory) -> Vec<[f64; 2]> {
    let bins = [0, 1].map(|axis| ((request.frequency[axis] * size[axis]) as isize).min(24));
    let mut all = vec![];
    for iy in -bins[1]..=bins[1] {
        for ix in -bins[0]..=bins[0] {
            let place = [ix as f64 / size[0], iy as f64 / size[1]];
            if place[0].hypot(place[1]) > request.length {
                continue;
            }
            all.push((model.density(place, q, memory), place));
        }
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.into_iter().take(GROUP).map(|p| p.1).collect()
}
