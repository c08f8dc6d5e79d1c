//! Relative geometry without a calibration (2018 paper, section 4.4), from one known length on the sample, two
//! distances, and the picture's centre.

use nacre_base::{Error, Result};
use nacre_optics::geometry::{Camera, Geometry, Pose, Uncertainty};

/// Manual measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ruler {
    /// Width and height of the photograph in pixels.
    pub image_px: [usize; 2],
    /// Two positions in pixels.
    pub places_px: [[f64; 2]; 2],
    /// Their distance on the sample in mm.
    pub apart_mm: f64,
    /// Distance in mm from the sample to the camera, which looks straight down.
    pub camera_mm: f64,
    /// Distance from the sample to the light in mm.
    pub light_mm: f64,
    /// Position of the light's highlight in pixels.
    pub highlight_px: [f64; 2],
}

/// Geometry of a camera without distortion above the centre of its picture. Periods are relative: an error of a
/// distance or length scales all of them by approximately the same factor.
///
/// # Errors
/// `Input`, naming the invalid number.
pub fn relative(ruler: &Ruler) -> Result<Geometry> {
    let bad = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
    for (what, mm) in
        [("known length", ruler.apart_mm), ("camera distance", ruler.camera_mm), ("light distance", ruler.light_mm)]
    {
        if !(0.1..=1e5).contains(&mm) {
            return bad(what, format!("is {mm}"), "give 0.1 to 100000 mm");
        }
    }
    let [width, height] = ruler.image_px.map(|n| n as f64);
    for [x, y] in ruler.places_px.into_iter().chain([ruler.highlight_px]) {
        if !((-1.0..=width).contains(&x) && (-1.0..=height).contains(&y)) {
            return bad("place", format!("{x}, {y} is outside of the photograph"), "give pixels from its upper left");
        }
    }
    let [a, b] = ruler.places_px;
    let apart_px = (a[0] - b[0]).hypot(a[1] - b[1]);
    if apart_px < 10.0 {
        return bad("known length", format!("is {apart_px:.1} pixels"), "choose places that are far apart");
    }
    let focal = ruler.camera_mm * apart_px / ruler.apart_mm;
    let center = [0.5 * (width - 1.0), 0.5 * (height - 1.0)];
    let camera = Camera { focal_px: [focal; 2], center_px: center, distortion: [0.0; 5] };
    let down = Pose {
        rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation_mm: [0.0, 0.0, ruler.camera_mm],
    };
    let mut geometry = Geometry::new(camera, down);
    // The highlight divides the line from camera to light in the ratio of their heights.
    let share = (ruler.camera_mm + ruler.light_mm) / ruler.camera_mm;
    let mm = ruler.apart_mm / apart_px;
    let place = [(ruler.highlight_px[0] - center[0]) * mm, (center[1] - ruler.highlight_px[1]) * mm];
    geometry.light_mm = Some([share * place[0], share * place[1], ruler.light_mm]);
    geometry.image_px = Some(ruler.image_px.map(|n| n as u32));
    geometry.relative = true;
    geometry.sigma = Uncertainty::default();
    geometry.check()?;
    Ok(geometry)
}
