//! Initial camera from homographies (Zhang 2000, section 3.1).

use super::plane::{pose, straightened};
use nacre_image::homography;
use nacre_optics::geometry::{Camera, Pose};
use nalgebra::{DMatrix, Matrix3, Vector6};

/// Camera without distortion from the homographies of at least three poses; `None` if they do not determine it.
pub(super) fn camera(homographies: &[Matrix3<f64>], [width, height]: [usize; 2]) -> Option<Camera> {
    // In units that keep all values near 1.
    let size = width.max(height) as f64;
    let middle = [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
    let unit = Matrix3::new(1.0 / size, 0.0, -middle[0] / size, 0.0, 1.0 / size, -middle[1] / size, 0.0, 0.0, 1.0);
    let scaled: Vec<Matrix3<f64>> = homographies.iter().map(|h| unit * h).map(|h| h / h.norm()).collect();
    let [fx, fy, cx, cy] = free(&scaled).or_else(|| centered(&scaled))?;
    Some(Camera {
        focal_px: [fx * size, fy * size],
        center_px: [middle[0] + cx * size, middle[1] + cy * size],
        distortion: [0.0; 5],
    })
}

/// Row of Zhang's equations: `h_iᵀ B h_j` for the symmetric B = (b11, b12, b22, b13, b23, b33).
fn row(h: &Matrix3<f64>, i: usize, j: usize) -> Vector6<f64> {
    let (a, b) = (h.column(i), h.column(j));
    Vector6::new(
        a[0] * b[0],
        a[0] * b[1] + a[1] * b[0],
        a[1] * b[1],
        a[2] * b[0] + a[0] * b[2],
        a[2] * b[1] + a[1] * b[2],
        a[2] * b[2],
    )
}

/// Focal lengths and principal point, without skew.
fn free(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    let mut rows = DMatrix::zeros(2 * homographies.len(), 5);
    for (k, h) in homographies.iter().enumerate() {
        for (line, all) in [row(h, 0, 1), row(h, 0, 0) - row(h, 1, 1)].iter().enumerate() {
            // Without skew, b12 is 0.
            for (to, from) in [0, 2, 3, 4, 5].into_iter().enumerate() {
                rows[(2 * k + line, to)] = all[from];
            }
        }
    }
    let eigen = (rows.transpose() * &rows).symmetric_eigen();
    let least = (0..5).min_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]))?;
    let b = eigen.eigenvectors.column(least);
    let (b11, b22, b13, b23, b33) = (b[0], b[1], b[2], b[3], b[4]);
    let (cx, cy) = (-b13 / b11, -b23 / b22);
    let scale = b33 + b13 * cx + b23 * cy;
    let (fx, fy) = ((scale / b11).sqrt(), (scale / b22).sqrt());
    let sensible = [fx, fy].iter().all(|f| (0.2..20.0).contains(f)) && cx.abs() < 0.5 && cy.abs() < 0.5;
    (sensible && (0.5..2.0).contains(&(fx / fy))).then_some([fx, fy, cx, cy])
}

/// One focal length, with the principal point in the image centre, for poses that do not determine more.
fn centered(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    // Both equations are linear in 1/f².
    let (mut square, mut product) = (0.0, 0.0);
    for h in homographies {
        for v in [row(h, 0, 1), row(h, 0, 0) - row(h, 1, 1)] {
            square += (v[0] + v[2]).powi(2);
            product -= (v[0] + v[2]) * v[5];
        }
    }
    let f = (square / product).sqrt();
    // Frontal views do not determine the focal length. Any start value serves; the fit then reports a large
    // uncertainty.
    let f = if (0.2..20.0).contains(&f) { f } else { 1.2 };
    Some([f, f, 0.0, 0.0])
}

/// Pose of a board for a given camera.
pub(super) fn board_pose(camera: &Camera, places: &[[f64; 2]], pixels: &[[f64; 2]]) -> Option<Pose> {
    pose(&homography(places, &straightened(camera, pixels)?)?)
}
