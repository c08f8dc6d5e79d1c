//! Lamps of an environment as point sources (2017 TOG, section 6.1). Small bright regions are removed from the
//! environment, and the table is convolved with their mirror image.

use super::{Environment, Frame, Table, geometry};

/// A lamp: a direction, and the point sources around it.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// Centroid of its light.
    pub direction: [f64; 3],
    /// Flux (radiance times solid angle) of each point source, and its position in direction cosines relative to the
    /// centroid (east, north).
    pub spread: Vec<([f64; 2], [f64; 3])>,
}

/// Separates regions brighter than `threshold` times the mean radiance: returns the lamps, and the environment with
/// these pixels at the threshold. Adjacent pixels form one lamp.
///
/// # Errors
/// As [`Environment::of`].
pub fn lamps(environment: &Environment, threshold: f64) -> nacre_base::Result<(Vec<Lamp>, Environment)> {
    let (width, height) = (environment.width, environment.height);
    let bright = |i: usize| environment.rgb[i].iter().map(|v| f64::from(*v)).sum::<f64>();
    let sum: f64 = (0..width * height).map(|i| bright(i) * environment.solid_angle(i / width)).sum();
    let limit = threshold * sum / (4.0 * std::f64::consts::PI);
    let mut seen: Vec<bool> = (0..width * height).map(|i| bright(i) <= limit).collect();
    let (mut found, mut rest) = (vec![], environment.rgb.clone());
    for start in 0..width * height {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut pixels = vec![start];
        let mut next = 0;
        while let Some(i) = pixels.get(next).copied() {
            next += 1;
            let (x, y) = (i % width, i / width);
            let beside = [y * width + (x + 1) % width, y * width + (x + width - 1) % width];
            let over = [(y > 0).then(|| i - width), (y + 1 < height).then(|| i + width)];
            for j in beside.into_iter().chain(over.into_iter().flatten()) {
                if !seen[j] {
                    seen[j] = true;
                    pixels.push(j);
                }
            }
        }
        found.push(lamp(environment, &pixels, limit, &mut rest));
    }
    Ok((found, Environment::of(width, height, rest)?))
}

fn lamp(environment: &Environment, pixels: &[usize], limit: f64, rest: &mut [[f32; 3]]) -> Lamp {
    let width = environment.width;
    let mut mean = [0.0; 3];
    let mut lights = vec![];
    for i in pixels {
        let pixel = environment.rgb[*i];
        let whole: f64 = pixel.iter().map(|v| f64::from(*v)).sum();
        let kept = (limit / whole) as f32;
        rest[*i] = pixel.map(|v| v * kept);
        let direction = environment.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let flux = pixel.map(|v| f64::from(v - v * kept) * environment.solid_angle(i / width));
        (0..3).for_each(|k| mean[k] += direction[k] * flux.iter().sum::<f64>());
        lights.push((direction, flux));
    }
    let length = mean.iter().map(|v| v * v).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    let direction = mean.map(|v| v / length);
    let frame = Frame::facing(direction, std::f64::consts::FRAC_PI_2);
    let place = |(d, flux): ([f64; 3], [f64; 3])| {
        let [x, y, _] = frame.local(d);
        ([x, y], flux)
    };
    Lamp { direction, spread: lights.into_iter().map(place).collect() }
}

impl Lamp {
    /// Radiance reflected towards `view` (world): the table convolved with the lamp, at the half vector of its
    /// centroid. `(1 + ωi·ωo)²` is assumed constant over the lamp.
    pub fn reflected(&self, table: &Table, frame: &Frame, view: [f64; 3]) -> [f64; 3] {
        let (light, view) = (frame.local(self.direction), frame.local(view));
        let factor = geometry(light, view);
        let mut sum = [0.0; 3];
        if factor == 0.0 {
            return sum;
        }
        let own = Frame::facing(self.direction, std::f64::consts::FRAC_PI_2);
        let [east, north] = [frame.local(own.tangent), frame.local(own.bitangent)];
        for ([x, y], flux) in &self.spread {
            let at = |k: usize| light[k] + view[k] + x * east[k] + y * north[k];
            let s = table.at([at(0), at(1)]);
            (0..3).for_each(|c| sum[c] += f64::from(s[c]) * flux[c] * factor);
        }
        sum
    }
}
