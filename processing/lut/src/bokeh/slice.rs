//! Light profile along a line through an image.

use super::rotation::Map;
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Scharr's derivative filter: transverse offsets and their weights.
const SCHARR: [[f64; 2]; 3] = [[-1.0, 3.0], [0.0, 10.0], [1.0, 3.0]];

/// Minimum number of samples of a slice.
const SHORTEST: usize = 8;

/// A line segment in an image: columns and rows of its end points in pixels; pixel centres are at integers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Line(pub [f64; 4]);

/// Light along a line, one sample per pixel of its length.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Slice {
    /// Mean over the width; NaN where unknown.
    pub light: Vec<f64>,
    /// Standard error of that mean, from the scatter across the width.
    pub sigma: Vec<f64>,
    pub line: Line,
    pub width: usize,
    /// Angle in degrees, -90 to 90, from the line to the direction of strongest change of light, anticlockwise.
    pub tilt_deg: f64,
}

impl Line {
    /// Horizontal line through the centre of an image.
    pub(super) fn middle(map: &Map) -> Self {
        let row = 0.5 * (map.height - 1) as f64;
        Self([0.0, row, (map.width - 1) as f64, row])
    }

    fn length(&self) -> f64 {
        let Self([x0, y0, x1, y1]) = *self;
        (x1 - x0).hypot(y1 - y0)
    }
}

/// Samples the light along a line; each sample is the mean over `width` pixels across it.
///
/// # Errors
/// `Input` for a line that is too short or outside of the image.
pub(super) fn slice(map: &Map, line: Line, width: usize) -> Result<Slice> {
    let Line([x0, y0, x1, y1]) = line;
    let bad = |problem: String, remedy: &str| Err(Error::input("--slice", problem, remedy));
    let inside =
        |x: f64, y: f64| (0.0..=(map.width - 1) as f64).contains(&x) && (0.0..=(map.height - 1) as f64).contains(&y);
    if !inside(x0, y0) || !inside(x1, y1) {
        let problem = format!("{x0},{y0},{x1},{y1} is not inside the result of {} x {} pixels", map.width, map.height);
        return bad(problem, "give two points inside it (columns and rows of the cropped and turned result)");
    }
    let length = line.length();
    let count = length.floor() as usize + 1;
    if count < SHORTEST {
        return bad(
            format!("is {length:.1} pixels long; at least {SHORTEST} are needed"),
            "give a longer one, across the lines",
        );
    }
    let (ux, uy) = ((x1 - x0) / length, (y1 - y0) / length);
    let point = |along: f64, across: f64| map.at(x0 + along * ux - across * uy, y0 + along * uy + across * ux);
    let offsets: Vec<f64> = (0..width.max(1)).map(|k| k as f64 - 0.5 * (width.max(1) - 1) as f64).collect();
    let mut light = Vec::with_capacity(count);
    let mut sigma = Vec::with_capacity(count);
    let change = |[a, o]: [f64; 2], [da, d_o]: [f64; 2]| f64::from(point(a + da, o + d_o) - point(a - da, o - d_o));
    // Structure tensor of the light in coordinates along and across the line.
    let [mut aa, mut bb, mut ab] = [0.0; 3];
    for i in 0..count {
        let along = i as f64;
        let values: Vec<f64> = offsets.iter().map(|o| f64::from(point(along, *o))).filter(|v| v.is_finite()).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        light.push(mean);
        sigma.push((variance / n).sqrt());
        for o in &offsets {
            // Scharr's filter (2000) has the smallest error of direction.
            let a: f64 = SCHARR.iter().map(|[d, w]| w * change([along, o + d], [1.0, 0.0])).sum();
            let b: f64 = SCHARR.iter().map(|[d, w]| w * change([along + d, *o], [0.0, 1.0])).sum();
            if (a * b).is_finite() {
                [aa, bb, ab] = [aa + a * a, bb + b * b, ab + a * b];
            }
        }
    }
    if light.iter().filter(|v| v.is_finite()).count() < SHORTEST {
        return bad("crosses hardly anything that is known".into(), "give another one");
    }
    // Rows grow downwards, hence the sign.
    let tilt_deg = -(0.5 * (2.0 * ab).atan2(aa - bb)).to_degrees();
    Ok(Slice { light, sigma, line, width: offsets.len(), tilt_deg })
}

impl Slice {
    /// Samples with unknown values interpolated, as a Fourier transform requires.
    pub(super) fn bridged(&self) -> Vec<f64> {
        let mut values = self.light.clone();
        let known: Vec<usize> = (0..values.len()).filter(|i| values[*i].is_finite()).collect();
        let (Some(first), Some(last)) = (known.first().copied(), known.last().copied()) else { return values };
        let (a, b) = (values[first], values[last]);
        values[..first].fill(a);
        values[last + 1..].fill(b);
        for pair in known.windows(2) {
            let (from, to) = (values[pair[0]], values[pair[1]]);
            for (i, v) in values[pair[0]..pair[1]].iter_mut().enumerate() {
                *v = from + (to - from) * i as f64 / (pair[1] - pair[0]) as f64;
            }
        }
        values
    }

    /// CSV table: position in pixels and, if the pixel size is known, in µm; light; its standard error; height,
    /// whose column has the given name.
    pub(super) fn csv(&self, pixel_um: Option<f64>, column: &str, height: &dyn Fn(f64) -> f64) -> String {
        use std::fmt::Write;
        let mut text = format!("position_px,position_um,light,light_sigma,{column}\n");
        let number = |v: f64| if v.is_finite() { format!("{v:.6e}") } else { String::new() };
        for (i, (light, sigma)) in self.light.iter().zip(&self.sigma).enumerate() {
            let um = pixel_um.map_or(String::new(), |p| format!("{:.4}", p * i as f64));
            let height = number(height(*light));
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{i},{um},{},{},{height}", number(*light), number(*sigma));
        }
        text
    }
}
