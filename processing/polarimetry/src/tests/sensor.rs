//! Tests with raw frames of polarization sensors: super-pixels, colour filters, interpolated images, and whether σ
//! matches the scatter of errors.

use crate::synthetic::normal;
use crate::tests::bracket::write_set;
use crate::{AppliedCorrections, Demosaic, Model, Options, Report, angle_difference, probe, reconstruct};
use nacre_base::operation::perform;
use nacre_base::progress::Silent;
use nacre_frames::{Channel, Frame, FrameSet, Kind, Layout, NoiseModel, Sensor, load};
use nacre_image::{encode_png16_gray, read_exr};
use std::collections::BTreeMap;
use std::path::Path;

const CAMERA: NoiseModel = NoiseModel { full_scale_e: 10_000.0, read_noise_e: 5.0 };
const SIDE: usize = 256;
const DOLP: f64 = 0.4;

/// Intensity behind red, green and blue filters, and polarization angle in rad of each.
const COLOURS: [(f64, f64); 3] = [(0.3, 0.2), (0.8, 1.1), (0.5, 2.5)];

/// Photographs `count` frames of uniform light with a sensor of Sony's layout.
fn photograph(folder: &Path, layout: Sensor, count: u64, noise: Option<NoiseModel>) {
    let angles = [90.0_f64, 45.0, 135.0, 0.0].map(f64::to_radians);
    let code = |frame: u64, i: usize| {
        let (x, y) = (i % SIDE, i / SIDE);
        let colour = if layout == Sensor::SonyColour { [0, 1, 1, 2][x / 2 % 2 + 2 * (y / 2 % 2)] } else { 1 };
        let (light, aolp) = COLOURS[colour];
        let light = 0.5 * light * (1.0 + DOLP * (2.0 * (angles[x % 2 + 2 * (y % 2)] - aolp)).cos());
        let sigma = (light / CAMERA.full_scale_e + (CAMERA.read_noise_e / CAMERA.full_scale_e).powi(2)).sqrt();
        ((light + sigma * normal(frame + 1, i as u64)) * 65_535.0).round() as u16
    };
    let frame = |k: u64| {
        let name = format!("{k}.png");
        let codes: Vec<u16> = (0..SIDE * SIDE).map(|i| code(k, i)).collect();
        std::fs::write(folder.join(&name), encode_png16_gray(SIDE, SIDE, &codes).unwrap()).unwrap();
        Frame::new(name)
    };
    let frames = (0..count).map(frame).collect();
    write_set(
        folder,
        &FrameSet { layout: Some(Layout::Named(layout)), noise, ..FrameSet::new(Kind::DivisionOfFocalPlane, frames) },
    );
}

fn maps(folder: &Path, demosaic: Demosaic) -> (Report, BTreeMap<String, Vec<f32>>) {
    let out = folder.join("out");
    let options = Options { demosaic, ..Options::default() };
    let report = perform(&options, folder, &out, true, &Silent).unwrap();
    let mut planes = read_exr(&out.join("aolp.exr")).unwrap().channels;
    planes.append(&mut read_exr(&out.join("stokes.exr")).unwrap().channels);
    (report, planes.into_iter().collect())
}

/// Root mean square of σ relative to that of the errors.
fn calibration(planes: &BTreeMap<String, Vec<f32>>, aolp: f64) -> f64 {
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
    let errors = square(&mut planes["aolp"].iter().map(|v| angle_difference(f64::from(*v), aolp)));
    (square(&mut planes["sigma"].iter().map(|v| f64::from(*v))) / errors).sqrt()
}

/// With given noise, and with noise estimated from one frame and from two.
#[test]
fn sigma_equals_the_scatter_of_interpolated_pixels() {
    for (count, noise) in [(1, Some(CAMERA)), (1, None), (2, None)] {
        let folder = tempfile::tempdir().unwrap();
        photograph(folder.path(), Sensor::Lucid, count, noise);
        for demosaic in [Demosaic::None, Demosaic::Bilinear, Demosaic::EdgeAware] {
            let (report, planes) = maps(folder.path(), demosaic);
            let side = if demosaic == Demosaic::None { SIDE / 2 } else { SIDE };
            assert_eq!((report.width, report.height), (side, side));
            assert!(!report.warnings.iter().any(|w| w.contains("halves")), "{:?}", report.warnings);
            let ratio = calibration(&planes, COLOURS[1].1);
            // 16,384 independent pixels determine scatter and noise to 0.6 % each. Edge-aware images at one position
            // are correlated. The median of their residuals, from which noise is estimated, is below that of
            // independent images with the same mean. For two frames the difference is largest, 6 %.
            let exactness = if count > 1 && demosaic == Demosaic::EdgeAware { 0.08 } else { 0.03 };
            assert!(
                (ratio - 1.0).abs() < exactness,
                "{count} frames, {demosaic:?}, {:?}: {ratio}",
                report.noise.source
            );
        }
    }
}

#[test]
fn colours_of_a_sensor_are_measured_apart() {
    let folder = tempfile::tempdir().unwrap();
    photograph(folder.path(), Sensor::SonyColour, 1, Some(CAMERA));
    let described = load(folder.path()).unwrap().set;
    assert_eq!(described.channel, Some(Channel::G), "the default");
    for (channel, (light, aolp)) in [Channel::R, Channel::G, Channel::B].into_iter().zip(COLOURS) {
        write_set(folder.path(), &FrameSet { channel: Some(channel), ..described.clone() });
        let (report, planes) = maps(folder.path(), Demosaic::None);
        assert_eq!((report.width, report.height), (SIDE / 4, SIDE / 4));
        let sensor = report.sensor.unwrap();
        assert_eq!((sensor.superpixel_px, sensor.map_pixel_px, sensor.channel), (4, 4, Some(channel)));
        let s0 = planes["S0"].iter().map(|v| f64::from(*v)).sum::<f64>() / planes["S0"].len() as f64;
        assert!((s0 / light - 1.0).abs() < 2e-3, "{channel:?}: {s0}");
        // Two green pixels are averaged.
        let ratio = calibration(&planes, aolp);
        assert!((ratio - 1.0).abs() < 0.05, "{channel:?}: {ratio}");
    }
    write_set(folder.path(), &FrameSet { channel: Some(Channel::Luminance), ..described });
    let (_, planes) = maps(folder.path(), Demosaic::None);
    let mean = |name: &str| planes[name].iter().map(|v| f64::from(*v)).sum::<f64>() / planes[name].len() as f64;
    let wanted = |of: fn(f64) -> f64| {
        let [r, g, b] = COLOURS.map(|(light, aolp)| light * DOLP * of(2.0 * aolp));
        (r + 2.0 * g + b) / 4.0
    };
    assert!((mean("S1") - wanted(f64::cos)).abs() < 1e-3 && (mean("S2") - wanted(f64::sin)).abs() < 1e-3);
}

/// The probe of a pixel shows the data of its map pixel.
#[test]
fn a_probed_pixel_is_that_of_the_maps() {
    for (layout, demosaic) in [
        (Sensor::Sony, Demosaic::None),
        (Sensor::Sony, Demosaic::Bilinear),
        (Sensor::Sony, Demosaic::EdgeAware),
        (Sensor::SonyColour, Demosaic::None),
    ] {
        let folder = tempfile::tempdir().unwrap();
        photograph(folder.path(), layout, 1, None);
        let (report, planes) = maps(folder.path(), demosaic);
        let applied = AppliedCorrections::read(&folder.path().join("out")).unwrap();
        let (x, y) = (report.width - 1, 7);
        let found = probe(&load(folder.path()).unwrap(), [x, y], &applied).unwrap();
        for (name, value) in [("S0", found.s0), ("S1", found.s1), ("S2", found.s2)] {
            let map = f64::from(planes[name][y * report.width + x]);
            assert!((map - value).abs() < 1e-6, "{layout:?} {demosaic:?} {name}: {map} {value}");
        }
    }
}

#[test]
fn interpolation_is_refused_where_it_has_no_meaning() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |options: Options| {
        reconstruct(folder.path(), &folder.path().join("bad"), &options, &Silent).unwrap_err().to_string()
    };
    let bilinear = || Options { demosaic: Demosaic::Bilinear, ..Options::default() };
    photograph(folder.path(), Sensor::SonyColour, 1, None);
    assert!(refused(bilinear()).contains("colour filters"));
    photograph(folder.path(), Sensor::Sony, 2, None);
    assert!(refused(Options { model: Some(Model::Auto), ..bilinear() }).contains("--model plain"));
    let mut set = load(folder.path()).unwrap().set;
    set.frames[0].exposure_s = Some(8.0);
    write_set(folder.path(), &set);
    assert!(refused(bilinear()).contains("exposures"));
    set.frames.iter_mut().zip([0.0, 60.0]).for_each(|(f, angle)| f.analyser_deg = Some(angle));
    (set.kind, set.layout) = (Kind::Polarization, None);
    write_set(folder.path(), &set);
    assert!(refused(bilinear()).contains("polarization sensors"));
}
