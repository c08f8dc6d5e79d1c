//! Calibration of camera, sample, panel and light, from photographs of chessboards, highlights, and manual
//! measurements.

mod band;
mod boards;
mod candidates;
mod corners;
mod fit;
mod grid;
mod highlight;
mod job;
mod light;
mod mirrors;
mod overlay;
mod panel;
mod picture;
mod plane;
mod relative;
mod report;
mod sample;
mod service;
mod start;
mod subpixel;
mod summary;
#[cfg(test)]
mod tests;

pub use band::{Band, band, band_of};
pub use boards::{Calibrated, Photograph, calibrate, of_corners};
pub use corners::{Board, View, find};
pub use highlight::{Found, find_highlight};
pub use job::{CameraFrom, Outcome, PanelFrom, Request, SampleFrom, calibrate_geometry};
pub use light::{Highlight, Known, PlacedLight, from_highlights};
pub use mirrors::{LightOptions, Mirror, MirrorImage};
pub use nacre_image::Gray;
pub use nacre_image::{homography, mapped};
pub use overlay::overlay;
pub use panel::{Pixels, PlacedPanel, Shown, by_hand, from_photograph};
pub use picture::board_picture;
pub use relative::{Ruler, relative};
pub use report::{PhotographReport, Report};
pub use sample::{CameraCovariance, Placed, camera_covariance, from_board, from_corners};
pub use service::{Calibration, Options, work, write_overlays};
pub use summary::summary;
