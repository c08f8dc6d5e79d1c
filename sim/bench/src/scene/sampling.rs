//! Rays of a pixel: many where it has an edge, few elsewhere.

use super::Scene;

/// Rays along each axis of a pixel that shows one surface.
const EVEN_RAYS: u32 = 2;

/// Points along each axis by which a pixel is judged: its edges and its middle.
const PROBES: u32 = 3;

impl Scene {
    /// Points in mm at which the rays of a pixel meet the sample.
    pub(super) fn rays(&self, x: f64, y: f64, shift: [f64; 2]) -> impl ExactSizeIterator<Item = (f64, f64)> {
        let all = self.bench.camera.subsamples;
        let n = if all > EVEN_RAYS && self.is_even(x, y, shift) { EVEN_RAYS } else { all };
        self.grid(x, y, shift, n, move |i| (f64::from(i) + 0.5) / f64::from(n))
    }

    /// Whether corners, edges and middle of a pixel show one surface.
    fn is_even(&self, x: f64, y: f64, shift: [f64; 2]) -> bool {
        let probes = self.grid(x, y, shift, PROBES, |i| f64::from(i) / f64::from(PROBES - 1));
        let mut points = probes.map(|(x, y)| self.sample.at(x, y));
        let first = points.next();
        first.is_none_or(|first| points.all(|point| point.is_like(&first)))
    }

    /// Points in mm at `n` offsets along each axis of a pixel; an offset runs from 0 to 1 over the pixel.
    fn grid(
        &self,
        x: f64,
        y: f64,
        [dx, dy]: [f64; 2],
        n: u32,
        offset: impl Fn(u32) -> f64,
    ) -> impl ExactSizeIterator<Item = (f64, f64)> {
        let (width, height) = (f64::from(self.bench.camera.width), f64::from(self.bench.camera.height));
        let pixel_mm = self.pixel_mm;
        (0..n * n).map(move |k| {
            let x_mm = (x - dx + offset(k % n) - 0.5 * width) * pixel_mm;
            (x_mm, (0.5 * height - y + dy - offset(k / n)) * pixel_mm)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BenchConfig;
    use crate::surface::SampleKind;

    /// The share of each surface in a pixel is that of a grid of 64 × 64 points, to the step of 8 × 8 rays.
    #[test]
    fn pixels_with_an_edge_get_all_rays() {
        let mut bench = BenchConfig { seed: 4, ..BenchConfig::default() };
        (bench.camera.width, bench.camera.height, bench.camera.subsamples) = (96, 96, 8);
        bench.sample.kind = SampleKind::Polygons;
        let scene = Scene::new(&bench).unwrap();
        let (mut fine, mut even) = (0, 0);
        for i in 0..96 * 96 {
            let (x, y) = (f64::from(i % 96), f64::from(i / 96));
            let rays = scene.rays(x, y, [0.3, 0.1]);
            if rays.len() == 64 {
                fine += 1
            } else {
                even += 1
            }
            let first = {
                let (x, y) = scene.grid(x, y, [0.3, 0.1], 1, |_| 0.5).next().unwrap();
                scene.sample.at(x, y)
            };
            let share = |points: &mut dyn Iterator<Item = (f64, f64)>| {
                let (mut like, mut all) = (0, 0);
                for (x, y) in points {
                    like += usize::from(scene.sample.at(x, y).is_like(&first));
                    all += 1;
                }
                like as f64 / all as f64
            };
            let exact = share(&mut scene.grid(x, y, [0.3, 0.1], 64, |i| (f64::from(i) + 0.5) / 64.0));
            let found = share(&mut scene.rays(x, y, [0.3, 0.1]));
            // An edge along the rows of rays is off by half a step, a sliver between two probes by less.
            assert!((found - exact).abs() <= 0.5 / 8.0, "{i}: {found} for {exact}");
        }
        // Polygons are about nine pixels wide here.
        assert!(even > 2 * fine && fine > 500, "{even} even, {fine} with an edge");
    }
}
