//! A corner to a fraction of a pixel.

use nacre_image::Gray;
use nalgebra::{Matrix2, Vector2};

/// Half the window's side: of the distance to the next corner, and at most so many pixels.
const SHARE: f64 = 0.35;
const WIDEST: f64 = 14.0;
const NARROWEST: f64 = 2.0;

/// Rounds at most, and when to stop, in pixels.
const ROUNDS: usize = 30;
const STILL: f64 = 1e-4;

/// Moves a corner to where all edges around it point; none if that is far off.
///
/// On an edge through the corner q the gradient g at p is perpendicular to p - q: `Σ w g gᵀ q = Σ w g gᵀ p` (Förstner and Gülch
/// 1987), with gradients of the pixels about q, again until q rests.
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
        // Singular but for rounding: edges in one direction only.
        // False for NaN.
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
