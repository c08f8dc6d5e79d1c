//! The bench that frames are taken on: its devices as `nacre.toml` describes them, its optics and its distances.

mod section;

pub use section::{BenchSection, Optics, lock_name};

use nacre_frames::Distances;
use serde::{Deserialize, Serialize};

/// What the frames were taken with, as far as it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Middle of the filter's band in nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Full width at half maximum of the filter's band in nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_nm: Option<f64>,
    /// Where sample, light and camera stand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Distances>,
    /// Width and height of the panel in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_mm: Option<[f64; 2]>,
}
