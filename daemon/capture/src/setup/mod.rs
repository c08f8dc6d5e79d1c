//! Description of the bench: devices from `nacre.toml`, optics and distances.

mod section;

pub use section::{BenchSection, Optics, lock_name};

use nacre_frames::Distances;
use serde::{Deserialize, Serialize};

/// Known optics and distances of the frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Centre wavelength of the filter in nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Bandwidth of the filter in nm (full width at half maximum).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_nm: Option<f64>,
    /// Distances between sample, light and camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Distances>,
    /// Width and height of the panel in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_mm: Option<[f64; 2]>,
}
