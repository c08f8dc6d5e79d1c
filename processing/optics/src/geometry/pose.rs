//! Rigid transforms.

use nacre_base::{Error, Result};
use nalgebra::{Matrix3, Rotation3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Tolerance of the orthogonality of rotations that are read from files.
const CROOKED: f64 = 1e-6;

/// Rigid transform `q = R p + t`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Rotation matrix R, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Translation t in mm.
    pub translation_mm: [f64; 3],
}

impl Pose {
    /// Identity transform.
    pub const IDENTITY: Self =
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation_mm: [0.0; 3] };

    /// Creates a transform from a rotation vector (axis times angle in rad, Rodrigues) and a translation in mm.
    pub fn from_rotation_vector(vector: [f64; 3], translation_mm: [f64; 3]) -> Self {
        Self::of(*Rotation3::from_scaled_axis(Vector3::from(vector)).matrix(), translation_mm)
    }

    /// Rotation vector: axis times angle in rad (at most π).
    pub fn rotation_vector(&self) -> [f64; 3] {
        // The matrix is a rotation within rounding.
        let matrix = Rotation3::from_matrix_unchecked(self.matrix());
        let quaternion = nalgebra::UnitQuaternion::from_rotation_matrix(&matrix);
        quaternion.scaled_axis().into()
    }

    /// Transforms a point.
    pub fn apply(&self, place: [f64; 3]) -> [f64; 3] {
        let turned = self.turn(place);
        [0, 1, 2].map(|k| turned[k] + self.translation_mm[k])
    }

    /// Rotates a direction.
    pub fn turn(&self, direction: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|row| row[0] * direction[0] + row[1] * direction[1] + row[2] * direction[2])
    }

    /// Inverse transform.
    pub fn inverse(&self) -> Self {
        let back = self.matrix().transpose();
        Self::of(back, (-(back * Vector3::from(self.translation_mm))).into())
    }

    /// Composition: this transform, followed by `next`.
    pub fn then(&self, next: &Self) -> Self {
        Self::of(next.matrix() * self.matrix(), next.apply(self.translation_mm))
    }

    /// Checks that this is a rigid transform with a translation of at most 1 km.
    ///
    /// # Errors
    /// `Input`, naming `what`.
    pub fn check(&self, what: &str) -> Result<()> {
        let matrix = self.matrix();
        let crooked = (matrix * matrix.transpose() - Matrix3::identity()).amax();
        // Written so that NaN is refused as well.
        if !(crooked < CROOKED && matrix.determinant() > 0.0) {
            let remedy = "give three perpendicular rows of length 1, right-handed";
            return Err(Error::input(format!("{what}.rotation"), "is no rotation", remedy));
        }
        if !self.translation_mm.iter().all(|t| t.abs() <= 1e6) {
            let problem = format!("is {:?}", self.translation_mm);
            return Err(Error::input(format!("{what}.translation_mm"), problem, "give at most 1000000 mm"));
        }
        Ok(())
    }

    /// Creates a transform from a rotation matrix and a translation in mm.
    pub fn of(matrix: Matrix3<f64>, translation_mm: [f64; 3]) -> Self {
        Self { rotation: [0, 1, 2].map(|r| [0, 1, 2].map(|c| matrix[(r, c)])), translation_mm }
    }

    /// Rotation as a matrix.
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|r, c| self.rotation[r][c])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn near(a: [f64; 3], b: [f64; 3]) {
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-12), "{a:?} {b:?}");
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let pose = Pose::from_rotation_vector([0.0, 0.0, FRAC_PI_2], [10.0, 20.0, 30.0]);
        near(pose.apply([1.0, 0.0, 0.0]), [10.0, 21.0, 30.0]);
        near(pose.turn([0.0, 1.0, 0.0]), [-1.0, 0.0, 0.0]);
        near(pose.inverse().apply(pose.apply([3.0, 4.0, 5.0])), [3.0, 4.0, 5.0]);
    }

    #[test]
    fn one_after_the_other_is_in_that_order() {
        let turn = Pose::from_rotation_vector([0.0, 0.0, FRAC_PI_2], [0.0; 3]);
        let shift = Pose { translation_mm: [1.0, 0.0, 0.0], ..Pose::IDENTITY };
        near(turn.then(&shift).apply([1.0, 0.0, 0.0]), [1.0, 1.0, 0.0]);
        near(shift.then(&turn).apply([1.0, 0.0, 0.0]), [0.0, 2.0, 0.0]);
    }

    #[test]
    fn vectors_come_back_from_rotations() {
        for vector in [[0.0; 3], [1e-9, 0.0, 0.0], [0.3, -0.5, 1.2], [PI - 1e-7, 0.0, 0.0], [0.0, 2.0, -2.4]] {
            let pose = Pose::from_rotation_vector(vector, [0.0; 3]);
            let again = Pose::from_rotation_vector(pose.rotation_vector(), [0.0; 3]);
            (0..3).for_each(|k| near(pose.rotation[k], again.rotation[k]));
            near(pose.rotation_vector(), vector);
        }
        // A rotation by π has two rotation vectors.
        let flip = Pose { rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]], ..Pose::IDENTITY };
        near(flip.rotation_vector().map(f64::abs), [PI, 0.0, 0.0]);
    }

    #[test]
    fn what_is_no_motion_is_refused() {
        let mirror = Pose { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], ..Pose::IDENTITY };
        let stretched = Pose { rotation: [[1.1, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], ..Pose::IDENTITY };
        let lost = Pose { translation_mm: [0.0, f64::NAN, 0.0], ..Pose::IDENTITY };
        for (pose, words) in [(mirror, "rotation"), (stretched, "rotation"), (lost, "translation_mm")] {
            let text = pose.check("sample").unwrap_err().to_string();
            assert!(text.starts_with(&format!("sample.{words}")), "{text}");
        }
        Pose::IDENTITY.check("sample").unwrap();
    }
}
