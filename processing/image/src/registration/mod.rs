//! Registration of photographs of one scene, to a few hundredths of a pixel.
//!
//! An analyser with non-parallel faces shifts the image as it rotates, by up to several pixels, which causes
//! orientation errors near edges. Rotation of the analyser also changes every region's brightness differently. Frames
//! are therefore compared with Malus' law rather than with each other. The estimated shifts minimise the residual of
//! `A + C cos 2ψ + S sin 2ψ`, fitted to each pixel. All shifts are estimated jointly, because the fit absorbs part of
//! any single one.

mod alignment;
mod coarse;
mod joint;
mod resample;
mod scene;
mod sums;
#[cfg(test)]
mod tests;
mod tile;
mod windows;

pub use alignment::{Align, Alignment};
pub use resample::Resampler;

use scene::Scene;
use windows::Windows;

/// Smallest number of angles for which Malus' law has a residual.
const FEWEST_ANGLES: usize = 4;

/// Height of a significant correlation peak in standard deviations. One of 800 frames of pure noise reaches it, and is
/// then refused for its σ.
const SIGNIFICANT: f64 = 5.0;

/// Height at which a few windows suffice.
const BEYOND_DOUBT: f64 = 3.0 * SIGNIFICANT;

/// Largest σ in pixels of a reported shift.
pub const MAX_SIGMA: f64 = 0.1;

/// Shift of a frame's content against the mean of all frames, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// Shift to the right.
    pub dx: f64,
    /// Shift down.
    pub dy: f64,
    /// Standard deviation along the less certain direction, from the scatter between parts of the image.
    pub sigma: f64,
}

/// Shifts of a set of frames, or the reason for which they are unknown.
#[derive(Clone, Debug, PartialEq)]
pub enum Registration {
    /// One shift per frame; their mean is zero.
    Told(Vec<Shift>),
    /// The shifts are unknown; frames are best left unchanged.
    CannotTell(Doubt),
}

/// Reason for which shifts are unknown.
#[derive(Clone, Debug, PartialEq)]
pub enum Doubt {
    /// The image is below 32 pixels wide or high, or there is no frame.
    TooSmall,
    /// These frames (counted from 0) do not correlate with the first, or have too few edges (images below about 128
    /// pixels).
    NothingInCommon(Vec<usize>),
    /// There are edges, but the frames do not follow the scene's model under any shifts.
    NoAgreement,
    /// The least certain shift has this σ in pixels.
    TooUncertain(f64),
}

impl std::fmt::Display for Doubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooSmall => write!(f, "the photographs are too small to tell shifts"),
            Self::NothingInCommon(frames) => {
                let list: Vec<String> = frames.iter().map(|k| (k + 1).to_string()).collect();
                write!(f, "photographs {} show too little in common with the first to tell shifts", list.join(", "))
            }
            Self::NoAgreement => write!(f, "the photographs follow Malus' law under no shifts"),
            Self::TooUncertain(sigma) => {
                write!(f, "there is too little texture: a shift is only known to {sigma:.2} pixels")
            }
        }
    }
}

/// Collects frames for registration: at most 16 windows of 256×256 pixels per frame, 4 bytes per pixel.
pub struct Registrar {
    windows: Windows,
}

impl Registrar {
    /// Creates a registrar for images of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { windows: Windows::new(width, height) }
    }

    /// Adds the next frame.
    ///
    /// `row(y, left, values, bad)` fills `values` with linear values of row `y` from column `left` on, and sets
    /// `bad[x] = 1` for unusable ones. Several threads call it.
    pub fn add(&mut self, row: impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync) {
        self.windows.add(row);
    }

    /// Shifts of a scene behind an analyser at these angles (rad), one per frame.
    ///
    /// With fewer than four angles Malus' law fits any shifts, so the modulation counts as a disturbance.
    pub fn polarized(&self, angles: &[f64]) -> Registration {
        let distinct = angles.len() >= FEWEST_ANGLES;
        self.register(if distinct { Scene::polarized(angles) } else { Scene::still(angles.len()) })
    }

    /// Shifts of a scene that does not change.
    pub fn still(&self) -> Registration {
        self.register(Scene::still(self.windows.frames()))
    }

    fn register(&self, scene: Scene) -> Registration {
        if self.windows.count() == 0 || scene.rows.len() != self.windows.frames() {
            return Registration::CannotTell(Doubt::TooSmall);
        }
        let peaks = coarse::peaks(&self.windows, BEYOND_DOUBT);
        let lost: Vec<usize> = (0..peaks.len()).filter(|k| peaks[*k].height < SIGNIFICANT).collect();
        if !lost.is_empty() {
            return Registration::CannotTell(Doubt::NothingInCommon(lost));
        }
        // Repeated tiles also match one another, so the highest peak may be wrong. A fit that starts from zero shifts
        // may not reach a large shift. If both give the same minimum, it is accepted.
        let start = joint::centred(peaks.iter().map(|p| p.shift).collect());
        let near = joint::from_nothing(&self.windows, &scene);
        let best = match near {
            Some(near) if near.is_at(&start) => Some(near),
            near => joint::better(near, joint::minimum(&self.windows, &start, &scene)),
        };
        let Some(found) = best.and_then(|best| joint::refine(&self.windows, best)) else {
            return Registration::CannotTell(Doubt::NoAgreement);
        };
        let worst = found.iter().map(|f| f.1).fold(0.0, f64::max);
        if worst.is_nan() || worst > MAX_SIGMA {
            return Registration::CannotTell(Doubt::TooUncertain(worst));
        }
        Registration::Told(found.into_iter().map(|([dx, dy], sigma)| Shift { dx, dy, sigma }).collect())
    }
}
