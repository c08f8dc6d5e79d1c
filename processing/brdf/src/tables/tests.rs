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
