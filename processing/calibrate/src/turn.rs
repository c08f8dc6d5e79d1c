//! Mean light of a region over the turn of the analyser.

use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::{ASSUMED, Frame, Linearizer, LoadedFrames, load};
use nacre_image::Info;
use std::path::Path;

/// Share of saturated pixels in the region above which a photograph is left out.
const SATURATED: f64 = 0.01;

/// Largest difference in degrees of stage angles that count as one.
const SAME_ANGLE_DEG: f64 = 1e-3;

/// Light at one angle of the stage.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// Angle of the stage in degrees.
    pub stage_deg: f64,
    /// Transmission axis in rad, calibrated if the photographs name a calibration of the analyser.
    pub axis: f64,
    /// Mean light per exposure and gain.
    pub light: f64,
    /// Variance of the mean from the noise of the pixels.
    pub variance: f64,
}

/// A series of photographs over the turn of the analyser.
#[derive(Clone, Debug)]
pub struct Turn {
    /// Light by angle, in the order of the photographs.
    pub lights: Vec<Light>,
    /// Standard deviation of the subtracted darkness, common to all angles.
    pub dark_sigma: f64,
    /// Whether ambient light was photographed and subtracted.
    pub has_dark: bool,
    /// Region: left, top, width, height in pixels.
    pub region: [usize; 4],
    /// Limitations.
    pub warnings: Vec<String>,
}

/// Region of a picture: as requested, or the middle half of each side.
///
/// # Errors
/// `Input` for a region beyond the picture.
pub fn region_of(requested: Option<[usize; 4]>, info: Info) -> Result<[usize; 4]> {
    let (width, height) = (info.width, info.height);
    let [left, top, w, h] = requested.unwrap_or([width / 4, height / 4, width.div_ceil(2), height.div_ceil(2)]);
    let fits = |start: usize, length: usize, limit: usize| {
        length > 0 && start.checked_add(length).is_some_and(|end| end <= limit)
    };
    if fits(left, w, width) && fits(top, h, height) {
        return Ok([left, top, w, h]);
    }
    let problem = format!("{left},{top},{w},{h} does not lie in photographs of {width} × {height} pixels");
    Err(Error::input("region", problem, "give left, top, width and height in pixels"))
}

/// Loads photographs behind a turning analyser.
///
/// # Errors
/// `Input` for frames without angles, and as [`load`].
pub fn turning(input: &Path) -> Result<LoadedFrames> {
    let frames = load(input)?;
    if frames.set.layout.is_some() || frames.set.frames.iter().any(|f| f.analyser_deg.is_none()) {
        let remedy = "give a series over the turn of an analyser, with analyser_deg of each frame";
        return Err(Error::file(&frames.path, "has frames without an angle of the analyser", remedy));
    }
    Ok(frames)
}

/// Measures the mean light of a region at every angle. Photographs that are saturated there are left out, and so are
/// pixels that are saturated in any other one. One photograph is in memory at a time.
///
/// # Errors
/// `Input` for unreadable files and saturated series; `Cancelled`.
pub fn measure(frames: &LoadedFrames, region: [usize; 4], progress: &dyn Progress) -> Result<Turn> {
    let linearizer = Linearizer::new(frames)?;
    let all = &frames.set.frames;
    progress.stage("measuring light", 2 * all.len() as u64);
    let mut bad = vec![0_u8; region[2] * region[3]];
    let mut kept: Vec<&Frame> = vec![];
    for frame in all {
        let mut own = vec![0_u8; bad.len()];
        rows(frames, &linearizer, frame, region, |y, _, row| own[y * region[2]..][..region[2]].copy_from_slice(row))?;
        if own.iter().filter(|b| **b > 0).count() as f64 <= SATURATED * own.len() as f64 {
            bad.iter_mut().zip(&own).for_each(|(bad, own)| *bad |= own);
            kept.push(frame);
        }
        progress.step();
        progress.check()?;
    }
    let pixels = bad.iter().filter(|b| **b == 0).count();
    let noise = frames.set.noise.unwrap_or(ASSUMED);
    let mut lights: Vec<Light> = vec![];
    let mut dark_sigma: f64 = 0.0;
    for frame in kept {
        let mut sum = 0.0;
        rows(frames, &linearizer, frame, region, |y, light, _| {
            let bad = &bad[y * region[2]..][..region[2]];
            sum += light.iter().zip(bad).filter(|(_, b)| **b == 0).map(|(v, _)| f64::from(*v)).sum::<f64>();
        })?;
        let light = sum / pixels.max(1) as f64;
        let noise = noise.frame(frame.gain.unwrap_or(1.0), frame.scale(), linearizer.step());
        let variance = (noise.shot * light.max(0.0) + noise.floor) / pixels.max(1) as f64;
        if frame.dark.is_some() || frames.set.dark.is_some() {
            dark_sigma = dark_sigma.max((noise.floor / pixels.max(1) as f64).sqrt());
        }
        let stage_deg = frame.analyser_deg.unwrap_or_default();
        add(&mut lights, Light { stage_deg, axis: frames.set.analyser_axis(frame), light, variance });
        progress.step();
        progress.check()?;
    }
    let lost = all.iter().filter(|f| lights.iter().all(|l| !same(l.stage_deg, f.analyser_deg.unwrap_or_default())));
    let lost = lost.count();
    if pixels == 0 || lights.len() < 5 {
        let problem = format!("leaves {} angles with unsaturated photographs; at least 5 are needed", lights.len());
        return Err(Error::file(&frames.path, problem, "expose less, or give another --region"));
    }
    let mut warnings = frames.warnings.clone();
    if lost > 0 {
        warnings.push(format!("{lost} photographs are saturated in the region, and no shorter exposure replaces them"));
    }
    let has_dark = all.iter().all(|f| f.dark.is_some() || frames.set.dark.is_some());
    Ok(Turn { lights, dark_sigma, has_dark, region, warnings })
}

fn same(a: f64, b: f64) -> bool {
    (a - b).abs() < SAME_ANGLE_DEG
}

/// Adds a measurement; those of one angle are averaged by their precision.
fn add(lights: &mut Vec<Light>, new: Light) {
    match lights.iter_mut().find(|l| same(l.stage_deg, new.stage_deg)) {
        Some(old) => {
            let [a, b] = [old.variance, new.variance].map(|v| 1.0 / v.max(f64::MIN_POSITIVE));
            old.light = (a * old.light + b * new.light) / (a + b);
            old.variance = 1.0 / (a + b);
        }
        None => lights.push(new),
    }
}

/// Calls `each(row, light, bad)` for the rows of the region in a photograph.
fn rows(
    frames: &LoadedFrames,
    linearizer: &Linearizer,
    frame: &Frame,
    [left, top, width, height]: [usize; 4],
    mut each: impl FnMut(usize, &[f32], &[u8]),
) -> Result<()> {
    let decoded = linearizer.frame(frames, frame)?;
    let (mut light, mut bad) = (vec![0.0; frames.info.width], vec![0; frames.info.width]);
    for y in 0..height {
        bad.fill(0);
        decoded.row(top + y, &mut light, &mut bad);
        each(y, &light[left..][..width], &bad[left..][..width]);
    }
    Ok(())
}
