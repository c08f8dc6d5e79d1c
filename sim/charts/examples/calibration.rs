//! Calibrates random benches: `calibration SEED DRAWS [SESSIONS]`; prints the errors of all quantities in standard
//! deviations, and the errors of absolute orientations of sessions on calibrated, ideal and uncalibrated benches.

use nacre_frames::Calibration;
use nacre_sim_charts::bench_calibration::{Absolute, Checked, absolute, bench, calibrated, ideal};
use std::collections::BTreeMap;

#[allow(clippy::unwrap_used, clippy::print_stdout, reason = "an example")]
fn main() {
    let args: Vec<u64> = std::env::args().skip(1).map(|a| a.parse().unwrap()).collect();
    let number = |i: usize, usual: u64| args.get(i).copied().unwrap_or(usual);
    let (first, draws, sessions) = (number(0, 1), number(1, 100), number(2, 0));
    let mut all: BTreeMap<&str, Vec<Checked>> = BTreeMap::new();
    for seed in first..first + draws {
        let place = tempfile::tempdir().unwrap();
        let kept = std::env::var_os("KEEP").map(|keep| std::path::Path::new(&keep).join(seed.to_string()));
        let folder = kept.as_deref().unwrap_or(place.path());
        match calibrated(&bench(seed), seed, folder) {
            Ok((found, calibration)) => {
                if seed < first + sessions {
                    let bench = bench(seed);
                    let camera = Calibration { camera: calibration.camera.clone(), ..Calibration::default() };
                    let without = folder.join("without");
                    let [of_ideal, uncalibrated] = [(ideal(&bench), "ideal"), (bench.clone(), "uncalibrated")]
                        .map(|(bench, name)| absolute(&bench, &camera, &without.join(name)));
                    let found = absolute(&bench, &calibration, &folder.join("with"));
                    let text = |a: Result<Absolute, _>| match a {
                        Ok(a) => format!(
                            "{:.3}° (expected {:.3}°; relative {:.3}°, offset {:.3}°)",
                            a.median_deg, a.expected_deg, a.relative_deg, a.offset_deg
                        ),
                        Err::<_, nacre_base::Error>(error) => error.to_string(),
                    };
                    println!(
                        "seed {seed}: absolute orientations on the ideal bench {}, calibrated {}, uncalibrated {}",
                        text(of_ideal),
                        text(found),
                        text(uncalibrated)
                    );
                }
                for checked in found {
                    let off = (checked.measured.value - checked.truth).abs();
                    if off > 3.0 * checked.measured.sigma {
                        println!("seed {seed}: {checked:?}");
                    }
                    all.entry(checked.name).or_default().push(checked);
                }
            }
            Err(error) => println!("seed {seed}: {error}"),
        }
    }
    for (name, found) in all {
        let within = found.iter().filter(|c| (c.measured.value - c.truth).abs() <= 3.0 * c.measured.sigma).count();
        let worst = found.iter().map(|c| (c.measured.value - c.truth).abs()).fold(0.0, f64::max);
        let relative = found.iter().map(|c| (c.measured.value / c.truth - 1.0).abs()).fold(0.0, f64::max);
        let rms = (found.iter().map(|c| ((c.measured.value - c.truth) / c.measured.sigma).powi(2)).sum::<f64>()
            / found.len() as f64)
            .sqrt();
        println!(
            "{name:24} {within:3} of {:3} within 3σ, largest error {worst:.4} ({:.2} %), rms {rms:.2} σ",
            found.len(),
            100.0 * relative
        );
    }
}
