//! Camera position, and the choice of the oblique-incidence correction.

use nacre_frames::Distances;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Correction of oblique incidence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Oblique {
    /// Applied if the geometry is known and the likelihood increases.
    Auto,
    /// Never.
    #[default]
    Off,
}

/// Position of the camera above the photographs.
#[derive(Clone, Copy, Debug)]
pub struct CameraPosition {
    pub(crate) width: usize,
    /// Pixel below the camera.
    pub(crate) nadir: [f32; 2],
    /// Squared distance of the camera in pixels.
    pub(crate) distance2: f32,
    pub(crate) largest_sin2: f64,
}

impl CameraPosition {
    /// Position from the distances on the bench, for photographs of this size and map pixels of `block` photograph
    /// pixels; `None` if the pixel size is unknown.
    pub fn new(geometry: &Distances, [width, height]: [usize; 2], block: usize) -> Option<Self> {
        let pixel_mm = geometry.pixel_um? / 1000.0;
        let middle = [0.5 * width as f64, 0.5 * height as f64];
        // The sample lies midway between the camera and the light, which is to the right of the camera.
        let nadir = geometry.camera_px.unwrap_or([middle[0] - 0.5 * geometry.baseline_mm / pixel_mm, middle[1]]);
        let distance2 = (geometry.distance_mm / pixel_mm).powi(2);
        let corners = [[0.0, 0.0], [width as f64, 0.0], [0.0, height as f64], [width as f64, height as f64]];
        let square = |c: [f64; 2]| (c[0] - nadir[0]).powi(2) + (c[1] - nadir[1]).powi(2);
        let farthest = corners.into_iter().map(square).fold(0.0, f64::max);
        let block_px = block as f64;
        Some(Self {
            width: width / block,
            nadir: nadir.map(|v| (v / block_px - 0.5) as f32),
            distance2: (distance2 / (block_px * block_px)) as f32,
            largest_sin2: farthest / (farthest + distance2),
        })
    }

    /// sin² of the angle of incidence at a pixel, and its products with cosine and sine of twice the azimuth of the
    /// plane of incidence.
    #[inline]
    pub(crate) fn at(&self, pixel: usize) -> [f32; 3] {
        let (x, y) = ((pixel % self.width) as f32 - self.nadir[0], self.nadir[1] - (pixel / self.width) as f32);
        let scale = 1.0 / (x * x + y * y + self.distance2);
        [(x * x + y * y) * scale, (x * x - y * y) * scale, 2.0 * x * y * scale]
    }
}
