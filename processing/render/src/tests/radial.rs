//! Tests of slits in all directions, and of the bright part of a photograph (2017 TOG paper, Fig. 20).

use super::*;
use nacre_image::write_png16_gray;

/// Step of the directions in the sum.
const STEP_DEG: f64 = 0.25;

/// Luminance of slits under a small light of one wavelength, at normal view.
fn luminance(layout: &str, light: [f64; 3]) -> f64 {
    let more = format!(
        "[material.a.diffraction]\ntype = \"multislit\"\n{layout}\n[[light]]\ntype = \"directional\"\ndirection = {light:?}\n\
         sigma_deg = 0.5\nspectrum = 550\n"
    );
    let scene = Scene::parse(&plane(0.0, 0.0, &more)).unwrap();
    let prepared = PreparedScene::new(&scene, Path::new(""), Accuracy::new(1e-4, None), &Silent).unwrap();
    prepared.at([2.0, 2.0], &mut Stream::new(0, 0), &mut Default::default())[1]
}

/// Slits in all directions equal the mean over slits of each direction: on orders and between them, from any side.
#[test]
fn radial_slits_are_the_mean_over_all_directions() {
    let (mut worst, mut most) = (0.0_f64, 0.0_f64);
    for (angle, azimuth) in [(16.0_f64, 0.0_f64), (16.0, 50.0), (12.0, 20.0), (33.4, 80.0)] {
        let (sin, cos) = angle.to_radians().sin_cos();
        let (s, c) = azimuth.to_radians().sin_cos();
        let light = [sin * c, sin * s, cos];
        // Slits at a larger angle contribute nothing there, because their window is narrower.
        let turned = |k: i32| luminance(&format!("orientation_deg = {:?}", azimuth + STEP_DEG * f64::from(k)), light);
        let truth = (-60..=60).map(turned).sum::<f64>() * STEP_DEG / 180.0;
        let found = luminance("radial = true", light);
        println!("{angle} {azimuth}: {found} {truth}");
        (worst, most) = (worst.max((found - truth).abs()), most.max(truth));
    }
    // Directions beside the half vector see slits at a slightly smaller frequency.
    assert!(worst < 0.05 * most, "{worst} {most}");
}

/// Bright stripes of a photograph diffract, the gaps between them do not; an explicit threshold moves the edge.
#[test]
fn a_photograph_is_its_own_mask() {
    let dir = tempfile::tempdir().unwrap();
    let codes: Vec<u16> = (0..16 * 16)
        .map(|i| {
            if i % 16 < 4 {
                50_000
            } else if i % 16 < 8 {
                30_000
            } else {
                3000
            }
        })
        .collect();
    write_png16_gray(&dir.path().join("flash.png"), 16, 16, &codes).unwrap();
    let pixels = |coverage: &str| {
        let text = format!(
            "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 10\nwidth = 16\nheight = 16\n[[shape]]\ntype = \"plane\"\nsize = [100, 100]\n\
             material = \"a\"\n[material.a]\ncoverage = {coverage}\n[material.a.diffraction]\ntype = \"multislit\"\nradial = true\n{SKY}"
        );
        let picture = picture(&text, dir.path(), &settings(16, 1e-3));
        (0..16).map(|x| picture.pixels[8 * 16 + x].luminance).collect::<Vec<f64>>()
    };
    // The plane fills the centre of the picture: 87.5 mm of 100 are visible.
    let found = pixels("{ photograph = \"flash.png\" }");
    assert!(found[1] > 0.05 && found[5] > 0.05 && found[12] == 0.0, "{found:?}");
    let narrow = pixels("{ photograph = \"flash.png\", threshold = 0.6 }");
    assert!(narrow[1] > 0.05 && narrow[6] == 0.0, "{narrow:?}");
    let scene = |more: &str| Scene::parse(&plane(0.0, 0.0, more)).unwrap();
    let both = scene(&format!("[material.a.diffraction]\ntype = \"multislit\"\nradial = true\ndisc = true\n{SKY}"));
    let problem = render(&both, dir.path(), &settings(4, 0.1), &Silent).unwrap_err().to_string();
    assert!(problem.contains("radial"), "{problem}");
}
