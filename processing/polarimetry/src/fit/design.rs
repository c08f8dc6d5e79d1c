//! Design matrix of a set of analyser angles, shared by all pixels.

use nacre_base::{Error, Result};
use nalgebra::{Matrix3, Vector3};

/// Largest difference modulo 180° of angles that count as equal, in degrees.
const SAME_ANGLE_DEG: f64 = 0.05;

/// Largest accepted condition number of the N×3 design matrix `[1, cos 2ψ, sin 2ψ]`. Equidistant angles have √2; at 100
/// the noise of the result is about 50 times that of a good set.
pub(crate) const MAX_CONDITION: f64 = 100.0;

/// The least-squares problem `I(ψ) = A + C cos 2ψ + S sin 2ψ` for a given set of angles.
#[derive(Clone, Debug)]
pub struct Design {
    /// `[1, cos 2ψ, sin 2ψ]` per frame.
    pub rows: Vec<Vector3<f64>>,
    /// Inverse of the normal matrix `Σ x xᵀ`.
    pub inverse: Matrix3<f64>,
    /// Condition number of the design matrix (√2 is optimal).
    pub condition: f64,
}

impl Design {
    /// Constructs the design for analyser angles in radians, one per frame.
    ///
    /// # Errors
    /// If angles are not finite, if fewer than three are distinct modulo 180°, or if they lie so close together that
    /// the condition number exceeds 100. The message lists the angles.
    pub fn new(angles: &[f64]) -> Result<Self> {
        if let Some(bad) = angles.iter().find(|a| !a.is_finite()) {
            return Err(Error::input("analyser angles", format!("{bad} is not an angle"), "give finite degrees"));
        }
        let distinct = distinct_mod_180(angles);
        if distinct < 3 {
            let problem = format!(
                "{distinct} distinct modulo 180° in [{}], but a polarization fit needs at least 3",
                list(angles)
            );
            return Err(Error::input("analyser angles", problem, "add frames at other angles, best evenly over 180°"));
        }
        let rows: Vec<_> = angles.iter().map(|psi| Vector3::new(1.0, (2.0 * psi).cos(), (2.0 * psi).sin())).collect();
        let normal: Matrix3<f64> = rows.iter().map(|x| x * x.transpose()).sum();
        let eigenvalues = normal.symmetric_eigenvalues();
        let condition = (eigenvalues.max() / eigenvalues.min().max(f64::MIN_POSITIVE)).sqrt();
        match normal.try_inverse() {
            Some(inverse) if condition <= MAX_CONDITION => Ok(Self { rows, inverse, condition }),
            _ => Err(Error::input(
                "analyser angles",
                format!(
                    "[{}] lie too close together (condition number {condition:.0}, at most {MAX_CONDITION})",
                    list(angles)
                ),
                "spread the angles over 180°",
            )),
        }
    }

    /// The design of an analyser with a contrast below 1, `[1, K cos 2ψ, K sin 2ψ]`.
    pub(crate) fn with_contrast(mut self, contrast: f64) -> Self {
        let scale = Vector3::new(1.0, contrast, contrast);
        self.rows.iter_mut().for_each(|row| *row = row.component_mul(&scale));
        let inverse = Matrix3::from_diagonal(&scale.map(|s| 1.0 / s));
        self.inverse = inverse * self.inverse * inverse;
        self
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.rows.len()
    }

    /// Degrees of freedom of the residual.
    pub fn freedom(&self) -> usize {
        self.rows.len() - 3
    }
}

fn list(angles: &[f64]) -> String {
    const SHOWN: usize = 24;
    let mut text: Vec<String> =
        angles.iter().take(SHOWN).map(|a| format!("{}°", (a.to_degrees() * 1e3).round() / 1e3)).collect();
    if angles.len() > SHOWN {
        text.push(format!("… {} in all", angles.len()));
    }
    text.join(", ")
}

fn distinct_mod_180(angles: &[f64]) -> usize {
    let mut folded: Vec<f64> = angles.iter().map(|a| a.to_degrees().rem_euclid(180.0)).collect();
    folded.sort_by(f64::total_cmp);
    folded.dedup_by(|b, a| (*b - *a).abs() < SAME_ANGLE_DEG);
    match (folded.first(), folded.last()) {
        (Some(first), Some(last)) if folded.len() > 1 && first + 180.0 - last < SAME_ANGLE_DEG => folded.len() - 1,
        _ => folded.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn degrees(angles: &[f64]) -> Result<Design> {
        Design::new(&angles.iter().map(|a| a.to_radians()).collect::<Vec<_>>())
    }

    #[test]
    fn contrast_scales_the_inverse_like_the_rows() {
        let design = degrees(&[0.0, 30.0, 70.0, 110.0, 160.0]).unwrap().with_contrast(0.8);
        let normal: Matrix3<f64> = design.rows.iter().map(|x| x * x.transpose()).sum();
        assert!((normal * design.inverse - Matrix3::identity()).norm() < 1e-12);
    }

    #[test]
    fn even_angles_are_perfectly_conditioned() {
        let d = degrees(&[0.0, 45.0, 90.0, 135.0]).unwrap();
        assert!((d.condition - 2f64.sqrt()).abs() < 1e-9);
        assert_eq!((d.frames(), d.freedom()), (4, 1));
    }

    #[test]
    fn degenerate_sets_are_refused_with_their_angles() {
        for (set, shown) in [
            (vec![], "[]"),
            (vec![10.0], "10°"),
            (vec![10.0, 40.0], "10°, 40°"),
            (vec![10.0, 190.0, 370.0, 55.0], "190°"),
            (vec![179.99, 0.0, 90.0], "179.99°"),
            (vec![0.0, 0.5, 1.0], "0.5°"),
        ] {
            let message = degrees(&set).unwrap_err().to_string();
            assert!(message.contains(shown), "{message}");
        }
        assert!(Design::new(&[0.0, 1.0, f64::NAN]).is_err());
    }
}
