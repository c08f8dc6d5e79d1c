//! Mapping of photograph pixels to half vectors for a nearby camera and flash.

use nacre_base::{Error, Result};
use nacre_optics::geometry::Geometry;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

/// Newton iterations from a pixel to its position; each doubles the number of correct digits.
const STEPS: usize = 6;

/// Maximum side of the resampled image, relative to the photograph's.
const LARGEST: f64 = 3.0;

/// Camera and flash above a flat surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Arrangement {
    /// Height of the camera above the surface in mm; it looks straight down.
    pub camera_mm: f64,
    /// Height of the flash above the surface in mm.
    pub flash_mm: f64,
    /// Displacement from camera to flash in mm, to the right and upwards in the photograph.
    #[serde(default)]
    pub baseline_mm: [f64; 2],
    /// Pixel size on the surface in µm.
    pub pixel_um: f64,
}

/// Positions of camera, surface and flash: measured by hand, or calibrated.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Placement {
    /// Camera looking straight down.
    Arranged(Arrangement),
    /// Contents of geometry.json: any camera pose, with lens distortion and the light.
    Calibrated(Box<Geometry>),
}

impl<'de> Deserialize<'de> for Placement {
    /// Selects the variant by the key `camera`, so that errors name the key of the intended variant.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let value = Value::deserialize(deserializer)?;
        if value.get("camera").is_some() {
            return serde_json::from_value(value).map(Self::Calibrated).map_err(D::Error::custom);
        }
        serde_json::from_value(value).map(Self::Arranged).map_err(D::Error::custom)
    }
}

/// Maximum distance of the zero order from the calibrated one, as a half vector; a larger one indicates another setup.
const ASTRAY: f64 = 0.03;

impl Placement {
    /// Validates the arrangement or geometry.
    ///
    /// # Errors
    /// `Input`.
    pub fn check(&self) -> Result<()> {
        match self {
            Self::Arranged(arrangement) => arrangement.check(),
            Self::Calibrated(geometry) => geometry.check(),
        }
    }

    /// Geometry of a photograph of this size, aligned to its measured zero order.
    ///
    /// # Errors
    /// `Input` for a geometry without a light, for another photograph size, and for a zero order far from the expected
    /// one.
    pub(super) fn view(&self, size: [usize; 2], center: [f64; 2]) -> Result<View<'_>> {
        match self {
            Self::Arranged(a) => {
                let [bx, by] = a.baseline_mm;
                let (light, viewer) = ([bx, by, a.flash_mm], [0.0, 0.0, a.camera_mm]);
                let zero = mirrored(light, viewer);
                Ok(View { light, viewer, pixels: Pixels::Even { zero, center, mm: a.pixel_um / 1000.0 } })
            }
            Self::Calibrated(geometry) => {
                let bad = |problem: String, remedy: &str| Err(Error::input("the geometry", problem, remedy));
                let Some(light) = geometry.light_mm else {
                    return bad("has no light".into(), "calibrate it: `nacre calibrate geometry --highlight`");
                };
                if let Some([w, h]) = geometry.image_px.filter(|px| px.map(|n| n as usize) != size) {
                    let [width, height] = size;
                    let problem = format!("is for photographs of {w} × {h} pixels, but this has {width} × {height}");
                    return bad(problem, "give the geometry of this camera and region of interest");
                }
                let viewer = geometry.viewer();
                let [x, y] = mirrored(light, viewer);
                let Some(expected) = geometry.pixel([x, y, 0.0]) else {
                    return bad("has no zero order in view".into(), "calibrate camera and light together");
                };
                let shift = [center[0] - expected[0], center[1] - expected[1]];
                let view = View { light, viewer, pixels: Pixels::Photographed { geometry, shift } };
                let away = shift[0].hypot(shift[1]);
                if away * view.scale([x, y]) > ASTRAY {
                    let problem =
                        format!("has the light's mirror image {away:.0} pixels from the zero order of the photograph");
                    return bad(
                        problem,
                        "calibrate the light: `nacre calibrate geometry --highlight`, or give --center",
                    );
                }
                Ok(view)
            }
        }
    }
}

/// Point on the surface z = 0 that reflects a light into the camera.
fn mirrored(light: [f64; 3], viewer: [f64; 3]) -> [f64; 2] {
    let share = viewer[2] / (viewer[2] + light[2]);
    [0, 1].map(|k| viewer[k] + share * (light[k] - viewer[k]))
}

/// Photograph of a surface, in mm of the surface plane.
pub(super) struct View<'a> {
    light: [f64; 3],
    viewer: [f64; 3],
    pixels: Pixels<'a>,
}

/// Mapping from surface positions to pixels.
enum Pixels<'a> {
    /// Linear: a surface position, its pixel, and the pixel size in mm.
    Even { zero: [f64; 2], center: [f64; 2], mm: f64 },
    /// Camera model, with an offset in pixels.
    Photographed { geometry: &'a Geometry, shift: [f64; 2] },
}

/// A photograph resampled to half vectors.
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
    /// Validates the arrangement.
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
}

impl View<'_> {
    /// Surface position seen by a pixel; NaN if it misses the surface.
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        match self.pixels {
            Pixels::Even { zero, center, mm } => [zero[0] + (x - center[0]) * mm, zero[1] - (y - center[1]) * mm],
            Pixels::Photographed { geometry, shift } => {
                geometry.point([x - shift[0], y - shift[1]]).map_or([f64::NAN; 2], |[x, y, _]| [x, y])
            }
        }
    }

    /// Pixel that sees a surface position; NaN if none does.
    fn pixel(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        match self.pixels {
            Pixels::Even { zero, center, mm } => [center[0] + (x - zero[0]) / mm, center[1] - (y - zero[1]) / mm],
            Pixels::Photographed { geometry, shift } => {
                geometry.pixel([x, y, 0.0]).map_or([f64::NAN; 2], |[x, y]| [x + shift[0], y + shift[1]])
            }
        }
    }

    /// Geometric mean of a pixel's sides on the surface, in mm.
    fn pixel_mm(&self, at: [f64; 2]) -> f64 {
        let [x, y] = self.pixel(at);
        let [right, down] = [self.place([x + 1.0, y]), self.place([x, y + 1.0])];
        let [a, b] = [[right[0] - at[0], right[1] - at[1]], [down[0] - at[0], down[1] - at[1]]];
        (a[0] * b[1] - a[1] * b[0]).abs().sqrt()
    }

    /// Surface position of the zero order.
    fn zero(&self) -> [f64; 2] {
        mirrored(self.light, self.viewer)
    }

    fn directions(&self, at: [f64; 2]) -> [Towards; 2] {
        [Towards::new(self.light, at), Towards::new(self.viewer, at)]
    }

    /// −(ωi + ωo) along the surface at a position, and its derivatives xx, xy, yy.
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

    /// Ratio of photographed light to the table at a position, relative to the zero order. It comprises cosine, inverse
    /// square, and the paper's G = (1 + ωi·ωo)² / (cos θi cos θo) (2017 paper, Eq. 8 and 10).
    fn factor(&self, at: [f64; 2]) -> f64 {
        let [i, o] = self.directions(at);
        let dot = i.x * o.x + i.y * o.y + i.z * o.z;
        let g = (1.0 + dot).powi(2) / (i.z * o.z);
        g * i.z / (i.distance * i.distance)
    }

    /// Half vector per pixel at a position.
    fn scale(&self, at: [f64; 2]) -> f64 {
        let (_, [xx, xy, yy]) = self.offset(at);
        (xx * yy - xy * xy).sqrt() * self.pixel_mm(at)
    }

    /// Resamples the photograph to a uniform grid of half vectors and corrects for cosine, inverse square and G.
    pub(super) fn resample(&self, light: &[f32], [width, height]: [usize; 2]) -> Resampled {
        let zero = self.zero();
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
        .map(|(x, y)| self.place([x, y]))
        .into_iter()
        .filter(|p| p[0].is_finite())
        .collect();
        // Pixels far from the centre span smaller half vectors; the step is at least half of the central one.
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
                let [x, y] = self.pixel(at);
                let [light, known] = plane.at(x as f32, y as f32);
                if known > 0.0 {
                    // Dividing by the known fraction corrects pixels beside the border.
                    *out = light / known * (one / self.factor(at)) as f32;
                }
            }
        });
        Resampled { light: out, width: columns, height: rows, center: [left, above], scale }
    }

    /// Position with the given −(ωi + ωo); NaN if there is none.
    fn place_of(&self, wanted: [f64; 2]) -> [f64; 2] {
        let (mut at, spread) = (self.zero(), 1.0 / self.viewer[2] + 1.0 / self.light[2]);
        // Perspective compresses directions outwards; the start is the solution for an orthographic view.
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

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_optics::geometry::{Camera, Pose};

    /// Oblique camera with a lens, and a light beside it.
    fn askew() -> Geometry {
        let (sin, cos) = 0.35_f64.sin_cos();
        // Rotated about the sample's x axis by 20 degrees, at a distance of 300 mm.
        let rotation = [[1.0, 0.0, 0.0], [0.0, -cos, sin], [0.0, -sin, -cos]];
        let camera =
            Camera { focal_px: [420.0; 2], center_px: [148.0, 152.0], distortion: [-0.12, 0.03, 1e-3, -1e-3, 0.0] };
        let sample = Pose { rotation, translation_mm: [4.0, -7.0, 300.0] };
        Geometry { light_mm: Some([60.0, 35.0, 280.0]), ..Geometry::new(camera, sample) }
    }

    /// A pattern rendered from half vectors is recovered at the same half vectors, through lens and tilt.
    #[test]
    fn a_calibrated_camera_may_look_askew() {
        let geometry = askew();
        let light = geometry.light_mm.unwrap();
        let pattern = |[u, v]: [f64; 2]| 1.0 + 0.5 * (17.0 * u).cos() * (11.0 * v + 3.0 * u).sin();
        let distance = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt();
        let drawn = |i: usize| {
            let place = geometry.point([(i % 300) as f64, (i / 300) as f64]).unwrap();
            let [u, v] = geometry.half(place, light).map(|h| -h);
            let (to_light, to_camera) = (distance(place, light), distance(place, geometry.viewer()));
            let cosines = [light[2] / to_light, geometry.viewer()[2] / to_camera];
            let dot: f64 = (0..3).map(|k| (light[k] - place[k]) * (geometry.viewer()[k] - place[k])).sum();
            let g = (1.0 + dot / (to_light * to_camera)).powi(2) / (cosines[0] * cosines[1]);
            (pattern([u, v]) * g * cosines[0] / to_light.powi(2) * 1e5) as f32
        };
        let photograph: Vec<f32> = (0..300 * 300).map(drawn).collect();
        let zero = mirrored(light, geometry.viewer());
        let center = geometry.pixel([zero[0], zero[1], 0.0]).unwrap();
        let placement = Placement::Calibrated(Box::new(geometry.clone()));
        let view = placement.view([300, 300], center).unwrap();
        let r = view.resample(&photograph, [300, 300]);
        let at = |column: usize, row: usize| f64::from(r.light[row * r.width + column]);
        let middle = at(r.center[0] as usize, r.center[1] as usize) / pattern([0.0; 2]);
        let (mut seen, mut worst) = (0, 0.0_f64);
        for row in 0..r.height {
            for column in 0..r.width {
                let half = [(column as f64 - r.center[0]) * r.scale, (r.center[1] - row as f64) * r.scale];
                let light = at(column, row) / middle;
                // Splines continue the photograph by its mirror image, which distorts the pattern near the border.
                let inside = view.pixel(view.place_of(half)).iter().all(|v| (3.0..=296.0).contains(v));
                if light.is_finite() && inside {
                    seen += 1;
                    worst = worst.max((light / pattern(half) - 1.0).abs());
                }
            }
        }
        assert!(seen > 60_000 && worst < 3e-3, "{seen} {worst}");
        // A displaced zero order indicates another light; another photograph size, another camera.
        let moved = [center[0] + 40.0, center[1]];
        assert!(placement.view([300, 300], moved).is_err_and(|e| e.to_string().contains("mirror image")));
        let sized = Placement::Calibrated(Box::new(Geometry { image_px: Some([640, 480]), ..geometry.clone() }));
        assert!(sized.view([300, 300], center).is_err_and(|e| e.to_string().contains("640")));
        let dark = Placement::Calibrated(Box::new(Geometry { light_mm: None, ..geometry }));
        assert!(dark.view([300, 300], center).is_err_and(|e| e.to_string().contains("light")));
    }
}
