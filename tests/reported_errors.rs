//! Errors stated in reports, compared with true errors, for large errors.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{Attribute, read_exr, write_exr, write_png16_gray};
use nacre_tests::nacre;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::Path;

/// Side of the photographs in pixels.
const SIDE: usize = 96;

/// Nearly normal numbers with mean 0 and variance 1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut even = || {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| even()).sum::<f64>() - 6.0
    }
}

fn photograph(path: &Path, light: impl FnMut(usize) -> f64) {
    let codes: Vec<u16> = (0..SIDE * SIDE).map(light).map(|v| v.round().clamp(0.0, 65535.0) as u16).collect();
    write_png16_gray(path, SIDE, SIDE, &codes).unwrap();
}

fn described(folder: &Path, kind: &str, frames: &[Value]) {
    let set = json!({ "kind": kind, "transfer": "linear", "frames": frames });
    std::fs::write(folder.join("frames.json"), set.to_string()).unwrap();
}

fn report(args: &[&str], folder: &Path) -> Value {
    let out = folder.join("out");
    nacre([&["--json"], args, &["--out", out.to_str().unwrap()]].concat()).expect(0).json()
}

fn rms(errors: impl IntoIterator<Item = f64>) -> f64 {
    let (mut square, mut n) = (0.0, 0.0);
    for e in errors {
        square += e * e;
        n += 1.0;
    }
    assert!(n > 0.5 * (SIDE * SIDE) as f64, "{n} pixels have a value");
    (square / n).sqrt()
}

/// Angles of weakly polarized light with a noisy camera, with errors of 3° and 5°: the expected error equals the true
/// one.
#[test]
fn noise_of_angles_is_the_scatter_about_the_truth() {
    for (k, degree, noise) in [(1, 0.3, 300.0), (2, 0.15, 300.0)] {
        let dir = tempfile::tempdir().unwrap();
        let mut dice = Noise(k);
        let angle = 0.6 + 0.4 * k as f64;
        let frames: Vec<Value> = (0..9)
            .map(|n| {
                let psi = PI * f64::from(n) / 9.0;
                let light = 5000.0 * (1.0 + degree * (2.0 * (psi - angle)).cos());
                photograph(&dir.path().join(format!("{n}.png")), |_| light + noise * dice.next());
                json!({ "file": format!("{n}.png"), "analyser_deg": 20 * n })
            })
            .collect();
        described(dir.path(), "polarization", &frames);
        let said = report(&["reconstruct", "polarization", dir.path().to_str().unwrap()], dir.path());
        let map = read_exr(&dir.path().join("out/aolp.exr")).unwrap();
        let off = |a: f32| (f64::from(a) - angle + 1.5 * PI).rem_euclid(PI) - 0.5 * PI;
        let known = map.channels["aolp"].iter().zip(&map.channels["mask"]).filter(|(_, mask)| **mask == 1.0);
        let real = rms(known.map(|(a, _)| off(*a))).to_degrees();
        // σ(I)/(√(2N) B), with the amplitude B of the curve.
        let theory = (noise / (18_f64.sqrt() * 5000.0 * degree)).to_degrees();
        let error = said["error_estimate_deg"].as_f64().unwrap();
        // The scatter of thousands of pixels is known to 1 or 2 %. The theory covers all pixels, but those with weak
        // modulation are masked. The report states a median, with noise estimated from residuals.
        assert!(real > 2.0 && (real / theory - 1.0).abs() < 0.1, "{real} {theory}");
        assert!(error > 0.85 * real && error < 1.2 * real, "{error} {real}: {said}");
    }
}

/// Merged light from exposures with 10 and 30 % of noise.
#[test]
fn noise_of_merged_light_is_the_scatter_about_the_truth() {
    for (k, part) in [(3, 0.1), (4, 0.3)] {
        let dir = tempfile::tempdir().unwrap();
        let mut dice = Noise(k);
        let frames: Vec<Value> = [0.01, 0.02]
            .iter()
            .enumerate()
            .map(|(n, time)| {
                let light = 4000.0 * time / 0.01;
                photograph(&dir.path().join(format!("{n}.png")), |_| light * (1.0 + part * dice.next()));
                json!({ "file": format!("{n}.png"), "exposure_s": time })
            })
            .collect();
        described(dir.path(), "exposures", &frames);
        let said = report(&["reconstruct", "hdr", dir.path().to_str().unwrap()], dir.path());
        let merged = read_exr(&dir.path().join("out/hdr.exr")).unwrap();
        let light = &merged.channels["Y"];
        let mean = light.iter().map(|v| f64::from(*v)).sum::<f64>() / light.len() as f64;
        let real = rms(light.iter().map(|v| f64::from(*v) / mean - 1.0));
        let error = said["error_estimate"].as_f64().unwrap();
        // Here the noise is proportional to the light, but the noise model has only shot noise and a floor, so the
        // agreement is approximate. Merging two exposures leaves at least half of the noise of one.
        assert!(real > 0.5 * part && error > 0.8 * real && error < 1.3 * real, "{error} {real}: {said}");
    }
}

/// Two equal lobes on a diagonal: their matrix has two equal singular values, so that one term omits half of the
/// squares.
#[test]
fn one_term_of_a_table_that_does_not_separate_is_said_to_be_far_off() {
    let dir = tempfile::tempdir().unwrap();
    let table = dir.path().join("table.exr");
    let lobe = |x: f64, y: f64| (-0.5 * (x * x + y * y) / 0.05_f64.powi(2)).exp();
    let at = |i: usize| (i as f64 + 0.5) / SIDE as f64 - 0.5;
    let extent = [("extent", Attribute::Text("0.5".into()))];
    write_exr(&table, SIDE, SIDE, &["X", "Y", "Z"], &extent, &|_, y, row| {
        let y = at(y);
        row.iter_mut().enumerate().for_each(|(x, out)| {
            *out = (lobe(at(x) - 0.2, y - 0.2) + lobe(at(x) + 0.2, y + 0.2)) as f32;
        });
    })
    .unwrap();
    let args = ["factor", table.to_str().unwrap(), "--rank", "1", "--directions-deg", "0,90"];
    let said = report(&args, dir.path());
    let error = said["error"].as_f64().unwrap();
    // Both lobes have equal weight by symmetry; 5 % allows for the grid of the curves, which differs from the table's.
    assert!((error / 0.5_f64.sqrt() - 1.0).abs() < 0.05, "{error}: {said}");
    assert!(said["picture_error_point"].as_f64().unwrap() >= error, "{said}");
}
