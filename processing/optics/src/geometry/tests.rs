use super::*;
use std::f64::consts::PI;

/// Camera perpendicularly above the sample, light to the right.
fn upright() -> Geometry {
    let camera = Camera { focal_px: [2000.0; 2], center_px: [499.5, 399.5], distortion: [0.0; 5] };
    let down = Pose::from_rotation_vector([PI, 0.0, 0.0], [0.0, 0.0, 500.0]);
    Geometry { light_mm: Some([300.0, 0.0, 400.0]), wavelength_nm: Some(530.0), ..Geometry::new(camera, down) }
}

fn near(a: &[f64], b: &[f64], within: f64) {
    assert!(a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < within), "{a:?} {b:?}");
}

#[test]
fn the_camera_sees_x_to_the_right_and_y_upwards() {
    let geometry = upright();
    near(&geometry.viewer(), &[0.0, 0.0, 500.0], 1e-9);
    near(&geometry.point([499.5, 399.5]).unwrap(), &[0.0, 0.0, 0.0], 1e-9);
    // 40 px at 2000 px and 500 mm are 10 mm; y increases towards smaller rows.
    near(&geometry.point([539.5, 399.5 - 80.0]).unwrap(), &[10.0, 20.0, 0.0], 1e-9);
    near(&geometry.pixel([10.0, 20.0, 0.0]).unwrap(), &[539.5, 319.5], 1e-9);
}

#[test]
fn half_vectors_follow_from_triangles() {
    let geometry = upright();
    // Seen from the middle, the light lies at the end of a 3-4-5 triangle and the camera straight above.
    near(&geometry.half([0.0; 3], [300.0, 0.0, 400.0]), &[0.6, 0.0], 1e-9);
    // The half vector vanishes at the mirror point of a light over (0, 100) at the camera's height.
    near(&geometry.half([0.0, 50.0, 0.0], [0.0, 100.0, 500.0]), &[0.0, 0.0], 1e-9);
    // Camera 30° to the left of the point, light 30° below it: both sines are 0.5.
    let tan = 1.0 / 3.0_f64.sqrt();
    let place = [500.0 * tan, 0.0, 0.0];
    near(&geometry.half(place, [place[0], -300.0 * tan, 300.0]), &[-0.5, -0.5], 1e-9);
}

#[test]
fn a_tilted_camera_looks_past_the_sample_above_its_horizon() {
    // Tilted by 80° from straight down: the horizon is 10° above the axis.
    let camera = Camera { focal_px: [100.0; 2], center_px: [0.0; 2], distortion: [0.0; 5] };
    let pose = Pose::from_rotation_vector([PI - 80.0_f64.to_radians(), 0.0, 0.0], [0.0, 0.0, 500.0]);
    let geometry = Geometry::new(camera, pose);
    let horizon = -100.0 * 10.0_f64.to_radians().tan();
    assert!(geometry.point([0.0, horizon + 0.1]).is_some());
    assert_eq!(geometry.point([0.0, horizon - 0.1]), None);
    // The axis still passes through the origin, seen from 500 mm at an angle of 80°.
    near(&geometry.point([0.0, 0.0]).unwrap(), &[0.0; 3], 1e-9);
    let (sin, cos) = 80.0_f64.to_radians().sin_cos();
    near(&geometry.viewer().map(f64::abs), &[0.0, 500.0 * sin, 500.0 * cos], 1e-9);
}

#[test]
fn panel_pixels_count_from_the_top_left_of_the_lit_side() {
    // The panel faces down 200 mm above the sample, both bottoms on the same side. Seen from below, its x points left.
    let pose =
        Pose { rotation: [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], translation_mm: [5.0, 0.0, 200.0] };
    let panel = Panel { pose, pixel_mm: [0.25, 0.5], size_px: [5, 3] };
    near(&panel.at([2.0, 1.0]), &[5.0, 0.0, 200.0], 1e-12);
    near(&panel.at([0.0, 0.0]), &[5.5, 0.5, 200.0], 1e-12);
    near(&panel.at([4.0, 2.0]), &[4.5, -0.5, 200.0], 1e-12);
    panel.check().unwrap();
}

#[test]
fn a_geometry_comes_back_from_its_file_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("geometry.json");
    let mut geometry = upright();
    geometry.sample = Pose::from_rotation_vector([2.9, 0.1, -0.2], [1.0 / 3.0, -2.0 / 7.0, 512.3]);
    geometry.panel = Some(Panel { pose: geometry.sample, pixel_mm: [0.2745, 0.2746], size_px: [1920, 1080] });
    geometry.sigma = Uncertainty { light_mm: Some([1.0, 0.1, 1.0 / 3.0]), ..Uncertainty::default() };
    geometry.image_px = Some([1000, 800]);
    geometry.relative = true;
    save(&geometry, &path).unwrap();
    assert_eq!(load(&path).unwrap(), geometry);
    save(&upright(), &path).unwrap();
    assert_eq!(load(&path).unwrap(), upright());
}

#[test]
fn what_is_wrong_in_a_file_is_named() {
    let whole = text(&upright());
    let with = |from: &str, to: &str| {
        assert!(whole.contains(from), "{whole}");
        whole.replacen(from, to, 1)
    };
    for (text, words) in [
        (with("\"camera\"", "\"kamera\""), "kamera"),
        (with("\"focal_px\": [2000.0", "\"focal_px\": [-2000.0"), "focal_px"),
        (with("\"focal_px\": [2000.0", "\"focal_px\": [1e999"), "camera.focal_px"),
        (with("[300.0, 0.0, 400.0]", "[300.0, 0.0, -400.0]"), "light_mm"),
        (with("[300.0, 0.0, 400.0]", "[300.0, 0.0]"), "light_mm"),
        (with("530.0", "5300"), "wavelength_nm"),
        (with("[0.0, 0.0, 500.0]", "[0.0, 0.0, -500.0]"), "camera"),
        (with("\"sigma\": {}", "\"sigma\": {\"light_mm\": [1, -1, 0]}"), "sigma.light_mm"),
        (with("\"relative\": false", "\"relative\": 0"), "relative"),
        (whole.clone() + "}", "closing brace"),
        (whole[..whole.len() / 2].to_string(), "EOF"),
        ("[[".repeat(10_000), "camera"),
        (String::new(), "EOF"),
    ] {
        let problem = parse(&text).unwrap_err();
        assert!(problem.contains(words) || words == "camera", "{words}: {problem}");
    }
    let missing = load(std::path::Path::new("no/such.json")).unwrap_err().to_string();
    assert!(missing.contains("no/such.json") && missing.contains("calibrate geometry"), "{missing}");
}
