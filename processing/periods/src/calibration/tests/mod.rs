mod render;

use super::*;
use nacre_base::progress::Silent;
use nacre_optics::color::Spectrum;
use nacre_optics::geometry::{Camera, Geometry, Pose};
use render::{meets, photograph, squares};
use std::f64::consts::PI;
use std::path::PathBuf;

const BOARD: Board = Board { columns: 9, rows: 6, square_mm: 25.0 };

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("NACRE_TEST_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")), PathBuf::from)
        .join("calibration");
    if !folder.is_dir() {
        println!("skipped: no photographs at {}", folder.display());
        return None;
    }
    Some(folder)
}

fn webcam() -> Camera {
    Camera { focal_px: [620.0, 615.0], center_px: [326.0, 236.0], distortion: [-0.22, 0.08, 0.0012, -0.0008, -0.02] }
}

/// Pose straight above, rotated about the camera's axes.
fn above(turn: [f64; 3], at: [f64; 3]) -> Pose {
    Pose::from_rotation_vector([PI, 0.0, 0.0], [0.0; 3]).then(&Pose::from_rotation_vector(turn, at))
}

/// A board over the sample's origin.
fn shot(camera: &Camera, pose: &Pose, board: &Board, seed: u64) -> Gray {
    photograph(camera, pose, [640, 480], 2.0, seed, &|from, along| {
        meets(&Pose::IDENTITY, from, along).map_or(1.0, |p| squares(board, p))
    })
}

fn no_covariance() -> CameraCovariance {
    CameraCovariance::zeros()
}

#[test]
fn thirteen_real_photographs_are_explained_to_0_42_px() {
    let Some(folder) = data() else { return };
    let found = calibrate(&folder, &BOARD, &Silent).unwrap();
    assert!(found.unused.is_empty(), "{:?}", found.unused);
    assert_eq!(found.used.len(), 13);
    assert!(found.rms_px <= 0.2, "{}", found.rms_px);
    // OpenCV 5.0 with corners refined in windows of 11 px: these values, and 0.195 px RMS.
    let peer = [532.83, 532.95, 342.49, 233.86, -0.2809];
    let c = &found.camera;
    let own = [c.focal_px[0], c.focal_px[1], c.center_px[0], c.center_px[1], c.distortion[0]];
    for k in 0..5 {
        assert!((own[k] - peer[k]).abs() < 2.0 * found.sigma[k], "{k}: {} ± {}, {}", own[k], found.sigma[k], peer[k]);
    }
    // No other board is detected in them.
    let other = calibrate(&folder, &Board { columns: 8, rows: 5, ..BOARD }, &Silent).unwrap_err().to_string();
    assert!(other.contains("more than 8 × 5") && other.contains("left01.jpg"), "{other}");
    let other = calibrate(&folder, &Board { columns: 10, rows: 7, ..BOARD }, &Silent).unwrap_err().to_string();
    assert!(other.contains("grid of 9 × 6"), "{other}");
}

#[test]
fn a_known_camera_is_found_within_its_uncertainty() {
    let camera = webcam();
    let poses: Vec<Pose> = (0..12)
        .map(|k| {
            let a = f64::from(k) * 2.4;
            let tilt = [0.55 * a.cos(), 0.55 * a.sin(), 0.2 * f64::from(k % 3) - 0.2];
            above(tilt, [55.0 * (1.7 * a).cos(), 40.0 * (1.3 * a).sin(), 420.0 + 12.0 * f64::from(k)])
        })
        .collect();
    let good: Vec<(PathBuf, Vec<[f64; 2]>)> = poses
        .iter()
        .enumerate()
        .map(|(k, pose)| {
            let corners = find(&shot(&camera, pose, &BOARD, k as u64), &BOARD, View::Direct).unwrap();
            // Compares each corner with the truth, projected in closed form.
            for (corner, place) in corners.iter().zip(BOARD.places()) {
                let truth = camera.project(pose.apply([place[0], place[1], 0.0])).unwrap();
                let off = (corner[0] - truth[0]).hypot(corner[1] - truth[1]);
                assert!(off < 0.25, "{k}: {off} {corner:?} {truth:?}");
            }
            (PathBuf::from(format!("{k}.png")), corners)
        })
        .collect();
    let found = of_corners(good, vec![], &BOARD, [640, 480], &Silent).unwrap();
    assert!(found.rms_px < 0.06, "{}", found.rms_px);
    let numbers = |c: &Camera| -> Vec<f64> { [&c.focal_px[..], &c.center_px, &c.distortion].concat() };
    for (k, (own, truth)) in numbers(&found.camera).iter().zip(numbers(&camera)).enumerate() {
        let sigma = found.sigma[k];
        assert!((own - truth).abs() < 4.0 * sigma, "{k}: {own} ± {sigma}, {truth}");
    }
    assert!(found.sigma[0] < 1e-3 * 620.0 && found.sigma[2] < 0.7, "{:?}", found.sigma);
    for (used, pose) in found.used.iter().zip(&poses) {
        for k in 0..3 {
            let off = used.pose.translation_mm[k] - pose.translation_mm[k];
            assert!(off.abs() < 4.0 * used.pose_sigma[3 + k] + 0.02, "{off} {:?}", used.pose_sigma);
        }
    }
}

#[test]
fn photographs_that_do_not_determine_a_camera_are_refused() {
    let camera = Camera { distortion: [0.0; 5], ..webcam() };
    // Frontal views only: distance and focal length are degenerate.
    let flat: Vec<(PathBuf, Vec<[f64; 2]>)> = (0..6)
        .map(|k| {
            let pose = above([0.0; 3], [10.0 * f64::from(k), 0.0, 400.0 + 20.0 * f64::from(k)]);
            let project = |p: [f64; 2]| {
                let seen = camera.project(pose.apply([p[0], p[1], 0.0])).unwrap();
                // Slight noise, without which the fit would be perfect.
                [seen[0] + 0.05 * (p[0] * 7.0 + f64::from(k)).sin(), seen[1] + 0.05 * (p[1] * 5.0).cos()]
            };
            (PathBuf::from("a.png"), BOARD.places().into_iter().map(project).collect())
        })
        .collect();
    let problem = of_corners(flat.clone(), vec![], &BOARD, [640, 480], &Silent).unwrap_err().to_string();
    assert!(problem.contains("tilted"), "{problem}");
    let unused = vec![(PathBuf::from("x/b.png"), "shows no board".to_string())];
    let problem = of_corners(flat[..2].to_vec(), unused, &BOARD, [640, 480], &Silent).unwrap_err().to_string();
    assert!(problem.contains("2 of 3") && problem.contains("b.png shows no board"), "{problem}");
    for board in [Board { columns: 1, ..BOARD }, Board { rows: 65, ..BOARD }, Board { square_mm: f64::NAN, ..BOARD }] {
        assert!(board.check().is_err());
    }
}

#[test]
fn pictures_without_the_board_say_so() {
    let shots = |board: &Board| shot(&webcam(), &above([0.3, 0.2, 0.1], [0.0, 0.0, 500.0]), board, 3);
    let none = Gray { width: 320, height: 240, values: vec![7.0; 320 * 240] };
    assert!(find(&none, &BOARD, View::Direct).unwrap_err().contains("no board"));
    let tiny = Gray { width: 4, height: 3, values: vec![7.0; 12] };
    assert!(find(&tiny, &BOARD, View::Direct).is_err());
    let smaller = shots(&Board { columns: 7, rows: 6, ..BOARD });
    assert!(find(&smaller, &BOARD, View::Direct).unwrap_err().contains("7 × 6"));
    let larger = shots(&Board { columns: 10, rows: 6, square_mm: 20.0 });
    assert!(find(&larger, &BOARD, View::Direct).unwrap_err().contains("more than 9 × 6"));
    // Stripes have edges but no corners.
    let stripes =
        Gray { values: (0..320 * 240).map(|i| f32::from(u8::from(i % 320 % 20 < 10)) * 99.0).collect(), ..none };
    assert!(find(&stripes, &BOARD, View::Direct).is_err());
}

#[test]
fn half_a_turn_of_a_board_is_seen() {
    for turn in [0.1, 1.7, PI, -1.4] {
        let pose = above([0.0, 0.0, turn], [0.0, 0.0, 500.0]);
        let corners = find(&shot(&webcam(), &pose, &BOARD, 5), &BOARD, View::Direct).unwrap();
        let truth = webcam().project(pose.apply([-100.0, 62.5, 0.0])).unwrap();
        assert!((corners[0][0] - truth[0]).hypot(corners[0][1] - truth[1]) < 0.3, "{turn}: {:?} {truth:?}", corners[0]);
    }
}

#[test]
fn a_sample_under_a_board_and_by_its_corners_is_placed() {
    let camera = webcam();
    // A board 2 mm thick on a sample rotated by 8° in the picture.
    let truth = above([0.2, -0.15, 0.14], [12.0, -7.0, 480.0]);
    let on_top = Pose { translation_mm: [0.0, 0.0, 2.0], ..Pose::IDENTITY }.then(&truth);
    let corners = find(&shot(&camera, &on_top, &BOARD, 9), &BOARD, View::Direct).unwrap();
    let placed = from_board(&camera, &no_covariance(), &BOARD, &corners, 2.0).unwrap();
    let near = |placed: &Placed, times: f64| {
        for k in 0..3 {
            let off = placed.pose.translation_mm[k] - truth.translation_mm[k];
            assert!(off.abs() < times * placed.sigma[3 + k], "{off} {:?}", placed.sigma);
        }
        let turn = truth.inverse().then(&placed.pose).rotation_vector();
        let most = placed.sigma[..3].iter().fold(0.0_f64, |a, b| a.max(*b));
        assert!(turn.iter().all(|t| t.abs() < times * most), "{turn:?} {:?}", placed.sigma);
    };
    near(&placed, 4.0);
    assert!(placed.sigma[5] < 0.2, "{:?}", placed.sigma);
    // Corners displaced by half a pixel in alternating directions.
    let [w, h] = [60.0, 40.0];
    let off = [[0.4, -0.3], [-0.3, 0.4], [0.3, 0.3], [-0.4, -0.2]];
    let seen = |k: usize| {
        let place = [[-w, h, 0.0], [w, h, 0.0], [w, -h, 0.0], [-w, -h, 0.0]][k];
        let p = camera.project(truth.apply(place)).unwrap();
        [p[0] + off[k][0], p[1] + off[k][1]]
    };
    let pixels = [seen(0), seen(1), seen(2), seen(3)];
    near(&from_corners(&camera, &no_covariance(), &pixels, [2.0 * w, 2.0 * h], 0.5).unwrap(), 4.0);
    let [a, b, c, d] = pixels;
    for wrong in [[b, a, d, c], [a, c, b, d], [a, a, c, d]] {
        let problem = from_corners(&camera, &no_covariance(), &wrong, [120.0, 80.0], 0.5).unwrap_err().to_string();
        assert!(problem.contains("clockwise"), "{problem}");
    }
}

#[test]
fn a_panel_in_the_mirror_is_placed() {
    let camera = webcam();
    let sample = above([0.35, 0.05, 0.0], [0.0, 10.0, 600.0]);
    // A mirror 1 mm above the sample; the panel faces it from above.
    let pixels = Pixels { pixel_mm: [0.25, 0.26], size_px: [1600, 1200] };
    let truth = by_hand(pixels, [20.0, 160.0, 520.0], [-17.0, 3.0, 4.0], 1.0, 1.0).unwrap().panel;
    let board = Board { columns: 9, rows: 6, square_mm: 60.0 };
    let shade = |from: [f64; 3], along: [f64; 3]| {
        let steps = (1.0 - from[2]) / along[2];
        let at = [0, 1, 2].map(|k| from[k] + steps * along[k]);
        let on = meets(&truth.pose, at, [along[0], along[1], -along[2]]);
        on.map_or(1.0, |[x, y]| squares(&Board { square_mm: 1.0, ..board }, [x / (60.0 * 0.25), y / (60.0 * 0.26)]))
    };
    let image = photograph(&camera, &sample, [640, 480], 2.0, 77, &shade);
    let corners = find(&image, &board, View::Mirrored).unwrap();
    let placed = Placed { pose: sample, sigma: [1e-4, 1e-4, 1e-4, 0.05, 0.05, 0.1], rms_px: 0.0 };
    let shown = Shown { corners: &corners, board, view: View::Mirrored, mirror_mm: 1.0 };
    let found = from_photograph(&camera, &no_covariance(), &placed, pixels, &shown).unwrap();
    for k in 0..3 {
        let off = found.panel.pose.translation_mm[k] - truth.pose.translation_mm[k];
        assert!(off.abs() < 4.0 * found.mm[k] && found.mm[k] < 3.0, "{off} {:?}", found.mm);
    }
    let turn = Pose::of(found.panel.pose.matrix() * truth.pose.matrix().transpose(), [0.0; 3]).rotation_vector();
    for k in 0..3 {
        assert!(turn[k].to_degrees().abs() < 4.0 * found.turn_deg[k], "{turn:?} {:?}", found.turn_deg);
    }
    // The panel's pixels coincide with the truth.
    let (a, b) = (found.panel.at([100.0, 1100.0]), truth.at([100.0, 1100.0]));
    assert!((0..3).all(|k| (a[k] - b[k]).abs() < 3.0), "{a:?} {b:?}");
    // Interpreted as a direct view, the panel would lie below the sample or be seen from behind.
    let direct = Shown { view: View::Direct, ..shown };
    assert!(from_photograph(&camera, &no_covariance(), &placed, pixels, &direct).is_err());
}

#[test]
fn a_panel_measured_by_hand_looks_down_and_turns() {
    let pixels = Pixels { pixel_mm: [0.5, 0.5], size_px: [3, 3] };
    let flat = by_hand(pixels, [0.0, 0.0, 300.0], [0.0; 3], 2.0, 0.5).unwrap();
    // Seen from below, its left side is at the sample's right.
    assert_eq!(flat.panel.at([0.0, 1.0]), [0.5, 0.0, 300.0]);
    assert_eq!(flat.panel.at([1.0, 0.0]), [0.0, 0.5, 300.0]);
    // Rotated by 90° about x, the face turns from down to +y.
    let upright = by_hand(pixels, [0.0, 0.0, 300.0], [90.0, 0.0, 0.0], 2.0, 0.5).unwrap();
    let normal = upright.panel.pose.turn([0.0, 0.0, 1.0]);
    assert!((normal[1] - 1.0).abs() < 1e-12, "{normal:?}");
    assert!(by_hand(pixels, [0.0; 3], [f64::NAN, 0.0, 0.0], 2.0, 0.5).is_err());
}

/// Pixel of a light's highlight in a mirror at a height: the line from camera to light is divided in the ratio of their
/// heights above it.
fn highlight(camera: &Camera, sample: &Pose, light: [f64; 3], height: f64) -> Highlight {
    let viewer = sample.inverse().translation_mm;
    let share = (viewer[2] - height) / (viewer[2] + light[2] - 2.0 * height);
    let at = |k: usize| viewer[k] + share * (light[k] - viewer[k]);
    let pixel = camera.project(sample.apply([at(0), at(1), height])).unwrap();
    Highlight { pixel, height_mm: height, tilt_deg: [0.0; 2] }
}

#[test]
fn a_light_is_placed_by_its_highlights() {
    let (camera, sample) = (webcam(), above([0.1, -0.05, 0.2], [5.0, 0.0, 500.0]));
    let light = [60.0, -40.0, 350.0];
    let sure = Placed { pose: sample, sigma: [0.0; 6], rms_px: 0.0 };
    let known = Known { sigma_px: 0.3, height_mm: None };
    // Two heights, each measured to 0.2 px.
    let mut all: Vec<Highlight> = [0.0, 120.0].iter().map(|h| highlight(&camera, &sample, light, *h)).collect();
    let exact = from_highlights(&camera, &sure, &all, &known).unwrap();
    assert!((0..3).all(|k| (exact.mm[k] - light[k]).abs() < 1e-5), "{exact:?}");
    all[0].pixel[0] += 0.2;
    all[1].pixel[1] -= 0.2;
    let found = from_highlights(&camera, &sure, &all, &known).unwrap();
    assert!((0..3).all(|k| (found.mm[k] - light[k]).abs() < 3.0 * found.sigma_mm[k]), "{found:?}");
    // One height, and a ruler.
    let ruled = Known { height_mm: Some([352.0, 2.0]), ..known };
    let found = from_highlights(&camera, &sure, &all[..1], &ruled).unwrap();
    assert!((0..3).all(|k| (found.mm[k] - light[k]).abs() < 3.0 * found.sigma_mm[k]), "{found:?}");
    assert!((found.sigma_mm[2] - 2.0).abs() < 0.1);
    // A tilt uncertainty of 0.01 rad displaces a light at a height of 352 mm by 3.5 mm.
    let vague = Placed { sigma: [0.01, 0.01, 0.01, 0.0, 0.0, 0.0], ..sure };
    let sigma = from_highlights(&camera, &vague, &all[..1], &ruled).unwrap().sigma_mm;
    assert!((3.4..4.2).contains(&sigma[0]) && (3.4..4.2).contains(&sigma[1]), "{sigma:?}");
    let one = from_highlights(&camera, &sure, &all[..1], &known).unwrap_err().to_string();
    assert!(one.contains("fewer than two"), "{one}");
    let same = from_highlights(&camera, &sure, &[all[0], all[0]], &known).unwrap_err().to_string();
    assert!(same.contains("how far away"), "{same}");
}

#[test]
fn a_tilted_mirror_is_as_good_as_a_higher_one() {
    let (camera, sample) = (webcam(), above([0.0; 3], [0.0, 0.0, 500.0]));
    let light = [0.0, 80.0, 400.0];
    // Mirror rotated by 5° about x: the reflection point minimises the path length (Fermat) in the plane x = 0.
    let (sin, cos) = 5.0_f64.to_radians().sin_cos();
    let path = |s: f64| {
        let (y, z) = (s * cos, s * sin);
        (y * y + (500.0 - z).powi(2)).sqrt() + ((80.0 - y).powi(2) + (400.0 - z).powi(2)).sqrt()
    };
    let (mut low, mut high) = (-200.0, 200.0);
    for _ in 0..200 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if path(a) < path(b) { high = b } else { low = a }
    }
    let s = 0.5 * (low + high);
    let pixel = camera.project(sample.apply([0.0, s * cos, s * sin])).unwrap();
    let tilted = Highlight { pixel, height_mm: 0.0, tilt_deg: [5.0, 0.0] };
    let all = [highlight(&camera, &sample, light, 0.0), tilted];
    let sure = Placed { pose: sample, sigma: [0.0; 6], rms_px: 0.0 };
    let found = from_highlights(&camera, &sure, &all, &Known { sigma_px: 0.2, height_mm: None }).unwrap();
    assert!((0..3).all(|k| (found.mm[k] - light[k]).abs() < 0.01), "{found:?}");
}

#[test]
fn bands_have_the_mean_and_the_width_of_their_curves() {
    let gauss = Spectrum::new(
        (480..=580).map(|nm| [f64::from(nm), (-0.5 * ((f64::from(nm) - 530.0) / 8.0).powi(2)).exp()]).collect(),
    );
    let gauss = gauss.unwrap();
    let found = band(std::slice::from_ref(&gauss), true).unwrap();
    assert!((found.mean_nm - 530.0).abs() < 1e-6 && (found.spread_nm - 8.0).abs() < 0.02, "{found:?}");
    assert!((found.fwhm_nm - 8.0 * (8.0 * 2.0_f64.ln()).sqrt()).abs() < 0.1, "{found:?}");
    assert!((found.sigma_nm - 0.5).abs() < 1e-12);
    // A lamp spectrum proportional to nm - 330 shifts the mean by variance over 200 nm.
    let rising = Spectrum::new(vec![[430.0, 100.0], [630.0, 300.0]]).unwrap();
    let moved = band(&[gauss.clone(), rising], true).unwrap();
    assert!((moved.mean_nm - 530.0 - 64.0 / 200.0).abs() < 0.01, "{moved:?}");
    assert!(band(std::slice::from_ref(&gauss), false).unwrap().sigma_nm > 0.5);
    let elsewhere = Spectrum::new(vec![[600.0, 1.0], [700.0, 1.0]]).unwrap();
    assert!(band(&[gauss, elsewhere], true).unwrap_err().to_string().contains("in common"));
    assert!(band(&[], true).is_err());
}

#[test]
fn the_papers_way_is_relative_and_right_where_it_holds() {
    let truth = Camera { focal_px: [900.0; 2], center_px: [319.5, 239.5], distortion: [0.0; 5] };
    let light = [45.0, -30.0, 300.0];
    let known = Geometry { light_mm: Some(light), ..Geometry::new(truth, above([0.0; 3], [0.0, 0.0, 500.0])) };
    let pixel = highlight(&truth, &known.sample, light, 0.0).pixel;
    let places = [[-80.0, 20.0], [70.0, -10.0]].map(|[x, y]| known.pixel([x, y, 0.0]).unwrap());
    let ruler = Ruler {
        image_px: [640, 480],
        places_px: places,
        apart_mm: 150.0_f64.hypot(30.0),
        camera_mm: 500.0,
        light_mm: 300.0,
        highlight_px: pixel,
    };
    let found = relative(&ruler).unwrap();
    assert!(found.relative);
    for pixel in [[10.0, 20.0], [600.0, 400.0]] {
        let half = |g: &Geometry| g.half(g.point(pixel).unwrap(), g.light_mm.unwrap());
        let (a, b) = (half(&found), half(&known));
        assert!((0..2).all(|k| (a[k] - b[k]).abs() < 1e-9), "{a:?} {b:?}");
    }
    // A wrong length scales all half vectors by nearly the same factor, which defines a relative geometry.
    let wrong = relative(&Ruler { apart_mm: 1.1 * ruler.apart_mm, ..ruler }).unwrap();
    let ratio = |pixel: [f64; 2]| {
        let half = |g: &Geometry| g.half(g.point(pixel).unwrap(), g.light_mm.unwrap());
        half(&wrong)[0] / half(&found)[0]
    };
    assert!((ratio([10.0, 240.0]) / ratio([600.0, 240.0]) - 1.0).abs() < 0.02);
    for bad in [
        Ruler { apart_mm: 0.0, ..ruler },
        Ruler { camera_mm: f64::NAN, ..ruler },
        Ruler { highlight_px: [700.0, 1.0], ..ruler },
    ] {
        assert!(relative(&bad).is_err());
    }
}

#[test]
fn a_board_to_show_has_its_corners_where_it_says() {
    let board = Board { columns: 9, rows: 6, square_mm: 40.0 };
    let picture = board_picture(&board, [640, 400], 40).unwrap();
    let image = Gray { width: 640, height: 400, values: picture.iter().map(|v| f32::from(*v)).collect() };
    let corners = find(&image, &board, View::Direct).unwrap();
    for (corner, place) in corners.iter().zip(board.places()) {
        let truth = [319.5 + place[0], 199.5 - place[1]];
        assert!((corner[0] - truth[0]).hypot(corner[1] - truth[1]) < 0.01, "{corner:?} {truth:?}");
    }
    assert!(board_picture(&board, [640, 400], 60).is_err());
    assert!(board_picture(&board, [640, 400], 39).is_err());
}
