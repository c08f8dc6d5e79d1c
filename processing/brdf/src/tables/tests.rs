//! Tables against the BRDF, and files as other programs read them.

#![allow(clippy::unwrap_used, reason = "tests")]

use super::*;
use crate::height::{Profile, Shape, Synthetic};
use nacre_base::progress::Silent;

/// A shallow grating of 2 µm along x.
fn grating() -> (HeightField, Quality) {
    let shape = Shape::Grating(Profile::Sinusoid);
    let field =
        Synthetic { shape, pixels: 80, pixel_um: 0.05, period_um: 2.0, depth_um: 0.1, angle: 0.0 }.field().unwrap();
    let quality = Quality::of(&field, 8.0);
    (field, quality)
}

#[test]
fn a_tensor_holds_the_brdf_at_its_entries() {
    let place = tempfile::tempdir().unwrap();
    let (field, quality) = grating();
    let out = place.path().join("grating.bsdf");
    let settings = Settings::default();
    let table = measured(&field, &quality, &settings, None, (33, [5, 8]), &out, &Silent).unwrap();
    assert_eq!(table.shape[..2], [9, 5]);
    let bytes = std::fs::read(&out).unwrap();
    assert_eq!(&bytes[..12], b"tensor_file\0");
    // The last field ends the file.
    let count: usize = 4 * table.shape.iter().product::<usize>();
    let spectra: Vec<f32> =
        bytes[bytes.len() - count..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let settings = Settings { coherence_um: table.coherence_um, ..settings };
    let prepared = Prepared::new(&field, &quality, &settings, 1000, &Silent).unwrap();
    // Incidence at 20° along x (entry 1 of 5, azimuth 4 of 8), half vector at u = 8/32, azimuth 0 (16 of 32).
    let light = Direction::new(20_f64.to_radians(), 0.0);
    let half = Direction::new(0.25 * 0.25 * FRAC_PI_2, 0.0);
    let view = mirrored(light, half);
    let [_, theta, count, size, _] = table.shape[..] else { unreachable!() };
    for w in 0..count {
        let nm = 380.0 + 400.0 * w as f64 / (count - 1) as f64;
        let truth = prepared.at(light, view, 1e3 / nm, &mut Memory::default()) * view.z;
        let found = f64::from(spectra[(((4 * theta + 1) * count + w) * size + 16) * size + 8]);
        // Single precision, of densities too.
        assert!((found - truth).abs() < 1e-5 * (1.0 + truth), "{nm}: {found} for {truth}");
    }
}

#[test]
fn finer_tables_are_closer() {
    let place = tempfile::tempdir().unwrap();
    let (field, quality) = grating();
    let error = |size: usize, angles: [usize; 2]| {
        let out = place.path().join(format!("{size}.bsdf"));
        measured(&field, &quality, &Settings::default(), Some(4.0), (size, angles), &out, &Silent).unwrap().error
    };
    let [coarse, fine] = [error(16, [4, 8]), error(48, [12, 24])];
    // Linear interpolation on three times as many entries has a ninth of the error, once lobes are resolved.
    assert!(fine < 0.5 * coarse && fine < 0.15, "{coarse} and {fine}");
}

#[test]
fn half_vectors_suffice_for_shallow_surfaces_only() {
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("lut.exr");
    let error = |depth_um: f64| {
        let shape = Shape::Grating(Profile::Sinusoid);
        let field =
            Synthetic { shape, pixels: 80, pixel_um: 0.05, period_um: 2.0, depth_um, angle: 0.0 }.field().unwrap();
        let quality = Quality::of(&field, 8.0);
        half_vector(&field, &quality, &Settings::default(), None, 128, &out, &Silent).unwrap().error
    };
    let [shallow, deep] = [error(0.02), error(0.4)];
    // The phase of 0.4 µm turns by more than a period between w = 0 and 2.
    assert!(shallow < 0.1 && deep > 0.3, "{shallow} and {deep}");
}

#[test]
fn a_grating_is_no_isotropic_material() {
    let place = tempfile::tempdir().unwrap();
    let (field, quality) = grating();
    let out = place.path().join("grating.binary");
    let error = merl(&field, &quality, &Settings::default(), None, &out, &Silent).err().unwrap().to_string();
    assert!(error.contains("not isotropic") && error.contains("mitsuba"), "{error}");
    assert!(!out.exists());
}

/// Random waves with directions all around.
fn bumps() -> (HeightField, Quality) {
    let mut stream = Stream::of(5);
    let waves: Vec<[f64; 3]> = (0..200)
        .map(|_| {
            // Whole periods in the patch of 10.24 µm, so that it repeats.
            let (f, phi) = (4.0 + 8.0 * stream.next(), TAU * stream.next());
            [(f * phi.cos()).round(), (f * phi.sin()).round(), TAU * stream.next()]
        })
        .collect();
    let height = |k: usize| {
        let (x, y) = ((k % 128) as f64 / 128.0, (k / 128) as f64 / 128.0);
        waves.iter().map(|[fx, fy, phase]| (TAU * (fx * x + fy * y) + phase).cos()).sum::<f64>() * 0.005
    };
    let um = (0..128 * 128).map(height).collect();
    let field =
        HeightField { name: "bumps".into(), width: 128, height: 128, pixel_um: 0.08, um, step_um: None, notes: vec![] };
    let quality = Quality::of(&field, 8.0);
    (field, quality)
}

#[test]
fn an_isotropic_table_is_the_mean_over_azimuths() {
    let place = tempfile::tempdir().unwrap();
    let (field, quality) = bumps();
    let out = place.path().join("bumps.binary");
    let settings = Settings { illuminant: "D65".into(), ..Settings::default() };
    let table = merl(&field, &quality, &settings, None, &out, &Silent).unwrap();
    let bytes = std::fs::read(&out).unwrap();
    assert_eq!(bytes.len(), 12 + 3 * 8 * 90 * 90 * 180);
    let settings = Settings { coherence_um: table.coherence_um, ..settings };
    let prepared = Prepared::new(&field, &quality, &settings, 1000, &Silent).unwrap();
    let samples = prepared.samples().unwrap();
    for (h, d, p) in [(0, 10, 20), (30, 20, 90), (45, 5, 40), (40, 40, 130)] {
        let pair = merl::pair_of(h, d, p).unwrap();
        let mut sum = [0.0; 3];
        for k in 0..180 {
            let turned = pair.map(|d| merl::turned(d, TAU * f64::from(k) / 180.0));
            let value = prepared.xyz(turned, &samples, &mut Memory::default());
            sum.iter_mut().zip(value).for_each(|(s, v)| *s += v / 180.0);
        }
        let number = |c: usize| {
            let at = 12 + 8 * (((c * 90 + h) * 90 + d) * 180 + p);
            f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) * merl::UNITS[c]
        };
        let found = nacre_optics::color::xyz_of_linear_srgb([0, 1, 2].map(|c| number(c) as f32))[1];
        // Interpolation between rings, half a lobe's width apart.
        assert!((f64::from(found) / sum[1] - 1.0).abs() < 0.03, "{h}, {d}, {p}: {found} for {}", sum[1]);
    }
    // Entries below the surface.
    assert!(merl::pair_of(89, 80, 0).is_none());
}
