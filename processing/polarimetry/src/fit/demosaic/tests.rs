use super::{Demosaic, demosaiced};
use crate::synthetic::normal;

const METHODS: [Demosaic; 2] = [Demosaic::Bilinear, Demosaic::EdgeAware];

fn images([width, height]: [usize; 2], method: Demosaic, mosaic: impl Fn(usize, usize) -> f32) -> [Vec<f32>; 4] {
    let mosaic: Vec<f32> = (0..width * height).map(|i| mosaic(i % width, i / width)).collect();
    demosaiced(&mosaic, [width, height], method)
}

#[test]
fn measured_pixels_are_unchanged_and_slopes_are_exact() {
    let (width, height) = (26, 18);
    // A linear ramp behind each polarizer, with constant differences.
    let light = |x: usize, y: usize, k: usize| 3.0 + 0.25 * x as f32 - 0.125 * y as f32 + [0.0, 1.0, -0.5, 0.75][k];
    for method in METHODS {
        let found = images([width, height], method, |x, y| light(x, y, x % 2 + 2 * (y % 2)));
        for (k, image) in found.iter().enumerate() {
            for (i, v) in image.iter().enumerate() {
                let (x, y) = (i % width, i / width);
                // Mirroring distorts ramps at the rim.
                let rim = [x, y, width - 1 - x, height - 1 - y].into_iter().min().unwrap();
                let own = (x % 2, y % 2) == (k % 2, k / 2);
                if own || rim >= if method == Demosaic::Bilinear { 1 } else { 8 } {
                    assert!((v - light(x, y, k)).abs() < 1e-5, "{method:?} {k} {x} {y}: {v}");
                }
            }
        }
    }
}

/// Sizes down to one super-pixel, and unusable pixels.
#[test]
fn small_frames_and_bad_pixels_are_no_harm() {
    for method in METHODS {
        for size in [[2, 2], [2, 8], [4, 2], [6, 6]] {
            let found = images(size, method, |_, _| 2.0);
            assert!(found.iter().flatten().all(|v| (v - 2.0).abs() < 1e-6), "{method:?} {size:?}");
        }
        let bad = [31, 30];
        let found = images([64, 64], method, |x, y| if [x, y] == bad { f32::NAN } else { 1.0 });
        let lost = |i: usize| found.iter().any(|image| image[i].is_nan());
        let away = |i: usize| (i % 64).abs_diff(bad[0]).max((i / 64).abs_diff(bad[1]));
        let reach = if method == Demosaic::Bilinear { 1 } else { 6 };
        assert!((0..64 * 64).all(|i| lost(i) == (away(i) == 0) || (1..=reach).contains(&away(i))), "{method:?}");
    }
}

/// The variances behind σ, on uniform light with noise.
#[test]
fn variances_are_measured() {
    let size = [512, 512];
    let noise = |x: usize, y: usize| 100.0 + normal(7, (y * size[0] + x) as u64) as f32;
    for method in METHODS {
        let found = images(size, method, noise);
        let mean = |of: &dyn Fn(usize) -> f64| (0..found[0].len()).map(of).sum::<f64>() / found[0].len() as f64;
        let i = |k: usize, at: usize| f64::from(found[k][at]) - 100.0;
        // 90 and 45° above 135 and 0°.
        let image = mean(&|at| (0..4).map(|k| i(k, at).powi(2)).sum::<f64>() / 4.0);
        let residual = mean(&|at| (i(3, at) + i(0, at) - i(1, at) - i(2, at)).powi(2) / 4.0);
        let s1 = mean(&|at| (i(3, at) - i(0, at)).powi(2) / 2.0);
        let s2 = mean(&|at| (i(1, at) - i(2, at)).powi(2) / 2.0);
        let stated = method.variances();
        println!("{method:?}: residual {residual:.4}, S1 {s1:.4}, S2 {s2:.4}");
        for (name, measured, stated) in [
            ("image", image, stated.image),
            ("residual", residual, stated.residual),
            ("stokes", (s1 + s2) / 2.0, stated.stokes),
        ] {
            assert!((measured / stated - 1.0).abs() < 0.03, "{method:?} {name}: {measured}, said {stated}");
        }
    }
}

/// Unpolarized light at a slanted edge: interpolation causes false polarization, less so along the edge.
#[test]
fn edges_make_less_false_polarization_edge_aware() {
    let edge = |x: usize, y: usize| 1.0 + 0.9 * ((x as f32 - 32.0 - 0.4 * (y as f32 - 32.0)) / 1.5).tanh();
    let false_polarization = |method| {
        let found = images([64, 64], method, edge);
        (0..64 * 64).map(|i| (found[3][i] - found[0][i]).hypot(found[1][i] - found[2][i])).sum::<f32>()
    };
    let [bilinear, aware] = METHODS.map(false_polarization);
    println!("bilinear {bilinear}, edge-aware {aware}");
    assert!(aware < 0.5 * bilinear, "{aware} {bilinear}");
}
