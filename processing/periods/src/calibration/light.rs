//! Position of the light from its highlights in mirrors.

use super::fit::nudged;
use super::sample::Placed;
use nacre_base::{Error, Result};
use nacre_optics::geometry::{Camera, Pose};
use nalgebra::{Matrix2x3, Matrix3, Vector3, Vector6};

/// Maximum number of iterations, and step in mm at which they stop.
const ROUNDS: usize = 50;
const STILL: f64 = 1e-9;

/// Maximum relative standard deviation of the light's distance.
const VAGUE: f64 = 0.25;

/// A highlight in a flat mirror.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Highlight {
    /// Position in pixels.
    pub pixel: [f64; 2],
    /// Height of the mirror above the sample's origin, in mm.
    pub height_mm: f64,
    /// Rotation of the mirror about x and about y of the sample, in degrees.
    pub tilt_deg: [f64; 2],
}

/// Further measurements of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// Standard deviation of a highlight in px.
    pub sigma_px: f64,
    /// Height of the light above the sample and its standard deviation, in mm.
    pub height_mm: Option<[f64; 2]>,
}

/// Position of the light in sample coordinates, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedLight {
    /// Position in mm.
    pub mm: [f64; 3],
    /// Standard deviations in mm, from the highlights and the sample's pose.
    pub sigma_mm: [f64; 3],
    /// Reduced χ², expected to be 1; `None` without degrees of freedom.
    pub chi2: Option<f64>,
}

impl Highlight {
    /// A point of the mirror, and its normal.
    fn plane(&self) -> (Vector3<f64>, Vector3<f64>) {
        let [x, y] = self.tilt_deg.map(f64::to_radians);
        let normal = Vector3::from(Pose::from_rotation_vector([x, 0.0, 0.0], [0.0; 3]).turn([0.0, 0.0, 1.0]));
        let normal = Vector3::from(Pose::from_rotation_vector([0.0, y, 0.0], [0.0; 3]).turn(normal.into()));
        (Vector3::new(0.0, 0.0, self.height_mm), normal)
    }

    /// Pixel of a light's mirror image.
    fn seen(&self, camera: &Camera, sample: &Pose, light: Vector3<f64>) -> Option<[f64; 2]> {
        let (point, normal) = self.plane();
        let height = (light - point).dot(&normal);
        let image = light - 2.0 * height * normal;
        (height > 0.0).then(|| camera.project(sample.apply(image.into())))?
    }

    /// Reflected ray: point on the mirror, and direction towards the light.
    fn ray(&self, camera: &Camera, sample: &Pose) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let back = sample.inverse();
        let (from, along) = (Vector3::from(back.translation_mm), Vector3::from(back.turn(camera.ray(self.pixel)?)));
        let (point, normal) = self.plane();
        let steps = (point - from).dot(&normal) / along.dot(&normal);
        let reflected = along - 2.0 * along.dot(&normal) * normal;
        (steps > 0.0 && reflected.z > 1e-3).then_some((from + steps * along, reflected))
    }
}

/// Least-squares position of the light from its mirror images. One highlight determines a ray. A second one in another
/// mirror, or the light's height, determines the position along it.
///
/// # Errors
/// `Input` for highlights inconsistent with any light, and for an undetermined distance.
pub fn from_highlights(camera: &Camera, sample: &Placed, all: &[Highlight], known: &Known) -> Result<PlacedLight> {
    check(all, known)?;
    let mm = solve(camera, &sample.pose, all, known)?;
    let (normal, squares) = misfit(camera, &sample.pose, all, known, mm)?;
    let vague = || {
        let remedy = "use mirrors whose heights or tilts differ more, or say --light-height-mm H,SIGMA";
        Error::input("highlights", "do not tell how far away the light is", remedy)
    };
    let freedom = 2 * all.len() + usize::from(known.height_mm.is_some()) - 3;
    let chi2 = (freedom > 0).then(|| squares / freedom as f64);
    let own = normal.0.try_inverse().ok_or_else(vague)? * chi2.unwrap_or(1.0).max(1.0);
    let mut sigma: [f64; 3] = std::array::from_fn(|k| own[(k, k)]);
    for k in 0..6 {
        let mut by = Vector6::zeros();
        by[k] = sample.sigma[k];
        // In the sample's own coordinates, which move with it.
        let moved = solve(camera, &nudged(&sample.pose, &by), all, known)?;
        (0..3).for_each(|axis| sigma[axis] += (moved[axis] - mm[axis]).powi(2));
    }
    let sigma = sigma.map(f64::sqrt);
    let distance = mm.norm();
    if !(sigma.iter().all(|s| *s < VAGUE * distance)) {
        return Err(vague());
    }
    Ok(PlacedLight { mm: mm.into(), sigma_mm: sigma, chi2 })
}

fn check(all: &[Highlight], known: &Known) -> Result<()> {
    let bad = |problem: String, remedy: &str| Err(Error::input("highlights", problem, remedy));
    if all.is_empty() || all.len() == 1 && known.height_mm.is_none() {
        return bad("are fewer than two".into(), "give another in a mirror at another height, or --light-height-mm");
    }
    if all.len() > 1000 {
        return bad(format!("are {}", all.len()), "give at most 1000");
    }
    for h in all {
        if !(h.pixel.iter().all(|p| p.abs() < 1e6)
            && h.height_mm.abs() <= 1e5
            && h.tilt_deg.iter().all(|t| t.abs() <= 60.0))
        {
            return bad(format!("{h:?} makes no sense"), "give X,Y in pixels, Z in mm, tilts within ±60°");
        }
    }
    if !(1e-3..=1e3).contains(&known.sigma_px) {
        return bad(format!("are off by {} px", known.sigma_px), "give 0.001 to 1000 px");
    }
    match known.height_mm {
        Some([h, s]) if !(h > 0.0 && h <= 1e6 && s > 0.0 && s <= 1e5) => {
            bad(format!("go with a height of {h} ± {s} mm"), "give numbers above 0")
        }
        _ => Ok(()),
    }
}

/// Weighted normal equations: matrix and right-hand side.
struct Normal(Matrix3<f64>, Vector3<f64>);

fn solve(camera: &Camera, sample: &Pose, all: &[Highlight], known: &Known) -> Result<Vector3<f64>> {
    let mut at = begin(camera, sample, all, known)?;
    for _ in 0..ROUNDS {
        let (Normal(matrix, right), squares) = misfit(camera, sample, all, known, at)?;
        let Some(mut step) = matrix.try_inverse().map(|m| m * right) else { break };
        // A step that increases the residual is shortened.
        let better =
            |to: Vector3<f64>| misfit(camera, sample, all, known, to).is_ok_and(|(_, s)| s <= squares * (1.0 + 1e-12));
        while step.norm() > STILL && !better(at + step) {
            step *= 0.5;
        }
        at += step;
        if step.norm() <= STILL {
            break;
        }
    }
    Ok(at)
}

/// Start: the point nearest to all rays, or on the first ray at the known height.
fn begin(camera: &Camera, sample: &Pose, all: &[Highlight], known: &Known) -> Result<Vector3<f64>> {
    let bad = |h: &Highlight| {
        let remedy = "check its pixel, and the mirror's height and tilt";
        Error::input("highlights", format!("there is no light that is seen at {}, {}", h.pixel[0], h.pixel[1]), remedy)
    };
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for h in all {
        let (from, along) = h.ray(camera, sample).ok_or_else(|| bad(h))?;
        if let Some([height, _]) = known.height_mm {
            return Ok(from + along * ((height - from.z) / along.z));
        }
        let across = Matrix3::identity() - along * along.transpose();
        matrix += across;
        right += across * from;
    }
    let at = matrix.try_inverse().map(|m| m * right).filter(|at| at.z > 0.0 && at.norm() < 1e6);
    at.ok_or_else(|| {
        let remedy = "use mirrors whose heights or tilts differ more, or say --light-height-mm H,SIGMA";
        Error::input("highlights", "do not tell how far away the light is", remedy)
    })
}

/// Normal equations and χ² at a position.
fn misfit(camera: &Camera, sample: &Pose, all: &[Highlight], known: &Known, at: Vector3<f64>) -> Result<(Normal, f64)> {
    let gone = || Error::input("highlights", "are not those of one light", "check pixels, heights and tilts");
    let (mut matrix, mut right, mut squares) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
    let mut add = |row: Vector3<f64>, off: f64| {
        matrix += row * row.transpose();
        right += row * off;
        squares += off * off;
    };
    let step = 1e-4 * at.norm().max(1.0);
    for h in all {
        let here = h.seen(camera, sample, at).ok_or_else(gone)?;
        let mut slope = Matrix2x3::zeros();
        for k in 0..3 {
            let by = Vector3::ith(k, step);
            let [more, less] = [at + by, at - by].map(|p| h.seen(camera, sample, p));
            let (more, less) = (more.ok_or_else(gone)?, less.ok_or_else(gone)?);
            (0..2).for_each(|c| slope[(c, k)] = (more[c] - less[c]) / (2.0 * step));
        }
        for (c, here) in here.iter().enumerate() {
            add(slope.row(c).transpose() / known.sigma_px, (h.pixel[c] - here) / known.sigma_px);
        }
    }
    if let Some([height, sigma]) = known.height_mm {
        add(Vector3::z() / sigma, (height - at.z) / sigma);
    }
    Ok((Normal(matrix, right), squares))
}
