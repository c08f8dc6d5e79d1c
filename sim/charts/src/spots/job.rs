//! A mosaic of gratings on the simulated bench, photographed under fringes and reconstructed from files to files, as a
//! user would.

use nacre_base::progress::Silent;
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_drivers::Pattern;
use nacre_frames::{Distances, Frame, FrameSet, Fringes, Kind, save};
use nacre_image::{read_exr, write_png16_gray};
use nacre_periods::fringes::{Report, Settings, frequencies, reconstruct};
use nacre_polarimetry::{NoiseModel, angle_difference};
use nacre_sim::BenchConfig;
use nacre_sim::Truth;
use nacre_sim::surface::SampleKind;
use nacre_sim::{Bench, Shining};
use std::path::Path;
use std::time::{Duration, Instant};

/// Brightest code relative to white.
const EXPOSED: f64 = 0.85;
/// Subpixels per pixel side in the reference map, and radius in pixels of the optical mixing.
const FINE: u32 = 4;
const BLUR: usize = 2;

/// Fringe patterns on the display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Number of fringe periods.
    pub count: usize,
    /// Phase steps of each period.
    pub phases: usize,
    /// Finest fringe period in mm.
    pub finest_mm: f64,
    /// Assumed exponent (gamma) of the display.
    pub gamma: f64,
}

impl Default for Shown {
    fn default() -> Self {
        Self { count: 12, phases: 4, finest_mm: 28.0, gamma: 2.2 }
    }
}

/// Errors of the reconstructed maps.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Median relative error of the period.
    pub period: f64,
    /// Median error of the orientation in degrees.
    pub orientation_deg: f64,
    /// Fraction of pixels without a result.
    pub masked: f64,
    /// Fraction of confidently wrong pixels. Their result deviates from all values mixed in the pixel by more than 5 σ
    /// and by more than 2 % or 1°.
    pub wrong: f64,
    /// Median of |error| / σ, of period and orientation; 0.67 for normal errors.
    pub calibration: [f64; 2],
    /// Median relative σ of the period.
    pub promised: f64,
    /// Duration of the reconstruction in s.
    pub seconds: f64,
    /// Report of the reconstruction.
    pub report: Report,
}

/// The reference bench: a display of 52 × 32 cm at 25 cm from a mosaic of 1.2 to 3 µm, at 560 nm.
pub fn bench(seed: u64, pixels: u32) -> BenchConfig {
    let mut bench = BenchConfig { seed, ..BenchConfig::default() };
    bench.sample.kind = SampleKind::Mosaic;
    bench.panel.size_mm = [520.0, 320.0];
    bench.filter.wavelength_nm = 560.0;
    (bench.geometry.distance_mm, bench.geometry.baseline_mm) = (250.0, 100.0);
    (bench.camera.width, bench.camera.height) = (pixels, pixels);
    bench
}

/// Takes the photographs and reconstructs the maps; `folder` must be empty.
///
/// # Errors
/// As [`reconstruct`]; `Output` if the folder is not writable.
pub fn judged(config: &BenchConfig, shown: &Shown, settings: &Settings, folder: &Path) -> Result<Judged> {
    judged_with_nominal_bench(config, config, shown, settings, folder)
}

/// As [`judged`], but `frames.json` describes another bench.
pub(super) fn judged_with_nominal_bench(
    config: &BenchConfig,
    nominal: &BenchConfig,
    shown: &Shown,
    settings: &Settings,
    folder: &Path,
) -> Result<Judged> {
    let mut bench = Bench::new(config, &Silent)?;
    photograph(&mut bench, nominal, shown, folder)?;
    let begun = Instant::now();
    let out = folder.join("result");
    let report = reconstruct(folder, &out, settings, &Silent)?;
    let seconds = begun.elapsed().as_secs_f64();
    let take = |name: &str, channel: &str| {
        let path = out.join(name);
        read_exr(&path)?.take(channel, &path)
    };
    let turn = [take("orientation.exr", "orientation")?, take("orientation.exr", "sigma")?];
    let period = [take("period.exr", "period")?, take("period.exr", "sigma")?];
    let truth = bench.truth();
    let (width, count) = (config.camera.width as usize, truth.period_um.len());
    // The reference keeps all values mixed in a pixel, not their mean.
    let mut fine = config.clone();
    (fine.camera.width, fine.camera.height) = (FINE * config.camera.width, FINE * config.camera.height);
    fine.camera.subsamples = 1;
    let fine = Bench::new(&fine, &Silent)?;
    let parts = fine.truth();
    let off = |truth: &Truth, i: usize, k: usize| {
        let turned = angle_difference(turn[0][i].into(), truth.orientation[k].into()).abs();
        let relative = (f64::from(period[0][i]) / f64::from(truth.period_um[k]) - 1.0).abs();
        [relative, turned]
    };
    let (mut errors, mut calibration, mut promised, mut wrong) = ([vec![], vec![]], [vec![], vec![]], vec![], 0);
    let known = |i: &usize| period[0][*i].is_finite();
    for i in (0..count).filter(known) {
        let sigmas = [f64::from(period[1][i] / period[0][i]), f64::from(turn[1][i])];
        let [x, y] = [i % width, i / width];
        // Values within the radius of the lens blur count as mixed in the pixel.
        let reach = |at: usize, side: usize| {
            let fine = FINE as usize;
            (fine * at).saturating_sub(BLUR * fine)..(fine * (at + 1 + BLUR)).min(fine * side)
        };
        let fine_width = FINE as usize * width;
        let around = reach(y, count / width).flat_map(|y| reach(x, width).map(move |x| y * fine_width + x));
        let is_off = |[p, t]: [f64; 2]| p > (5.0 * sigmas[0]).max(0.02) || t > (5.0 * sigmas[1]).max(1f64.to_radians());
        wrong += usize::from(around.map(|k| off(parts, i, k)).all(is_off));
        let own = off(truth, i, i);
        for part in 0..2 {
            errors[part].push(own[part]);
            calibration[part].push(own[part] / sigmas[part]);
        }
        promised.push(sigmas[0]);
    }
    let middle = |values: Vec<f64>| median(values).unwrap_or(f64::NAN);
    let [period_errors, turn_errors] = errors;
    let answered = promised.len() as f64;
    Ok(Judged {
        period: middle(period_errors),
        orientation_deg: middle(turn_errors).to_degrees(),
        masked: 1.0 - answered / count as f64,
        wrong: wrong as f64 / count as f64,
        calibration: calibration.map(middle),
        promised: middle(promised),
        seconds,
        report,
    })
}

/// Writes photographs of fringes into `folder`, with a `frames.json` that describes the bench `config`.
///
/// # Errors
/// `Output` if the folder is not writable.
pub fn photograph(bench: &mut Bench, config: &BenchConfig, shown: &Shown, folder: &Path) -> Result<()> {
    let camera = &config.camera;
    let (black, white) = (f64::from(camera.black_level), f64::from((1u32 << camera.bits) - 1));
    let gamma = shown.gamma;
    let pattern = |cycles_per_mm, phase| Pattern::Fringes { cycles_per_mm, phase, gamma };
    let mut exposure_s = 1e-3;
    for _ in 0..4 {
        let brightest = codes(bench, pattern([0.0; 2], 0.0), exposure_s)?.into_iter().max().unwrap_or(0);
        let level = (f64::from(brightest) - black).max(1.0) / (white - black);
        exposure_s *= (EXPOSED / level).clamp(0.1, 20.0);
    }
    let even = [0.0, 0.25, 1.0 / 3.0].into_iter().map(|phase| ([0.0; 2], phase));
    let phases = shown.phases;
    let moving = frequencies(shown.count, shown.finest_mm)
        .into_iter()
        .flat_map(|f| (0..phases).map(move |k| (f, k as f64 / phases as f64)));
    let mut frames = vec![];
    let write = |name: &str, codes: &[u16]| {
        write_png16_gray(&folder.join(name), camera.width as usize, camera.height as usize, codes)
    };
    write("black.png", &codes(bench, Pattern::Black, exposure_s)?)?;
    for (k, (cycles_per_mm, phase)) in even.chain(moving).enumerate() {
        let file = format!("{k:03}.png");
        write(&file, &codes(bench, pattern(cycles_per_mm, phase), exposure_s)?)?;
        let fringes = Some(Fringes { cycles_per_mm, phase });
        frames.push(Frame { fringes, exposure_s: Some(exposure_s), ..Frame::new(file) });
    }
    let set = FrameSet {
        black: Some(black),
        white: Some(white),
        dark: Some("black.png".into()),
        noise: Some(NoiseModel { full_scale_e: camera.well_e, read_noise_e: camera.read_noise_e }),
        wavelength_nm: Some(config.filter.wavelength_nm),
        band_nm: Some(config.filter.band_nm).filter(|b| *b > 0.0),
        geometry: Some(Distances {
            distance_mm: config.geometry.distance_mm,
            baseline_mm: config.geometry.baseline_mm,
            pixel_um: Some(bench.pixel_um()),
            camera_px: None,
        }),
        panel_mm: Some(config.panel.size_mm),
        ..FrameSet::new(Kind::Spots, frames)
    };
    let path = folder.join("frames.json");
    std::fs::write(&path, save(&set)).map_err(|e| Error::output(&path, e))
}

/// Takes one photograph of a pattern.
fn codes(bench: &mut Bench, pattern: Pattern, exposure_s: f64) -> Result<Vec<u16>> {
    bench.set_camera(exposure_s, 1.0);
    bench.shine(Shining { pattern, flash: false, covered: false }, Duration::ZERO);
    let shown = bench.now();
    // The camera's latency takes tens of frames at most.
    for _ in 0..100_000 {
        bench.advance_to(bench.next_frame_at());
        while let Some(frame) = bench.take_frame() {
            if frame.start >= shown && frame.settings.exposure_s == exposure_s {
                return Ok(bench.codes(&frame));
            }
        }
    }
    Err(Error::input("camera", "sends no frame in time", "report this"))
}
