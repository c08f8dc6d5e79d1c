//! Photographs a mosaic of gratings under fringes, reconstructs the period maps and compares them with the truth:
//! `spots SEED PIXELS COUNT PHASES FINEST_MM [KEY=VALUE…]`.

use nacre_periods::fringes::Settings;
use nacre_sim::BenchConfig;
use nacre_sim_charts::spots::{Shown, bench, judged};

#[allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "an example")]
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, usual: f64| args.get(i).and_then(|a| a.parse().ok()).unwrap_or(usual);
    let mut config: BenchConfig = bench(number(0, 1.0) as u64, number(1, 96.0) as u32);
    let shown = Shown {
        count: number(2, 12.0) as usize,
        phases: number(3, 4.0) as usize,
        finest_mm: number(4, 28.0),
        ..Shown::default()
    };
    let mut settings = Settings::default();
    for arg in args.iter().skip(5) {
        let (key, value) = arg.split_once('=').unwrap();
        let value: f64 = value.parse().unwrap();
        match key {
            "well" => config.camera.well_e = value,
            "baseline" => config.geometry.baseline_mm = value,
            "gamma" => config.panel.gamma = value,
            "bumps" => config.sample.bumps_deg = value,
            "depth" => config.sample.depth_um = value,
            "band" => config.filter.band_nm = value,
            "aperture" => config.camera.aperture_mm = value,
            "blur" => config.camera.blur_px = value,
            "period" => config.sample.period_um = Some(value),
            "nm" => settings.wavelength_nm = Some(value),
            "size" => config.sample.size_mm = Some(value),
            "mixed" => (config.sample.mixed_dots, config.sample.dot_um) = (value, None),
            "portrait" => config.panel.size_mm = [320.0, 520.0],
            _ => panic!("{key}"),
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let begun = std::time::Instant::now();
    let j = judged(&config, &shown, &settings, folder.path()).unwrap();
    println!(
        "period {:.3} % orientation {:.3}° masked {:.2} % wrong {:.4} % z {:.2} {:.2} promised {:.3} % {:.2} s (all {:.1} s)\n{:?}\naperture {} mirror {:?} residual {:?} response {:?} {:?}",
        100.0 * j.period,
        j.orientation_deg,
        100.0 * j.masked,
        100.0 * j.wrong,
        j.calibration[0],
        j.calibration[1],
        100.0 * j.promised,
        j.seconds,
        begun.elapsed().as_secs_f64(),
        j.report.pixels,
        j.report.aperture_mm,
        j.report.mirror_offset_deg,
        j.report.residual,
        j.report.response,
        j.report.seconds
    );
}
