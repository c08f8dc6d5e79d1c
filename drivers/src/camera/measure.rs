//! Camera measurements under constant light: control lag in frames, and linearity.
//!
//! The light must be constant, above the dark level and below saturation. Exposures that are multiples of the display's
//! refresh period average out its flicker ([`refresh_multiples`]).

use crate::{Camera, Class, DeviceError, DeviceResult, Frame, Freshness};
use std::time::Duration;

/// Frames examined after a change of the exposure.
const WATCHED: u32 = 40;
/// Consecutive frames at the new level that confirm the change.
const SETTLED: u32 = 10;
/// Number of exposure changes.
const TOGGLES: u32 = 6;
/// Averaged frames per exposure.
const AVERAGED: u32 = 3;
/// Tolerated incomplete or late frames. Each may take several seconds.
const FAILURES: u32 = 5;
/// Largest deviation from the line, relative to the line's level, for which a camera counts as linear.
pub const LINEARITY: f64 = 0.02;
/// Maximum number of proposed exposures.
const MAX_OFFERED: usize = 200;

/// Mean levels against exposures, with the fitted line.
#[derive(Clone, Debug, PartialEq)]
pub struct Ramp {
    /// Pairs of actual exposure in s and mean level above black.
    pub points: Vec<[f64; 2]>,
    /// Level per second.
    pub slope: f64,
    /// Largest deviation of a level from the line, relative to the line's level.
    pub max_deviation: f64,
    /// Whether `max_deviation` is below [`LINEARITY`].
    pub linear: bool,
}

/// Measures the number of frames until a new exposure takes effect: the maximum over several changes between two
/// exposures. The result is the value for [`crate::CameraInfo::control_lag_frames`].
///
/// # Errors
/// As the camera. `Setup` if the light is too weak or too strong, or if the camera does not apply the exposure.
pub async fn control_lag(camera: &mut dyn Camera, exposures: [Duration; 2], gain: f64) -> DeviceResult<u32> {
    let mut levels = [0.0; 2];
    for (level, exposure) in levels.iter_mut().zip(exposures) {
        *level = settled_level(camera, exposure, gain).await?;
    }
    let [low, high] = [levels[0].min(levels[1]), levels[0].max(levels[1])];
    if high - low < 0.02 * f64::from(camera.describe().white) || low <= 0.0 {
        let got = format!("levels {:.1} and {:.1}", levels[0], levels[1]);
        return Err(unusable(camera, "measure the control lag", "two exposures that differ in light", got));
    }
    let mut lag = 0;
    for toggle in 0..TOGGLES {
        let to = (toggle % 2) as usize;
        let (goal, from) = (levels[to], levels[1 - to]);
        lag = lag.max(frames_until(camera, exposures[to], gain, from, goal).await?);
    }
    Ok(lag)
}

/// Number of frames with the old exposure, after the frame in progress at the change.
async fn frames_until(
    camera: &mut dyn Camera,
    exposure: Duration,
    gain: f64,
    from: f64,
    goal: f64,
) -> DeviceResult<u32> {
    let set_at = camera.configure(exposure, gain).await?.set_at;
    let mut first = None;
    // Number of the last frame away from the new level, and count of frames since.
    let (mut last_old, mut since) = (None, 0);
    for _ in 0..WATCHED {
        let frame = whole_frame(camera).await?;
        let stamp = frame.stamp;
        first = first.or((stamp.timestamp > set_at).then_some(stamp.sequence));
        let level = mean_level(camera, &frame);
        if (level - goal).abs() > 0.25 * (from - goal).abs() {
            (last_old, since) = (Some(stamp.sequence), 0);
        } else {
            since += u32::from(first.is_some());
        }
        if since == SETTLED {
            break;
        }
    }
    match (first, last_old) {
        // `first` was in progress; every later frame with the old exposure counts.
        (Some(first), Some(last)) => Ok(u32::try_from(last.saturating_sub(first)).unwrap_or(u32::MAX)),
        (Some(_), None) => Ok(0),
        (None, _) => {
            Err(unusable(camera, "measure the control lag", "frames after the change", "only older ones".into()))
        }
    }
}

/// Measures mean levels at these exposures and fits a line through black.
///
/// # Errors
/// As the camera. `Setup` for fewer than five exposures, or if too few of them receive light without saturation.
pub async fn exposure_ramp(camera: &mut dyn Camera, exposures: &[Duration], gain: f64) -> DeviceResult<Ramp> {
    let info = camera.describe();
    let top = 0.9 * f64::from(info.white.saturating_sub(info.black));
    let mut points = Vec::new();
    for exposure in exposures {
        let set = camera.configure(*exposure, gain).await?;
        settle(camera, set.set_at).await?;
        let level = average(camera).await?;
        if level > 0.0 && level < top {
            points.push([set.exposure.as_secs_f64(), level]);
        }
    }
    if points.len() < 5 {
        let got = format!("{} of {}", points.len(), exposures.len());
        return Err(unusable(camera, "measure linearity", "five exposures with light and not saturated", got));
    }
    Ok(fit(points))
}

/// Line through the origin, with equal relative weights.
fn fit(points: Vec<[f64; 2]>) -> Ramp {
    let slope = points.iter().map(|[s, level]| level / s).sum::<f64>() / points.len() as f64;
    let max_deviation = points.iter().map(|[s, level]| (level / (slope * s) - 1.0).abs()).fold(0.0, f64::max);
    Ramp { points, slope, max_deviation, linear: max_deviation < LINEARITY }
}

/// Exposures in s within `range_s` that are whole periods of a display with refresh rate `hz`: all short ones, then
/// increasingly sparse ones.
pub fn refresh_multiples(hz: f64, range_s: [f64; 2]) -> Vec<f64> {
    if !(hz.is_finite() && hz > 0.0 && range_s[0] <= range_s[1]) {
        return Vec::new();
    }
    let within = |n: &f64| (range_s[0]..=range_s[1]).contains(&(n / hz));
    let grow = |n: &f64| Some((n * 1.1).ceil().max(n + 1.0));
    // Rounding must not exclude the ends of the range.
    let first = (range_s[0] * hz - 1e-9).ceil().max(1.0);
    std::iter::successors(Some(first), grow)
        .take(MAX_OFFERED)
        .take_while(|n| n / hz <= range_s[1])
        .filter(within)
        .map(|n| n / hz)
        .collect()
}

async fn settled_level(camera: &mut dyn Camera, exposure: Duration, gain: f64) -> DeviceResult<f64> {
    let set_at = camera.configure(exposure, gain).await?.set_at;
    settle(camera, set_at).await?;
    average(camera).await
}

/// Drops frames until the longest possible lag has passed.
async fn settle(camera: &mut dyn Camera, set_at: Duration) -> DeviceResult<()> {
    let mut after = 0;
    for _ in 0..WATCHED {
        after += u32::from(camera.next_frame(Freshness::NEVER).await?.stamp.timestamp > set_at);
        if after > SETTLED {
            break;
        }
    }
    Ok(())
}

async fn average(camera: &mut dyn Camera) -> DeviceResult<f64> {
    let mut sum = 0.0;
    for _ in 0..AVERAGED {
        let frame = whole_frame(camera).await?;
        sum += mean_level(camera, &frame);
    }
    Ok(sum / f64::from(AVERAGED))
}

/// The next frame. Incomplete and late ones are skipped and counted, up to five in all.
///
/// # Errors
/// As the camera.
pub async fn next_frame(camera: &mut dyn Camera, fresh: Freshness, failures: &mut u32) -> DeviceResult<Frame> {
    loop {
        match camera.next_frame(fresh).await {
            Err(e) if e.class == Class::Retry && *failures < FAILURES => *failures += 1,
            frame => return frame,
        }
    }
}

/// Takes an undamaged frame with its codes.
async fn whole_frame(camera: &mut dyn Camera) -> DeviceResult<Frame> {
    let mut failures = 0;
    for _ in 0..WATCHED {
        let frame = next_frame(camera, Freshness::default(), &mut failures).await?;
        if !frame.damaged && !frame.codes.is_empty() {
            return Ok(frame);
        }
    }
    let error = DeviceError::new(&camera.describe().id, "take a frame", "a whole frame", "only damaged ones");
    Err(error.remedy("check cable and USB hub").class(Class::Retry))
}

/// Mean code above black.
fn mean_level(camera: &dyn Camera, frame: &Frame) -> f64 {
    let sum: u64 = frame.codes.iter().map(|c| u64::from(*c)).sum();
    sum as f64 / frame.codes.len() as f64 - f64::from(camera.describe().black)
}

fn unusable(camera: &dyn Camera, command: &str, expected: &str, got: String) -> DeviceError {
    DeviceError::new(&camera.describe().id, command, expected, got)
        .remedy(
            "point the camera at a constant light that fills the frame and does not saturate it, then measure again",
        )
        .class(Class::Setup)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::v4l2::fake::{BLACK, FakeNode};
    use crate::camera::v4l2::tests::run;
    use crate::camera::v4l2::{Settings, V4l2Camera};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn camera(lag: usize, gamma: f64) -> V4l2Camera {
        let node = FakeNode::new();
        node.state().lag = lag;
        node.state().gamma = gamma;
        let settings = Settings { black: Some(BLACK as u16), ..Settings::new("/dev/video0") };
        let clock = Arc::new(node.clock.clone());
        let reset = Box::new(|| Err(String::new()));
        V4l2Camera::open(Box::new(node), "v4l2 fake", settings, clock, reset).unwrap()
    }

    fn ms(times: &[u64]) -> Vec<Duration> {
        times.iter().map(|t| Duration::from_millis(*t)).collect()
    }

    #[test]
    fn the_control_lag_is_counted() {
        for lag in [0, 1, 2, 5] {
            let exposures = [Duration::from_millis(5), Duration::from_millis(20)];
            // The fake applies controls at the end of a frame, so the frame in progress already has them.
            let measured = run(control_lag(&mut camera(lag, 1.0), exposures, 1.0));
            assert_eq!(measured, Ok((lag as u32).saturating_sub(1)), "{lag}");
        }
    }

    #[test]
    fn indistinguishable_exposures_are_refused() {
        let same = [Duration::from_millis(5); 2];
        assert_eq!(run(control_lag(&mut camera(2, 1.0), same, 1.0)).unwrap_err().class, Class::Setup);
    }

    #[test]
    fn a_linear_camera_is_distinguished_from_one_with_a_tone_curve() {
        let exposures = ms(&[5, 10, 15, 20, 30, 40]);
        let straight = run(exposure_ramp(&mut camera(2, 1.0), &exposures, 1.0)).unwrap();
        assert!(straight.linear && straight.max_deviation < 0.01, "{straight:?}");
        assert!((straight.slope / 5000.0 - 1.0).abs() < 0.01, "{straight:?}");
        let bent = run(exposure_ramp(&mut camera(2, 0.45), &exposures, 1.0)).unwrap();
        assert!(!bent.linear && bent.max_deviation > 0.3, "{bent:?}");
        let saturating = run(exposure_ramp(&mut camera(2, 1.0), &ms(&[5, 10, 60, 70, 80, 90]), 1.0));
        assert!(saturating.unwrap_err().got.contains("2 of 6"));
    }

    #[test]
    fn exposures_are_whole_periods_of_the_panel() {
        let offered = refresh_multiples(60.0, [1e-4, 0.1]);
        assert_eq!(offered.len(), 6);
        assert_eq!((offered[0], offered[5]), (1.0 / 60.0, 0.1));
        assert!(refresh_multiples(f64::NAN, [0.0, 1.0]).is_empty() && refresh_multiples(60.0, [1e-4, 1e-3]).is_empty());
    }

    proptest! {
        #[test]
        fn offered_exposures_are_within_the_range(hz in 0.0f64..1e4, low in 0.0f64..10.0, high in 0.0f64..1e4) {
            for s in refresh_multiples(hz, [low, high]) {
                prop_assert!(s >= low && s <= high && (s * hz - (s * hz).round()).abs() < 1e-6);
            }
        }
    }
}
