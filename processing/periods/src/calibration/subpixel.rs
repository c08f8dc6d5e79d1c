//! Subpixel refinement of a corner.

use nacre_image::Gray;
use nalgebra::{Matrix2, Vector2};

/// Half the window's side: fraction of the distance to the next corner, and upper bound in pixels.
const SHARE: f64 = 0.35;
const WIDEST: f64 = 14.0;
const NARROWEST: f64 = 2.0;

/// Maximum number of iterations, and step in pixels at which they stop.
const ROUNDS: usize = 30;
const STILL: f64 = 1e-4;

/// Moves a corner to the intersection of all edges around it; `None` if that is far away.
///
/// On an edge through the corner q, the gradient g at p is perpendicular to p - q: `Σ w g gᵀ q = Σ w g gᵀ p` (Förstner
/// and Gülch 1987). Iterated with the gradients around the new q until it converges.
pub(super) fn refine(image: &Gray, start: [f64; 2], spacing: f64) -> Option<[f64; 2]> {
    let half = (SHARE * spacing).clamp(NARROWEST, WIDEST);
    let reach = half.ceil() as i64;
    let mut at = start;
    for _ in 0..ROUNDS {
        let middle = at.map(|v| v.round() as i64);
        let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for y in middle[1] - reach..=middle[1] + reach {
            for x in middle[0] - reach..=middle[0] + reach {
                let off = Vector2::new(x as f64 - at[0], y as f64 - at[1]);
                let weight = (-2.0 * off.norm_squared() / (half * half)).exp();
                let g = Vector2::new(
                    f64::from(image.near(x + 1, y) - image.near(x - 1, y)),
                    f64::from(image.near(x, y + 1) - image.near(x, y - 1)),
                );
                let part = weight * g * g.transpose();
                matrix += part;
                right += part * off;
            }
        }
        let step = matrix.try_inverse()? * right;
        // The matrix is nearly singular if all edges are parallel. The comparison is false for NaN.
        let near = step.norm() < 2.0 * half;
        if !near {
            return None;
        }
        at = [at[0] + step[0], at[1] + step[1]];
        let moved = (at[0] - start[0]).hypot(at[1] - start[1]);
        if moved > half + 2.0 {
            return None;
        }
        if step.norm() < STILL {
            break;
        }
    }
    let inside = |v: f64, n: usize| v >= 1.0 && v <= n as f64 - 2.0;
    (inside(at[0], image.width) && inside(at[1], image.height)).then_some(at)
}
