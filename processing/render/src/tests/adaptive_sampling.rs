//! Tests of adaptive against uniform sampling.

use super::*;

/// Root mean square luminance difference and difference of the means, relative to the mean.
fn off(found: &Picture, truth: &Picture) -> [f64; 2] {
    let count = truth.pixels.len() as f64;
    let mean = truth.pixels.iter().map(|p| p.luminance).sum::<f64>() / count;
    let pairs = || found.pixels.iter().zip(&truth.pixels).map(|(a, b)| a.luminance - b.luminance);
    let square = pairs().map(|d| d * d).sum::<f64>() / count;
    [square.sqrt() / mean, pairs().sum::<f64>() / count / mean]
}

/// The error falls to less than half for the same number of samples, matches the picture's estimate, and the picture is
/// unbiased.
#[test]
fn samples_where_noise_is_save_error_and_bias_nothing() {
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    let shape = "[[shape]]\ntype = \"sphere\"\nradius = 40\nmaterial = \"a\"\n";
    let lamp = "[[light]]\ntype = \"rectangle\"\ncenter = [0, 150, 100]\nnormal = [0, -1, -0.6]\nup = [0, 0, 1]\nsize = [20, 20]\nluminance = 5\n";
    let skin = "[material.a.diffraction]\ntype = \"heightfield\"\nfile = \"heights.exr\"\ncoherence_um = 5\n";
    for more in [format!("{shape}{FOIL}"), format!("{shape}{lamp}{skin}")] {
        // A lamp so wide that no single pixel dominates.
        let scene = Scene::parse(&format!("{STAGE}{more}").replace("sigma_mm = 4", "sigma_mm = 12")).unwrap();
        let prepared = PreparedScene::new(&scene, dir.path(), Accuracy::new(0.01, None), &Silent).unwrap();
        let rounds = 24;
        let all = vec![100; 32 * 32];
        // The later passes alone: all passes without the first ones.
        let mut first = Picture::new(prepared.size());
        first.add_passes(&prepared, &all, &Silent).unwrap();
        let mut truth = first.clone();
        for _ in 0..3 {
            truth.add_passes(&prepared, &all, &Silent).unwrap();
        }
        for (pixel, first) in truth.pixels.iter_mut().zip(&first.pixels) {
            pixel.luminance += (pixel.luminance - first.luminance) / 3.0;
        }
        let [mut even, mut placed] = [0, 1].map(|_| Picture::new(prepared.size()));
        for _ in 0..rounds {
            placed.add(&prepared, &Silent).unwrap();
        }
        let passes = |p: &Picture| p.pixels.iter().map(|p| p.passes as usize).sum::<usize>();
        while passes(&even) < passes(&placed) {
            even.add_passes(&prepared, &vec![1; 32 * 32], &Silent).unwrap();
        }
        let [[e, _], [p, bias]] = [&even, &placed].map(|found| off(found, &truth));
        let saved = (e / p).powi(2);
        println!(
            "even {e:.4}, placed {p:.4} ({:.4} said), {bias:.4} too bright: {saved:.0} times the samples",
            placed.error()
        );
        assert!(saved > 4.0 && p < 1.5 * placed.error() && placed.error() < 1.5 * p, "{e} {p} {}", placed.error());
        assert!(bias.abs() < 3.0 * p / 32.0, "{bias} {p}");
    }
}
