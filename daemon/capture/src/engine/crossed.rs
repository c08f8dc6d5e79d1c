//! Crossed direction of an analyser, from the frames of a full turn.

use crate::plan::{Added, Plan};
use nacre_base::{Error, Result};
use nacre_frames::Frame;
use nacre_image::{Samples, read};
use nacre_polarimetry::{Design, Fit};
use std::path::Path;

/// Addition of the angles around the crossed direction: the minimum of I = a + b cos 2ψ + c sin 2ψ, fitted to the mean
/// values of the frames. `limits_deg` is the range of the stage.
///
/// # Errors
/// `Input` for an unreadable frame, light that does not depend on the analyser, and a stage that does not reach the
/// angles.
pub fn crossed(folder: &Path, turn: &[&Frame], plan: &Plan, limits_deg: [f64; 2]) -> Result<Added> {
    let mut fit = Fit::new(1, 1);
    let mut angles = vec![];
    for frame in turn {
        let angle = frame.analyser_deg.unwrap_or_default().to_radians();
        let mean = mean(&folder.join(&frame.file))?;
        fit.add(angle, |_, row, _| row[0] = mean);
        angles.push(angle);
    }
    let maps = fit.solve(&Design::new(&angles)?);
    let (b, c) = (f64::from(maps.s1[0]), f64::from(maps.s2[0]));
    let amplitude = b.hypot(c);
    if amplitude.is_nan() || amplitude <= 0.0 {
        let remedy = "put a polarizer into the light, or give calibration.crossed = 0";
        return Err(Error::input("the light", "does not depend on the analyser", remedy));
    }
    let crossed_deg = 0.5 * (-c).atan2(-b).to_degrees();
    let crossed_deg = plan.crossed_within(crossed_deg, limits_deg).ok_or_else(|| {
        let [low, high] = limits_deg;
        let problem = format!("turns from {low}° to {high}° only, and light is crossed at {crossed_deg:.1}°");
        Error::input("the analyser's stage", problem, "give calibration.crossed = 0")
    })?;
    Ok(Added::Crossed { crossed_deg })
}

/// Mean value of a photograph.
fn mean(file: &Path) -> Result<f32> {
    let raster = read(file)?;
    let sum = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>();
    let (sum, count) = match &raster.samples {
        Samples::U8(v) => (sum(&mut v.iter().map(|v| (*v).into())), v.len()),
        Samples::U16(v) => (sum(&mut v.iter().map(|v| (*v).into())), v.len()),
        Samples::F32(v) => (sum(&mut v.iter().map(|v| (*v).into())), v.len()),
    };
    Ok((sum / count.max(1) as f64) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_image::write_png16_gray;

    #[test]
    fn the_darkest_direction_is_found_within_the_range_of_the_stage() {
        let place = tempfile::tempdir().unwrap();
        let plan = "kind = \"calibration\"\ncalibration = { of = \"analyser\" }";
        let plan: Plan = toml::from_str(plan).unwrap();
        let turn = |axis_deg: f64, contrast: f64| {
            let frame = |k: u32| {
                let angle = 15.0 * f64::from(k);
                let level = 20_000.0 * (1.0 + contrast * (2.0 * (angle - axis_deg)).to_radians().cos());
                let file = format!("{k}.png");
                write_png16_gray(&place.path().join(&file), 2, 1, &[level as u16 - 100, level as u16 + 100]).unwrap();
                Frame { analyser_deg: Some(angle), ..Frame::new(file) }
            };
            (0..24).map(frame).collect::<Vec<_>>()
        };
        let found = |axis_deg, contrast, limits_deg| {
            let frames = turn(axis_deg, contrast);
            let frames: Vec<&Frame> = frames.iter().collect();
            crossed(place.path(), &frames, &plan, limits_deg)
        };
        for (axis_deg, limits_deg, wanted) in [
            (30.0, [-400.0, 400.0], 120.0),
            (91.5, [-400.0, 400.0], 1.5),
            (91.5, [0.0, 360.0], 181.5),
            (91.5, [-180.0, 180.0], 1.5),
        ] {
            let Added::Crossed { crossed_deg } = found(axis_deg, 0.9, limits_deg).unwrap() else {
                panic!("another addition")
            };
            assert!((crossed_deg - wanted).abs() < 0.01, "{axis_deg} {limits_deg:?}: {crossed_deg}");
        }
        assert!(found(91.5, 0.9, [0.0, 180.0]).unwrap_err().to_string().contains("calibration.crossed"));
        assert!(found(30.0, 0.0, [0.0, 360.0]).unwrap_err().to_string().contains("does not depend"));
    }
}
