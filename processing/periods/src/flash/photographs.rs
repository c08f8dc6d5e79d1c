//! Photographs of a set grouped by light, and merging of their exposures.

use nacre_base::{Error, Result};
use nacre_frames::NoiseModel;
use nacre_frames::{Frame, Kind, Linearizer, LoadedFrames};
use nacre_image::catmull_rom;
use rayon::prelude::*;

/// Noise model of a small sensor, used when none is known, so that σ is rather overestimated.
const ASSUMED: NoiseModel = NoiseModel { full_scale_e: 5000.0, read_noise_e: 10.0 };

/// Maximum number of lights of a set.
const MAX_LIGHTS: usize = 1000;

/// Exposures under one light.
pub(super) struct Group {
    /// Frames, the longest exposure first.
    pub frames: Vec<Frame>,
    /// Position of the light, if the set states it.
    pub light_mm: Option<[f64; 3]>,
}

/// Frames of a set by illumination.
pub(super) struct Groups {
    /// By light, in the order of the set.
    pub lights: Vec<Group>,
    /// Frames under room light.
    pub room: Option<Group>,
}

/// A photograph as light per exposure time and gain.
pub(super) struct Photograph {
    pub width: usize,
    pub height: usize,
    /// NaN where all exposures are saturated.
    pub light: Vec<f32>,
    /// Variance of camera noise.
    pub variance: Vec<f32>,
}

/// Groups the frames of a set.
///
/// # Errors
/// `Input` for sets of another kind, and for sets without lights.
pub(super) fn groups(frames: &LoadedFrames) -> Result<Groups> {
    let refuse = |problem: &str, remedy: &str| Err(Error::file(&frames.path, problem, remedy));
    if !matches!(frames.set.kind, Kind::Flash | Kind::Free) {
        return refuse("holds no flash photographs", "give a set of kind flash");
    }
    let default = frames.set.kind == Kind::Flash;
    let mut lights: Vec<Group> = vec![];
    let mut room: Option<Group> = None;
    for frame in &frames.set.frames {
        if !frame.flash.unwrap_or(default) {
            let group = room.get_or_insert_with(|| Group { frames: vec![], light_mm: None });
            group.frames.push(frame.clone());
            continue;
        }
        match lights.iter_mut().find(|g| g.light_mm == frame.light_mm) {
            Some(group) => group.frames.push(frame.clone()),
            None => lights.push(Group { frames: vec![frame.clone()], light_mm: frame.light_mm }),
        }
    }
    if lights.is_empty() {
        return refuse("holds no photograph under the flash", "take one to five, with the flash at different places");
    }
    if lights.len() > MAX_LIGHTS {
        return refuse("holds more than 1000 places of the flash", "give fewer");
    }
    for group in lights.iter_mut().chain(&mut room) {
        group.frames.sort_by(|a, b| a.scale().total_cmp(&b.scale()));
    }
    Ok(Groups { lights, room })
}

/// Merges exposures: each pixel is taken from the longest unsaturated exposure. One file is decoded at a time.
///
/// # Errors
/// `Input` for unreadable files.
pub(super) fn merged(frames: &LoadedFrames, group: &Group, linearizer: &Linearizer) -> Result<Photograph> {
    let (width, height) = (frames.info.width, frames.info.height);
    let noise = frames.set.noise.unwrap_or(ASSUMED);
    let mut light = vec![f32::NAN; width * height];
    let mut variance = vec![f32::NAN; width * height];
    for frame in &group.frames {
        let decoded = linearizer.frame(frames, frame)?;
        let of = noise.frame(frame.gain.unwrap_or(1.0), frame.scale(), linearizer.step());
        let rows = light.par_chunks_mut(width).zip(variance.par_chunks_mut(width)).enumerate();
        rows.for_each_init(
            || (vec![0.0; width], vec![0_u8; width]),
            |(values, bad), (y, (light, variance))| {
                bad.fill(0);
                decoded.row(y, values, bad);
                for x in 0..width {
                    if light[x].is_nan() && bad[x] == 0 {
                        light[x] = values[x];
                        variance[x] = (of.shot * f64::from(values[x].max(0.0)) + of.floor) as f32;
                    }
                }
            },
        );
    }
    Ok(Photograph { width, height, light, variance })
}

impl Photograph {
    /// Interpolated light (Catmull-Rom) and its variance; NaN outside and beside saturated pixels.
    pub fn at(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        let (column, row) = (x.floor(), y.floor());
        let inside =
            column >= 1.0 && row >= 1.0 && column + 3.0 <= self.width as f64 && row + 3.0 <= self.height as f64;
        if !inside {
            return [f32::NAN; 2];
        }
        let (wx, wy) = (catmull_rom((x - column) as f32), catmull_rom((y - row) as f32));
        let first = (row as usize - 1) * self.width + column as usize - 1;
        let [mut light, mut variance] = [0.0; 2];
        for (j, wy) in wy.iter().enumerate() {
            let at = first + j * self.width;
            for (k, wx) in wx.iter().enumerate() {
                let w = wx * wy;
                light += w * self.light[at + k];
                variance += w * w * self.variance[at + k];
            }
        }
        [light, variance]
    }
}
