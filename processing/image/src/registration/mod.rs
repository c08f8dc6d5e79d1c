//! How far photographs of one scene are shifted against each other, to a few hundredths of a pixel.
//!
//! An analyser whose faces are not parallel shifts the image as it turns, by up to pixels, and orientations near edges
//! are then wrong. What makes registering polarization frames hard is that turning the analyser also changes every region's
//! brightness in its own way. So frames are not compared with each other but with Malus' law: those shifts are right with
//! which `A + C cos 2ψ + S sin 2ψ`, fitted to each pixel, leaves least over. All shifts are found together, since the fit
//! takes up part of any one of them.

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

/// Fewest angles at which Malus' law leaves something over to judge shifts by.
const FEWEST_ANGLES: usize = 4;

/// Height of a correlation's peak in standard deviations, from which it is no noise: 1 of 800 frames of pure noise gets there,
/// and is then refused for its σ.
const SIGNIFICANT: f64 = 5.0;

/// And from which a few windows have told it.
const BEYOND_DOUBT: f64 = 3.0 * SIGNIFICANT;

/// A shift less certain than this, in pixels, is not told.
pub const MAX_SIGMA: f64 = 0.1;

/// Where a frame's content lies, relative to the mean of all frames, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// To the right.
    pub dx: f64,
    /// Down.
    pub dy: f64,
    /// Standard deviation along the less certain direction, from the scatter over parts of the image.
    pub sigma: f64,
}

/// Shifts of a set, or why they cannot be told.
#[derive(Clone, Debug, PartialEq)]
pub enum Registration {
    /// One shift per frame; their mean is zero.
    Told(Vec<Shift>),
    /// Nothing is known; frames are best left where they are.
    CannotTell(Doubt),
}

/// Why shifts cannot be told.
#[derive(Clone, Debug, PartialEq)]
pub enum Doubt {
    /// The image is below 32 pixels wide or high, or there is no frame.
    TooSmall,
    /// These frames (counted from 0) show nothing in common with the first, or too few edges to tell (images below about
    /// 128 pixels).
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

/// Collects what is needed of each frame: at most 16 windows of 256×256 pixels, 4 bytes each.
pub struct Registrar {
    windows: Windows,
}

impl Registrar {
    /// For images of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { windows: Windows::new(width, height) }
    }

    /// Takes in the next frame. `row(y, left, values, bad)` fills in linear values of row `y` from column `left` on, as many as
    /// are asked for, and sets `bad[x] = 1` where one cannot be used; it is called from several threads.
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
        // Repeated tiles also match one another, so that the highest peak may be wrong; and the way to a large shift is
        // barred to those who start from none. Where both ways lead to the same place, it is that.
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
