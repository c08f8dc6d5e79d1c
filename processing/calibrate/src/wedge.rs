//! Image shift of a wedged analyser over its turn.

use crate::turn::Turn;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_frames::{Linearizer, LoadedFrames};
use nacre_image::registration::{Registrar, Registration};
use schemars::JsonSchema;
use serde::Serialize;

/// Share of the brightest photograph below which one shows too little to be registered.
const BRIGHT: f64 = 0.3;

/// Smallest number of photographs.
const LEAST: usize = 6;

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

/// Measures the shift by registration of the bright photographs; `None` if they show too little structure.
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
    let bright: Vec<_> = turn.lights.iter().filter(|l| l.light > BRIGHT * brightest).collect();
    if bright.len() < LEAST {
        return Ok(None);
    }
    let linearizer = Linearizer::new(frames)?;
    let mut registrar = Registrar::new(frames.info.width, frames.info.height);
    progress.stage("registering", bright.len() as u64);
    for light in &bright {
        let of_angle = |a: &f64| (a - light.stage_deg).abs() < 1e-9;
        let frame = frames.set.frames.iter().find(|f| f.analyser_deg.as_ref().is_some_and(of_angle));
        let Some(frame) = frame else { return Ok(None) };
        let decoded = linearizer.frame(frames, frame)?;
        registrar.add(|y, left, values, bad| decoded.strided(y, left, 1, values, bad));
        progress.step();
        progress.check()?;
    }
    let axes: Vec<f64> = bright.iter().map(|l| (zero_deg + sense * l.stage_deg).to_radians()).collect();
    let Registration::Told(shifts) = registrar.polarized(&axes) else { return Ok(None) };
    let points: Vec<[f64; 2]> = shifts.iter().map(|s| [s.dx, -s.dy]).collect();
    let sigma = shifts.iter().map(|s| s.sigma * s.sigma).sum::<f64>() / shifts.len() as f64;
    Ok(Some(turning(&axes, &points, sigma.sqrt())))
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
