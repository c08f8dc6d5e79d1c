//! What the studies share: rendered series, the methods, and how a map is judged.

use crate::{Axis, Effort, Outcome};
use nacre_base::Result;
use nacre_plot::style::number;
use nacre_polarimetry::synthetic::{Photographs, Synthetic};
use nacre_polarimetry::{
    Asked, CLOUD, Design, Fit, Model, OrientationMaps, StokesMaps, angle_difference, angle_sigma, compare, misses,
    orient, orient_with,
};
use num_complex::Complex;
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Instant;

/// From the maps of photographs to orientations.
pub(super) type Solve = dyn Fn(&mut StokesMaps, &Photographs) -> Result<OrientationMaps> + Send + Sync;

/// A model by name.
#[derive(Clone)]
pub(super) struct Method {
    pub name: &'static str,
    pub solve: Arc<Solve>,
    /// The program's choice when the user makes none.
    pub default: bool,
}

/// The models to be compared; one more is one more entry. `auto` is last, so that it lies on top of what it chose.
pub(super) fn methods() -> Vec<Method> {
    let models = [Model::Sinusoid, Model::Prenormalized, Model::Circle, Model::Curve, Model::Auto];
    models.map(|model| method(model, CLOUD)).to_vec()
}

/// The phase alone, without a look at what else might explain the points: for what concerns photographs and not films.
pub(super) fn sinusoid() -> Method {
    let solve = |maps: &mut StokesMaps, of: &Photographs| Ok(orient(maps, &of.design, &of.noise, 0.0));
    Method { name: "sinusoid", solve: Arc::new(solve), default: true }
}

/// The program's choice with the angles of the analyser as they are said to be.
pub(super) fn angles_as_said() -> Method {
    let solve = |maps: &mut StokesMaps, of: &Photographs| Ok(as_said(maps, of, Asked::of(Model::Auto)));
    Method { name: "auto, angles as said", solve: Arc::new(solve), default: false }
}

/// Orientations with the angles as they are said to be, and how good they are by the residuals.
fn as_said(maps: &mut StokesMaps, of: &Photographs, asked: Asked) -> OrientationMaps {
    let angle_sigma = angle_sigma(&views(of), &of.design, maps).unwrap_or(0.0);
    orient_with(maps, &of.design, &of.noise, &Asked { angle_sigma, ..asked })
}

fn views(of: &Photographs) -> Vec<&[f32]> {
    of.frames.iter().map(Vec::as_slice).collect()
}

/// A model that is fitted to so many pixels.
pub(super) fn method(model: Model, pixels: usize) -> Method {
    let solve = move |maps: &mut StokesMaps, of: &Photographs| {
        // As the program does where nobody says how good the stage is.
        if let Some(found) = misses(&views(of), &of.angles, None, |angles, design| fit_of(of, angles, design)) {
            let angles: Vec<f64> = of.angles.iter().zip(&found.errors).map(|(a, e)| a + e).collect();
            let design = Design::new(&angles)?;
            *maps = fit_of(of, &angles, &design);
            let asked = Asked { pixels, angle_sigma: found.left, ..Asked::of(model) };
            return Ok(orient_with(maps, &design, &of.noise, &asked));
        }
        Ok(as_said(maps, of, Asked { pixels, ..Asked::of(model) }))
    };
    Method { name: model.word(), solve: Arc::new(solve), default: model == Model::Auto }
}

/// Pixels per scene where time matters little.
pub(super) fn pixels(effort: Effort) -> usize {
    effort.pick(4000, 1000)
}

/// What all studies of orientation measure.
pub(super) fn orientation_error() -> Axis {
    Axis::log("mean orientation error", "°")
}

/// Time of what grows with the pixels.
pub(super) fn time() -> Axis {
    Axis::log("time per megapixel", "s")
}

/// Time of a whole map, where most of it goes into the model's fit, which grows little with the pixels.
pub(super) fn time_of_map(pixels: usize) -> Axis {
    Axis::log(&format!("time for a map of {} pixels", number(pixels as f64)), "s")
}

/// Ratio of amplitudes and phase in degrees as a complex number.
pub(super) fn ratio(r: f64, zeta_deg: f64) -> Complex<f64> {
    Complex::from_polar(r, zeta_deg.to_radians())
}

/// Renders a scene and runs a method on it; the clock runs for fit, solution and method, in s per map.
pub(super) fn run(scene: &Synthetic, method: &Method, pixels: usize, seed: u64) -> Result<Outcome> {
    let photographs = scene.render(pixels, seed)?;
    let begun = Instant::now();
    let mut maps = fitted(&photographs);
    let map = (method.solve)(&mut maps, &photographs)?;
    Ok(judge(&map.orientation, &map.sigma, &photographs.truth, begun.elapsed().as_secs_f64()))
}

/// Pixels per row of the fit, so that it uses all threads as it does on a photograph.
const ROW: usize = 1024;

/// The fit to all photographs. Pixels are drawn each for itself: in one row they have no neighbours, which would all be edges.
pub(super) fn fitted(photographs: &Photographs) -> StokesMaps {
    fit_of(photographs, &photographs.angles, &photographs.design)
}

/// The same with these angles in rad.
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

/// A map of orientations and their σ in rad against the truth, its gauge removed: mean error in degrees, shares, and the error
/// that σ promises.
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

/// Mean |x| of a normal deviate of this standard deviation.
pub(super) fn mean_of_normal(sigma: f64) -> f64 {
    sigma * (2.0 / PI).sqrt()
}

/// Phrase for the legend of studies whose expected error is the map's own σ.
pub(super) const PROMISED: &str = "the error that σ promises";

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_polarimetry::synthetic::{even_angles, normal};

    /// Maps of more than a row of the fit promise what their pixels are off by: pixels are no edges of each other. To a tenth, of which the mean of 4096
    /// errors varies by 1 %; as edges they promised 46°.
    #[test]
    fn charted_maps_promise_their_errors() {
        let scene = Synthetic { reflectance: 0.2, ..Synthetic::default() };
        let outcome = run(&scene, &method(Model::Circle, 2000), 4 * ROW, 1).unwrap();
        let (error, promised) = (outcome.error.unwrap(), outcome.predicted.unwrap());
        assert!((promised / error - 1.0).abs() < 0.1, "{promised} {error}");
    }

    /// Angles that are off at random, and a stage that turns too far, make an ellipse of the circle, which a film can explain as well: no pixel is
    /// wrong and confident, and the bare sample is as right as the phase alone, but for a tenth of the noise (as a film it was 2° off).
    #[test]
    fn wrong_angles_are_no_film() {
        let bare = |angle_errors| Synthetic { reflectance: 0.2, angle_errors, ..Synthetic::default() };
        let missed = (0..12).map(|k| f64::to_radians(0.5) * normal(1, k)).collect();
        let too_far = even_angles(12).iter().map(|a| a / 180.0).collect();
        for scene in [bare(missed), bare(too_far)] {
            let [auto, phase] = [method(Model::Auto, CLOUD), sinusoid()].map(|m| run(&scene, &m, 4000, 1).unwrap());
            assert!(auto.error.unwrap() < phase.error.unwrap() + 0.01 && auto.wrong == 0.0, "{auto:?} {phase:?}");
        }
    }
}
