//! Brackets of known light.

use super::*;
use crate::NoiseModel;
use crate::{Calibration, FlatCalibration, Frame, FrameSet, Kind, Transfer, save};
use nacre_base::progress::Silent;
use nacre_image::registration::Align;
use nacre_image::{read_exr, write_exr, write_png8, write_png16_gray};
use std::path::Path;

/// Light of a scene of `width` × `height` pixels, 0 to `top`, log-uniform, in blocks with edges.
fn scene(width: usize, height: usize, low: f64, top: f64) -> Vec<f64> {
    let ramp = |i: usize| {
        let (x, y) = (i % width, i / width);
        let place = (x as f64 + 0.37 * (y as f64 * 1.7).sin()) / width as f64;
        low * (top / low).powf(place.clamp(0.0, 1.0))
    };
    (0..width * height).map(ramp).collect()
}

/// Photographs of a scene in several exposures by an 8-bit camera with this curve.
struct Bracket<'a> {
    light: &'a [f64],
    width: usize,
    times: &'a [f64],
    encode: &'a dyn Fn(f64) -> f64,
}

impl Bracket<'_> {
    fn write(&self, folder: &Path, transfer: Transfer) {
        let frames = self.times.iter().enumerate().map(|(k, time)| {
            let name = format!("{k}.png");
            let code = |l: &f64| ((self.encode)((l * time).min(1.0)) * 255.0).round() as u8;
            let codes: Vec<u8> = self.light.iter().map(code).collect();
            write_png8(&folder.join(&name), self.width, self.light.len() / self.width, 1, &codes).unwrap();
            Frame { exposure_s: Some(*time), ..Frame::new(name) }
        });
        let set = FrameSet { transfer, ..FrameSet::new(Kind::Exposures, frames.collect()) };
        std::fs::write(folder.join("frames.json"), save(&set)).unwrap();
    }
}

/// Root mean square relative error over pixels that `counts`.
fn error(merged: &[f32], light: &[f64], counts: impl Fn(f64) -> bool) -> f64 {
    let off = merged.iter().zip(light).filter(|(_, l)| counts(**l));
    let (sum, n) = off.fold((0.0, 0), |(s, n), (m, l)| (s + (f64::from(*m) / l - 1.0).powi(2), n + 1));
    (sum / f64::from(n)).sqrt()
}

fn channel(out: &Path, file: &str, name: &str) -> Vec<f32> {
    read_exr(&out.join(file)).unwrap().channels.remove(name).unwrap()
}

const TIMES: [f64; 5] = [1.0 / 256.0, 1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0, 1.0];

#[test]
fn a_bracket_of_known_response_is_right_to_its_rounding() {
    let dir = tempfile::tempdir().unwrap();
    let (width, height) = (1024, 256);
    let light = scene(width, height, 0.2, 250.0);
    let encode = |l: f64| l.powf(1.0 / 2.2);
    Bracket { light: &light, width, times: &TIMES, encode: &encode }.write(dir.path(), Transfer::Gamma(2.2));
    let out = dir.path().join("out");
    let options = Options { align: Align::Off, ..Options::default() };
    let report = reconstruct(dir.path(), &out, &options, &Silent).unwrap();
    let merged = channel(&out, "hdr.exr", "Y");
    // Restricted to light of at least a quarter of white in the longest exposure, and below white in the shortest.
    let off = error(&merged, &light, |l| l > 0.25);
    println!("RMS {:.4} %, {report:?}", 100.0 * off);
    assert!(off < 0.004, "{off}");
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    // The variance predicts the error.
    let variance = channel(&out, "variance.exr", "Y");
    let ratio = merged.iter().zip(&light).zip(&variance).filter(|((_, l), _)| **l > 0.25);
    let (sum, n) =
        ratio.fold((0.0, 0.0), |(s, n), ((m, l), v)| (s + (f64::from(*m) - l).powi(2) / f64::from(*v), n + 1.0));
    println!("chi2 {}", sum / n);
    assert!((0.8..1.25).contains(&(sum / n)), "{}", sum / n);
}

#[test]
fn responses_are_recovered() {
    let srgb = |l: f64| if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
    // A film-like curve: a power law with a shoulder below white.
    let film = |l: f64| (1.0 - (-2.5 * l.powf(0.6)).exp()) / (1.0 - (-2.5_f64).exp());
    let curves: [(&str, &dyn Fn(f64) -> f64); 4] =
        [("gamma 2.2", &|l| l.powf(1.0 / 2.2)), ("linear", &|l| l), ("sRGB", &srgb), ("film", &film)];
    for (name, encode) in curves {
        let dir = tempfile::tempdir().unwrap();
        let light = scene(512, 128, 0.02, 250.0);
        Bracket { light: &light, width: 512, times: &TIMES, encode }.write(dir.path(), Transfer::Recover);
        let out = dir.path().join("out");
        let options = Options { align: Align::Off, ..Options::default() };
        let report = reconstruct(dir.path(), &out, &options, &Silent).unwrap();
        let curve = Response::read(&out.join("response.json")).unwrap().curves.remove(0);
        // Light at which the camera shows each code, by bisection.
        let truth = |code: usize| {
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if encode(middle) * 255.0 < code as f64 { low = middle } else { high = middle }
            }
            low
        };
        let ratio: Vec<f64> = (8..=250).map(|k| f64::from(curve[k]) / truth(k)).collect();
        let mean = ratio.iter().sum::<f64>() / ratio.len() as f64;
        let rms = (ratio.iter().map(|r| (r / mean - 1.0).powi(2)).sum::<f64>() / ratio.len() as f64).sqrt();
        let worst = ratio.iter().map(|r| (r / mean - 1.0).abs()).fold(0.0, f64::max);
        println!(
            "{name}: RMS {:.3} %, worst {:.2} %, sigma {:?} chi2 {:?} {:?}",
            100.0 * rms,
            100.0 * worst,
            report.response_sigma,
            report.chi2,
            report.warnings
        );
        assert!(rms < 0.01, "{name}: {rms}");
    }
}

#[test]
fn noisy_cameras_are_recovered_from() {
    let light = scene(512, 128, 0.02, 250.0);
    // Noise in codes above black, as in JPEG photographs.
    for (black, noise) in [(0.0, 0.5), (0.0, 1.5), (5.0, 0.0), (5.0, 1.5)] {
        let dir = tempfile::tempdir().unwrap();
        let mut normal = rand_free::Normal(3);
        let frames = TIMES.iter().enumerate().map(|(k, time)| {
            let name = format!("{k}.png");
            let mut code = |l: &f64| {
                let level = (l * time).powf(1.0 / 2.2);
                (black + (255.0 - black) * level + noise * normal.next()).round().clamp(0.0, 255.0) as u8
            };
            let codes: Vec<u8> = light.iter().map(&mut code).collect();
            write_png8(&dir.path().join(&name), 512, 128, 1, &codes).unwrap();
            Frame { exposure_s: Some(*time), ..Frame::new(name) }
        });
        let set = FrameSet { transfer: Transfer::Recover, ..FrameSet::new(Kind::Exposures, frames.collect()) };
        std::fs::write(dir.path().join("frames.json"), save(&set)).unwrap();
        let out = dir.path().join("out");
        let options = Options { align: Align::Off, ..Options::default() };
        let report = reconstruct(dir.path(), &out, &options, &Silent).unwrap();
        let merged = channel(&out, "hdr.exr", "Y");
        // Relative to the merged light; rows are averaged, because noise is not tested here.
        let column = |x: usize| {
            let ratio = |y: usize| f64::from(merged[y * 512 + x]) / light[y * 512 + x];
            (0..128).map(ratio).sum::<f64>() / 128.0
        };
        // In the last columns, noise saturates some pixels of every exposure.
        let ratio: Vec<f64> = (160..490).map(column).collect();
        let mean = ratio.iter().sum::<f64>() / ratio.len() as f64;
        let worst = ratio.iter().map(|r| (r / mean - 1.0).abs()).fold(0.0, f64::max);
        let rms = (ratio.iter().map(|r| (r / mean - 1.0).powi(2)).sum::<f64>() / ratio.len() as f64).sqrt();
        println!("black {black} noise {noise}: RMS {:.2} %, worst {:.2} %", 100.0 * rms, 100.0 * worst);
        assert!(rms < 0.01 && worst < 0.02, "black {black} noise {noise}: {rms} {worst}");
        assert!(report.warnings.iter().all(|w| w.contains("saturated")), "{:?}", report.warnings);
    }
}

#[test]
fn saturated_and_dark_samples_are_flagged_and_black_is_subtracted() {
    let dir = tempfile::tempdir().unwrap();
    let (width, height, black) = (64, 32, 200.0_f64);
    // Left: darkness; middle: light that both exposures see; right: saturated in both.
    let light = |x: usize| [0.0, 0.01, 0.5, 40.0][x / 16];
    for (name, time) in [("long.png", 1.0), ("short.png", 0.1)] {
        let code = |x: usize| (black + (4095.0 - black) * light(x) * time).min(4095.0).round() as u16;
        let codes: Vec<u16> = (0..width * height).map(|i| code(i % width)).collect();
        write_png16_gray(&dir.path().join(name), width, height, &codes).unwrap();
    }
    let frames = [("long.png", 1.0), ("short.png", 0.1)];
    let frames = frames.map(|(name, time)| Frame { exposure_s: Some(time), ..Frame::new(name) }).to_vec();
    let noise = Some(NoiseModel { full_scale_e: 20_000.0, read_noise_e: 5.0 });
    let set = FrameSet { black: Some(black), white: Some(4095.0), noise, ..FrameSet::new(Kind::Exposures, frames) };
    std::fs::write(dir.path().join("frames.json"), save(&set)).unwrap();
    let out = dir.path().join("out");
    let report = reconstruct(dir.path(), &out, &Options::default(), &Silent).unwrap();
    let (merged, flags) = (channel(&out, "hdr.exr", "Y"), channel(&out, "flags.exr", "Y"));
    for (x, expected, flag) in [(5, 0.0, 2.0), (20, 0.01, 0.0), (40, 0.5, 0.0), (60, f32::NAN, 1.0)] {
        let value = merged[3 * width + x];
        // One code of the longer exposure.
        assert!(value.is_nan() && expected.is_nan() || (value - expected).abs() < 3e-4, "{x}: {value}");
        assert_eq!(flags[3 * width + x], flag, "{x}");
    }
    assert_eq!((report.samples.saturated, report.samples.dark), (16 * height, 16 * height));
    assert!(report.warnings.iter().any(|w| w.contains("512 samples (25.00 %) are saturated")), "{:?}", report.warnings);
}

#[test]
fn a_wrong_time_and_a_wrong_response_are_noticed() {
    let dir = tempfile::tempdir().unwrap();
    let light = scene(256, 128, 0.2, 250.0);
    let encode = |l: f64| l.powf(1.0 / 2.2);
    let bracket = Bracket { light: &light, width: 256, times: &TIMES, encode: &encode };
    bracket.write(dir.path(), Transfer::Gamma(2.2));
    let path = dir.path().join("frames.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("0.0625", "0.07")).unwrap();
    let options = Options { align: Align::Off, ..Options::default() };
    let report = reconstruct(dir.path(), &dir.path().join("time"), &options, &Silent).unwrap();
    // 1/16 s, stated as 0.07 s.
    let gain = report.frames[2].gain.unwrap()[0];
    assert!((gain - 0.0625 / 0.07).abs() < 0.02, "{gain}");
    assert!(report.warnings.iter().any(|w| w.contains("2.png") && w.contains("darker")), "{:?}", report.warnings);
    std::fs::write(&path, text.replace("\"gamma\":2.2", "\"gamma\":1.8")).unwrap();
    let report = reconstruct(dir.path(), &dir.path().join("response"), &options, &Silent).unwrap();
    assert!(report.warnings.iter().any(|w| w.contains("response")), "{:?}", report.warnings);
}

#[test]
fn shot_noise_is_weighted_without_bias() {
    merged_noise(None);
}

#[test]
fn the_noise_of_a_flat_field_is_in_the_variance() {
    merged_noise(Some(0.03));
}

/// Checks means and variances of merged exposures; `flat` is the standard deviation of a flat field.
fn merged_noise(flat: Option<f64>) {
    use rand_free::Normal;
    let dir = tempfile::tempdir().unwrap();
    let (width, height, full) = (256, 256, 2000.0_f64);
    let mut normal = Normal(7);
    let times = [1.0, 0.25_f64];
    let levels = [0.0, 0.004, 0.02, 0.1, 0.5, 2.0_f64];
    let light = |i: usize| levels[(i % width) * levels.len() / width];
    for (k, time) in times.iter().enumerate() {
        let mut code = |i: usize| {
            let electrons = light(i) * time * full;
            let signal = electrons + normal.next() * (electrons + 9.0).sqrt();
            (500.0 + 60_000.0 * signal / full).clamp(0.0, 60_500.0).round() as u16
        };
        let codes: Vec<u16> = (0..width * height).map(&mut code).collect();
        write_png16_gray(&dir.path().join(format!("{k}.png")), width, height, &codes).unwrap();
    }
    let frames = times.iter().enumerate();
    let frames = frames.map(|(k, t)| Frame { exposure_s: Some(*t), ..Frame::new(format!("{k}.png")) }).collect();
    let noise = Some(NoiseModel { full_scale_e: full, read_noise_e: 3.0 });
    let mut set =
        FrameSet { black: Some(500.0), white: Some(60_500.0), noise, ..FrameSet::new(Kind::Exposures, frames) };
    if let Some(sigma) = flat {
        let field: Vec<f32> = (0..width * height).map(|_| (1.0 + sigma * normal.next()) as f32).collect();
        let row = |_: usize, y: usize, row: &mut [f32]| row.copy_from_slice(&field[y * width..][..width]);
        write_exr(&dir.path().join("flat.exr"), width, height, &["Y"], &[], &row).unwrap();
        set.flat = Some("flat.exr".into());
        let flat = FlatCalibration { source: None, file: "flat.exr".into(), sigma };
        set.calibration = Some(Calibration { flat: Some(flat), ..Calibration::default() });
    }
    std::fs::write(dir.path().join("frames.json"), save(&set)).unwrap();
    let out = dir.path().join("out");
    let options = Options { align: Align::Off, ..Options::default() };
    let report = reconstruct(dir.path(), &out, &options, &Silent).unwrap();
    let (merged, variance) = (channel(&out, "hdr.exr", "Y"), channel(&out, "variance.exr", "Y"));
    for (level, truth) in levels.iter().enumerate() {
        let of = |i: &usize| (i % width) * levels.len() / width == level;
        let all: Vec<usize> = (0..width * height).filter(of).collect();
        let n = all.len() as f64;
        let mean = all.iter().map(|i| f64::from(merged[*i])).sum::<f64>() / n;
        let scatter = all.iter().map(|i| (f64::from(merged[*i]) - mean).powi(2)).sum::<f64>() / n;
        let said = all.iter().map(|i| f64::from(variance[*i])).sum::<f64>() / n;
        let off = (mean - truth) / (scatter / n).sqrt();
        println!("{truth}: mean {mean:.6} off {off:.1} sigma, variance {:.2} of the scatter", said / scatter);
        // A tenth of a pixel's standard deviation, which is many standard deviations of the mean.
        assert!((mean - truth).abs() < 0.1 * scatter.sqrt(), "{truth}: {mean}");
        assert!((0.8..1.25).contains(&(said / scatter)), "{truth}: {said} {scatter}");
    }
    assert!(report.chi2.is_some_and(|c| (0.8..1.25).contains(&c)), "{:?}", report.chi2);
    // Neither exposure is reported as too bright, although noise exceeds most of the light.
    for gain in report.frames.iter().filter_map(|f| f.gain) {
        assert!((gain[0] - 1.0).abs() < 5.0 * gain[1].max(2e-3), "{gain:?}");
    }
}

#[test]
fn light_that_is_subtracted_leaves_its_noise() {
    let dir = tempfile::tempdir().unwrap();
    let (width, height, full, light) = (256, 128, 2000.0_f64, 0.05);
    let mut normal = rand_free::Normal(11);
    let times = [1.0, 0.25_f64];
    // Ambient light is five times the measured light, and varies over the image.
    let ambient = |i: usize| 0.25 * (i % width) as f64 / width as f64;
    let mut write = |name: String, electrons: &dyn Fn(usize) -> f64| {
        let mut code = |i: usize| {
            let signal = electrons(i) + normal.next() * (electrons(i) + 9.0).sqrt();
            (500.0 + 60_000.0 * signal / full).clamp(0.0, 60_500.0).round() as u16
        };
        let codes: Vec<u16> = (0..width * height).map(&mut code).collect();
        write_png16_gray(&dir.path().join(&name), width, height, &codes).unwrap();
        name
    };
    let mut frames = vec![];
    for (k, time) in times.into_iter().enumerate() {
        let file = write(format!("{k}.png"), &|i| (light + ambient(i)) * time * full);
        let dark = write(format!("dark{k}.png"), &|i| ambient(i) * time * full);
        frames.push(Frame { exposure_s: Some(time), dark: Some(dark.into()), ..Frame::new(file) });
    }
    let noise = Some(NoiseModel { full_scale_e: full, read_noise_e: 3.0 });
    let set = FrameSet { black: Some(500.0), white: Some(60_500.0), noise, ..FrameSet::new(Kind::Exposures, frames) };
    std::fs::write(dir.path().join("frames.json"), save(&set)).unwrap();
    let out = dir.path().join("out");
    let options = Options { align: Align::Off, ..Options::default() };
    let report = reconstruct(dir.path(), &out, &options, &Silent).unwrap();
    let (merged, variance) = (channel(&out, "hdr.exr", "Y"), channel(&out, "variance.exr", "Y"));
    let all = merged.iter().zip(&variance);
    let chi2 = all.map(|(m, v)| (f64::from(*m) - light).powi(2) / f64::from(*v)).sum::<f64>() / merged.len() as f64;
    let mean = merged.iter().map(|m| f64::from(*m)).sum::<f64>() / merged.len() as f64;
    assert!((0.9..1.1).contains(&chi2) && (mean / light - 1.0).abs() < 0.01, "{chi2} {mean}");
    assert!(report.chi2.is_some_and(|c| (0.8..1.25).contains(&c)), "{:?}", report.chi2);
}

/// Normal deviates from a seed.
mod rand_free {
    pub struct Normal(pub u64);

    impl Normal {
        fn uniform(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        }

        pub fn next(&mut self) -> f64 {
            (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
        }
    }
}

/// 12-bit data in 16-bit files: the warning names the clipping value and the flag that sets it; pixels at that value
/// are then masked.
#[test]
fn photographs_that_clip_below_white_are_named_until_white_is_given() {
    let dir = tempfile::tempdir().unwrap();
    let (width, height) = (64, 64);
    let ramp = |time: f64| -> Vec<u16> {
        let codes = (0..width * height).map(|i| (4095.0 * time * i as f64 / 2000.0).min(4095.0).round() as u16);
        codes.collect()
    };
    let frames = [("long.png", 1.0), ("short.png", 0.7)].map(|(name, time)| {
        write_png16_gray(&dir.path().join(name), width, height, &ramp(time)).unwrap();
        Frame { exposure_s: Some(time), ..Frame::new(name) }
    });
    std::fs::write(dir.path().join("frames.json"), save(&FrameSet::new(Kind::Exposures, frames.to_vec()))).unwrap();
    let merged = |white, out: &str| {
        let options = Options { white, align: Align::Off, ..Options::default() };
        reconstruct(dir.path(), &dir.path().join(out), &options, &Silent)
    };
    let warned = |report: &Report| report.warnings.iter().any(|w| w.contains("give --white 4095"));
    let unknown = merged(None, "unknown").unwrap();
    assert!(warned(&unknown) && unknown.samples.saturated == 0, "{:?}", unknown.warnings);
    let known = merged(Some(4095.0), "known").unwrap();
    let clipped = ramp(0.7).iter().filter(|code| **code == 4095).count();
    assert!(!warned(&known) && known.samples.saturated == clipped, "{:?}", known.warnings);
    let refused = merged(Some(-1.0), "refused").unwrap_err().to_string();
    assert!(refused.contains("--white") && refused.contains("not above black"), "{refused}");
}

/// A single photograph: contradictions between its file's statements and the options are warnings, as for sets.
#[test]
fn statements_of_a_single_photograph_are_warnings() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.png");
    write_png8(&path, 8, 4, 1, &[9; 32]).unwrap();
    let source = || Source::find(&path, &Silent).unwrap();
    assert!(source().warnings(Transfer::Linear).is_empty());
    let file = std::fs::read(&path).unwrap();
    // After the header: an sRGB chunk with its checksum.
    let stated = [&file[..33], b"\0\0\0\x01sRGB\0\xae\xce\x1c\xe9", &file[33..]].concat();
    std::fs::write(&path, stated).unwrap();
    let warnings = source().warnings(Transfer::Linear);
    assert!(warnings.len() == 1 && warnings[0].contains("x.png states transfer srgb"), "{warnings:?}");
    assert!(source().warnings(Transfer::Srgb).is_empty());
}
