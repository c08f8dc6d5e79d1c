//! Shared parts of the studies: rendered series, methods, and evaluation of a map.

use crate::{Axis, Effort, Outcome};
use nacre_base::Result;
use nacre_plot::style::number;
use nacre_polarimetry::synthetic::{Photographs, Synthetic};
use nacre_polarimetry::{
    Design, Fit, Model, OrientationMaps, SAMPLE_PIXELS, SolveOptions, StokesMaps, angle_difference, angle_errors,
    angle_sigma, compare, orient, orient_with,
};
use num_complex::Complex;
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Instant;

/// Computes orientations from the Stokes maps of the photographs.
pub(super) type Solve = dyn Fn(&mut StokesMaps, &Photographs) -> Result<OrientationMaps> + Send + Sync;

/// A named model.
#[derive(Clone)]
pub(super) struct Method {
    pub name: &'static str,
    pub solve: Arc<Solve>,
    /// Whether the program uses it by default.
    pub default: bool,
}

/// The compared models. `auto` is last, so that its curve is drawn on top of the model that it selects.
pub(super) fn methods() -> Vec<Method> {
    let models = [Model::Sinusoid, Model::Prenormalized, Model::Circle, Model::Curve, Model::Auto];
    models.map(|model| method(model, SAMPLE_PIXELS)).to_vec()
}

/// The phase of the sinusoid without model selection, for studies of the photographs rather than of films.
pub(super) fn sinusoid() -> Method {
    let solve = |maps: &mut StokesMaps, of: &Photographs| Ok(orient(maps, &of.design, &of.noise, 0.0));
    Method { name: "sinusoid", solve: Arc::new(solve), default: true }
}

/// The program's default model with nominal analyser angles.
pub(super) fn nominal_angles() -> Method {
    let solve =
        |maps: &mut StokesMaps, of: &Photographs| Ok(with_nominal_angles(maps, of, SolveOptions::of(Model::Auto)));
    Method { name: "auto, angles as said", solve: Arc::new(solve), default: false }
}

/// Orientations with nominal analyser angles, and their σ from the residuals.
fn with_nominal_angles(maps: &mut StokesMaps, of: &Photographs, options: SolveOptions) -> OrientationMaps {
    let angle_sigma = angle_sigma(&views(of), &of.design, maps).unwrap_or(0.0);
    orient_with(maps, &of.design, &of.noise, &SolveOptions { angle_sigma, ..options })
}

fn views(of: &Photographs) -> Vec<&[f32]> {
    of.frames.iter().map(Vec::as_slice).collect()
}

/// A model fitted to a given number of pixels.
pub(super) fn method(model: Model, pixels: usize) -> Method {
    let solve = move |maps: &mut StokesMaps, of: &Photographs| {
        // As the program does when the accuracy of the stage is not given.
        if let Some(found) = angle_errors(&views(of), &of.angles, None, |angles, design| fit_of(of, angles, design)) {
            let angles: Vec<f64> = of.angles.iter().zip(&found.errors).map(|(a, e)| a + e).collect();
            let design = Design::new(&angles)?;
            *maps = fit_of(of, &angles, &design);
            let options = SolveOptions { pixels, angle_sigma: found.sigma, ..SolveOptions::of(model) };
            return Ok(orient_with(maps, &design, &of.noise, &options));
        }
        Ok(with_nominal_angles(maps, of, SolveOptions { pixels, ..SolveOptions::of(model) }))
    };
    Method { name: model.word(), solve: Arc::new(solve), default: model == Model::Auto }
}

/// Pixels per scene in studies where time matters little.
pub(super) fn pixels(effort: Effort) -> usize {
    effort.pick(4000, 1000)
}

/// Error axis of all studies of orientation.
pub(super) fn orientation_error() -> Axis {
    Axis::log("mean orientation error", "°")
}

/// Time axis of methods whose time is proportional to the number of pixels.
pub(super) fn time() -> Axis {
    Axis::log("time per megapixel", "s")
}

/// Time axis for a whole map. The model fit dominates, and its time hardly depends on the number of pixels.
pub(super) fn time_of_map(pixels: usize) -> Axis {
    Axis::log(&format!("time for a map of {} pixels", number(pixels as f64)), "s")
}

/// Ratio of amplitudes and phase in degrees as a complex number.
pub(super) fn ratio(r: f64, zeta_deg: f64) -> Complex<f64> {
    Complex::from_polar(r, zeta_deg.to_radians())
}

/// Renders a scene and runs a method on it. The time covers fit, solution and method, in s per map.
pub(super) fn run(scene: &Synthetic, method: &Method, pixels: usize, seed: u64) -> Result<Outcome> {
    let photographs = scene.render(pixels, seed)?;
    let begun = Instant::now();
    let mut maps = fitted(&photographs);
    let map = (method.solve)(&mut maps, &photographs)?;
    Ok(judge(&map.orientation, &map.sigma, &photographs.truth, begun.elapsed().as_secs_f64()))
}

/// Pixels per row of the fit, so that it uses all threads as for a photograph.
const ROW: usize = 1024;

/// Fits all photographs. The pixels are independent of each other, and in a single row no pixel counts as the edge of
/// its neighbours.
pub(super) fn fitted(photographs: &Photographs) -> StokesMaps {
    fit_of(photographs, &photographs.angles, &photographs.design)
}

/// As [`fitted`], with these angles in rad.
fn fit_of(photographs: &Photographs, angles: &[f64], design: &Design) -> StokesMaps {
    let n = photographs.truth.len();
    let width = if n.is_multiple_of(ROW) { ROW } else { n };
    let mut fit = Fit::new(width, n / width);
    for (psi, frame) in angles.iter().zip(&photographs.frames) {
        fit.add(*psi, |y, values, bad| {
            let row = &frame[y * width..][..width];
            values.copy_from_slice(row);
            if let Some(white) = photographs.white {
                bad.iter_mut().zip(row).for_each(|(bad, v)| *bad |= u8::from(*v >= white));
            }
        });
    }
    StokesMaps { width: n, height: 1, ..fit.solve(design) }
}

/// Evaluates orientations and their σ (rad) against the truth, with the unknown common offset removed. Returns the mean
/// error in degrees, the shares, and the error expected from σ.
pub fn judge(orientation: &[f32], sigma: &[f32], truth: &[f32], seconds: f64) -> Outcome {
    let n = truth.len() as f64;
    let compared = compare(orientation, sigma, truth, |_| true);
    let offset = compared.map_or(0.0, |c| c.offset_deg.to_radians());
    let (mut wrong, mut promised) = (0_usize, 0.0);
    for ((theta, sigma), truth) in orientation.iter().zip(sigma).zip(truth) {
        if theta.is_finite() {
            let error = angle_difference(f64::from(*theta) - f64::from(*truth), offset).abs();
            wrong += usize::from(error > 5.0 * f64::from(*sigma));
            promised += f64::from(*sigma);
        }
    }
    let known = compared.map_or(0, |c| c.pixels);
    Outcome {
        error: compared.map(|c| c.mean_deg),
        seconds,
        masked: 1.0 - known as f64 / n,
        wrong: wrong as f64 / n,
        predicted: (known > 0).then(|| mean_of_normal(promised / known as f64).to_degrees()),
    }
}

/// Mean |x| of a normal distribution of this standard deviation.
pub(super) fn mean_of_normal(sigma: f64) -> f64 {
    sigma * (2.0 / PI).sqrt()
}

/// Legend entry of studies whose expected error is the map's σ.
pub(super) const PROMISED: &str = "the error that σ promises";

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_polarimetry::synthetic::{even_angles, normal};

    /// For maps of more than one row the predicted error matches the true one, because pixels do not count as edges of
    /// each other. Tolerance 10 %; the mean of 4096 errors varies by 1 %. When counted as edges, they predicted 46°.
    #[test]
    fn charted_maps_promise_their_errors() {
        let scene = Synthetic { reflectance: 0.2, ..Synthetic::default() };
        let outcome = run(&scene, &method(Model::Circle, 2000), 4 * ROW, 1).unwrap();
        let (error, promised) = (outcome.error.unwrap(), outcome.predicted.unwrap());
        assert!((promised / error - 1.0).abs() < 0.1, "{promised} {error}");
    }

    /// Random analyser errors and a scale error of the stage turn the circle into an ellipse, which a film can also
    /// explain. No pixel may be confidently wrong. The orientation of the bare sample stays as accurate as by the phase
    /// alone, within a tenth of the noise (2° off if explained as a film).
    #[test]
    fn wrong_angles_are_no_film() {
        let bare = |angle_errors| Synthetic { reflectance: 0.2, angle_errors, ..Synthetic::default() };
        let missed = (0..12).map(|k| f64::to_radians(0.5) * normal(1, k)).collect();
        let too_far = even_angles(12).iter().map(|a| a / 180.0).collect();
        for scene in [bare(missed), bare(too_far)] {
            let [auto, phase] =
                [method(Model::Auto, SAMPLE_PIXELS), sinusoid()].map(|m| run(&scene, &m, 4000, 1).unwrap());
            assert!(auto.error.unwrap() < phase.error.unwrap() + 0.01 && auto.wrong == 0.0, "{auto:?} {phase:?}");
        }
    }
}
