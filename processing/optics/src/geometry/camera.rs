//! Pinhole camera with lens distortion by OpenCV's five coefficients.

use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Limit of Newton steps from a pixel to its direction. Convergence is quadratic.
const STEPS: usize = 20;

/// Tolerance of the inversion in units of the focal length: 1e-9 px for a focal length of 1000 px.
const FOUND: f64 = 1e-12;

/// Camera model: projects directions onto the sensor.
///
/// Camera coordinates: x right, y down, z forward, origin at the entrance pupil. Pixel centres are at integers, row 0
/// on top. The distortion is Brown's (1966) with OpenCV's order of coefficients. With `x = X/Z`, `y = Y/Z`,
/// `s = x² + y²`: `x' = x (1 + k1 s + k2 s² + k3 s³) + 2 p1 x y + p2 (s + 2x²)`,
/// `y' = y (…) + p1 (s + 2y²) + 2 p2 x y`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Focal length in pixels, horizontally and vertically (1 to 10⁷).
    pub focal_px: [f64; 2],
    /// Principal point in pixels from the left and from the top (at most 10⁶).
    pub center_px: [f64; 2],
    /// Distortion coefficients k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

impl Camera {
    /// Checks that all parameters are finite and within their ranges.
    ///
    /// # Errors
    /// `Input`, naming the parameter.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
        if !self.focal_px.iter().all(|f| (1.0..=1e7).contains(f)) {
            return bad("focal_px", format!("is {:?}", self.focal_px), "give 1 to 10000000 px twice");
        }
        if !self.center_px.iter().all(|c| c.abs() <= 1e6) {
            return bad("center_px", format!("is {:?}", self.center_px), "give a place near the image, in px");
        }
        if !self.distortion.iter().all(|k| k.abs() <= 1e6) {
            return bad("distortion", format!("is {:?}", self.distortion), "give k1, k2, p1, p2, k3 within ±1000000");
        }
        Ok(())
    }

    /// Projects a point in camera coordinates to a pixel. `None` behind the camera, or beyond the angle at which the
    /// distortion model folds back.
    pub fn project(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        if z <= 0.0 || !z.is_finite() {
            return None;
        }
        let at = [x / z, y / z];
        self.unfolded(at).then(|| {
            let [x, y] = self.bend(at).0;
            [self.center_px[0] + self.focal_px[0] * x, self.center_px[1] + self.focal_px[1] * y]
        })
    }

    /// Unit direction of a pixel's ray in camera coordinates; `None` where the distortion model has no inverse.
    pub fn ray(&self, pixel: [f64; 2]) -> Option<[f64; 3]> {
        let seen = [0, 1].map(|k| (pixel[k] - self.center_px[k]) / self.focal_px[k]);
        let mut at = seen;
        for _ in 0..STEPS {
            let (found, [[xx, xy], [yx, yy]]) = self.bend(at);
            let (dx, dy) = (seen[0] - found[0], seen[1] - found[1]);
            if dx.hypot(dy) <= FOUND {
                break;
            }
            let determinant = xx * yy - xy * yx;
            at[0] += (yy * dx - xy * dy) / determinant;
            at[1] += (xx * dy - yx * dx) / determinant;
        }
        let found = self.bend(at).0;
        // Comparisons with NaN are false.
        let near = (found[0] - seen[0]).hypot(found[1] - seen[1]) <= 1e3 * FOUND * (1.0 + seen[0].hypot(seen[1]));
        if !near || !self.unfolded(at) {
            return None;
        }
        let length = (at[0] * at[0] + at[1] * at[1] + 1.0).sqrt();
        Some([at[0] / length, at[1] / length, 1.0 / length])
    }

    /// Distorted image coordinates of a direction, and their Jacobian `[[xx, xy], [yx, yy]]`.
    pub fn bend(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let s = x * x + y * y;
        let radial = 1.0 + s * (k1 + s * (k2 + s * k3));
        // 2 · d radial / ds, because ds/dx = 2x.
        let slope = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3));
        let place = [
            x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
            y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        let mixed = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let derivative = [
            [radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed],
            [mixed, radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x],
        ];
        (place, derivative)
    }

    /// Whether the distorted radius increases monotonically from the axis out to this direction. Beyond a maximum, two
    /// directions share a pixel.
    fn unfolded(&self, [x, y]: [f64; 2]) -> bool {
        let [k1, k2, _, _, k3] = self.distortion;
        let end = x * x + y * y;
        // Derivative of r (1 + k1 r² + k2 r⁴ + k3 r⁶) by r, as a function of s = r².
        let growth = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
        let (a, b, c) = (21.0 * k3, 10.0 * k2, 3.0 * k1);
        let root = (b * b - 4.0 * a * c).sqrt();
        // Extrema of that cubic. Both forms of the root are used, so that neither suffers from cancellation.
        let extremes = [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a), 2.0 * c / (-b - root), 2.0 * c / (-b + root)];
        end.is_finite()
            && growth(end) > 0.0
            && extremes.iter().filter(|s| **s > 0.0 && **s < end).all(|s| growth(*s) > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn webcam() -> Camera {
        Camera {
            focal_px: [536.1, 536.0],
            center_px: [342.4, 235.5],
            distortion: [-0.265, -0.047, 0.0018, -0.0003, 0.23],
        }
    }

    #[test]
    fn a_pinhole_projects_as_similar_triangles_have_it() {
        let camera = Camera { focal_px: [1000.0, 500.0], center_px: [320.0, 240.0], distortion: [0.0; 5] };
        assert_eq!(camera.project([30.0, -20.0, 100.0]), Some([620.0, 140.0]));
        assert_eq!(camera.project([30.0, -20.0, -100.0]), None);
        let ray = camera.ray([320.0 + 750.0, 240.0]).unwrap();
        assert!((ray[0] - 0.6).abs() < 1e-12 && ray[1].abs() < 1e-12 && (ray[2] - 0.8).abs() < 1e-12);
    }

    #[test]
    fn one_coefficient_at_a_time_moves_a_place_as_the_model_has_it() {
        // At (0.3, 0.4): s = 0.25.
        let expected: [[f64; 2]; 5] =
            [[0.075, 0.1], [0.01875, 0.025], [0.24, 0.25 + 0.32], [0.25 + 0.18, 0.24], [0.0046875, 0.00625]];
        for (k, expected) in expected.into_iter().enumerate() {
            let mut camera = Camera { focal_px: [1.0; 2], center_px: [0.0; 2], distortion: [0.0; 5] };
            camera.distortion[k] = 1e-3;
            let got = camera.project([0.3, 0.4, 1.0]).unwrap();
            assert!((got[0] - 0.3 - 1e-3 * expected[0]).abs() < 1e-15, "{k}: {got:?}");
            assert!((got[1] - 0.4 - 1e-3 * expected[1]).abs() < 1e-15, "{k}: {got:?}");
        }
    }

    #[test]
    fn the_derivative_is_that_of_the_bent_place() {
        let (camera, at, step) = (webcam(), [0.31, -0.22], 1e-6);
        let (_, derivative) = camera.bend(at);
        for k in 0..2 {
            let mut ends = [at, at];
            ends[0][k] += step;
            ends[1][k] -= step;
            let [more, less] = ends.map(|end| camera.bend(end).0);
            for row in 0..2 {
                assert!(((more[row] - less[row]) / (2.0 * step) - derivative[row][k]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn rays_lead_back_to_their_pixels() {
        let camera = webcam();
        for x in (-40..=680).step_by(60) {
            for y in (-40..=520).step_by(40) {
                let pixel = [f64::from(x), f64::from(y)];
                let [a, b, c] = camera.ray(pixel).unwrap();
                assert!((a * a + b * b + c * c - 1.0).abs() < 1e-12);
                let back = camera.project([7.0 * a, 7.0 * b, 7.0 * c]).unwrap();
                assert!((back[0] - pixel[0]).hypot(back[1] - pixel[1]) < 1e-8, "{pixel:?} {back:?}");
            }
        }
    }

    #[test]
    fn where_the_lens_folds_back_nothing_is_seen() {
        // r (1 - 0.3 r²) has its maximum 0.703 at r = 1.054.
        let camera = Camera { focal_px: [100.0; 2], center_px: [0.0; 2], distortion: [-0.3, 0.0, 0.0, 0.0, 0.0] };
        assert!(camera.project([1.05, 0.0, 1.0]).is_some());
        assert_eq!(camera.project([1.06, 0.0, 1.0]), None);
        assert_eq!(camera.project([5.0, 0.0, 1.0]), None);
        assert!(camera.ray([70.2, 0.0]).is_some());
        assert_eq!(camera.ray([70.4, 0.0]), None);
        assert_eq!(camera.ray([f64::NAN, 0.0]), None);
        // Decreases between 0.72 and 1.13 and increases again beyond.
        let camera = Camera { distortion: [-0.9, 0.3, 0.0, 0.0, 0.0], ..camera };
        assert!(camera.project([0.7, 0.0, 1.0]).is_some());
        assert_eq!(camera.project([2.5, 0.0, 1.0]), None);
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        for (camera, name) in [
            (Camera { focal_px: [0.0, 1.0], ..webcam() }, "focal_px"),
            (Camera { center_px: [f64::NAN, 1.0], ..webcam() }, "center_px"),
            (Camera { distortion: [f64::INFINITY; 5], ..webcam() }, "distortion"),
        ] {
            assert!(camera.check().unwrap_err().to_string().contains(name));
        }
        webcam().check().unwrap();
    }
}
