//! Bundle adjustment of camera and poses (Levenberg-Marquardt), with covariances.

use nacre_base::least_squares::{Damping, Problem, Step, levenberg_marquardt};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_optics::geometry::{Camera, Pose};
use nalgebra::{Cholesky, Matrix2x3, Matrix3, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector6};
use rayon::prelude::*;

/// Number of camera parameters: two focal lengths, principal point, five of the lens.
pub(super) const CAMERA: usize = 9;

type Normal = SMatrix<f64, CAMERA, CAMERA>;
type Gradient = SVector<f64, CAMERA>;
type Mixed = SMatrix<f64, CAMERA, 6>;

/// Maximum number of iterations; ten are typical.
const STEPS: usize = 200;

/// One photograph of the board.
#[derive(Clone, Debug)]
pub(super) struct Observation {
    /// Corners in pixels.
    pub pixels: Vec<[f64; 2]>,
    /// From board to camera coordinates.
    pub pose: Pose,
}

/// Result of the adjustment.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub camera: Camera,
    pub poses: Vec<Pose>,
    /// Root mean square reprojection error in pixels: of all photographs, and of each.
    pub rms_px: f64,
    pub each_px: Vec<f64>,
    /// Covariance of fx, fy, cx, cy, k1, k2, p1, p2, k3.
    pub covariance: Normal,
    /// Standard deviations of each pose: rotation about the camera's axes in rad, translation in mm.
    pub pose_sigma: Vec<[f64; 6]>,
}

/// Residual of a corner (observed - model), and its derivatives with respect to camera and pose.
struct Row {
    off: Vector2<f64>,
    camera: SMatrix<f64, 2, CAMERA>,
    pose: SMatrix<f64, 2, 6>,
}

/// Normal equations of one photograph.
#[derive(Clone)]
struct Sums {
    squares: f64,
    camera: Normal,
    mixed: Mixed,
    pose: Matrix6<f64>,
    camera_right: Gradient,
    pose_right: Vector6<f64>,
}

/// Levenberg-Marquardt damping.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.1, least: 1e-12, up: 10.0, most: 1e12 };

/// Relative decrease of the sum of squares, and of its prediction, below which the fit has converged.
const CONVERGED: f64 = 1e-12;
const LEAST_GAIN: f64 = 1e-14;

/// Adjusts camera and poses.
///
/// # Errors
/// `Input` if the photographs do not determine the camera; `Cancelled`.
pub(super) fn fit(
    camera: Camera,
    observations: &[Observation],
    places: &[[f64; 2]],
    progress: &dyn Progress,
) -> Result<Fit> {
    let boards = Boards { observations, places, progress };
    let start = boards.at(camera, observations.iter().map(|s| s.pose).collect());
    let Found { camera, poses, sums } = levenberg_marquardt(&boards, start, DAMPING, STEPS)?;
    finished(camera, poses, &sums, places.len())
}

/// Photographs of the board, and its corners in board coordinates.
struct Boards<'a> {
    observations: &'a [Observation],
    places: &'a [[f64; 2]],
    progress: &'a dyn Progress,
}

/// Camera and poses, with the normal equations of each photograph.
struct Found {
    camera: Camera,
    poses: Vec<Pose>,
    sums: Vec<Option<Sums>>,
}

impl Boards<'_> {
    fn at(&self, camera: Camera, poses: Vec<Pose>) -> Found {
        let of =
            |(pose, observations): (&Pose, &Observation)| Sums::of(&camera, pose, &observations.pixels, self.places);
        let sums = poses.par_iter().zip(self.observations).map(of).collect();
        Found { camera, poses, sums }
    }
}

impl Problem for Boards<'_> {
    type State = Found;
    type Error = Error;

    /// Sum of squares; infinite if a corner is not visible.
    fn cost(&self, found: &Found) -> f64 {
        found.sums.iter().map(|s| s.as_ref().map_or(f64::INFINITY, |s| s.squares)).sum()
    }

    fn step(&self, from: &Found, damping: f64) -> Result<Step<Found>> {
        self.progress.check()?;
        let Some((camera, poses, gain)) = step(&from.camera, &from.poses, &from.sums, damping) else {
            return Ok(Step::Singular);
        };
        if gain < LEAST_GAIN * self.cost(from) {
            return Ok(Step::End);
        }
        Ok(Step::Trial(self.at(camera, poses)))
    }

    fn accept(&self, from: &Found, to: &mut Found) -> bool {
        let cost = self.cost(from);
        cost - self.cost(to) < CONVERGED * cost.max(f64::MIN_POSITIVE)
    }
}

impl Sums {
    fn of(camera: &Camera, pose: &Pose, pixels: &[[f64; 2]], places: &[[f64; 2]]) -> Option<Self> {
        let mut sums = Self {
            squares: 0.0,
            camera: Normal::zeros(),
            mixed: Mixed::zeros(),
            pose: Matrix6::zeros(),
            camera_right: Gradient::zeros(),
            pose_right: Vector6::zeros(),
        };
        for (pixel, place) in pixels.iter().zip(places) {
            let row = row(camera, pose, *place, *pixel)?;
            sums.squares += row.off.norm_squared();
            sums.camera += row.camera.transpose() * row.camera;
            sums.mixed += row.camera.transpose() * row.pose;
            sums.pose += row.pose.transpose() * row.pose;
            sums.camera_right += row.camera.transpose() * row.off;
            sums.pose_right += row.pose.transpose() * row.off;
        }
        Some(sums)
    }
}

fn row(camera: &Camera, pose: &Pose, [x, y]: [f64; 2], pixel: [f64; 2]) -> Option<Row> {
    let turned = Vector3::from(pose.turn([x, y, 0.0]));
    let p = turned + Vector3::from(pose.translation_mm);
    if p.z <= 1e-6 {
        return None;
    }
    let at = [p.x / p.z, p.y / p.z];
    let (bent, [[xx, xy], [yx, yy]]) = camera.bend(at);
    let [fx, fy] = camera.focal_px;
    let off =
        Vector2::new(pixel[0] - camera.center_px[0] - fx * bent[0], pixel[1] - camera.center_px[1] - fy * bent[1]);
    let s = at[0] * at[0] + at[1] * at[1];
    let [u, v] = at;
    let camera_part = SMatrix::<f64, 2, CAMERA>::from_columns(&[
        Vector2::new(bent[0], 0.0),
        Vector2::new(0.0, bent[1]),
        Vector2::new(1.0, 0.0),
        Vector2::new(0.0, 1.0),
        Vector2::new(fx * u * s, fy * v * s),
        Vector2::new(fx * u * s * s, fy * v * s * s),
        Vector2::new(fx * 2.0 * u * v, fy * (s + 2.0 * v * v)),
        Vector2::new(fx * (s + 2.0 * u * u), fy * 2.0 * u * v),
        Vector2::new(fx * u * s * s * s, fy * v * s * s * s),
    ]);
    // Derivative with respect to the point in camera coordinates.
    let inverse = 1.0 / p.z;
    let flat = Matrix2x3::new(inverse, 0.0, -u * inverse, 0.0, inverse, -v * inverse);
    let lens = nalgebra::Matrix2::new(fx * xx, fx * xy, fy * yx, fy * yy);
    let by_place = lens * flat;
    // A rotation by a small vector w displaces the point by w × turned.
    let cross = Matrix3::new(0.0, turned.z, -turned.y, -turned.z, 0.0, turned.x, turned.y, -turned.x, 0.0);
    let mut pose_part = SMatrix::<f64, 2, 6>::zeros();
    pose_part.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_place * cross));
    pose_part.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_place);
    Some(Row { off, camera: camera_part, pose: pose_part })
}

/// Applies a small rotation and translation to a pose.
pub(super) fn nudged(pose: &Pose, by: &Vector6<f64>) -> Pose {
    let turn = Pose::from_rotation_vector([by[0], by[1], by[2]], [0.0; 3]);
    let t = pose.translation_mm;
    let turned = Pose { translation_mm: [0.0; 3], ..*pose }.then(&turn);
    Pose { translation_mm: [t[0] + by[3], t[1] + by[4], t[2] + by[5]], ..turned }
}

fn nudged_camera(camera: &Camera, by: &Gradient) -> Camera {
    let mut camera = *camera;
    for k in 0..2 {
        camera.focal_px[k] += by[k];
        camera.center_px[k] += by[2 + k];
    }
    (0..5).for_each(|k| camera.distortion[k] += by[4 + k]);
    camera
}

/// Damped step: camera, poses, and predicted decrease. Poses are eliminated first (Schur complement), because each
/// occurs only in its own block.
fn step(camera: &Camera, poses: &[Pose], sums: &[Option<Sums>], damping: f64) -> Option<(Camera, Vec<Pose>, f64)> {
    let sums: Vec<&Sums> = sums.iter().map(Option::as_ref).collect::<Option<_>>()?;
    let mut reduced = sums.iter().map(|s| s.camera).sum::<Normal>();
    let mut right = sums.iter().map(|s| s.camera_right).sum::<Gradient>();
    (0..CAMERA).for_each(|k| reduced[(k, k)] *= 1.0 + damping);
    let inverses: Vec<Matrix6<f64>> = sums
        .iter()
        .map(|s| {
            let mut pose = s.pose;
            (0..6).for_each(|k| pose[(k, k)] *= 1.0 + damping);
            Some(Cholesky::new(pose)?.inverse())
        })
        .collect::<Option<_>>()?;
    for (s, inverse) in sums.iter().zip(&inverses) {
        reduced -= s.mixed * inverse * s.mixed.transpose();
        right -= s.mixed * inverse * s.pose_right;
    }
    let by = Cholesky::new(reduced)?.solve(&right);
    let mut gain = by.dot(&sums.iter().map(|s| s.camera_right).sum::<Gradient>());
    let moved = poses
        .iter()
        .zip(sums.iter().zip(&inverses))
        .map(|(pose, (s, inverse))| {
            let step = inverse * (s.pose_right - s.mixed.transpose() * by);
            gain += step.dot(&s.pose_right);
            nudged(pose, &step)
        })
        .collect();
    let next = nudged_camera(camera, &by);
    (next.focal_px.iter().all(|f| *f > 0.0 && f.is_finite())).then_some((next, moved, gain))
}

/// Covariances at the minimum.
fn finished(camera: Camera, poses: Vec<Pose>, sums: &[Option<Sums>], corners: usize) -> Result<Fit> {
    let vague = || {
        Error::input(
            "photographs",
            "do not tell the camera's focal length, centre and lens",
            "give more of them, with the board tilted by 20° to 45° in several directions and near all edges of the picture",
        )
    };
    let sums: Vec<&Sums> = sums.iter().map(Option::as_ref).collect::<Option<_>>().ok_or_else(vague)?;
    let cost: f64 = sums.iter().map(|s| s.squares).sum();
    let count = 2 * corners * sums.len();
    let freedom = count.saturating_sub(CAMERA + 6 * sums.len()).max(1) as f64;
    let inverses: Vec<Matrix6<f64>> =
        sums.iter().map(|s| Some(Cholesky::new(s.pose)?.inverse())).collect::<Option<_>>().ok_or_else(vague)?;
    let mut reduced = Normal::zeros();
    // Scatter of the photographs' score vectors.
    let mut scatter = Normal::zeros();
    for (s, inverse) in sums.iter().zip(&inverses) {
        reduced += s.camera - s.mixed * inverse * s.mixed.transpose();
        let score = s.camera_right - s.mixed * inverse * s.pose_right;
        scatter += score * score.transpose();
    }
    let inverse = Cholesky::new(reduced).ok_or_else(vague)?.inverse();
    let variance = cost / freedom;
    let n = sums.len() as f64;
    let clustered = inverse * scatter * inverse * (n / (n - 1.0).max(1.0));
    // Corners of one photograph share errors, for instance of a bent board. The larger of this covariance and the one
    // from independent corners is used.
    let mut covariance = inverse * variance;
    let grow = Gradient::from_fn(|k, _| (clustered[(k, k)] / covariance[(k, k)]).max(1.0).sqrt());
    covariance = Normal::from_fn(|r, c| covariance[(r, c)] * grow[r] * grow[c]);
    let pose_sigma = sums
        .iter()
        .zip(&inverses)
        .map(|(s, own)| {
            let through = own * s.mixed.transpose();
            let all = own * variance + through * covariance * through.transpose();
            std::array::from_fn(|k| all[(k, k)].max(0.0).sqrt())
        })
        .collect();
    Ok(Fit {
        camera,
        poses,
        rms_px: (cost / (corners * sums.len()) as f64).sqrt(),
        each_px: sums.iter().map(|s| (s.squares / corners as f64).sqrt()).collect(),
        covariance,
        pose_sigma,
    })
}

/// A board in one photograph, with a known camera.
struct Board<'a> {
    camera: &'a Camera,
    pixels: &'a [[f64; 2]],
    places: &'a [[f64; 2]],
}

/// The damped normal matrix has no inverse.
struct Undetermined;

impl Board<'_> {
    fn at(&self, pose: &Pose) -> Option<Sums> {
        Sums::of(self.camera, pose, self.pixels, self.places)
    }
}

impl Problem for Board<'_> {
    type State = (Pose, Sums);
    type Error = Undetermined;

    fn cost(&self, (_, sums): &(Pose, Sums)) -> f64 {
        sums.squares
    }

    fn step(&self, (pose, sums): &(Pose, Sums), damping: f64) -> std::result::Result<Step<(Pose, Sums)>, Undetermined> {
        let mut normal = sums.pose;
        (0..6).for_each(|k| normal[(k, k)] *= 1.0 + damping);
        let next = nudged(pose, &Cholesky::new(normal).ok_or(Undetermined)?.solve(&sums.pose_right));
        // A step that makes a corner invisible is too long.
        Ok(self.at(&next).map_or(Step::Singular, |sums| Step::Trial((next, sums))))
    }

    fn accept(&self, (_, from): &(Pose, Sums), (_, to): &mut (Pose, Sums)) -> bool {
        from.squares - to.squares < CONVERGED * from.squares
    }
}

/// Pose of one board for a known camera, its covariance (rotation about the camera's axes in rad, translation in mm),
/// and its root mean square reprojection error in pixels. `noise_px` is a lower bound of the corner error; `covariance`
/// is that of the camera parameters.
pub(super) fn pose_only(
    camera: &Camera,
    start: Pose,
    pixels: &[[f64; 2]],
    places: &[[f64; 2]],
    noise_px: f64,
    covariance: &Normal,
) -> Option<(Pose, Matrix6<f64>, f64)> {
    let board = Board { camera, pixels, places };
    let (pose, sums) = levenberg_marquardt(&board, (start, board.at(&start)?), DAMPING, STEPS).ok()?;
    let n = pixels.len() as f64;
    let freedom = 2.0 * n - 6.0;
    let scatter = if freedom > 0.0 { sums.squares / freedom } else { 0.0 };
    let variance = scatter.max(noise_px * noise_px);
    let own = Cholesky::new(sums.pose)?.inverse();
    let through = own * sums.mixed.transpose();
    let all = own * variance + through * covariance * through.transpose();
    Some((pose, all, (sums.squares / n).sqrt()))
}
