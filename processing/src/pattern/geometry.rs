//! From places in a photograph to half vectors, when camera and flash are near.

use crate::{Error, Result};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Newton's steps from a pixel to its place; each doubles the digits.
const STEPS: usize = 6;

/// Most pixels of a side of what is resampled, as a multiple of the photograph's.
const LARGEST: f64 = 3.0;

/// Where camera and flash stood above a flat surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Arrangement {
    /// Camera above the surface, in mm; it looks straight down.
    pub camera_mm: f64,
    /// Flash above the surface, in mm.
    pub flash_mm: f64,
    /// From the camera to the flash, to the right and up in the photograph, in mm.
    #[serde(default)]
    pub baseline_mm: [f64; 2],
    /// Size of a pixel on the surface, in µm.
    pub pixel_um: f64,
}

/// A photograph over half vectors.
pub(super) struct Resampled {
    pub light: Vec<f32>,
    pub width: usize,
    pub height: usize,
    pub center: [f64; 2],
    pub scale: f64,
}

/// A vector's component along the surface, and its height.
#[derive(Clone, Copy)]
struct Towards {
    x: f64,
    y: f64,
    z: f64,
    distance: f64,
}

impl Towards {
    fn new([x, y, z]: [f64; 3], at: [f64; 2]) -> Self {
        let (x, y) = (x - at[0], y - at[1]);
        let distance = (x * x + y * y + z * z).sqrt();
        Self { x: x / distance, y: y / distance, z: z / distance, distance }
    }
}

impl Arrangement {
    /// Refuses what is none.
    ///
    /// # Errors
    /// `Input`.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, problem: String, expected: &str| Err(Error::input(what, problem, expected));
        for (what, mm) in [("camera_mm", self.camera_mm), ("flash_mm", self.flash_mm)] {
            if !(1.0..=1e6).contains(&mm) {
                return bad(what, format!("is {mm}"), "give its height above the surface, 1 to 1000000 mm");
            }
        }
        if !self.baseline_mm.iter().all(|b| b.abs() <= 1e6) {
            return bad("baseline_mm", format!("is {:?}", self.baseline_mm), "give at most 1000000 mm");
        }
        if !(0.01..=1e5).contains(&self.pixel_um) {
            return bad(
                "pixel_um",
                format!("is {}", self.pixel_um),
                "give the size of a pixel on the surface, 0.01 to 100000 µm",
            );
        }
        Ok(())
    }

    /// Where the zero order lies, in mm from the camera's foot.
    fn zero(&self) -> [f64; 2] {
        let share = self.camera_mm / (self.camera_mm + self.flash_mm);
        self.baseline_mm.map(|b| b * share)
    }

    fn directions(&self, at: [f64; 2]) -> [Towards; 2] {
        let [bx, by] = self.baseline_mm;
        [Towards::new([bx, by, self.flash_mm], at), Towards::new([0.0, 0.0, self.camera_mm], at)]
    }

    /// −(ωi + ωo) along the surface at a place, and how it changes with the place: xx, xy, yy.
    fn offset(&self, at: [f64; 2]) -> ([f64; 2], [f64; 3]) {
        let mut sum = [0.0; 2];
        let mut slope = [0.0; 3];
        for w in self.directions(at) {
            sum[0] -= w.x;
            sum[1] -= w.y;
            slope[0] += (1.0 - w.x * w.x) / w.distance;
            slope[1] -= w.x * w.y / w.distance;
            slope[2] += (1.0 - w.y * w.y) / w.distance;
        }
        (sum, slope)
    }

    /// What a place shows of the table: cosine, inverse square, and the paper's G = (1 + ωi·ωo)² / (cos θi cos θo), relative to the zero
    /// order (2017 paper, Eq. 8 and 10).
    fn factor(&self, at: [f64; 2]) -> f64 {
        let [i, o] = self.directions(at);
        let dot = i.x * o.x + i.y * o.y + i.z * o.z;
        let g = (1.0 + dot).powi(2) / (i.z * o.z);
        g * i.z / (i.distance * i.distance)
    }

    /// Half vectors per pixel at a place.
    fn scale(&self, at: [f64; 2]) -> f64 {
        let (_, [xx, xy, yy]) = self.offset(at);
        (xx * yy - xy * xy).sqrt() * self.pixel_um / 1000.0
    }

    /// The photograph with equal steps of the half vector from pixel to pixel, as it were without cosine, inverse square and G.
    pub(super) fn resample(&self, light: &[f32], [width, height]: [usize; 2], center: [f64; 2]) -> Resampled {
        let (zero, mm) = (self.zero(), self.pixel_um / 1000.0);
        let place = |x: f64, y: f64| [zero[0] + (x - center[0]) * mm, zero[1] - (y - center[1]) * mm];
        let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
        let border: Vec<[f64; 2]> = [
            (0.0, 0.0),
            (right, 0.0),
            (0.0, bottom),
            (right, bottom),
            (0.5 * right, 0.0),
            (0.5 * right, bottom),
            (0.0, 0.5 * bottom),
            (right, 0.5 * bottom),
        ]
        .map(|(x, y)| place(x, y))
        .to_vec();
        // Pixels far out are smaller in half vectors; but not below half of what they are in the middle.
        let middle = self.scale(zero);
        let scale = border.iter().map(|p| self.scale(*p)).fold(middle, f64::min).max(0.5 * middle);
        let reach =
            |sign: f64, axis: usize| border.iter().map(|p| sign * self.offset(*p).0[axis]).fold(0.0, f64::max) / scale;
        let [left, after, above, below] = [reach(-1.0, 0), reach(1.0, 0), reach(1.0, 1), reach(-1.0, 1)].map(f64::ceil);
        let size = |reach: f64, n: usize| ((reach + 1.0) as usize).clamp(1, (LARGEST * n as f64) as usize + 1);
        let (columns, rows) = (size(left + after, width), size(above + below, height));
        let plane = super::plane::Plane::new(light, width, height);
        let (one, mut out) = (self.factor(zero), vec![f32::NAN; columns * rows]);
        out.par_chunks_mut(columns).enumerate().for_each(|(row, out)| {
            for (column, out) in out.iter_mut().enumerate() {
                let at = self.place_of([(column as f64 - left) * scale, (above - row as f64) * scale]);
                let x = center[0] + (at[0] - zero[0]) / mm;
                let y = center[1] - (at[1] - zero[1]) / mm;
                let [light, known] = plane.at(x as f32, y as f32);
                if known > 0.0 {
                    *out = light * (one / self.factor(at)) as f32;
                }
            }
        });
        Resampled { light: out, width: columns, height: rows, center: [left, above], scale }
    }

    /// Where −(ωi + ωo) is so much. NaN where it is nowhere.
    fn place_of(&self, wanted: [f64; 2]) -> [f64; 2] {
        let (mut at, spread) = (self.zero(), 1.0 / self.camera_mm + 1.0 / self.flash_mm);
        // Directions steepen outwards: begin where a lens without perspective errors has it.
        let square = 0.25 * (wanted[0] * wanted[0] + wanted[1] * wanted[1]);
        let stretch = 1.0 / (1.0 - square.min(0.96)).sqrt();
        at = [at[0] + stretch * wanted[0] / spread, at[1] + stretch * wanted[1] / spread];
        for _ in 0..STEPS {
            let (found, [xx, xy, yy]) = self.offset(at);
            let (dx, dy) = (wanted[0] - found[0], wanted[1] - found[1]);
            let determinant = xx * yy - xy * xy;
            at[0] += (yy * dx - xy * dy) / determinant;
            at[1] += (xx * dy - xy * dx) / determinant;
        }
        let (found, _) = self.offset(at);
        if (found[0] - wanted[0]).hypot(found[1] - wanted[1]) < 1e-6 { at } else { [f64::NAN; 2] }
    }
}
