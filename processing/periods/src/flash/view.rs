//! Camera view of the sheet: positions of pixels, and half vectors.

use super::settings::Settings;
use nacre_base::{Error, Result};
use nacre_image::homography;
use nacre_optics::geometry::Geometry;
use nalgebra::{Matrix3, Vector3};

/// Mapping between sheet positions (mm, to the right of and above the centre) and pixels.
pub(super) struct View {
    map: Map,
    /// Position of the camera.
    pub viewer: [f64; 3],
    /// Reason why periods are relative; `None` for a calibrated camera.
    pub relative: Option<String>,
    /// Relative error of periods from position errors that vary over the sheet, so that parts of it appear to differ.
    pub uneven: f64,
}

/// Standard deviation in pixels of detected or picked corners.
const CORNER_PX: f64 = 1.0;

enum Map {
    Calibrated(Box<Geometry>),
    /// Homography from sheet positions to pixels; w = 1 at the origin.
    Flat(Matrix3<f64>),
}

/// Directions of light and camera at a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Half {
    /// Position in mm.
    pub place: [f64; 2],
    /// Tangential part of ωi + ωo (2018 paper, Eq. 3 and section 4.4).
    pub half: [f64; 2],
    /// Cosine of incidence over squared distance, in 1/mm².
    pub gain: f64,
    /// Derivative of the half vector with respect to the light's position in its plane: xx, xy and yy in 1/mm.
    pub slope: [f64; 3],
    /// Deviation of the mean half vector over an extended light from that of its centre, per mm² of the light's
    /// variance.
    pub bend: [f64; 2],
}

impl View {
    /// View of a calibrated camera.
    pub fn calibrated(geometry: &Geometry) -> Self {
        let relative = geometry.relative.then(|| "the geometry is one of relative lengths".to_owned());
        Self { viewer: geometry.viewer(), map: Map::Calibrated(Box::new(geometry.clone())), relative, uneven: 0.0 }
    }

    /// Approximate view (2018 paper, section 4.4): four corners of a sheet of known size, and a camera without
    /// distortion above the centre of a photograph of `image` pixels.
    ///
    /// # Errors
    /// `Input` for invalid corners.
    pub fn flat(corners: [[f64; 2]; 4], size_mm: [f64; 2], camera_mm: f64, image: [usize; 2]) -> Result<Self> {
        let [w, h] = size_mm.map(|s| 0.5 * s);
        let places = [[-w, h], [w, h], [w, -h], [-w, -h]];
        let twist = |k: usize| {
            let [a, b, c] = [corners[k], corners[(k + 1) % 4], corners[(k + 2) % 4]];
            (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
        };
        // Clockwise in the picture, where y points down.
        if (0..4).any(|k| twist(k).is_nan() || twist(k) <= 1.0) {
            let remedy = "give top left, top right, bottom right, bottom left as x,y";
            return Err(Error::input("--corners-px", format!("{corners:?} is no sheet seen from above"), remedy));
        }
        let in_front = |map: &Matrix3<f64>| places.iter().all(|p| project(map, *p).is_some());
        let map = homography(&places, &corners).filter(in_front).ok_or_else(|| {
            Error::input("--corners-px", format!("{corners:?} is no perspective of a sheet"), "correct the corners")
        })?;
        let relative = "the camera was taken to stand over the middle of the picture, without distortion".to_owned();
        let side = |a: usize, b: usize| (corners[a][0] - corners[b][0]).hypot(corners[a][1] - corners[b][1]);
        let shortest = (0..4).map(|k| side(k, (k + 1) % 4)).fold(f64::INFINITY, f64::min);
        let (map, viewer) = (Map::Flat(map), [0.0, 0.0, camera_mm]);
        let mut view = Self { map, viewer, relative: Some(relative), uneven: CORNER_PX / shortest };
        let middle = image.map(|n| 0.5 * (n as f64 - 1.0));
        let [x, y] = view.point(middle).ok_or_else(|| {
            Error::input("--corners-px", "put the picture's middle beyond the sheet's horizon", "correct the corners")
        })?;
        view.viewer = [x, y, camera_mm];
        Ok(view)
    }

    /// Pixel that shows a position; `None` if it is not visible.
    pub fn pixel(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        match &self.map {
            Map::Calibrated(geometry) => geometry.pixel([x, y, 0.0]),
            Map::Flat(m) => project(m, [x, y]),
        }
    }

    /// Position shown by a pixel.
    pub fn point(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        match &self.map {
            Map::Calibrated(geometry) => geometry.point(pixel).map(|[x, y, _]| [x, y]),
            Map::Flat(m) => project(&m.try_inverse()?, pixel),
        }
    }

    /// Half vector and irradiance at a position for a light.
    pub fn half(&self, place: [f64; 2], light: [f64; 3]) -> Half {
        half(self.viewer, place, light)
    }

    /// Position of a light at a known height whose mirror image appears at a position on the sheet.
    pub fn light_at(&self, highlight: [f64; 2], height_mm: f64) -> [f64; 3] {
        let back = height_mm / self.viewer[2];
        let [x, y] = [0, 1].map(|k| highlight[k] + back * (highlight[k] - self.viewer[k]));
        [x, y, height_mm]
    }

    /// Pixel size on the sheet in mm, at a position.
    pub fn pixel_mm(&self, at: [f64; 2]) -> Option<f64> {
        let step = 1.0;
        let [a, b, c] = [self.pixel(at)?, self.pixel([at[0] + step, at[1]])?, self.pixel([at[0], at[1] + step])?];
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        (area != 0.0).then(|| step / area.abs().sqrt())
    }
}

/// Half vector and irradiance at a position for a camera and a light.
pub(super) fn half(viewer: [f64; 3], [x, y]: [f64; 2], light: [f64; 3]) -> Half {
    let towards = |far: [f64; 3]| {
        let d = [far[0] - x, far[1] - y, far[2]];
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        (d.map(|v| v / length), length)
    };
    let ((o, _), (i, distance)) = (towards(viewer), towards(light));
    // Half of the half vector's second derivatives, plus the effect of brighter near points of the light: cos θi/d²
    // changes by -3/d times the tangential part per mm.
    let bend = -(0.5 + 4.5 * i[2] * i[2]) / (distance * distance);
    Half {
        place: [x, y],
        half: [o[0] + i[0], o[1] + i[1]],
        gain: i[2] / (distance * distance),
        slope: [(1.0 - i[0] * i[0]) / distance, -i[0] * i[1] / distance, (1.0 - i[1] * i[1]) / distance],
        bend: [bend * i[0], bend * i[1]],
    }
}

fn project(m: &Matrix3<f64>, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let seen = m * Vector3::new(x, y, 1.0);
    (seen.z > 1e-9).then(|| [seen.x / seen.z, seen.y / seen.z])
}

/// View from the options and the geometry; corners must be known.
///
/// # Errors
/// `Input` for missing values.
pub(super) fn view(settings: &Settings, corners: Option<[[f64; 2]; 4]>, image: [usize; 2]) -> Result<View> {
    if let Some(geometry) = &settings.geometry {
        if let Some(of) = geometry.image_px.map(|s| s.map(|n| n as usize)).filter(|s| *s != image) {
            let problem = format!("is of photographs of {of:?} pixels, but these have {image:?}");
            return Err(Error::input("geometry", problem, "give that of this camera at this resolution"));
        }
        return Ok(View::calibrated(geometry));
    }
    let missing = |what: &str, remedy: &str| Error::input(what, "is not known", remedy);
    let remedy = "give a geometry (nacre calibrate geometry), or corners, size and camera distance of the sheet";
    let corners = corners.ok_or_else(|| missing("geometry", remedy))?;
    let size_mm = settings.size_mm.ok_or_else(|| missing("--size-mm", remedy))?;
    let camera_mm = settings.camera_mm.ok_or_else(|| missing("--camera-mm", remedy))?;
    View::flat(corners, size_mm, camera_mm, image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_corners_are_met_and_the_way_back_is_the_same() {
        let corners = [[100.0, 80.0], [900.0, 60.0], [960.0, 700.0], [60.0, 640.0]];
        let view = View::flat(corners, [297.0, 210.0], 500.0, [1000, 760]).unwrap();
        for (corner, place) in corners.iter().zip([[-148.5, 105.0], [148.5, 105.0], [148.5, -105.0], [-148.5, -105.0]])
        {
            let found = view.pixel(place).unwrap();
            assert!((found[0] - corner[0]).abs() + (found[1] - corner[1]).abs() < 1e-6, "{found:?}");
            let back = view.point(*corner).unwrap();
            assert!((back[0] - place[0]).abs() + (back[1] - place[1]).abs() < 1e-6, "{back:?}");
        }
        let turned = [corners[1], corners[0], corners[3], corners[2]];
        assert!(View::flat(turned, [297.0, 210.0], 500.0, [1000, 760]).is_err());
        assert!(View::flat([[0.0, 0.0]; 4], [297.0, 210.0], 500.0, [1000, 760]).is_err());
    }

    #[test]
    fn the_slope_is_that_of_the_half_vector() {
        let corners = [[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]];
        let view = View::flat(corners, [100.0, 100.0], 400.0, [101, 101]).unwrap();
        let (at, light) = ([20.0, -30.0], [-40.0, 25.0, 210.0]);
        let near = view.half(at, light);
        let step = 1e-4;
        for (axis, slopes) in [[0, 1], [1, 2]].iter().enumerate() {
            let mut moved = light;
            moved[axis] += step;
            let found = view.half(at, moved).half;
            for k in 0..2 {
                let slope = (found[k] - near.half[k]) / step;
                assert!((slope - near.slope[slopes[k]]).abs() < 1e-7, "{axis} {k}");
            }
        }
        // The light's position follows from its highlight.
        let place = view.light_at([12.0, -7.0], 210.0);
        let at_highlight = view.half([12.0, -7.0], place).half;
        assert!(at_highlight[0].abs() + at_highlight[1].abs() < 1e-12);
    }
}
