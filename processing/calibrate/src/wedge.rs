//! Image shift of a wedged analyser over its turn.

use crate::turn::{Light, Turn};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_frames::{Frame, LinearFrame, Linearizer, LoadedFrames};
use nacre_image::registration::{Registrar, Registration};
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::PI;

/// Share of the brightest photograph below which one shows too little to be registered.
const BRIGHT: f64 = 0.3;

/// Smallest number of photographs.
const LEAST: usize = 6;

/// Light at the edge of the bright part, relative to its mean, between which the weight of a pixel rises from 0 to 1.
/// Weights of all other pixels are constant, so that uneven light and noise do not move the centroid.
const EDGE: [f64; 2] = [0.25, 0.75];

/// Standard deviation of the weight of an edge pixel from its ideal one, as the edge is sampled on the pixel grid:
/// 0.07 on ten simulated benches of 192² pixels, rounded up.
const EDGE_SIGMA: f64 = 0.08;

/// Bright part of a picture.
struct Bright {
    /// Area in pixels.
    area: f64,
    /// Centroid in pixels, to the right and upwards.
    centroid: [f64; 2],
}

/// Image shift that turns with the analyser: its length, and its direction at the transmission axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Wedge {
    /// Length of the shift in pixels.
    pub shift_px: f64,
    /// Direction of the shift relative to the transmission axis in degrees, anticlockwise.
    pub direction_deg: f64,
    /// Standard deviation of each component in pixels.
    pub sigma_px: f64,
}

/// Measures the shift from the bright photographs: by the centroid of their bright part if it lies within the picture,
/// as a polarizer in a mount, otherwise by registration. `None` if they show too little structure.
///
/// # Errors
/// `Input` for unreadable files; `Cancelled`.
pub fn wedge(
    frames: &LoadedFrames,
    turn: &Turn,
    sense: f64,
    zero_deg: f64,
    progress: &dyn Progress,
) -> Result<Option<Wedge>> {
    let brightest = turn.lights.iter().map(|l| l.light).fold(0.0, f64::max);
    let photograph = |light: &Light| {
        let of_angle = |a: &f64| (a - light.stage_deg).abs() < 1e-9;
        let frame = frames.set.frames.iter().find(|f| f.analyser_deg.as_ref().is_some_and(of_angle))?;
        Some((frame, (zero_deg + sense * light.stage_deg).to_radians()))
    };
    let (bright, axes): (Vec<&Frame>, Vec<f64>) =
        turn.lights.iter().filter(|l| l.light > BRIGHT * brightest).filter_map(photograph).unzip();
    if bright.len() < LEAST {
        return Ok(None);
    }
    let linearizer = Linearizer::new(frames)?;
    let mut registrar = Registrar::new(frames.info.width, frames.info.height);
    let mut parts = vec![];
    progress.stage("measuring shifts", bright.len() as u64);
    for frame in bright {
        let decoded = linearizer.frame(frames, frame)?;
        parts.push(bright_part(&decoded, [frames.info.width, frames.info.height]));
        registrar.add(|y, left, values, bad| decoded.strided(y, left, 1, values, bad));
        progress.step();
        progress.check()?;
    }
    if let Some(parts) = parts.into_iter().collect::<Option<Vec<_>>>() {
        let points: Vec<[f64; 2]> = parts.iter().map(|part| part.centroid).collect();
        let found = turning(&axes, &points, 0.0);
        // Standard deviation of the centroid of a disc whose 2πR edge pixels have independent errors.
        let radius = (parts[0].area / PI).sqrt();
        let sampling = EDGE_SIGMA / (PI * radius).sqrt();
        return Ok(Some(Wedge { sigma_px: found.sigma_px.hypot(sampling), ..found }));
    }
    let Registration::Told(shifts) = registrar.polarized(&axes) else { return Ok(None) };
    let points: Vec<[f64; 2]> = shifts.iter().map(|s| [s.dx, -s.dy]).collect();
    let sigma = shifts.iter().map(|s| s.sigma * s.sigma).sum::<f64>() / shifts.len() as f64;
    Ok(Some(turning(&axes, &points, sigma.sqrt())))
}

/// The bright part of the picture. `None` if it reaches the border, which may cut it, or if a pixel is saturated.
fn bright_part(photograph: &LinearFrame, [width, height]: [usize; 2]) -> Option<Bright> {
    let mut bad = vec![0; width];
    let mut each = |use_row: &mut dyn FnMut(usize, &[f32])| {
        let mut values = vec![0.0; width];
        for y in 0..height {
            photograph.row(y, &mut values, &mut bad);
            use_row(y, &values);
        }
    };
    let mean_above = |limit: f64, [sum, pixels]: &mut [f64; 2], row: &[f32]| {
        for v in row.iter().map(|v| f64::from(*v)).filter(|v| *v > limit) {
            (*sum, *pixels) = (*sum + v, *pixels + 1.0);
        }
    };
    let mut all = [0.0; 2];
    each(&mut |_, row| mean_above(f64::MIN, &mut all, row));
    let mut above = [0.0; 2];
    each(&mut |_, row| mean_above(all[0] / all[1], &mut above, row));
    let level = above[0] / above[1];
    let (mut total, mut right, mut up, mut border) = (0.0, 0.0, 0.0, 0.0);
    each(&mut |y, row| {
        for (x, v) in row.iter().enumerate() {
            let weight = ((f64::from(*v) / level - EDGE[0]) / (EDGE[1] - EDGE[0])).clamp(0.0, 1.0);
            (total, right, up) = (total + weight, right + weight * x as f64, up - weight * y as f64);
            if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
                border += weight;
            }
        }
    });
    let is_whole = border == 0.0 && total > 0.0 && bad.iter().all(|b| *b == 0);
    is_whole.then(|| Bright { area: total, centroid: [right / total, up / total] })
}

/// Least squares of `shift = mean + R(axis) · w` for the vector w. The mean is that of the registration's frames.
fn turning(axes: &[f64], shifts: &[[f64; 2]], sigma: f64) -> Wedge {
    let count = axes.len() as f64;
    let mean = |of: &dyn Fn(usize) -> f64| (0..axes.len()).map(of).sum::<f64>() / count;
    let (cos, sin) = (mean(&|i| axes[i].cos()), mean(&|i| axes[i].sin()));
    let (right, up) = (mean(&|i| shifts[i][0]), mean(&|i| shifts[i][1]));
    let (mut along, mut across, mut norm) = (0.0, 0.0, 0.0);
    for (axis, [dx, dy]) in axes.iter().zip(shifts) {
        let (c, s, dx, dy) = (axis.cos() - cos, axis.sin() - sin, dx - right, dy - up);
        along += c * dx + s * dy;
        across += c * dy - s * dx;
        norm += c * c + s * s;
    }
    let (along, across) = (along / norm.max(f64::MIN_POSITIVE), across / norm.max(f64::MIN_POSITIVE));
    let residual = axes.iter().zip(shifts).map(|(axis, [dx, dy])| {
        let (c, s) = (axis.cos() - cos, axis.sin() - sin);
        (dx - right - along * c + across * s).powi(2) + (dy - up - along * s - across * c).powi(2)
    });
    let scatter = (residual.sum::<f64>() / (2.0 * count - 4.0).max(1.0)).sqrt();
    Wedge {
        shift_px: along.hypot(across),
        direction_deg: across.atan2(along).to_degrees(),
        sigma_px: sigma.max(scatter) / norm.max(f64::MIN_POSITIVE).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turning_shift_is_found_beside_a_constant_one() {
        let axes: Vec<f64> = (0..12).map(|k| 0.4 * f64::from(k)).collect();
        let shifts: Vec<[f64; 2]> =
            axes.iter().map(|a| [3.0 + 0.5 * (a + 0.3).cos(), 1.0 + 0.5 * (a + 0.3).sin()]).collect();
        let found = turning(&axes, &shifts, 0.01);
        assert!((found.shift_px - 0.5).abs() < 1e-9, "{found:?}");
        assert!((found.direction_deg - 0.3_f64.to_degrees()).abs() < 1e-6, "{found:?}");
    }
}
