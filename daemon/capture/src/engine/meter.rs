//! Exposure metering: the longest exposure without saturation over the full rotation of the analyser, and from there
//! the exposures of a bracket.

use super::bench_controller::BenchController;
use crate::failure::Failure;
use crate::plan::{BracketPlan, Plan, Role, State, light_on_s};
use nacre_base::progress::Progress;
use nacre_base::statistics::quantile;
use nacre_drivers::{CameraInfo, DeviceError, Frame, Pattern};
use nacre_polarimetry::{Design, Fit};
use std::time::Duration;

/// Target level of the brightest pixels, relative to white.
const TARGET: f64 = 0.85;

/// Levels that are neither clipped nor dominated by noise, so that one further step suffices.
const TRUSTED: std::ops::RangeInclusive<f64> = 0.2..=0.95;

/// Maximum number of attempts to reach such a level.
const ATTEMPTS: u32 = 12;

/// Maximum number of metered lights (spots, steps); longer series are subsampled.
const LIGHTS: usize = 8;

/// Quantile of the pixels that counts as brightest; beyond it are hot pixels and glints.
const BRIGHT: f64 = 0.999;

/// Fraction of the darkest pixels that may stay dark, and level relative to white that ends a bracket.
const DARKEST: f64 = 0.01;
const LIT: f32 = 0.1;

/// Analyser angles that determine the maximum over the full rotation.
pub(crate) const TURN_DEG: [f64; 4] = [0.0, 45.0, 90.0, 135.0];

/// Start exposure in s without prior knowledge.
const FIRST_S: f64 = 0.01;

/// Result of metering.
pub struct Metered {
    /// Exposure time for steps without a stated one.
    pub exposure: Duration,
    /// Exposures of the bracket in ms, if the plan requests one.
    pub bracket_ms: Vec<f64>,
}

/// Meters everything that the plan leaves open.
///
/// # Errors
/// Device errors; no light; a sample too bright for the shortest exposure.
pub async fn metered(
    controller: &mut BenchController<'_>,
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Metered, Failure> {
    let exposure = meter(controller, plan, progress).await?;
    let bracket_ms = match plan.bracket {
        Some(wanted) => bracket(controller, plan, wanted, exposure, progress).await?,
        None => vec![],
    };
    Ok(Metered { exposure, bracket_ms })
}

/// Exposures from the shortest, which saturates almost no pixels, upwards until longer ones add no information.
async fn bracket(
    controller: &mut BenchController<'_>,
    plan: &Plan,
    wanted: BracketPlan,
    shortest: Duration,
    progress: &dyn Progress,
) -> Result<Vec<f64>, Failure> {
    let (camera, lights) = (controller.limits().camera.clone(), lights(plan));
    let Some(light) = lights.first() else { return Ok(vec![]) };
    let longest = longest(controller, light.flash);
    let (black, range) = (f32::from(camera.black), f32::from(camera.white.saturating_sub(camera.black).max(1)));
    progress.stage("metering the bracket", u64::from(wanted.at_most));
    controller.prepare(light.analyser_deg.is_some()).await?;
    let mut exposures = vec![];
    let mut exposure = shortest;
    loop {
        exposures.push(exposure.as_secs_f64() * 1000.0);
        progress.step();
        let next = exposure.as_secs_f64() * wanted.step_ev.exp2();
        if exposures.len() == wanted.at_most as usize || next > longest {
            break;
        }
        controller.expose(exposure, plan.camera.gain).await?;
        controller.cover(false).await?;
        controller.show(light.pattern).await?;
        if let Some(angle) = light.analyser_deg {
            controller.turn(angle).await?;
        }
        let mut codes = lit(controller, light.flash).await?.codes;
        let at = (codes.len().saturating_sub(1) as f64 * DARKEST) as usize;
        let dark = (f32::from(*codes.select_nth_unstable(at).1) - black) / range;
        if dark >= LIT {
            break;
        }
        let longer = offered(Duration::from_secs_f64(next), &camera);
        if longer <= exposure {
            break;
        }
        exposure = longer;
    }
    controller.dark().await?;
    Ok(exposures)
}

/// Longest exposure permitted by camera and flash, in seconds.
fn longest(controller: &BenchController<'_>, flash: bool) -> f64 {
    let [shortest, mut longest] = controller.limits().camera.exposure_s;
    if flash {
        // Longer exposures would exceed the maximum on-time of the flash.
        let max = controller.limits().flash.as_ref().map_or(0.0, |f| f.max_on_s);
        while light_on_s(Duration::from_secs_f64(longest), 1, controller.limits()) > max && longest > shortest {
            longest *= 0.5;
        }
    }
    longest
}

/// Exposure time for steps without a stated one: the shortest required by any of the plan's lights.
///
/// # Errors
/// Device errors; no light; a sample too bright for the shortest exposure.
async fn meter(
    controller: &mut BenchController<'_>,
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Duration, Failure> {
    let lights = lights(plan);
    let turn = lights.iter().any(|l| l.analyser_deg.is_some());
    progress.stage("metering", lights.len() as u64);
    controller.prepare(turn).await?;
    let mut shortest: Option<Duration> = None;
    for light in &lights {
        let exposure = one(controller, plan.camera.gain, light, shortest).await?;
        shortest = Some(shortest.map_or(exposure, |s| s.min(exposure)));
        progress.step();
    }
    controller.dark().await?;
    let camera = &controller.limits().camera;
    let shortest = shortest.ok_or_else(|| nothing(camera, Duration::ZERO))?;
    Ok(settled(shortest, camera))
}

/// Exposure time of a live picture under this pattern, with the analyser where it stands.
///
/// # Errors
/// Device errors; no light; a sample too bright for the shortest exposure.
pub async fn meter_preview(
    controller: &mut BenchController<'_>,
    gain: f64,
    pattern: Pattern,
    guess: Duration,
) -> Result<Duration, Failure> {
    let light = State { pattern, analyser_deg: None, flash: false, covered: false, exposure_ms: None };
    let exposure = one(controller, gain, &light, Some(guess)).await?;
    Ok(settled(exposure, &controller.limits().camera))
}

/// Longest exposure within a metered one that the camera offers and that is synchronous with the panel's refresh.
pub(super) fn settled(exposure: Duration, camera: &CameraInfo) -> Duration {
    offered(steady(exposure, &camera.steady_exposures_s), camera)
}

/// Longest exposure within this one that the camera offers.
fn offered(exposure: Duration, camera: &CameraInfo) -> Duration {
    match camera.exposure_choices_s.is_empty() {
        true => exposure,
        false => Duration::from_secs_f64(camera.at_most(exposure.as_secs_f64())),
    }
}

/// Longest exposure that is synchronous with the panel's refresh and not longer than `exposure`, unless it would lose
/// more than half of it.
fn steady(exposure: Duration, suiting_s: &[f64]) -> Duration {
    let fits = |s: &f64| (0.5..=1.0 + 1e-9).contains(&(s / exposure.as_secs_f64()));
    let longest = suiting_s.iter().copied().filter(fits).max_by(f64::total_cmp);
    longest.map_or(exposure, Duration::from_secs_f64)
}

/// Distinct illuminations of the steps to meter.
pub(crate) fn lights(plan: &Plan) -> Vec<State> {
    let mut lights: Vec<State> = vec![];
    let steps = plan.steps();
    let series: Vec<&State> =
        steps.iter().filter(|s| s.role == Role::Series && s.state.exposure_ms.is_none()).map(|s| &s.state).collect();
    for state in series.iter().step_by(series.len().div_ceil(64).max(1)) {
        if !lights.iter().any(|l| (l.pattern, l.flash) == (state.pattern, state.flash)) {
            lights.push((*state).clone());
        }
    }
    let every = lights.len().div_ceil(LIGHTS).max(1);
    lights.into_iter().step_by(every).collect()
}

/// Meters one illumination, starting with a guess.
///
/// # Errors
/// Device errors; no light; a sample too bright for the shortest exposure.
pub(super) async fn one(
    controller: &mut BenchController<'_>,
    gain: f64,
    light: &State,
    guess: Option<Duration>,
) -> Result<Duration, Failure> {
    let camera = controller.limits().camera.clone();
    let longest = longest(controller, light.flash);
    let clamp =
        |seconds: f64| offered(Duration::from_secs_f64(seconds.min(longest).max(camera.exposure_s[0])), &camera);
    let mut exposure = guess.map_or_else(|| clamp(FIRST_S), |guess| offered(guess, &camera));
    for _ in 0..ATTEMPTS {
        controller.expose(exposure, gain).await?;
        controller.cover(false).await?;
        controller.show(light.pattern).await?;
        let level = level(controller, light, &camera).await?;
        let next = clamp(exposure.as_secs_f64() * step(level));
        if TRUSTED.contains(&level) {
            return Ok(next);
        }
        if next == exposure {
            break;
        }
        exposure = next;
    }
    Err(nothing(&camera, exposure).into())
}

/// Factor to the next exposure after one with this level. Near white the level is clipped, and at low levels it is
/// mostly noise, so fixed steps are taken there.
fn step(level: f64) -> f64 {
    if level > *TRUSTED.end() { 0.2 } else { (TARGET / level.max(1e-3)).min(20.0) }
}

/// Exposures tried for a light that requires this one.
pub(crate) fn tried(guess: Option<Duration>, needed: Duration) -> Vec<Duration> {
    let mut all = vec![guess.unwrap_or(Duration::from_secs_f64(FIRST_S))];
    while let Some(last) = all.last().filter(|_| all.len() < ATTEMPTS as usize).map(Duration::as_secs_f64) {
        let level = TARGET * last / needed.as_secs_f64();
        if TRUSTED.contains(&level) {
            break;
        }
        all.push(Duration::from_secs_f64(last * step(level)));
    }
    all
}

/// Level of the brightest pixels between black (0) and white (1), at the brightest analyser angle. Four frames at 0,
/// 45, 90 and 135 degrees determine the full rotation; without an analyser, one frame suffices.
async fn level(controller: &mut BenchController<'_>, light: &State, camera: &CameraInfo) -> Result<f64, Failure> {
    let (black, range) = (f32::from(camera.black), f32::from(camera.white.saturating_sub(camera.black).max(1)));
    let linear = |code: &u16| (f32::from(*code) - black) / range;
    let mut values: Vec<f32> = if light.analyser_deg.is_some() {
        let mut fit = Fit::new(camera.width, camera.height);
        for angle in TURN_DEG {
            controller.turn(angle).await?;
            let frame = lit(controller, light.flash).await?;
            fit.add(angle.to_radians(), |y, row, _| {
                row.iter_mut().zip(&frame.codes[y * frame.width..]).for_each(|(v, c)| *v = linear(c));
            });
        }
        let maps = fit.solve(&Design::new(&TURN_DEG.map(f64::to_radians))?);
        (0..maps.s0.len()).map(|i| 0.5 * (maps.s0[i] + maps.s1[i].hypot(maps.s2[i]))).collect()
    } else {
        lit(controller, light.flash).await?.codes.iter().map(linear).collect()
    };
    Ok(f64::from(quantile(&mut values, BRIGHT).unwrap_or(0.0)))
}

/// A fresh frame, with the flash switched on only during its exposure if required.
async fn lit(controller: &mut BenchController<'_>, flash: bool) -> Result<Frame, Failure> {
    if flash {
        controller.switch(true).await?;
    }
    let (frame, _) = controller.fresh().await?;
    controller.still_lit(flash).await?;
    if flash {
        controller.switch(false).await?;
    }
    Ok(frame)
}

fn nothing(camera: &CameraInfo, exposure: Duration) -> DeviceError {
    let got = format!("none up to {} s", exposure.as_secs_f64());
    DeviceError::new(&camera.id, "meter the exposure", "a level between black and white", got)
        .remedy("check that the light is on and the lens open, or set camera.exposure_ms")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metered_exposures_are_whole_periods_of_the_panel() {
        let suiting: Vec<f64> = (1..10).map(|n| f64::from(n) / 60.0).collect();
        let of = |ms: u64| steady(Duration::from_millis(ms), &suiting).as_secs_f64();
        assert!((of(40) - 2.0 / 60.0).abs() < 1e-9 && (of(20) - 1.0 / 60.0).abs() < 1e-9);
        // No exposure is short enough, or all are far too short: the metered one is used.
        assert_eq!((of(10), of(1000)), (0.01, 1.0));
    }
}
