//! Homographies: perspective maps of a plane.

use nalgebra::{DMatrix, Matrix3, Vector3};

/// Homography from points on a plane to points in an image, from four or more pairs; `None` for collinear points.
///
/// Normalised direct linear transformation (Hartley and Zisserman 2004, algorithm 4.2).
pub fn homography(plane: &[[f64; 2]], seen: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    if plane.len() < 4 || plane.len() != seen.len() {
        return None;
    }
    let (from, to) = (evened(plane)?, evened(seen)?);
    let mut rows = DMatrix::zeros(2 * plane.len(), 9);
    for (k, (p, q)) in plane.iter().zip(seen).enumerate() {
        let p = from * Vector3::new(p[0], p[1], 1.0);
        let q = to * Vector3::new(q[0], q[1], 1.0);
        for c in 0..3 {
            rows[(2 * k, c)] = p[c];
            rows[(2 * k, 6 + c)] = -q[0] * p[c];
            rows[(2 * k + 1, 3 + c)] = p[c];
            rows[(2 * k + 1, 6 + c)] = -q[1] * p[c];
        }
    }
    // The null vector of the rows.
    let eigen = (rows.transpose() * &rows).symmetric_eigen();
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let [least, next, most] = [order[0], order[1], order[8]].map(|k| eigen.eigenvalues[k].max(0.0));
    // A second null vector: too many points are collinear.
    if next <= 1e-10 * most || !least.is_finite() {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let h = to.try_inverse()? * h * from;
    let middle = plane.iter().fold([0.0; 2], |m, p| [m[0] + p[0], m[1] + p[1]]).map(|v| v / plane.len() as f64);
    let scale = (h * Vector3::new(middle[0], middle[1], 1.0))[2];
    (scale != 0.0 && scale.is_finite()).then(|| h / scale)
}

/// Similarity that moves the mean to the origin and scales the root mean square distance to √2.
fn evened(points: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean = points.iter().fold([0.0; 2], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
    let square: f64 = points.iter().map(|p| (p[0] - mean[0]).powi(2) + (p[1] - mean[1]).powi(2)).sum();
    let s = (2.0 * n / square).sqrt();
    s.is_finite().then(|| Matrix3::new(s, 0.0, -s * mean[0], 0.0, s, -s * mean[1], 0.0, 0.0, 1.0))
}

/// Image of a point under a homography.
pub fn mapped(h: &Matrix3<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    let v = h * Vector3::new(x, y, 1.0);
    [v[0] / v[2], v[1] / v[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_homography_is_that_of_its_pairs() {
        let truth = Matrix3::new(1.2, 0.1, 320.0, -0.05, 1.1, 240.0, 2e-4, -3e-4, 1.0);
        let plane: Vec<[f64; 2]> =
            (0..12).map(|k| [30.0 * f64::from(k % 4) - 45.0, 30.0 * f64::from(k / 4) - 30.0]).collect();
        let seen: Vec<[f64; 2]> = plane.iter().map(|p| mapped(&truth, *p)).collect();
        let found = homography(&plane, &seen).unwrap();
        for p in [[0.0, 0.0], [77.0, -31.0], [-120.0, 90.0]] {
            let (a, b) = (mapped(&truth, p), mapped(&found, p));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-7, "{a:?} {b:?}");
        }
        let line: Vec<[f64; 2]> = (0..6).map(|k| [f64::from(k), 2.0 * f64::from(k)]).collect();
        assert!(homography(&line, &line).is_none());
        assert!(homography(&plane[..3], &seen[..3]).is_none());
    }
}
