//! Stacks of known values.

use super::Options;
use super::combine::row;
use nacre_base::operation::perform;
use nacre_base::progress::Silent;
use nacre_base::random::Stream;
use nacre_image::{read_exr, write_png16_gray};
use std::path::Path;

/// Writes `count` photographs of 40 × 30 pixels with normal noise (σ 20) about 1000; `spoiled` replaces values.
fn series(folder: &Path, count: usize, spoiled: impl Fn(usize, usize) -> Option<u16>) {
    let mut stream = Stream::of(5);
    let mut normal = || (-2.0 * (1.0 - stream.next()).ln()).sqrt() * (std::f64::consts::TAU * stream.next()).cos();
    for k in 0..count {
        let codes: Vec<u16> =
            (0..1200).map(|i| spoiled(k, i).unwrap_or((1000.0 + 20.0 * normal()).round() as u16)).collect();
        write_png16_gray(&folder.join(format!("{k:02}.png")), 40, 30, &codes).unwrap();
    }
}

#[test]
fn noise_is_measured_and_outliers_are_rejected() {
    for count in [6, 16] {
        let dir = tempfile::tempdir().unwrap();
        series(dir.path(), count, |k, i| (k == i % count && i % 7 == 0).then_some(60_000));
        let out = dir.path().join("out");
        let report = perform(&Options::default(), dir.path(), &out, false, &Silent).unwrap();
        let mean = read_exr(&out.join("mean.exr")).unwrap().channels["Y"].clone();
        let kept = read_exr(&out.join("kept.exr")).unwrap().channels["Y"].clone();
        let error = 20.0 / (count as f32).sqrt();
        // Six standard errors, exceeded with a probability of about 10⁻⁹.
        assert!(mean.iter().all(|v| (v - 1000.0).abs() < 6.0 * error), "{count}");
        let spoiled = (0..1200).filter(|i| i % 7 == 0).count() as f64;
        assert!((0..1200).filter(|i| i % 7 == 0).all(|i| kept[i] < count as f32));
        // Clipping rejects 0.15 % of the valid values of six photographs.
        let rejected = report.rejected * 1200.0 * count as f64;
        assert!(rejected < spoiled + 0.005 * 1200.0 * count as f64, "{count}: {rejected} {spoiled}");
        // The median standard deviation of six normal values is 0.93 of the true one.
        let sigma = report.sigma.unwrap();
        assert!((sigma / 20.0 - 1.0).abs() < 0.1, "{count}: {sigma}");
    }
}

#[test]
fn without_clipping_it_is_the_textbook() {
    let photographs = [vec![1.0, 5.0], vec![2.0, 5.0], vec![4.0, 5.0], vec![9.0, f32::NAN]];
    let found = row(&photographs, None, 0.0);
    assert_eq!((found[0].mean, found[0].median, found[0].kept), (4.0, 3.0, 4));
    assert!((found[0].sigma - (38.0_f32 / 3.0).sqrt()).abs() < 1e-6);
    assert_eq!((found[1].sigma, found[1].kept, found[1].given), (0.0, 3, 3));
}

#[test]
fn photographs_that_differ_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    series(dir.path(), 2, |_, _| None);
    write_png16_gray(&dir.path().join("other.png"), 4, 3, &[0; 12]).unwrap();
    let refused = perform(&Options::default(), dir.path(), &dir.path().join("out"), false, &Silent).unwrap_err();
    assert!(refused.to_string().contains("other.png"), "{refused}");
    assert!(!dir.path().join("out").exists());
}
