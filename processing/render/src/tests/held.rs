//! Tests of noise predictions, on scenes that were not used to tune them.

use super::*;

/// A picture's noise is within a factor of 1.5 of the prediction from its first passes, even where few pixels have
/// nearly all of it.
#[test]
fn noise_is_predicted_where_few_pixels_have_most_of_it() {
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    table(dir.path());
    flat::sky(dir.path());
    let sky = "[[light]]\ntype = \"environment\"\nfile = \"sky.exr\"\n";
    let lamp = "[[light]]\ntype = \"rectangle\"\ncenter = [0, 150, 100]\nnormal = [0, -1, -0.6]\nup = [0, 0, 1]\nsize = [20, 20]\nluminance = 5\n";
    let skin = "[material.a.diffraction]\ntype = \"heightfield\"\nfile = \"heights.exr\"\ncoherence_um = 5\n";
    let spots = "[material.a.diffraction]\ntype = \"table\"\nfile = \"lut.exr\"\n";
    let slits = "[material.a.diffraction]\ntype = \"multislit\"\ndisc = true\n";
    let [small, ball] = [6, 40].map(|r| format!("[[shape]]\ntype = \"sphere\"\nradius = {r}\nmaterial = \"a\"\n"));
    let disc = "[[shape]]\ntype = \"disc\"\ninner = 5\nouter = 20\nmaterial = \"a\"\n";
    let scenes = [
        format!("{small}{FOIL}"),
        format!("{small}{skin}{sky}"),
        format!("{ball}{spots}{sky}"),
        format!("{disc}{slits}{lamp}"),
        format!("{small}{FOIL}{lamp}{sky}"),
    ];
    for (k, more) in scenes.iter().enumerate() {
        for samples in [24, 256] {
            let scene = Scene::parse(&format!("{STAGE}{more}")).unwrap();
            let (_, report) = render(&scene, dir.path(), &settings(samples, 1e-5), &Silent).unwrap();
            let ratio = report.noise / report.predicted.noise;
            println!("{k} {samples}: {ratio:.2} times {:.4}", report.predicted.noise);
            assert!((1.0 / 1.5..1.5).contains(&ratio), "{k} {samples}: {ratio} {report:?}");
        }
    }
}
